"""Contact of periodic layers beside the sparse path, and Westergaard's closed form."""

import numpy as np
import pytest

from contact import ContactProblem, Cylinder, Infeasible, InputError, Sphere, Status
from contact.obstacles.rigid import Rigid
from contact.spectral.grid_contact import GridContact
from contact.spectral.periodic_layers import PeriodicLayers
from skfem_adini import ElementHexAdini, ElementQuadAdini

COATED = [(0.1, 2, 3.0, 0.2), (0.4, 4, 1.0, 0.3)]


def plane(n=16):
    block = PeriodicLayers(1.0, COATED, n, motion=(0.01, -0.04))
    return block, Cylinder((0.5, -0.3), 0.3)


def space(n=10):
    block = PeriodicLayers((1.0, 1.25), COATED, (n, n + 2), motion=(0.01, 0.005, -0.08))
    return block, Sphere((0.5, 0.625, -0.5), 0.5)


def rollers(n=16):
    block = PeriodicLayers(1.0, COATED, n, motion=(0.0, -0.04), sides="x")
    return block, Cylinder((0.1, -0.3), 0.3)


def held(n=16):
    layers = [(0.1, 2, 3.0, 0.2), (0.4, 4, 1.0, 0.3)]
    block = PeriodicLayers(1.0, layers, n, sides="y", top="xy", motion=(0.01, 0.0))
    return block, Rigid(Cylinder((0.45, -0.3), 0.3), displacement=(0.0, 0.04))


def mixed(n=8):
    block = PeriodicLayers((1.0, 1.25), COATED, (n, n + 1), motion=(0.01, 0.0, -0.08),
                           sides=("periodic", "y"))  # fmt: skip
    return block, Sphere((0.5, 0.1, -0.5), 0.5)


def box(n=8):
    block = PeriodicLayers((1.0, 1.25), COATED, (n, n + 1), motion=(0.0, 0.0, -0.08),
                           sides=("x", "y"))  # fmt: skip
    return block, Sphere((0.1, 1.0, -0.5), 0.5)


def adini_on_rollers(n=16):
    block = PeriodicLayers(1.0, COATED, n, motion=(0.0, -0.04), sides="x",
                           element=ElementQuadAdini())  # fmt: skip
    return block, Rigid(Cylinder((0.9, -0.3), 0.3), displacement=(0.02, 0.0))


def adini_in_space(n=8):
    block = PeriodicLayers((1.0, 1.25), COATED, (n, n + 1), motion=(0.01, 0.005, -0.08),
                           element=ElementHexAdini())  # fmt: skip
    return block, Sphere((0.5, 0.625, -0.5), 0.5)


def adini_in_a_box(n=6):
    block = PeriodicLayers((1.0, 1.25), COATED, (n, n + 1), motion=(0.0, 0.0, -0.08),
                           sides=("x", "y"), element=ElementHexAdini())  # fmt: skip
    return block, Sphere((0.1, 1.0, -0.5), 0.5)


def adini(n=16):
    return PeriodicLayers(
        1.0, COATED, n, motion=(0.01, -0.04), element=ElementQuadAdini()
    ), Cylinder((0.5, -0.3), 0.3)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("friction", [0.0, 0.3, 0.9])
@pytest.mark.parametrize(
    "make",
    [
        *(plane, space, rollers, held, mixed, box),
        *(adini, adini_on_rollers, adini_in_space, adini_in_a_box),
    ],
)
def test_pressure_and_shear_are_those_of_the_sparse_path(make, friction):
    block, obstacle = make()
    grid = GridContact(block, obstacle, friction=friction).solve()
    body, dim = block.elastic(), block.dim
    functional = "nodal" if make.__name__.startswith("adini") else None
    problem = ContactProblem(body, "bottom", obstacle, friction=friction, functional=functional)
    sparse = problem.solve()
    places = sparse.x_nominal[: dim - 1]
    at = tuple(np.rint(x / h).astype(int) for x, h in zip(places, block.spacing, strict=True))
    inside = np.all([k < n for k, n in zip(at, block.shape, strict=True)], axis=0)
    at = tuple(k[inside] for k in at)
    touching = sparse.pressure > 0
    assert 3 <= touching.sum() < touching.size / 2
    assert not np.any(touching & ~inside)
    size = sparse.pressure.max()
    assert np.abs(grid.pressure[at] - sparse.pressure[inside]).max() < 1e-10 * size
    assert np.array_equal(grid.status[at] == 0, sparse.status[inside] == 0)
    assert np.abs(grid.resultant - sparse.resultant).max() < 1e-10 * np.abs(sparse.resultant).max()
    nodes = body.basis.nodal_dofs[:, body.mesh.p[-1] < 1e-9]
    low = body.mesh.p[:, body.mesh.p[-1] < 1e-9]
    here = tuple(
        np.rint(low[a] / block.spacing[a]).astype(int) % block.shape[a] for a in range(dim - 1)
    )
    for c in range(dim):
        assert np.abs(grid.u[c][here] - sparse.u[nodes[c]]).max() < 1e-9 * np.abs(sparse.u).max()


def test_a_wavy_ground_on_layers_of_a_half_space_by_westergaard():
    """Westergaard 1939: sin^2(pi a) = p / (pi E* h) with the half width a of the contact."""
    errors = []
    for n in (64, 128, 256):
        x, h, p = np.arange(n) / n, 1e-3, 1e-3
        block = PeriodicLayers(1.0, [(0.25, n // 4, 1.0, 0.3)], n, base=(1.0, 0.3))
        ground = Rigid(h * (1 - np.cos(2 * np.pi * x)), force=(0.0, p))
        result = GridContact(block, ground).solve()
        s = p * 0.91 / (np.pi * h)
        inside = np.sin(np.pi * np.minimum(x, 1 - x)) ** 2
        exact = 2 * p * np.cos(np.pi * x) / s * np.sqrt(np.maximum(s - inside, 0.0))
        errors.append(np.sqrt(np.mean((result.pressure - np.abs(exact)) ** 2)) / exact.max())
    assert errors[-1] < 5e-3
    assert errors[-1] < 0.6 * errors[0]


def test_a_box_on_rollers_is_a_quarter_of_the_mirrored_periodic_body():
    """Pressure, area and perimeter count cells on the sides as halves."""
    heights = 0.02 * np.random.default_rng(2).uniform(0, 1, (9, 7))
    twice = np.concatenate((heights, heights[-2:0:-1]))
    twice = np.concatenate((twice, twice[:, -2:0:-1]), axis=1)
    ground = {"displacement": (0.0, 0.0, 0.012)}
    quarter = PeriodicLayers((1.0, 0.75), COATED, (8, 6), sides=("x", "y"))
    whole = PeriodicLayers((2.0, 1.5), COATED, (16, 12))
    ours = GridContact(quarter, Rigid(heights, **ground), 0.3).solve()
    full = GridContact(whole, Rigid(twice, **ground), 0.3).solve()
    assert 0.1 < ours.area / 0.75 < 0.9
    assert np.abs(ours.pressure - full.pressure[:9, :7]).max() < 1e-9 * ours.pressure.max()
    assert np.abs(ours.shear - full.shear[:, :9, :7]).max() < 1e-9 * ours.pressure.max()
    assert ours.area == pytest.approx(full.area / 4)
    assert ours.perimeter == pytest.approx(full.perimeter / 4)
    assert ours.corrected_area == pytest.approx(full.corrected_area / 4)
    assert ours.resultant[2] == pytest.approx(full.resultant[2] / 4)
    with pytest.raises(InputError, match="spectrum: the surface is not periodic"):
        ours.spectrum()


def test_tresca_by_areas_that_are_halves_on_the_sides():
    block = PeriodicLayers(1.0, COATED, 8, motion=(0.0, -0.01), sides="x")
    bound = 1e-3
    result = GridContact(
        block, Rigid(np.zeros(9), displacement=(0.1, 0.0)), bound, "tresca"
    ).solve()
    assert np.abs(result.shear[0] - bound).max() < 1e-9 * bound


def test_an_obstacle_that_enters_a_held_side_is_named():
    block = PeriodicLayers(1.0, COATED, 8, sides="y")
    with pytest.raises(Infeasible, match=r"enters grid point \(0,\) by 0.01, where a side holds"):
        GridContact(block, Rigid(np.zeros(9), displacement=(0.0, 0.01))).solve()


@pytest.mark.parametrize("motion", [1e-5, 1e-3])
@pytest.mark.parametrize("friction", [0.05, 0.3, 3.0])
def test_an_obstacle_moved_along_points_that_rollers_hold(motion, friction):
    """They slip, however little it moves; elsewhere forces are those of the sparse path."""
    block = PeriodicLayers(1.0, COATED, 8, sides="x")
    moved = (motion, 0.01)
    heights = 0.02 * (np.arange(9) / 8 - 0.3) ** 2
    grid = GridContact(block, Rigid(heights, displacement=moved), friction).solve()
    assert grid.pressure[0] > 0
    assert grid.status[0] == Status.SLIP
    assert grid.shear[0, 0] == pytest.approx(friction * grid.pressure[0])
    bowl = Rigid(lambda x: 0.02 * (x[0] - 0.3) ** 2, displacement=moved)
    sparse = ContactProblem(block.elastic(), "bottom", bowl, friction).solve()
    order = np.argsort(sparse.x_nominal[0])
    size = sparse.mu.max()
    assert np.abs(grid.forces[0] - sparse.mu[order]).max() < 1e-11 * size
    along = np.abs(grid.shear[0] * block.weights / 8)[1:-1]
    assert np.abs(along - np.abs(sparse.t.ravel()[order][1:-1])).max() < 1e-11 * size


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("dim", [2, 3])
def test_an_obstacle_driven_by_a_force_along_sides_that_hold_it(dim, law):
    """Points on the sides stick and take what the others do not, so that it does not move."""
    sides, cells = (("x",), (6,)) if dim == 2 else (("x", "y"), (6, 5))
    block = PeriodicLayers((1.0,) * (dim - 1), COATED, cells, sides=sides)
    heights = 0.01 * np.random.default_rng(2).uniform(0, 1, block.shape)
    heights[(0,) * (dim - 1)] = 0.0
    drag = (0.002,) * (dim - 1)
    friction = 0.5 if law == "coulomb" else 0.02
    result = GridContact(block, Rigid(heights, force=(*drag, 0.02)), friction, law).solve()
    assert result.resultant == pytest.approx((*drag, 0.02))
    assert np.abs(result.motion[:-1]).max() < 1e-12
    assert max(result.kkt.values()) < 1e-10
    assert result.status[(0,) * (dim - 1)] == Status.STICK


def test_given_friction_cycles_within_coulomb_friction():
    """A bending plate between held sides: Newton's method cycles with given friction, too."""
    layers = [(0.4, 4, 1700.0, -0.3), (6e-4, 3, 2.4, 0.49), (0.37, 4, 2.4, 0.499)]
    block = PeriodicLayers(0.9, layers, 16, sides="y", top="x", plane="stress")
    gaps = 1e-5 * np.random.default_rng(0).integers(3, 34, 17)
    gaps[[0, -1]] = 1.0
    ground = Rigid(gaps, displacement=(-4.4e-5, 3.4e-4))
    result = GridContact(block, ground, 0.3).solve()
    assert max(result.kkt.values()) < 1e-10


def test_sides_that_hold_all_points_are_named():
    block = PeriodicLayers((1.0, 1.0), COATED, (1, 3), sides=("yz", "periodic"))
    with pytest.raises(InputError, match="compliance: its sides fix the normal displacement"):
        GridContact(block, Rigid(0.0, displacement=(0.0, 0.0, 0.1)))


def test_given_friction_holds_a_drag_without_contact():
    """Tresca's bound acts on open points, too: they stick and share the force, in pascals."""
    layers = [(height, cells, 1e11 * E, nu) for height, cells, E, nu in COATED]
    block = PeriodicLayers(1.0, layers, 6, top="y")
    ground = Rigid(0.02, displacement=(None, 0.01), force=(3e8, None))
    result = GridContact(block, ground, 1e9, "tresca").solve()
    assert not result.pressure.any()
    assert result.shear[0] == pytest.approx(np.full(6, 3e8))
