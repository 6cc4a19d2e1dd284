"""Bodies pressed on surface meshes, beside the obstacles whose shape the meshes approach."""

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID
from skfem import ElementHex1, ElementQuad1, MeshQuad
from surfaces import ball, brick, ring

from contact import (
    ClosestPoint,
    ContactProblem,
    ContactResult,
    ContactWarning,
    CutBody,
    Cylinder,
    ElasticBody,
    LayeredBlock,
    LoadStepper,
    Pair,
    Plane,
    Rigid,
    Sphere,
    SurfaceMesh,
)
from skfem_adini import ElementQuadAdini


def cube(make, element, cells=None, unit=1.0, E=1.0, push=0.02, drag=0.01):
    """The unit square or cube in another unit, pushed down and dragged along x."""
    dim = 3 if element in SOLID else 2
    ticks = unit * np.linspace(0, 1, (cells or (4 if dim == 3 else 8)) + 1)
    body = ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=E, nu=0.3)
    body.fix("top", "x", drag * unit).fix("top", dim - 1, -push * unit)
    return body.fix("top", "y") if dim == 3 else body


def floor(dim, unit=1.0, slope=0.0):
    """A box whose top is turned about its middle, and the plane of that top."""
    low, high = np.full(dim, -3.0), np.full(dim, 4.0)
    high[-1] = 0.0
    points, facets = brick(low, high)
    middle = np.zeros(dim)
    middle[:-1] = 0.5
    turn = np.eye(dim)
    c, s = np.cos(slope), np.sin(slope)
    turn[np.ix_([0, -1], [0, -1])] = [[c, -s], [s, c]]
    points = unit * (turn @ (points - middle[:, None]) + middle[:, None])
    return SurfaceMesh(points, facets), Plane(unit * middle, turn[:, -1])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3])
@pytest.mark.parametrize("element", [*PLANE_AND_BFS, *SOLID], ids=lambda e: e.__name__)
def test_a_box_presses_as_its_plane(make, element, unit):
    """Every family, along the body's normal and to the closest point, with friction."""
    body = cube(make, element, 3, unit, E=2e5 / unit**2)
    box, plane = floor(body.dim, unit, slope=0.01)
    for how in (lambda o: o, ClosestPoint):
        ours, theirs = (ContactProblem(body, "bottom", how(o), 0.3).solve() for o in (box, plane))
        top = theirs.pressure.max()
        assert top > 0
        # Rounding of the gap times the condition of the body.
        np.testing.assert_allclose(ours.pressure, theirs.pressure, rtol=0, atol=1e-9 * top)
        np.testing.assert_allclose(ours.shear, theirs.shear, rtol=0, atol=1e-9 * top)
        assert max(ours.kkt.values()) <= 1e-10


def test_a_stamp_under_a_force_turns(make):
    """An edged stamp, held by force and moment, as the plane of its face; and it is kept."""
    ticks = np.linspace(0, 1, 9)
    body = ElasticBody.from_mesh(
        make.box(ElementQuadAdini, ticks, ticks), ElementQuadAdini(), E=1.0, nu=0.3
    )
    body.fix("bottom", "xy")
    results = []
    for face in (SurfaceMesh(*brick((-1.0, 1.0), (2.0, 3.0))), Plane((0.0, 1.0), (0.0, -1.0))):
        stamp = Rigid(face, force=(None, -0.02), moment=0.0, centre=(0.4, 1.0))
        results.append(ContactProblem(body, "top", stamp, friction=0.3).solve())
    ours, theirs = results
    assert ours.resultant[1] == pytest.approx(-0.02, rel=1e-9)
    np.testing.assert_allclose(ours.motion, theirs.motion, rtol=0, atol=1e-10)
    np.testing.assert_allclose(ours.pressure, theirs.pressure, rtol=0, atol=1e-10)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_roller_drawn_along(make, dim, tmp_path):
    """Translated from step to step; friction sees it move as it sees the round one."""
    element = ElementQuad1 if dim == 2 else ElementHex1
    body = cube(make, element, push=0.0, drag=0.0)
    centre = np.full(dim, 0.5)
    centre[-1] = -1.0
    solid = (Sphere if dim == 3 else Cylinder)(centre, 1.0)
    made = ring(512, 1.0, centre) if dim == 2 else ball(5, 1.0, centre)
    rough = SurfaceMesh(*made)

    def way(t):
        step = np.zeros(dim)
        step[0], step[-1] = 0.05 * max(t - 1.0, 0.0), 0.02 * min(t, 1.0)
        return step

    histories = []
    for start, there in (
        (rough, lambda t: rough.translated(way(t))),
        (solid, lambda t: type(solid)(centre + way(t), 1.0)),
    ):
        stepper = LoadStepper(ContactProblem(body, "bottom", start, 0.3)).obstacle(there)
        histories.append(stepper.run([0.5, 1.0, 1.5, 2.0]))
    scale = np.abs(histories[1][-1].resultant).max()
    for ours, theirs in zip(*histories, strict=True):
        assert max(ours.kkt.values()) <= 1e-10
        # Facets of 1/80 and of 1/20 of the radius; the roller sinks in by 1/50 of it.
        near = 5e-3 if dim == 2 else 5e-2
        np.testing.assert_allclose(ours.resultant, theirs.resultant, atol=near * scale)
    last = histories[0][-1]
    again = ContactResult.load(last.save(tmp_path / "rolled.npz"))
    np.testing.assert_array_equal(again.pressure, last.pressure)
    assert again.kkt == last.kkt


def test_a_bore_and_its_cavity(make):
    """An eighth of turn into a hole given by a polygon, beside the round one."""
    angles = np.linspace(0, np.pi / 2, 17)
    flat = make.box(ElementQuad1, np.linspace(1.0, 2.0, 9), angles)
    r, angle = flat.p
    mesh = make.remesh(flat, np.array([r * np.sin(angle), -r * np.cos(angle)]))
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3)
    body.fix("bottom", "x").fix("top", "y")
    exact = ContactProblem(body, "right", Cylinder((0.0, 0.0), 1.95, hollow=True), 0.2).solve()
    hole = SurfaceMesh(*ring(2000, 1.95), hollow=True)
    result = ContactProblem(body, "right", hole, 0.2).solve()
    # The sagitta over the interference: (2 pi / 2000)^2 * 1.95 / 8 / .05.
    np.testing.assert_allclose(result.pressure, exact.pressure, rtol=1e-3)
    with pytest.warns(ContactWarning, match=r"SurfaceMesh\(\.\.\., hollow=True\)"):
        ContactProblem(body, "right", SurfaceMesh(*ring(200, 2.05)), 0.2).condense()


def test_layers_cut_bodies_and_pairs(make):
    """Bodies that are discretised otherwise, and one pair among others."""
    outline = SurfaceMesh(*brick((-3.0, -4.0), (3.0, -1.0)))
    plane = Plane((0.0, -1.0), (0.0, 1.0))
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 13), np.linspace(-1.1, 0.0, 7))
    mesh = mesh.with_boundaries({"flat": lambda x: np.abs(x[1]) < 1e-9})
    disk = CutBody(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 1, 1.0, 0.3)
    disk.fix("flat", "x").fix("flat", "y", -0.05)
    low = disk.arc(where=lambda x: np.hypot(x[0], x[1] + 1) < 0.6)
    layers = LayeredBlock(1.0, [(0.5, 4, 1.0, 0.3)], columns=8).fix("top", "x", 0.01)
    layers.fix("top", "y", lambda x: -1.02 - 0.01 * x[0])
    upper = make.block(4).named("upper")
    lower_mesh = make.box(ElementQuad1, np.linspace(0, 1, 4), np.linspace(-1, 0, 4))
    lower = ElasticBody.from_mesh(lower_mesh, ElementQuad1(), E=1.0, nu=0.3).named("lower")
    lower.fix("left", "x")

    def solved(case, floor):
        if case == "cut":
            return ContactProblem(disk, low, ClosestPoint(floor), 0.2).solve()
        if case == "layers":
            return ContactProblem(layers, "bottom", floor, 0.2).solve()
        pairs = [
            Pair(upper, "bottom", lower, "top", 0.2),
            Pair(lower, "bottom", floor, friction=0.2),
        ]
        return ContactProblem([upper, lower], pairs).solve()

    for case in ("cut", "layers", "pairs"):
        ours, theirs = solved(case, outline), solved(case, plane)
        top = theirs.pressure.max()
        assert top > 0
        np.testing.assert_allclose(ours.pressure, theirs.pressure, rtol=0, atol=1e-9 * top)
