"""VTK lines of a contact boundary join the points of connected facets, all of them and no others.

Neighbours may differ in length a thousand times, and other runs may lie nearer than a neighbour; a
line around a body closes.
"""

import numpy as np
import pytest
from families import STRAIGHT
from skfem import ElementQuad1, ElementQuad2, ElementTriP1, ElementTriP2, MeshQuad

from contact import ContactProblem, ContactResult, CutBody, ElasticBody, LayeredBlock
from contact.output.contact_runs import arc_length
from skfem_adini import ElementQuadAdini, LevelSet

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

CASES = [
    (ElementTriP1, None),
    (ElementTriP2, None),
    (ElementTriP2, "gauss"),
    (ElementQuad1, None),
    (ElementQuad2, None),
    (ElementQuadAdini, None),
    (ElementQuadAdini, "gauss"),
    (ElementQuadAdini, "centroid"),
]


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


def ring(element, n):
    """4 n facets around a bore of one half and a rim of one."""
    kind = STRAIGHT[element]
    around = 4 * n
    strip = kind.init_tensor(np.arange(3.0), np.arange(around + 1.0))
    i, j = strip.p.round().astype(int)
    number = i * around + j % around
    p = np.zeros((2, 3 * around))
    angle = 2 * np.pi * j / around
    p[:, number] = (0.5 + 0.25 * i) * np.array([np.cos(angle), np.sin(angle)])
    mesh = kind(p, number[strip.t], sort_t=False)
    facets = mesh.boundary_facets()
    inner = np.linalg.norm(p[:, mesh.facets[0, facets]], axis=0) < 0.75
    mesh = mesh.with_boundaries({"bore": facets[inner], "rim": facets[~inner]})
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize(("element", "functional"), CASES)
def test_lines_around_a_ring_close(element, functional, together):
    """Each ends where it began, and turns once around."""
    obstacle = -0.01 if together else [-0.01, -0.01]
    result = unsolved(ring(element, 3), ["bore", "rim"], obstacle, functional)
    assert len(lines(result)) == 2
    for line in lines(result):
        assert line[0] == line[-1]
        assert np.unique(line).size == line.size - 1
        turn = np.angle(np.exp(1j * np.diff(np.arctan2(*result.x[::-1, line]))))
        assert abs(abs(turn.sum()) - 2 * np.pi) < 1e-9
        assert np.abs(turn).max() < 2 * np.pi / 10
    assert sum(line.size - 1 for line in lines(result)) == result.mu.size


def test_an_arc_of_a_ring_is_open():
    body = ring(ElementQuad2, 6)
    mesh = body.mesh
    rim = mesh.boundaries["rim"]
    right = rim[mesh.p[0, mesh.facets[:, rim]].mean(axis=0) > -0.9]
    result = unsolved(body, right, 0.0)
    (line,) = lines(result)
    assert np.unique(line).size == line.size == result.mu.size


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


def test_block_of_layers():
    block = LayeredBlock(1.0, [(1.0, 6, 1.0, 0.3)])
    result = unsolved(block, "bottom", 0.0)
    (line,) = lines(result)
    np.testing.assert_array_equal(line, np.arange(result.mu.size))
