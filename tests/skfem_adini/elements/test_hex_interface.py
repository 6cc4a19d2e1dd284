"""Everything scikit-fem does with an element works with the brick."""

import numpy as np
import pytest
from skfem import Basis, BilinearForm, ElementDG, ElementVector, FacetBasis, LinearForm, MeshHex
from skfem.helpers import ddot, dot, sym_grad
from skfem.models.poisson import laplace, mass

from skfem_adini import ElementHexAdini, InputError


def cubic(x):
    return x[0] ** 3 - 2 * x[0] * x[1] ** 2 + x[1] * x[2] + 1


POINTS = np.random.default_rng(0).uniform(0.05, 0.95, (3, 40))


@pytest.fixture(scope="module")
def unit_basis():
    return Basis(MeshHex().refined(1).with_defaults(), ElementHexAdini())


def test_vector_interpolator_and_split(unit_basis):
    basis = Basis(MeshHex(), ElementVector(ElementHexAdini()))
    names = [f"{name}^{k}" for name in ("u", "u_x", "u_y", "u_z") for k in (1, 2, 3)]
    assert basis.elem.dofnames == names
    x = basis.project(lambda p: np.array([cubic(p), p[0] * p[1], p[2] ** 3]))
    expected = [cubic(POINTS), POINTS[0] * POINTS[1], POINTS[2] ** 3]
    np.testing.assert_allclose(basis.interpolator(x)(POINTS), expected, atol=1e-12)
    for (part, scalar), values in zip(basis.split(x), expected, strict=True):
        np.testing.assert_allclose(scalar.interpolator(part)(POINTS), values, atol=1e-12)


def test_rigid_motions_have_no_energy():
    basis = Basis(MeshHex(), ElementVector(ElementHexAdini()))
    K = BilinearForm(lambda u, v, _: ddot(sym_grad(u), sym_grad(v))).assemble(basis)
    turn = basis.project(lambda p: np.array([p[1] - 2 * p[2], -p[0], 2 * p[0]]))
    assert np.abs(K @ turn).max() < 1e-12
    assert np.sum(np.linalg.eigvalsh(K.toarray()) < 1e-10) == 6


def test_named_dofs(unit_basis):
    view = unit_basis.get_dofs("left")
    assert set(view.nodal) == {"u", "u_x", "u_y", "u_z"}
    nodes = np.flatnonzero(unit_basis.mesh.p[0] == 0)
    np.testing.assert_array_equal(np.sort(view.nodal["u_z"]), 4 * nodes + 3)
    np.testing.assert_array_equal(np.sort(view.all(["u"])), 4 * nodes)


def test_green_formula_on_every_mesh(parallelepipeds):
    """Stiffness of a cubic against all functions equals volume and face terms."""
    basis = Basis(parallelepipeds, ElementHexAdini())
    x = basis.project(cubic)
    volume = LinearForm(lambda v, w: -2 * w.x[0] * v).assemble(basis)

    @LinearForm
    def flux(v, w):
        x, y, z = w.x
        gradient = np.array([3 * x**2 - 2 * y**2, -4 * x * y + z, y])
        return dot(gradient, w.n) * v

    boundary = FacetBasis(parallelepipeds, ElementHexAdini(), intorder=6)
    np.testing.assert_allclose(
        laplace.assemble(basis) @ x, volume + flux.assemble(boundary), atol=1e-10
    )


def test_discontinuous_copy():
    basis = Basis(MeshHex().refined(1), ElementDG(ElementHexAdini()), intorder=5)
    assert basis.N == 32 * 8
    x = np.linalg.solve(
        mass.assemble(basis).toarray(), LinearForm(lambda v, w: cubic(w.x) * v).assemble(basis)
    )
    np.testing.assert_allclose(basis.interpolate(x), cubic(basis.global_coordinates()), atol=1e-11)


def test_elements_subset(unit_basis):
    part = unit_basis.with_elements(np.array([1, 5, 6]))
    assert part.dx.sum() == pytest.approx(3 / 8)


def test_hessian_of_linear_fields_on_warped_cells(warped_hexes):
    basis = Basis(warped_hexes, ElementHexAdini())
    x = basis.project(lambda x: 1 + x[0] - 2 * x[1] + 3 * x[2])
    assert np.abs(basis.interpolate(x).hess).max() < 1e-10


@pytest.fixture
def logged(caplog):
    """Return a function that gives what is logged when a basis is made."""

    def messages(mesh):
        caplog.clear()
        Basis(mesh, ElementHexAdini(), intorder=1)
        return caplog.messages

    return messages


def test_silent_on_parallelepipeds(parallelepipeds, logged):
    assert not logged(parallelepipeds)


def frustum():
    """The top face has half the sides of the bottom face."""
    x, y, z = MeshHex().p
    return MeshHex(np.array([x * (1 - z / 2), y * (1 - z / 2), z]), MeshHex().t)


def test_logs_once_and_twist_falls_with_uniform_refinement(logged):
    messages = [logged(frustum().refined(k)) for k in range(4)]
    assert [len(m) for m in messages] == [1, 1, 1, 1]
    assert "from 4 to 2 in L2 and from 3 to 1 in H1" in messages[0][0]
    assert "uniform refinement of a coarse hexahedral mesh" in messages[0][0]
    twists = [float(m[0].split()[8]) for m in messages]
    falls = np.divide(twists[:-1], twists[1:])
    assert falls[-1] == pytest.approx(2, abs=0.3)


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6])
def test_rounding_is_no_twist(parallelepipeds, offset):
    """Parallelepipeds far from the origin still count as such."""
    mesh = MeshHex(parallelepipeds.p + offset, parallelepipeds.t)
    element = ElementHexAdini(derivatives=3)
    assert Basis(mesh, element, intorder=1).basis[0][0].grad3 is not None


def moved(vertex, place):
    p = MeshHex().p.copy()
    p[:, vertex] = place
    return MeshHex(p, MeshHex().t, validate=False)


def turned_top(angle):
    """Turn the face z = 1; the section at z has the area |1 - z + z e^(i angle)|^2."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = MeshHex().p - 0.5
    p = np.where(z > 0, np.array([c * x - s * y, s * x + c * y, z]), np.array([x, y, z]))
    return MeshHex(p, MeshHex().t)


BAD = {
    "vertex pushed through the opposite corner": moved(7, (-0.2, -0.2, -0.2)),
    "vertex in the plane of its neighbours": moved(0, (0.5, 0.5, 0.0)),
    "flat cell": MeshHex(MeshHex().p * [[1.0], [1], [0]], MeshHex().t, validate=False),
    "two vertices in one place": moved(0, (1.0, 0, 0)),
    "NaN vertex": moved(3, (np.nan, 0, 0)),
    "order of another code": MeshHex(MeshHex().p, np.roll(MeshHex().t, 1, axis=0)),
    # All corners are sound, the middle is flat.
    "top turned by half a turn": turned_top(np.pi),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_bad_cells_are_refused(name):
    with pytest.raises(InputError, match=r"1 of 1 cells.*Jacobian of one sign"):
        ElementHexAdini().gbasis(BAD[name]._mapping(), np.full((3, 1), 0.5), 0)


@pytest.mark.parametrize("angle", [1.0, 3.0])
def test_far_from_a_parallelepiped_but_valid(angle, logged):
    """At 3.0 only the eight parts of each edge show that the Jacobian keeps its sign."""
    assert len(logged(turned_top(angle))) == 1
