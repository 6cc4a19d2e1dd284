"""What scikit-fem asks in its own test lists, of each of ours; data come from `project`."""

import pickle

import numpy as np
import pytest
import skfem
from skfem import Basis, BilinearForm, Functional, LinearForm, MeshQuad, condense, solve
from skfem.helpers import ddot, dot, grad, sym_grad
from skfem.io.meshio import from_meshio, to_meshio
from skfem.models.poisson import laplace, mass, unit_load

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS, essential_dofs

ELEMENTS = [ElementQuadAdini(), ElementQuadBFS(), ElementHexAdini()]
each = pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: type(e).__name__)


def mesh_of(element, refinements=None):
    mesh = MeshQuad if element.dim == 2 else skfem.MeshHex
    return mesh().refined((3 if element.dim == 2 else 1) if refinements is None else refinements)


def basis_of(element, refinements=None):
    return Basis(mesh_of(element, refinements).with_defaults(), element)


def cubic(x):
    return 1 + x[0] ** 3 - 2 * x[0] * x[1] ** 2 + x[-1]


def equal(A, B, to):
    return abs(A - B).max() <= to


@each
def test_discontinuous_copies(element):
    mesh = mesh_of(element, 1)
    named = (skfem.ElementQuadDG if element.dim == 2 else skfem.ElementHexDG)(element)
    assert len((named * element).doflocs) == 2 * len(element.doflocs)
    broken = Basis(mesh, named)
    M, inverse = mass.assemble(broken).toarray(), mass.coo_data(broken).inverse().tocsr()
    np.testing.assert_allclose(inverse @ M, np.eye(broken.N), atol=1e-7)
    for basis in (broken, Basis(mesh, skfem.ElementDG(element))):
        found, values = basis.interpolate(basis.project(cubic)), cubic(basis.global_coordinates())
        np.testing.assert_allclose(found, values, atol=1e-11)


@each
def test_other_cells_are_refused(element):
    for mesh in (skfem.MeshTri(), skfem.MeshHex() if element.dim == 2 else MeshQuad()):
        with pytest.raises(ValueError, match="Incompatible"):
            Basis(mesh, element)


@each
def test_interpolation_probes_and_projection(element):
    basis = basis_of(element, 2 if element.dim == 2 else 1)
    X = np.random.default_rng(0).uniform(0, 1, (element.dim, 200))
    more = isinstance(element, ElementQuadBFS)
    field = lambda x: cubic(x) + more * x[0] ** 3 * x[1] ** 2  # noqa: E731
    x = basis.project(field)
    np.testing.assert_allclose(basis.probes(X) @ x, field(X), atol=1e-12)
    np.testing.assert_allclose(basis.interpolator(x)(X), field(X), atol=1e-12)
    np.testing.assert_allclose(basis.project(basis.interpolate(x)), x, atol=1e-9)
    assert basis.point_source(X[:, 0]) @ x == pytest.approx(field(X[:, 0]), abs=1e-12)
    x = basis.project(cubic)
    slope = basis.project(lambda x: 3 * x[0] ** 2 - 2 * x[1] ** 2)
    np.testing.assert_allclose(basis.project(basis.interpolate(x).grad[0]), slope, atol=1e-8)
    fine = Basis(basis.mesh.refined(), element)
    np.testing.assert_allclose(fine.project(basis.interpolator(x)), fine.project(cubic), atol=1e-8)
    mesh, values = basis.refinterp(x, nrefs=1)
    np.testing.assert_allclose(values, cubic(mesh.p), atol=1e-10)


@each
def test_dofs_by_name_and_boundary(element):
    basis = basis_of(element)
    left = basis.get_dofs("left")
    assert set(left.nodal) == set(element.dofnames)
    nodes, n = np.flatnonzero(basis.mesh.p[0] == 0), element.nodal_dofs
    np.testing.assert_array_equal(np.sort(left.nodal["u_y"]), n * nodes + 2)
    np.testing.assert_array_equal(np.sort(left.all(["u"])), n * nodes)
    np.testing.assert_array_equal(left.drop(element.dofnames[1:]).all(), left.keep("u").all())
    assert not basis.get_dofs("left", skip=element.dofnames).all().size
    assert len(basis.get_dofs(elements=np.array([0])).all()) == len(element.doflocs)
    # The places of the dofs are those of the vertices.
    np.testing.assert_allclose(basis.doflocs[:, basis.nodal_dofs[0]], basis.mesh.p, atol=1e-14)


@each
def test_facets(element):
    """Areas, Gauss' theorem, facets around a subdomain, both sides of inner facets."""
    basis = basis_of(element)
    one, x = basis.project(lambda x: 1 + 0 * x[0]), basis.project(lambda x: x[0])
    assert one @ mass.assemble(basis.boundary()) @ one == pytest.approx(2 * element.dim)
    for k in range(element.dim):
        flux = LinearForm(lambda v, w, k=k: w.n[k] * v).assemble(basis.boundary())
        assert flux @ basis.project(lambda x, k=k: x[k]) == pytest.approx(1)
    part = skfem.FacetBasis(basis.mesh, element, facets=basis.mesh.facets_around([0]))
    flux = Functional(lambda w: dot(w.n, grad(w["u"]))).assemble(part, u=x)
    assert flux == pytest.approx(0, abs=1e-12)
    x = basis.project(cubic)
    sides = [skfem.InteriorFacetBasis(basis.mesh, element, side=side) for side in (0, 1)]
    u, v = (side.interpolate(x) for side in sides)
    np.testing.assert_allclose(u, v, atol=1e-11)
    np.testing.assert_allclose(u.grad, v.grad, atol=1e-10)
    jump = BilinearForm(lambda u, v, w: (-1.0) ** sum(w.idx) * dot(u.grad, w.n) * dot(v.grad, w.n))
    assert abs(skfem.asm(jump, sides, sides) @ x).max() < 1e-10


@each
def test_parts_threads_and_copies(element):
    """Cells by name and restriction, forms in threads, pickled bases and meshes in files."""
    mesh = mesh_of(element).with_subdomains({"half": lambda x: x[0] < 0.5})
    basis = Basis(mesh, element)
    form = BilinearForm(lambda u, v, _: u.grad[0] * v + dot(u.grad, v.grad))
    K, x, square = form.assemble(basis), basis.project(cubic), Functional(lambda w: w["u"] ** 2)
    half, rest = (basis.with_elements(cells) for cells in ("half", lambda x: x[0] > 0.5))
    inner = Basis(mesh.restrict("half"), element)
    found = square.assemble(inner, u=inner.project(cubic))
    assert found == pytest.approx(square.assemble(half, u=x))
    parts = square.elemental(basis, u=x)
    assert parts.sum() == pytest.approx(found + square.assemble(rest, u=x))
    assert equal(skfem.asm(form, [half, rest]), K, 1e-12)
    assert equal(BilinearForm(form.form, nthreads=2).assemble(basis), K, 0)
    assert equal(form.coo_data(basis).tocsr(), K, 1e-14)
    assert equal(form.assemble(pickle.loads(pickle.dumps(basis))), K, 0)
    assert equal(form.assemble(Basis(from_meshio(to_meshio(mesh)), element)), K, 1e-13)
    assert not hasattr(Basis(mesh, element, disable_doflocs=True), "doflocs")


@each
def test_vectors_and_composites(element):
    mesh = mesh_of(element, 1)
    vector, basis = Basis(mesh, skfem.ElementVector(element)), Basis(mesh, element)
    names = [f"{name}^{k + 1}" for name in element.dofnames for k in range(element.dim)]
    assert vector.elem.dofnames == names
    x = vector.project(lambda x: np.array([k + cubic(x) for k in range(element.dim)]))
    for k, (part, alone) in enumerate(vector.split(x)):
        np.testing.assert_allclose(part, alone.project(lambda x, k=k: k + cubic(x)), atol=1e-9)
    pair = Basis(mesh, element * element)
    u, p = pair.split(pair.project(lambda x: (cubic(x), x[0])))
    np.testing.assert_allclose(p[0], basis.project(lambda x: x[0]), atol=1e-9)
    np.testing.assert_allclose(u[0], basis.project(cubic), atol=1e-9)
    block = BilinearForm(lambda u, p, v, q, _: dot(grad(u), grad(v)) + p * q)
    assert equal(block.block(1, 1).assemble(basis), mass.assemble(basis), 1e-14)
    strain = BilinearForm(lambda u, v, _: ddot(sym_grad(u), sym_grad(v)))
    K = strain.assemble(Basis(mesh_of(element, 0), skfem.ElementVector(element))).toarray()
    assert np.sum(np.linalg.eigvalsh(K) < 1e-10) == {2: 3, 3: 6}[element.dim]  # rigid motions


@each
def test_ways_to_solve(element):
    basis = basis_of(element, 2)
    K, f, D = laplace.assemble(basis), unit_load.assemble(basis), essential_dofs(basis)
    x, zero = basis.project(cubic), solve(*condense(K, f, D=D))
    # The series solution of -lap u = 1 at the centre.
    exact, rel = {2: (0.0736713, 1e-3), 3: (0.0562128, 2e-3)}[element.dim]
    assert basis.probes(np.full((element.dim, 1), 0.5)) @ zero == pytest.approx(exact, rel=rel)
    expected = solve(*condense(K, f, x=x, D=D))
    np.testing.assert_allclose(solve(*skfem.enforce(K, f, x=x, D=D)), expected, atol=1e-9)
    # Green's function is symmetric.
    places = np.full((element.dim, 1), 0.3), np.full((element.dim, 1), 0.6)
    one, two = (solve(*condense(K, basis.point_source(p[:, 0]), D=D)) for p in places)
    assert basis.probes(places[1]) @ one == pytest.approx(basis.probes(places[0]) @ two, rel=1e-9)


def test_fields_on_cells_of_any_shape(space):
    """Linear fields have no second derivatives, also where one instance serves all meshes."""
    mesh, kind = space
    element = next(each for each in ELEMENTS if type(each) is kind)
    basis = Basis(mesh, element)
    x = basis.project(lambda x: 1 + x[0] - 2 * x[1] + 3 * x[-1])
    assert np.abs(basis.interpolate(x).hess).max() < 1e-9
