"""Bases and extensions of cut domains; features near the size of the cells."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv, yv
from skfem import Basis, ElementQuad1, ElementVector, MeshQuad, MeshQuad2
from skfem.models.poisson import laplace, unit_load

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdini,
    InputError,
    LevelSet,
    UnresolvedWarning,
    ghost_penalty,
    lowest_eigenpairs,
    nitsche,
    refined_at_boundary,
)
from tests.skfem_adini.boundary_integrals import Curve, eigenvalue
from tests.skfem_adini.cut_problems import LEVEL_SETS, extended, matrices, robin, unit_square

ELEMENT = ElementQuadAdini()
N = 32
H = 1 / N
ROOT = 2.404825557695773


def ball(x, y, r):
    return LevelSet(lambda p: (p[0] - x) ** 2 + (p[1] - y) ** 2 - r**2)


@pytest.fixture
def disk():
    return CutDomain(unit_square(8), LEVEL_SETS["disk"])


def test_numbering_and_orientation_of_cells_do_not_matter():
    mesh = unit_square(8)
    t = mesh.t.copy()
    t[:, ::3] = np.roll(t[:, ::3], 1, axis=0)
    t[:, 1::3] = t[::-1, 1::3]
    values = []
    for m in (mesh, MeshQuad(mesh.p, t)):
        A, _, M = extended(m, LEVEL_SETS["ellipse"])
        values.append(lowest_eigenpairs(A, M, 3, shift=0.0)[0])
    np.testing.assert_allclose(*values, rtol=1e-11)


def test_normals_and_size_in_forms(disk):
    boundary = disk.boundary(ELEMENT)
    parameters = boundary.default_parameters()
    np.testing.assert_allclose(np.asarray(parameters["h"]), 1 / 8, rtol=1e-13)
    assert np.asarray(parameters["n"]).shape == np.asarray(parameters["x"]).shape
    assert boundary.dx.sum() == pytest.approx(2 * np.pi * 0.411, abs=1e-11)
    other = boundary.with_element(linear := ElementQuad1())
    assert other.elem is linear
    half = boundary.of_cells(boundary.tind[::2])
    assert half.dx.sum() == pytest.approx(boundary.dx[::2].sum())


def test_ghost_facets_have_two_active_cells_one_of_them_cut(disk):
    cells = disk.mesh.f2t[:, disk.ghost_facets]
    assert np.isin(cells, disk.active).all()
    assert np.isin(cells, disk.cut).any(axis=0).all()
    others = np.setdiff1d(np.flatnonzero(disk.mesh.f2t[1] >= 0), disk.ghost_facets)
    cells = disk.mesh.f2t[:, others]
    cut, active = np.isin(cells, disk.cut).any(axis=0), np.isin(cells, disk.active).all(axis=0)
    assert not (active & cut).any()


@pytest.mark.parametrize("kind", ["stiffness", "mass"])
def test_ghost_penalty_of_vectors_acts_on_each_component(disk, kind):
    scalar = ghost_penalty(disk, ELEMENT, matrix=kind)
    vector = ghost_penalty(disk, ElementVector(ELEMENT), matrix=kind)
    x = np.random.default_rng(0).uniform(-1, 1, scalar.shape[0])
    dofs = Basis(disk.mesh, ElementVector(ELEMENT), intorder=1).nodal_dofs
    for c in (0, 1):
        y = np.zeros(2 * len(x))
        y[dofs[c::2]] = x[Basis(disk.mesh, ELEMENT, intorder=1).nodal_dofs]
        assert y @ vector @ y == pytest.approx(x @ scalar @ x)


@pytest.mark.parametrize("threshold", [0.3, 0.5, 1.0])
def test_extension_reproduces_cubics(disk, threshold):
    basis = Basis(disk.mesh, ELEMENT, intorder=1)
    extension = AdiniExtension(basis, disk, threshold)
    x, y = disk.mesh.p
    exact = basis.zeros()
    exact[basis.nodal_dofs] = [x**3 - x * y**2 + 1, 3 * x**2 - y**2, -2 * x * y]
    active = disk.active_dofs(basis)
    z = np.linalg.lstsq(extension.P.toarray()[active], exact[active], rcond=None)[0]
    np.testing.assert_allclose(extension.expand(z)[active], exact[active], atol=1e-12)
    good = np.unique(disk.mesh.t[:, extension.good])
    assert extension.P.shape[1] == 3 * good.size
    assert np.abs(extension.P[basis.nodal_dofs[:, good].ravel()]).max() == 1


def test_a_hole_gets_the_conditions_too():
    A, _, M = extended(unit_square(24), ball(0.5, 0.5, 0.4) - ball(0.5, 0.5, 0.15))
    k = brentq(lambda k: jv(0, 0.4 * k) * yv(0, 0.15 * k) - jv(0, 0.15 * k) * yv(0, 0.4 * k), 9, 14)
    assert lowest_eigenpairs(A, M, 1, shift=0.0)[0][0] == pytest.approx(k**2, rel=1e-5)


def test_hanging_vertices_stay_away_from_cut_cells():
    level_set = LEVEL_SETS["flower"]
    mesh = refined_at_boundary(unit_square(12), level_set, 2)
    domain = CutDomain(mesh, level_set, q=3)
    sizes = np.ptp(mesh.p[0][mesh.t], axis=0)
    np.testing.assert_allclose(sizes[domain.cut], 1 / 48, rtol=1e-12)
    assert sizes.max() == pytest.approx(1 / 12)
    assert ghost_penalty(domain, ELEMENT).shape == (3 * mesh.p.shape[1],) * 2
    assert refined_at_boundary(mesh, level_set, 0) is mesh


def test_grids_of_second_order_are_those_of_first_order():
    """Vertices come first there, so everything is the same but the other nodes."""
    first = MeshQuad.init_tensor(*[np.linspace(0, 1, 9)] * 2)
    second = MeshQuad2.from_mesh(first)
    found = []
    for mesh in (first, second):
        domain = CutDomain(mesh, lambda x: (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - 0.411**2)
        extension = AdiniExtension(Basis(mesh, ELEMENT), domain)
        B, b = nitsche(domain.boundary(ELEMENT), lambda x: x[0], extension=extension)
        found.append(extension.solve(domain.assemble(laplace, ELEMENT) + B, b))
        active = domain.on_active_cells()
        assert active.area == domain.area
        assert Basis(active.mesh, ELEMENT).N > 0
    np.testing.assert_allclose(*found, atol=1e-10)
    curved = second.doflocs.copy()
    curved[1, 100] += 0.01
    with pytest.raises(InputError, match=r"mesh: .*curved"):
        CutDomain(MeshQuad2(curved, second.t), lambda x: x[0] - 0.5)


# Gaps, holes, strips and components near the size of the cells: right, or a warning, or an error.


def side_by_side(gap):
    """Two disks of radii .2 and .17, their gap given in cells, its middle inside a cell."""
    at = 0.5123
    return ball(at - 0.2 - gap * H / 2, 0.5, 0.2) | ball(at + 0.17 + gap * H / 2, 0.51, 0.17)


def extension_of(level_set):
    mesh = unit_square(N)
    return AdiniExtension(Basis(mesh, ELEMENT, intorder=1), CutDomain(mesh, level_set, q=4))


@pytest.mark.parametrize(
    ("level_set", "message"),
    [
        (side_by_side(0.3), "gap or hole"),
        (side_by_side(0.9), "gap or hole"),
        (ball(0.5, 0.5, 0.4) - ball(0.52, 0.51, 0.2 * H), "gap or hole"),
        (ball(0.5, 0.5, 0.4) - ball(0.52, 0.51, 0.8 * H), "gap or hole"),
        (ball(0.5, 0.5, 0.4) - ball(0.791, 0.51, 0.1), "thin in the cell"),
        (ball(0.35, 0.5, 0.3) | ball(0.83, 0.515, 0.2 * H), "thin in the cell"),
    ],
    ids=["gap .3", "gap .9", "hole .4", "hole 1.6", "ligament .3", "component .4"],
)
def test_what_the_cells_cannot_tell_apart_is_warned_of(level_set, message):
    with pytest.warns(UnresolvedWarning, match=message):
        extension_of(level_set)


def test_the_ghost_penalty_warns_alike():
    domain = CutDomain(unit_square(12), ball(0.5, 0.5, 0.4) - ball(0.52, 0.51, 0.05))
    with pytest.warns(UnresolvedWarning, match="gap or hole"):
        ghost_penalty(domain, ELEMENT)


@pytest.mark.parametrize("gap", [1.5, pytest.param(2.2, marks=pytest.mark.slow)])
def test_components_apart_are_not_coupled(gap):
    """The vertices of each follow cells of its own, and eigenvalues are those of both."""
    level_set = side_by_side(gap)
    A, _, M = extended(unit_square(N), level_set)
    values = lowest_eigenpairs(A, M, 2, shift=0.0)[0]
    np.testing.assert_allclose(values, (ROOT / np.array([0.2, 0.17])) ** 2, rtol=2e-6)
    extension = extension_of(level_set)
    mesh = extension.domain.mesh
    sides = mesh.p[0, extension.outside] < 0.5123
    np.testing.assert_array_equal(mesh.p[0, mesh.t[0, extension.roots]] < 0.5123, sides)


def test_a_small_component_follows_itself_and_leaves_the_threshold_of_the_large_one():
    """No cell of the small disk is inside by half: its threshold alone is lowered."""
    small = ball(0.875, 0.5, 0.7 * H)
    extension = extension_of(ball(0.4, 0.5, 0.35) | small)
    alone = extension_of(ball(0.4, 0.5, 0.35))
    assert extension.threshold < 0.5
    mesh = extension.domain.mesh
    x = mesh.p[0, mesh.t[0]]
    np.testing.assert_array_equal(extension.good[x[extension.good] < 0.8], alone.good)
    own = mesh.p[0, extension.outside] > 0.8
    assert (x[extension.roots[own]] > 0.8).all()


@pytest.mark.filterwarnings("ignore::skfem_adini.UnresolvedWarning")
def test_a_component_without_any_good_cell_is_refused():
    tiny = ball(0.875, 0.5, 0.2 * H)
    with pytest.raises(InputError, match=r"\(0.\d+, 0.\d+\); the domain is too thin"):
        extension_of(ball(0.4, 0.5, 0.35) | tiny)


def test_resolved_features_are_not_warned_of():
    for level_set in (
        ball(0.5, 0.5, 0.42) - ball(0.81, 0.5, 0.06),
        LEVEL_SETS["mild flower"],
        ball(0.5, 0.5, 0.5 - H * (1 + 1e-9)),
    ):
        extension_of(level_set)


CASES = {
    "Cassini's oval": (
        [lambda w: np.abs(w**2 - 0.25**2) ** 2 - 0.27**4],
        [
            lambda t: np.exp(1j * t)
            * np.sqrt(
                0.0625 * np.cos(2 * t) + np.sqrt(0.27**4 - (0.0625 * np.sin(2 * t)) ** 2)
            )
        ],
        3e-4,
    ),
    "kidney": (
        [lambda w: (w.real / 0.35) ** 2 + ((w.imag + 0.1 - w.real**2) / 0.15) ** 2 - 1],
        [lambda t: 0.35 * np.cos(t) + 1j * (0.15 * np.sin(t) + 0.1225 * np.cos(t) ** 2 - 0.1)],
        3e-4,
    ),
    "hole at the edge": (
        (lambda w: np.abs(w) ** 2 - 0.42**2, lambda w: np.abs(w - 0.31) ** 2 - 0.06**2),
        [lambda t: 0.42 * np.exp(1j * t), lambda t: 0.31 + 0.06 * np.exp(-1j * t)],
        5e-4,
    ),
}  # fmt: skip


def turned(function, turn):
    return lambda x: function((x[0] - 0.507 + 1j * (x[1] - 0.489)) * np.exp(-1j * turn))


@pytest.mark.parametrize(
    "name", ["kidney", *(pytest.param(k, marks=pytest.mark.slow) for k in CASES if k != "kidney")]
)
def test_eigenvalues_and_measures_of_domains_that_are_not_convex(name):
    """Two eigenvalues with u = 0, d_n u = 0 and d_n u + 3 u = 0, area and perimeter."""
    functions, curves, tolerance = CASES[name]
    curves = [Curve(curve, count) for curve, count in zip(curves, (100, 40), strict=False)]
    level_set, *holes = (LevelSet(turned(function, 0.37)) for function in functions)
    for hole in holes:
        level_set = level_set - hole
    mesh = unit_square(24)
    domain, K, M, B = matrices(mesh, level_set)
    # Both integrals have errors far below the distance asked for: spectral and h^16.
    assert domain.area == pytest.approx(sum(c.area for c in curves), abs=1e-11)
    assert domain.perimeter == pytest.approx(sum(c.length for c in curves), abs=1e-11)
    mixed = robin(domain, 3.0)
    extension = AdiniExtension(Basis(mesh, ELEMENT, intorder=1), domain)
    *stiffness, M = extension.apply(K + B, K, K + mixed, M)
    for A, condition in zip(stiffness, (None, 0.0, 3.0), strict=True):
        found = lowest_eigenpairs(A, M, 3)[0][1:]
        exact = [eigenvalue(curves, value, condition) for value in found]
        np.testing.assert_allclose(found, exact, rtol=tolerance)
        assert (found > np.array(exact) * (1 - 1e-9)).all() or condition is None


@pytest.mark.parametrize("centre", [(0.5, 0.5), (0.53125, 0.53125), (0.52, 0.51), (0.5, 0.53125)])
@pytest.mark.parametrize("radius", [0.03, 0.02, 0.0165])
def test_a_disk_smaller_than_a_cell_is_warned_of_and_solved(centre, radius):
    """Cells of 1/16: not singular, and Poisson's solution, which is quadratic, is exact."""
    mesh = unit_square(16)
    domain = CutDomain(mesh, ball(*centre, radius))
    with pytest.warns(UnresolvedWarning, match="thin in the cells"):
        extension = AdiniExtension(Basis(mesh, ELEMENT), domain)
    B, _ = nitsche(domain.boundary(ELEMENT), extension=extension)
    load = domain.assemble(unit_load, ELEMENT)
    u = extension.solve(domain.assemble(laplace, ELEMENT) + B, load)
    assert load @ u == pytest.approx(np.pi * radius**4 / 8, rel=1e-9)
