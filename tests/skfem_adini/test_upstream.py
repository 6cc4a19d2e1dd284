"""What docs/upstream offers to scikit-fem does what scikit-fem's own does, and more."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from skfem import Basis, BilinearForm, Mesh, MeshHex, MeshLine, MeshQuad, MeshTet, MeshTri
from skfem.helpers import ddot, dot, grad

FOLDER = Path(__file__).parents[2] / "docs" / "upstream"


HERMITE, FACETS = (
    SimpleNamespace(**runpy.run_path(str(FOLDER / f"{name}.py"))) for name in ("hermite", "facets")
)


@BilinearForm
def form(u, v, _):
    return u * v + 0.1 * dot(grad(u), grad(v)) + 0.01 * ddot(u.hess, v.hess)


def uneven(side: float, cells: int) -> np.ndarray:
    return side * np.linspace(0, 1, cells + 1) ** 1.3


LINE = (MeshLine(uneven(2.0, 5)), "ElementLineHermite")
PLANE = (MeshQuad.init_tensor(uneven(1.0, 4), uneven(2.0, 3)), "ElementQuadBFS")


@pytest.mark.parametrize(("mesh", "name"), [LINE, PLANE])
def test_matrices_are_those_of_scikit_fem(mesh: Mesh, name: str) -> None:
    theirs, ours = (form.assemble(Basis(mesh, getattr(m, name)())) for m in (skfem, HERMITE))
    assert abs(theirs - ours).max() < 1e-11 * abs(theirs).max()


def test_cells_may_be_turned_by_quarters() -> None:
    mesh = PLANE[0]
    turned = MeshQuad(mesh.p, np.roll(mesh.t, 1, axis=0))
    basis = Basis(turned, HERMITE.ElementQuadBFS())
    x, y = turned.p
    u = np.zeros(basis.N)
    for name, value in {"u": x**3 * y**2, "u_x": 3 * x**2 * y**2, "u_y": 2 * x**3 * y}.items():
        u[basis.get_dofs(nodes=np.arange(turned.nvertices)).all(name)] = value
    u[basis.get_dofs(nodes=np.arange(turned.nvertices)).all("u_xy")] = 6 * x**2 * y
    field = basis.interpolate(u)
    at = basis.global_coordinates()
    np.testing.assert_allclose(field, at[0] ** 3 * at[1] ** 2, atol=1e-13)
    np.testing.assert_allclose(field.hess[0, 1], 6 * at[0] ** 2 * at[1], atol=1e-12)


@pytest.mark.parametrize(("cells", "theirs"), [(20, 1e-7), (100, 1e-3)])
def test_many_cells_keep_their_digits(cells: int, theirs: float) -> None:
    """Errors of x^2 y, interpolated on the last cells of a square; scikit-fem's are larger."""
    ticks = np.linspace(0, 1, cells + 1)[-3:]
    corner = MeshQuad.init_tensor(ticks, ticks)
    x, y = corner.p
    for element, least, most in (
        (skfem.ElementQuadBFS(), theirs, 10 * theirs),
        (HERMITE.ElementQuadBFS(), 0.0, 1e-14),
    ):
        basis = Basis(corner, element)
        u = np.zeros(basis.N)
        u[basis.nodal_dofs] = x**2 * y, 2 * x * y, x**2, 2 * x
        at = basis.global_coordinates()
        error = np.abs(basis.interpolate(u) - at[0] ** 2 * at[1]).max()
        assert least <= error <= most


def test_periodic_meshes_have_the_matrices_of_equal_dofs() -> None:
    x, y = uneven(1.0, 4), uneven(2.0, 3)
    mesh = MeshQuad.init_tensor(x, y)
    left, right = (np.flatnonzero(mesh.p[0] == side) for side in (0.0, 1.0))
    periodic = skfem.MeshQuad1DG.periodic(mesh, right, left)
    basis, plain = (Basis(m, HERMITE.ElementQuadBFS()) for m in (periodic, mesh))
    label = np.arange(plain.N)
    label[plain.nodal_dofs[:, right]] = plain.nodal_dofs[:, left]
    glue = np.zeros((plain.N, basis.N))
    glue[plain.element_dofs, basis.element_dofs] = 1.0
    np.testing.assert_array_equal(glue.sum(axis=1), 1.0)
    expected = glue.T @ form.assemble(plain).toarray() @ glue
    np.testing.assert_allclose(form.assemble(basis).toarray(), expected, atol=1e-12)


def test_cells_that_are_no_rectangles_are_refused() -> None:
    skew = MeshQuad(np.array([[0.0, 1.0, 1.2, 0.1], [0.0, 0.0, 1.0, 1.0]]), np.arange(4)[:, None])
    with pytest.raises(ValueError, match="rectangles"):
        Basis(skew, HERMITE.ElementQuadBFS())


@pytest.mark.parametrize("sort", [True, False])
@pytest.mark.parametrize("mesh", [MeshTri().refined(3), MeshTet().refined(2), MeshHex().refined(2)])
def test_facets_and_edges_are_those_of_scikit_fem(mesh: Mesh, sort: bool) -> None:
    rng = np.random.default_rng(5)
    t = rng.permutation(mesh.nvertices)[mesh.t]
    for corners in (mesh.elem.refdom.facets, mesh.elem.refdom.edges):
        theirs = type(mesh).build_entities(t, corners, sort)
        for ours, other in zip(FACETS.build_entities(t, corners, sort), theirs, strict=True):
            np.testing.assert_array_equal(ours, other)


def test_vertices_whose_keys_would_overflow_are_ranked() -> None:
    t = np.array([[2**31 - 5, 2**31 - 5], [2**31 - 4, 2**31 - 4], [2**31 - 3, 2**31 - 2], [0, 1]])
    theirs = Mesh.build_entities(t, [[0, 1, 2], [0, 1, 3]])
    ours = FACETS.build_entities(t, [[0, 1, 2], [0, 1, 3]])
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(a, b)
