"""Gaps, holes, strips and components near the size of the cells: right, or a warning, or an error.

References are boundary integrals and Bessel roots.
"""

import numpy as np
import pytest
from skfem import Basis
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
)

N = 32
H = 1 / N
ROOT = 2.404825557695773
ELEMENT = ElementQuadAdini()


def ball(x, y, r):
    return LevelSet(lambda p: (p[0] - x) ** 2 + (p[1] - y) ** 2 - r**2)


def side_by_side(gap):
    """Two disks of radii .2 and .17, their gap given in cells, its middle inside a cell."""
    at = 0.5123
    return ball(at - 0.2 - gap * H / 2, 0.5, 0.2) | ball(at + 0.17 + gap * H / 2, 0.51, 0.17)


def extension_of(cut_problems, level_set):
    mesh = cut_problems.unit_square(N)
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
def test_what_the_cells_cannot_tell_apart_is_warned_of(cut_problems, level_set, message):
    with pytest.warns(UnresolvedWarning, match=message):
        extension_of(cut_problems, level_set)


def test_the_ghost_penalty_warns_alike(cut_problems):
    domain = CutDomain(cut_problems.unit_square(12), ball(0.5, 0.5, 0.4) - ball(0.52, 0.51, 0.05))
    with pytest.warns(UnresolvedWarning, match="gap or hole"):
        ghost_penalty(domain, ELEMENT)


@pytest.mark.parametrize("gap", [1.5, pytest.param(2.2, marks=pytest.mark.slow)])
def test_components_apart_are_not_coupled(cut_problems, gap):
    """The vertices of each follow cells of its own, and eigenvalues are those of both."""
    level_set = side_by_side(gap)
    A, _, M = cut_problems.extended(cut_problems.unit_square(N), level_set)
    values = lowest_eigenpairs(A, M, 2, shift=0.0)[0]
    np.testing.assert_allclose(values, (ROOT / np.array([0.2, 0.17])) ** 2, rtol=2e-6)
    extension = extension_of(cut_problems, level_set)
    mesh = extension.domain.mesh
    sides = mesh.p[0, extension.outside] < 0.5123
    np.testing.assert_array_equal(mesh.p[0, mesh.t[0, extension.roots]] < 0.5123, sides)


def test_a_small_component_follows_itself_and_leaves_the_threshold_of_the_large_one(cut_problems):
    """No cell of the small disk is inside by half: its threshold alone is lowered."""
    small = ball(0.875, 0.5, 0.7 * H)
    extension = extension_of(cut_problems, ball(0.4, 0.5, 0.35) | small)
    alone = extension_of(cut_problems, ball(0.4, 0.5, 0.35))
    assert extension.threshold < 0.5
    np.testing.assert_array_equal(
        extension.good[
            extension.domain.mesh.p[0, extension.domain.mesh.t[0, extension.good]] < 0.8
        ],
        alone.good,
    )
    mesh = extension.domain.mesh
    own = mesh.p[0, extension.outside] > 0.8
    assert (mesh.p[0, mesh.t[0, extension.roots[own]]] > 0.8).all()


@pytest.mark.filterwarnings("ignore::skfem_adini.UnresolvedWarning")
def test_a_component_without_any_good_cell_is_refused(cut_problems):
    tiny = ball(0.875, 0.5, 0.2 * H)
    with pytest.raises(InputError, match=r"\(0.\d+, 0.\d+\); the domain is too thin"):
        extension_of(cut_problems, ball(0.4, 0.5, 0.35) | tiny)


def test_resolved_features_are_not_warned_of(cut_problems):
    for level_set in (
        ball(0.5, 0.5, 0.42) - ball(0.81, 0.5, 0.06),
        cut_problems.LEVEL_SETS["mild flower"],
        ball(0.5, 0.5, 0.5 - H * (1 + 1e-9)),
    ):
        extension_of(cut_problems, level_set)


CASES = {
    "Cassini's oval": (
        lambda w: np.abs(w**2 - 0.25**2) ** 2 - 0.27**4,
        [
            lambda t: np.exp(1j * t)
            * np.sqrt(
                0.0625 * np.cos(2 * t) + np.sqrt(0.27**4 - (0.0625 * np.sin(2 * t)) ** 2)
            )
        ],
        3e-4,
    ),
    "kidney": (
        lambda w: (w.real / 0.35) ** 2 + ((w.imag + 0.1 - w.real**2) / 0.15) ** 2 - 1,
        [lambda t: 0.35 * np.cos(t) + 1j * (0.15 * np.sin(t) + 0.1225 * np.cos(t) ** 2 - 0.1)],
        3e-4,
    ),
    "hole at the edge": (
        lambda w: np.maximum(np.abs(w) ** 2 - 0.42**2, 0.06**2 - np.abs(w - 0.31) ** 2),
        [lambda t: 0.42 * np.exp(1j * t), lambda t: 0.31 + 0.06 * np.exp(-1j * t)],
        5e-4,
    ),
}  # fmt: skip


def turned(function, turn):
    return lambda x: function((x[0] - 0.507 + 1j * (x[1] - 0.489)) * np.exp(-1j * turn))


@pytest.mark.parametrize(
    "name", ["kidney", *(pytest.param(k, marks=pytest.mark.slow) for k in CASES if k != "kidney")]
)
def test_eigenvalues_and_measures_of_domains_that_are_not_convex(
    cut_problems, boundary_integrals, name
):
    """Two eigenvalues with u = 0, d_n u = 0 and d_n u + 3 u = 0, area and perimeter."""
    function, curves, tolerance = CASES[name]
    curves = [
        boundary_integrals.Curve(curve, count)
        for curve, count in zip(curves, (100, 40), strict=False)
    ]
    level_set = turned(function, 0.37)
    if name == "hole at the edge":
        level_set = LevelSet(turned(lambda w: np.abs(w) ** 2 - 0.42**2, 0.37)) - LevelSet(
            turned(lambda w: np.abs(w - 0.31) ** 2 - 0.06**2, 0.37)
        )
    mesh = cut_problems.unit_square(24)
    domain, K, M, B = cut_problems.matrices(mesh, level_set)
    # Both integrals have errors far below the distance asked for: spectral and h^16.
    assert domain.area == pytest.approx(sum(c.area for c in curves), abs=1e-11)
    assert domain.perimeter == pytest.approx(sum(c.length for c in curves), abs=1e-11)
    robin = cut_problems.robin(domain, 3.0)
    extension = AdiniExtension(Basis(mesh, ELEMENT, intorder=1), domain)
    *stiffness, M = extension.apply(K + B, K, K + robin, M)
    for A, condition in zip(stiffness, (None, 0.0, 3.0), strict=True):
        found = lowest_eigenpairs(A, M, 3)[0][1:]
        exact = [boundary_integrals.eigenvalue(curves, value, condition) for value in found]
        np.testing.assert_allclose(found, exact, rtol=tolerance)
        assert (found > np.array(exact) * (1 - 1e-9)).all() or condition is None


@pytest.mark.parametrize("centre", [(0.5, 0.5), (0.53125, 0.53125), (0.52, 0.51), (0.5, 0.53125)])
@pytest.mark.parametrize("radius", [0.03, 0.02, 0.0165])
def test_a_disk_smaller_than_a_cell_is_warned_of_and_solved(cut_problems, centre, radius):
    """Cells of 1/16: not singular, and Poisson's solution, which is quadratic, is exact."""
    mesh = cut_problems.unit_square(16)
    domain = CutDomain(mesh, ball(*centre, radius))
    with pytest.warns(UnresolvedWarning, match="thin in the cells"):
        extension = AdiniExtension(Basis(mesh, ELEMENT), domain)
    B, _ = nitsche(domain.boundary(ELEMENT), extension=extension)
    load = domain.assemble(unit_load, ELEMENT)
    u = extension.solve(domain.assemble(laplace, ELEMENT) + B, load)
    assert load @ u == pytest.approx(np.pi * radius**4 / 8, rel=1e-9)
