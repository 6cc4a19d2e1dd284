"""Lines of a contact boundary: arcs in units of length, run by run, and what VTK joins."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from skfem import (
    ElementQuad1,
    ElementQuad2,
    ElementTriP1,
    ElementTriP2,
    MeshQuad,
    MeshTri,
    MeshTri2,
)

from contact import ContactProblem, ContactResult, CutBody, Cylinder, ElasticBody, LayeredBlock
from contact.output.contact_runs import arc_length
from skfem_adini import ElementQuadAdini, LevelSet
from tests.contact.rows.cases import whole_ring

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")
RADII = [0.5, 0.75, 1.0]
CASES = [
    *((ElementQuadAdini, functional) for functional in (None, "gauss", "centroid")),
    *((ElementTriP1, None), (ElementTriP2, None), (ElementTriP2, "gauss")),
    *((ElementQuad1, None), (ElementQuad2, None), (ElementQuad2, "gauss")),
]


@pytest.fixture(autouse=True)
def closed():
    """Close the figures of each test."""
    yield
    plt.close("all")


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "functional"), CASES)
def test_runs_follow_one_another(element, functional, make):
    """Two boundaries, and one boundary of two sides: each begins where the last one ended."""
    ticks = make.graded
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks), element(), E=1.0, nu=0.3)
    body.fix("top", "y")
    for place, obstacle in ((["left", "right"], -0.01), (["bottom", "right"], [-0.01, -0.01])):
        if isinstance(obstacle, list):
            body.fix("left", "x")
        result = ContactProblem(body, place, obstacle, functional=functional).solve()
        s, run = arc_length(result)
        along = [result.x[0], result.x[1]] if isinstance(obstacle, list) else [result.x[1]] * 2
        for k in (0, 1):
            at = along[k][run == k]
            same = np.abs(s[run == k] - k - at).max() < 1e-12
            assert same or np.abs(s[run == k] - k - (1 - at)).max() < 1e-12
        assert len([line for line in result.plot().lines if line.get_color() == "0.25"]) == 2
    # As one boundary bottom and right are one run of length two.
    result = ContactProblem(body, ["bottom", "right"], -0.01, functional=functional).solve()
    s, run = arc_length(result)
    assert not run.any()
    low = result.x_nominal[1] < 1e-9
    side = ~low & (result.x_nominal[0] > 1 - 1e-9)
    low &= result.x_nominal[0] < 1 - 1e-9
    np.testing.assert_allclose(s[low], result.x[0, low], atol=1e-12)
    np.testing.assert_allclose(s[side], 1 + result.x[1, side], atol=1e-12)


@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("element", [ElementTriP1, ElementTriP2])
def test_closed_loop(element, curved):
    """A whole circle: places differ by the angles, from the facet of the first point on."""
    mesh = (MeshTri2 if curved else MeshTri).init_circle(3)
    rim = mesh.boundary_facets()
    body = ElasticBody.from_mesh(mesh.with_boundaries({"rim": rim}), element(), E=1.0, nu=0.3)
    result = ContactProblem(body, "rim", Cylinder((0, 0), 0.95, hollow=True), 0.2).solve()
    s, run = arc_length(result)
    assert not run.any()
    assert np.all(np.diff(s) > 0)
    angle = np.unwrap(np.arctan2(*result.x_nominal[::-1]))
    facets = mesh.boundary_facets().size
    assert s[0] < 2 * np.pi / facets
    # Facets are chords of the circle, or parabolas.
    np.testing.assert_allclose(s - s[0], np.abs(angle - angle[0]), atol=0.02)
    assert s[-1] < 2 * np.pi


def unsolved(body, place, obstacle, functional=None):
    """A result of zeros: the contact points are there all the same."""
    system = ContactProblem(body, place, obstacle, functional=functional).system_of(body)
    rows = system.rows
    zero = np.zeros(rows.G.shape[1]), np.zeros(rows.gap.size), np.zeros((rows.gap.size, 1))
    return ContactResult(system, *zero, "newton", ())


def lines(result):
    """Numbers of the points of each line."""
    cloud, found = result.boundary_to_pyvista(), []
    if not cloud.n_lines:
        return []
    cells = np.asarray(cloud.lines)
    while cells.size:
        found.append(cells[1 : 1 + cells[0]])
        cells = cells[1 + cells[0] :]
    return found


@pytest.mark.sampled(3)
@pytest.mark.parametrize("unit", [1.0, 1e-6])
@pytest.mark.parametrize(("element", "functional"), [*CASES, ("layers", None)])
def test_a_straight_side_is_its_coordinate(element, functional, unit, make):
    """Not from the first contact point, which lies inside where points of Gauss are taken."""
    if element == "layers":
        body = LayeredBlock(unit, [(unit, 6, 1.0, 0.3)], top="xy")
    else:
        ticks = unit * make.graded
        body = ElasticBody.from_mesh(make.box(element, ticks, ticks), element(), E=1.0, nu=0.3)
        body.fix("top", "xy")
    result = ContactProblem(body, "bottom", -0.01 * unit, 0.3, functional=functional).solve()
    s, run = arc_length(result)
    np.testing.assert_allclose(s, result.x[0], atol=1e-12 * unit)
    assert not run.any()
    np.testing.assert_array_equal(result.plot().lines[0].get_xdata(), s)
    (line,) = lines(result)
    np.testing.assert_array_equal(line, np.arange(result.mu.size))


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize(("element", "functional"), CASES)
def test_sides_of_a_slender_column(element, functional, several, make):
    """Nearer to each other than the points of one side are."""
    mesh = make.box(element, np.array([0.0, 0.02]), np.linspace(0, 1, 5))
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    result = unsolved(body, ["left", "right"], [0.0, 0.0] if several else 0.0, functional)
    assert len(lines(result)) == 2
    for line in lines(result):
        assert np.ptp(result.x[0, line]) < 1e-12
        assert np.ptp(result.x[1, line]) > 0.6
    assert sum(line.size for line in lines(result)) == result.mu.size


@pytest.mark.parametrize("ratio", [3.0, 1e3])
@pytest.mark.parametrize(("element", "functional"), CASES)
def test_neighbours_of_very_different_length(element, functional, ratio, make):
    size = np.where(np.arange(8) % 3, 1.0, ratio)
    ticks = np.r_[0.0, np.cumsum(size)] / size.sum()
    mesh = make.box(element, ticks, np.linspace(0, 1, 5))
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    result = unsolved(body, "bottom", 0.0, functional)
    (line,) = lines(result)
    np.testing.assert_array_equal(line, np.arange(result.mu.size))
    assert np.all(np.diff(result.x_nominal[0, line]) > 0)
    assert not arc_length(result)[1].any()


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize(("element", "functional"), CASES)
def test_lines_around_a_ring_close(element, functional, together):
    """Each ends where it began, and turns once around."""
    obstacle = -0.01 if together else [-0.01, -0.01]
    result = unsolved(whole_ring(element, 12, RADII, 0.0), ["bore", "rim"], obstacle, functional)
    assert len(lines(result)) == 2
    for line in lines(result):
        assert line[0] == line[-1]
        assert np.unique(line).size == line.size - 1
        turn = np.angle(np.exp(1j * np.diff(np.arctan2(*result.x[::-1, line]))))
        assert abs(abs(turn.sum()) - 2 * np.pi) < 1e-9
        assert np.abs(turn).max() < 2 * np.pi / 10
    assert sum(line.size - 1 for line in lines(result)) == result.mu.size


def test_open_runs(make):
    """An arc of a ring; and a strip of one cell, whose short sides join points but do not touch."""
    body = whole_ring(ElementQuad2, 24, RADII, 0.0)
    mesh = body.mesh
    rim = mesh.boundaries["rim"]
    right = rim[mesh.p[0, mesh.facets[:, rim]].mean(axis=0) > -0.9]
    result = unsolved(body, right, 0.0)
    (line,) = lines(result)
    assert np.unique(line).size == line.size == result.mu.size
    mesh = make.box(ElementQuad1, np.linspace(0, 1, 6), np.array([0.0, 0.2]))
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3)
    s, run = arc_length(unsolved(body, ["bottom", "top"], -0.01))
    assert run.max() == 1
    assert 0.8 < s[run == 0].max() <= 1 <= s[run == 1].min() < s.max() <= 2


def circle(x, y, r):
    return LevelSet(lambda p: (p[0] - x) ** 2 + (p[1] - y) ** 2 - r**2)


CUT = {
    "ring": (circle(0, 0, 0.9) & ~circle(0.1, 0.05, 0.4), 2),
    "two disks": (circle(-0.5, 0, 0.4) | circle(0.5, 0.1, 0.37), 2),
    "disk": (circle(0.013, -0.02, 0.71), 1),
}


@pytest.mark.parametrize("name", CUT)
def test_curves_that_cut_cells(name):
    """Every closed curve is a line that closes, and lengths go on from one to the next."""
    level_set, count = CUT[name]
    mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 17)] * 2).with_defaults()
    body = CutBody(mesh, level_set, E=1.0, nu=0.3)
    result = unsolved(body, body.arc(), 0.0)
    assert len(lines(result)) == count
    curves = body.arc().curves
    for line in lines(result):
        assert line[0] == line[-1]
        step = np.linalg.norm(np.diff(result.x[:, line]), axis=0)
        assert step.max() < 2 * np.median(step)
    assert arc_length(result)[1].max() == len(curves) - 1
    part = body.arc(where=lambda x: x[1] > -0.2)
    assert not any(c.closed for c in part.curves)
    assert all(line[0] != line[-1] for line in lines(unsolved(body, part, 0.0)))
