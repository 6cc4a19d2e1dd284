"""Dirichlet conditions on straight facets that stand for a curve, have a kink, or are rough."""

import numpy as np
import pytest
from convergence import order
from scipy.sparse.linalg import spsolve
from skfem import Basis, FacetBasis, LinearForm, MeshHex, MeshQuad
from skfem.models.poisson import laplace

from skfem_adini import ElementHexAdini, ElementQuadAdini, InputError, essential_constraints
from skfem_adini.conditions.trace_directions import vertex_normals

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

ELEMENTS = {2: ElementQuadAdini(), 3: ElementHexAdini()}
solids = pytest.mark.parametrize("solid", [False, True], ids=["quad", "hex"])
KINKS = [0.0, 1e-14, 1e-12, 1e-10, 1e-8, 3e-7, 1e-6, 3e-6, 1e-5, 1e-4, 4e-4, 1e-2]


def quarter(n, solid=False, angles=None):
    """A quarter of a ring, n facets on its inner side, of radius one."""
    angles = np.linspace(0, np.pi / 2, n + 1) if angles is None else angles
    ticks = [np.linspace(1, 2, max(2, n // 2) + 1), angles]
    make = MeshHex if solid else MeshQuad
    mesh = make.init_tensor(*ticks, *([np.array([0.0, 0.4])] if solid else []))
    sides = {
        "inner": mesh.facets_satisfying(lambda x: x[0] < 1 + 1e-9),
        "outer": mesh.facets_satisfying(lambda x: x[0] > 2 - 1e-9),
    }
    p = mesh.p.copy()
    p[:2] = p[0] * np.array([np.cos(p[1]), np.sin(p[1])])
    return make(p, mesh.t).with_boundaries(sides)


def error(mesh, exact, gradient, value, smooth):
    """Relative error in L2 of Laplace's equation, u given inside and its flux outside."""
    basis = Basis(mesh, ELEMENTS[mesh.dim()])
    T, x0 = essential_constraints(basis, "inner", value, smooth=smooth)
    K = laplace.assemble(basis)
    flux = LinearForm(lambda v, w: sum(gradient(w.x) * w.n) * v)
    f = flux.assemble(FacetBasis(mesh, basis.elem, facets="outer"))
    x = T @ spsolve((T.T @ K @ T).tocsc(), T.T @ (f - K @ x0)) + x0
    at = exact(np.array(basis.global_coordinates()))
    off = np.array(basis.interpolate(x)) - at
    return np.sqrt(np.sum(off**2 * basis.dx) / np.sum(at**2 * basis.dx))


def logarithm(x):
    return np.log(np.hypot(x[0], x[1]))


def flux(x):
    return np.concatenate([x[:2] / np.sum(x[:2] ** 2, axis=0), 0 * x[2:]])


@solids
def test_zero_on_a_curve(solid):
    """Order two along the curve, one where the facets themselves are held."""
    n = [4, 6, 8] if solid else [8, 16, 32]
    smooth, facets = (
        [error(quarter(k, solid), logarithm, flux, 0.0, way) for k in n] for way in (True, False)
    )
    assert order(n, smooth) > (1.3 if solid else 1.75)  # 1.94 from 32 to 64
    assert order(n, facets) < 1.1
    assert smooth[-1] < (0.1 if solid else 0.03) * facets[-1]


@pytest.mark.parametrize("graded", [False, True])
def test_data_of_the_curve_alone(graded):
    """Data that are known along the curve, here in its angle, as in (r^2 + r^-2) cos 2 phi."""
    z = lambda x: x[0] + 1j * x[1]  # noqa: E731
    exact = lambda x: (z(x) ** 2 + z(x) ** -2).real  # noqa: E731
    data = lambda x: 2 * np.cos(2 * np.angle(z(x)))  # noqa: E731

    def gradient(x):
        slope = 2 * z(x) - 2 * z(x) ** -3
        return np.array([slope.real, -slope.imag])

    n, found = [4, 8, 16], []
    for k in n:
        s = np.linspace(0, 1, k + 1)
        mesh = quarter(k, angles=np.pi / 2 * (s + 0.4 * graded * s * (1 - s)))
        found.append(error(mesh, exact, gradient, data, True))
    assert order(n, found) > 1.8
    assert found[-1] < 5e-3


def test_a_field_known_beside_the_curve():
    """Its whole gradient on the facets: order four; along the curve two."""
    n = [4, 8, 16]
    facets = [error(quarter(k), logarithm, flux, logarithm, False) for k in n]
    assert order(n, facets) > 3.4
    smooth = [error(quarter(k), logarithm, flux, logarithm, True) for k in n]
    assert 1.7 < order(n, smooth) < 2.5


def cubic(x):
    return x[0] ** 3 - 3 * x[0] * x[1] ** 2 + x[0] * x[1] - 2 * x[1] + 1


def slopes(x):
    along = 3 * x[0] ** 2 - 3 * x[1] ** 2 + x[1], -6 * x[0] * x[1] + x[0] - 2
    return np.array([*along, *(0 * x[2:])])


def kinked(kink, solid=False, rng=None):
    """A block whose lower side is bent by an angle in its middle, or rough; slanted."""
    ticks = [np.array([0.0, 0.3, 0.5, 0.8, 1.0]), np.array([0.0, 0.4, 1.0])]
    mesh = MeshHex.init_tensor(*ticks, ticks[1]) if solid else MeshQuad.init_tensor(*ticks)
    low = mesh.facets_satisfying(lambda x: x[1] < 1e-9)
    p = mesh.p.copy()
    rough = kink * (rng.uniform(-0.1, 0.1, p.shape[1]) if rng else np.maximum(p[0] - 0.5, 0.0))
    p[1] -= rough * (1 - p[1])
    c, s = np.cos(0.3), np.sin(0.3)
    p[:2] = [c * p[0] - s * p[1], s * p[0] + c * p[1]]
    return type(mesh)(p, mesh.t).with_boundaries({"low": low})


@solids
@pytest.mark.parametrize("smooth", [False, True])
def test_cubic_data_on_a_line_with_a_kink(smooth, solid):
    """The cubic is among the vectors, whatever the kink: no frame is nearly singular."""
    for kink in KINKS:
        mesh = kinked(kink, solid)
        basis = Basis(mesh, ELEMENTS[mesh.dim()], intorder=1)
        T, x0 = essential_constraints(basis, "low", cubic, smooth=smooth)
        exact = basis.zeros()
        exact[basis.nodal_dofs] = [cubic(mesh.p), *slopes(mesh.p)]
        # Rounding of the data's derivative, over the least turn that counts.
        allowed = 2e-13 if smooth or kink < 1e-3 else 1e-11
        assert np.abs(T @ (T.T @ (exact - x0)) + x0 - exact).max() < allowed
        assert np.abs((T.T @ T).toarray() - np.eye(T.shape[1])).max() < 1e-14
        if kink == 0.0:
            straight = T.shape[1]
        assert (T.shape[1] < straight) == (not smooth and kink > 1e-3)


@solids
@pytest.mark.parametrize("smooth", [False, True])
def test_rough_sides(smooth, solid):
    """What is free changes by what the coordinates do."""
    element, spans = ELEMENTS[2 + solid], []
    noises = [n for n in KINKS if smooth or n < 4e-4]
    for noise in noises:
        mesh = kinked(noise, solid, np.random.default_rng(5))
        T, _ = essential_constraints(Basis(mesh, element, intorder=1), "low", smooth=smooth)
        spans.append((T @ T.T).toarray())
    for noise, span in zip(noises, spans, strict=True):
        assert np.abs(span - spans[0]).max() < 2 * noise + 1e-14


@solids
def test_corners_are_corners(solid):
    """The whole surface of a box, and what is left of one where a smaller one is cut out."""
    ticks = [np.array([0.0, 0.4, 1.0])] * (3 if solid else 2)
    box = MeshHex.init_tensor(*ticks) if solid else MeshQuad.init_tensor(*ticks)
    for mesh in (box, box.remove_elements(np.array([0]))):
        basis = Basis(mesh, ELEMENTS[mesh.dim()], intorder=1)
        one, two = (
            essential_constraints(basis, mesh.boundary_facets(), cubic, smooth=way)
            for way in (False, True)
        )
        assert abs(one[0] - two[0]).max() == 0
        np.testing.assert_array_equal(one[1], two[1])
    # Sides that nearly fold back on each other.
    mesh = MeshQuad(np.array([[0, 1, 1.2, 0.9], [0, -0.1, 0.0, 0.1]]), np.array([[0, 1, 2, 3]]).T)
    basis = Basis(mesh, ElementQuadAdini(), intorder=1)
    T, _ = essential_constraints(basis, smooth=True)
    assert not T[basis.nodal_dofs[:, mesh.p[0] == 0].ravel()].nnz


def test_normals_are_exact_on_circles_and_spheres():
    rng = np.random.default_rng(3)
    s = np.sort(np.r_[0, rng.uniform(0, 1, 7), 1])
    mesh = quarter(8, angles=np.pi / 2 * (0.5 * s + 0.5 * np.linspace(0, 1, 9)))
    facets = mesh.boundaries["inner"]
    normals = vertex_normals(mesh, facets, np.full(facets.size, 0.9))
    x = mesh.p
    within = (np.abs(np.hypot(*x) - 1) < 1e-9) & (x.min(axis=0) > 1e-9)
    assert np.abs(normals[:, within] + x[:, within]).max() < 1e-14

    side = np.linspace(-0.3, 0.3, 5)
    ball = MeshHex.init_tensor(side, side, np.array([0.0, 0.5]))
    top = ball.facets_satisfying(lambda x: x[2] > 0.5 - 1e-9)
    p = ball.p.copy()
    p[:2] += 0.02 * np.sin(7 * p[1::-1])
    up = p[2] > 0.4
    p[2, up] = np.sqrt(1 - np.sum(p[:2, up] ** 2, axis=0))
    normals = vertex_normals(MeshHex(p, ball.t), top, np.full(top.size, 0.9))
    inside = up & (np.abs(ball.p[:2]).max(axis=0) < 0.29)
    # Warped faces have no one normal.
    assert np.abs(normals[:, inside] - p[:, inside]).max() < 2e-3


def test_one_way_for_each_condition():
    basis = Basis(quarter(4), ElementQuadAdini(), intorder=1)
    conditions = [("inner", 0.0), ("outer", 0.0)]
    count = [
        essential_constraints(basis, conditions, smooth=way)[0].shape[1]
        for way in (False, [True, False], [False, True], True)
    ]
    assert count[0] < count[1] == count[2] < count[3]
    for wrong in ([True], 0.9, "curve", [1, 0]):
        with pytest.raises(InputError, match="smooth"):
            essential_constraints(basis, conditions, smooth=wrong)
