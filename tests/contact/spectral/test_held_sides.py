"""Friction on layers, also with sides that hold points: the grid beside the mesh, to 1e-10."""

import numpy as np
import pytest

from contact import ContactProblem, LoadStepper, Plane, Rigid, Sphere, Status
from contact.spectral.grid_contact import GridContact
from contact.spectral.periodic_layers import PeriodicLayers

LAYERS = [(0.2, 2, 3.0, 0.2), (0.4, 3, 1.0, 0.3)]
F = 0.3


def flat(dim, *motion):
    normal = np.zeros(dim)
    normal[-1] = 1.0
    return Rigid(Plane(np.zeros(dim), normal), displacement=motion)


CASES = {
    # In the plane the sides hold the normal direction of the surface or that along it.
    "rollers in the plane": (1.0, 8, {"sides": "x"}, (0.02, 0.03)),
    "the same, to the left": (1.0, 8, {"sides": "x"}, (-0.02, 0.03)),
    "at rest": (1.0, 8, {"sides": "x"}, (0.0, 0.03)),
    "a box on rollers": ((1.0, 0.75), (6, 5), {"sides": ("x", "y")}, (0.02, -0.01, 0.03)),
    "across one roller": ((1.0, 0.75), (6, 7), {"sides": ("x", "periodic")}, (0.02, 0.0, 0.1)),
    "along one roller": ((1.0, 0.75), (6, 7), {"sides": ("x", "periodic")}, (0.0, 0.01, 0.1)),
    "sticks and slips": (1.0, 12, {"sides": "x"}, (0.004, 0.03)),
    "a box that sticks": (
        (1.0, 0.75),
        (6, 5),
        {"sides": ("x", "y")},
        (3e-3, -2e-3, 0.03),
    ),
    "endless": (1.0, 12, {}, (0.002, 0.03)),
    "endless in space": ((1.0, 0.75), (6, 7), {}, (0.001, 0.002, 0.1)),
    "askew": ((1.0, 0.75), (6, 7), {"sides": ("x", "periodic")}, (0.001, 0.002, 0.1)),
}


def obstacle_of(case, dim, motion):
    """Flat; where the mesh ties the ends of the surface to each other, it touches between."""
    if "endless" in case and dim == 2:
        return Rigid(lambda x: 0.1 * (x[0] - 0.45) ** 2, displacement=motion)
    if dim == 2 or "box" in case:
        return flat(dim, *motion)
    centre = (0.45 if "endless" in case else 0.05, 0.375, -0.65)
    return Rigid(Sphere(centre, 0.6), displacement=motion)


def on_the_mesh(block, problem_of, obstacle, law, friction):
    result = problem_of(obstacle, law, friction)
    dim = block.dim
    at = [
        np.rint(x / h).astype(int)
        for x, h in zip(result.x_nominal[: dim - 1], block.spacing, strict=True)
    ]
    inside = np.all([k < n for k, n in zip(at, block.shape, strict=True)], axis=0)
    return result, tuple(k[inside] for k in at), inside


def compared(grid, mesh, at, inside):
    """Pressures, shear vectors, sums and states."""
    size = mesh.pressure.max()
    assert size > 0
    assert np.abs(grid.pressure[at] - mesh.pressure[inside]).max() < 1e-10 * size
    shear = np.einsum("djm,mj->dm", mesh.system.rows.tangents, mesh.shear)
    for c, own in enumerate(grid.shear):
        assert np.abs(own[at] - shear[c, inside]).max() < 1e-10 * size
    assert np.abs(grid.resultant - mesh.resultant).max() < 1e-10 * np.abs(mesh.resultant).max()
    assert np.array_equal(grid.status[at], mesh.status[inside])


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("case", CASES)
def test_the_grid_and_the_mesh_agree(case, law) -> None:
    lengths, cells, given, motion = CASES[case]
    if law == "tresca" and "periodic" in given.get("sides", "periodic"):
        pytest.skip("given friction acts where the mesh ties its ends, too: not determined there")
    block = PeriodicLayers(lengths, LAYERS, cells, **given)
    obstacle = obstacle_of(case, block.dim, motion)
    friction = F if law == "coulomb" else (0.03 if "sticks" in case else 0.01)
    grid = GridContact(block, obstacle, friction=friction, law=law).solve()
    problem = ContactProblem(block.elastic(), "bottom", obstacle, friction=friction, law=law)
    mesh, at, inside = on_the_mesh(block, lambda *_: problem.solve(), obstacle, law, friction)
    compared(grid, mesh, at, inside)
    if "plane" in case or "left" in case:
        assert np.all(grid.status == Status.SLIP)
        bound = F * grid.resultant[1] if law == "coulomb" else 0.01
        assert abs(grid.resultant[0]) == pytest.approx(bound, rel=1e-10)
    if "rest" in case:
        assert np.all(grid.status[[0, -1]] == Status.UNDETERMINED)
        assert not np.any(grid.shear[0][[0, -1]])


@pytest.mark.parametrize("case", ["rollers in the plane", "a box on rollers"])
@pytest.mark.filterwarnings("ignore")  # a motion far beyond a facet, of a plane along itself
@pytest.mark.parametrize("far", [1.0, 1e4])
def test_histories_agree(case, far) -> None:
    lengths, cells, given, _ = CASES[case]
    block = PeriodicLayers(lengths, LAYERS, cells, **given)
    dim = block.dim
    path = np.array([0.0, 0.01, 0.02, 0.012, 0.012, 0.0]) * far
    ways = [(*tuple([x] * (dim - 1)), 0.03) for x in path[1:]]
    grids = GridContact(block, flat(dim, *ways[0]), F).history([flat(dim, *way) for way in ways])
    problem = ContactProblem(block.elastic(), "bottom", flat(dim, *ways[0]), F)
    stepper = LoadStepper(problem)
    stepper.obstacle(lambda t: flat(dim, *ways[round(t) - 1]))
    history = stepper.run(np.arange(1.0, len(path)))
    for grid, mesh in zip(grids, history, strict=True):
        _, at, inside = on_the_mesh(block, lambda *_, mesh=mesh: mesh, None, None, None)
        compared(grid, mesh, at, inside)
