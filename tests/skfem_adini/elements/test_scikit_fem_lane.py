"""What scikit-fem asks of the elements in its own test lists, asked of each of ours.

Elements of Hermite kind differ in one thing: a vector of ones is not the function 1, so data come
from `project`, and the functions of u alone sum to one.
"""

import pickle

import numpy as np
import pytest
import skfem
from skfem import (
    Basis,
    BilinearForm,
    ElementHexDG,
    ElementQuad0,
    ElementQuadDG,
    ElementTriP1,
    ElementVector,
    FacetBasis,
    Functional,
    InteriorFacetBasis,
    LinearForm,
    MeshHex,
    MeshQuad,
    MeshTri,
    TrilinearForm,
    asm,
    condense,
    enforce,
    mpc,
    penalize,
    solve,
)
from skfem.helpers import dd, ddot, dot, grad, mul
from skfem.io.meshio import from_meshio, to_meshio
from skfem.models.poisson import laplace, mass, unit_load

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS, essential_dofs

ELEMENTS = [ElementQuadAdini(), ElementQuadBFS(), ElementHexAdini()]
each = pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: type(e).__name__)


def mesh_of(element, refinements=None):
    mesh = MeshQuad if element.dim == 2 else MeshHex
    return mesh().refined((3 if element.dim == 2 else 1) if refinements is None else refinements)


def basis_of(element, refinements=None):
    return Basis(mesh_of(element, refinements).with_defaults(), element)


def cubic(x):
    return 1 + x[0] ** 3 - 2 * x[0] * x[1] ** 2 + x[-1]


# The lists of elements.


@each
def test_each_dof_is_one_for_its_function_and_zero_for_the_others(element):
    """The dofs are derivatives by name; on the reference cell the map is the identity."""
    mapping = mesh_of(element, 0)._mapping()
    corners = np.unique(element.doflocs, axis=0)
    values = {}
    for i in range(len(element.doflocs)):
        (f,) = element.gbasis(mapping, corners.T, i, tind=np.array([0]))
        parts = {"u": np.asarray(f)[0], "u_xy": f.hess[0, 1, 0]}
        parts |= {f"u_{name}": f.grad[k, 0] for k, name in enumerate("xyz"[: element.dim])}
        for name in element.dofnames:
            for corner, value in zip(map(tuple, corners), parts[name], strict=True):
                values[i, name, corner] = value
    for (i, name, corner), value in values.items():
        own = element.dofnames[i % element.nodal_dofs] == name
        own = own and tuple(element.doflocs[i]) == corner
        assert value == pytest.approx(float(own), abs=1e-13)


@each
@pytest.mark.parametrize("base", [0.0, 0.3, 0.6, 0.9])
def test_gradients_are_those_of_differences(element, base):
    step = 1e-6
    X = np.full((element.dim, 1), base)
    for i in range(len(element.doflocs)):
        value, gradient = element.lbasis(X, i)
        for k in range(element.dim):
            moved = X + step * np.eye(element.dim)[:, [k]]
            difference = (element.lbasis(moved, i)[0] - value) / step
            assert difference[0] == pytest.approx(gradient[k, 0], abs=1e-4)


@each
def test_functions_of_u_sum_to_one(element):
    X = np.full((element.dim, 1), 0.15)
    of_u = range(0, len(element.doflocs), element.nodal_dofs)
    assert sum(element.lbasis(X, i)[0][0] for i in of_u) == pytest.approx(1)


@each
@pytest.mark.parametrize("i", [-1, 10**3])
def test_there_is_no_function_of_this_number(element, i):
    with pytest.raises(ValueError, match="number of basis functions"):
        element.lbasis(np.zeros((element.dim, 1)), i)
    with pytest.raises(ValueError, match="number of basis functions"):
        element.gbasis(mesh_of(element)._mapping(), np.zeros((element.dim, 1)), i)


@each
def test_discontinuous_copies(element):
    named = ElementQuadDG if element.dim == 2 else ElementHexDG
    mesh = mesh_of(element, 1)
    square = Functional(lambda w: w["u"] ** 2)
    u = [b.interpolate(b.ones()) for b in (Basis(mesh, element), Basis(mesh, named(element)))]
    sizes = [square.assemble(Basis(mesh, element), u=field) for field in u]
    assert sizes[0] == pytest.approx(sizes[1])
    pair = named(element) * element
    assert len(pair.doflocs) == 2 * len(element.doflocs)
    M = mass.assemble(Basis(mesh, named(element))).toarray()
    blocks = mass.coo_data(Basis(mesh, named(element))).inverse().tocsr().toarray()
    np.testing.assert_allclose(blocks @ M, np.eye(len(M)), atol=1e-7)


@each
def test_other_cells_are_refused(element):
    for mesh in (MeshTri(), MeshHex() if element.dim == 2 else MeshQuad()):
        with pytest.raises(ValueError, match="Incompatible"):
            Basis(mesh, element)


# The lists of bases.


@each
def test_interpolation_probes_and_projection(element):
    basis = basis_of(element, 2 if element.dim == 2 else 1)
    X = np.random.default_rng(0).uniform(0, 1, (element.dim, 200))
    x = basis.project(cubic)
    np.testing.assert_allclose(basis.probes(X) @ x, cubic(X), atol=1e-10)
    np.testing.assert_allclose(basis.interpolator(x)(X), cubic(X), atol=1e-10)
    np.testing.assert_allclose(basis.project(basis.interpolate(x)), x, atol=1e-9)
    np.testing.assert_allclose(
        basis.project(basis.interpolate(x).grad[0]),
        basis.project(lambda x: 3 * x[0] ** 2 - 2 * x[1] ** 2),
        atol=1e-8,
    )


@each
def test_dofs_by_name_boundary_and_set(element):
    basis = basis_of(element)
    left, right = basis.get_dofs("left"), basis.get_dofs("right")
    assert set(left.nodal) == set(element.dofnames)
    both = basis.get_dofs({"left", "right"}).all()
    np.testing.assert_array_equal(np.union1d(left.all(), right.all()), both)
    np.testing.assert_array_equal(left.keep(["u", "u_x"]).keep("u").all(), left.keep("u").all())
    np.testing.assert_array_equal(left.drop(element.dofnames[1:]).all(), left.keep("u").all())
    assert not basis.get_dofs("left", skip=element.dofnames).all().size
    cells = basis.get_dofs(elements=np.array([0]))
    assert len(cells.all()) == len(element.doflocs)
    with pytest.raises(ValueError, match="not found"):
        basis.get_dofs("no such boundary")
    # The places of the dofs are those of the vertices.
    np.testing.assert_allclose(basis.doflocs[:, basis.nodal_dofs[0]], basis.mesh.p, atol=1e-14)


@each
def test_facets(element):
    """Areas, outward normals, Gauss' theorem, and facets around a subdomain."""
    basis = basis_of(element)
    boundary = basis.boundary()
    one, x = basis.project(lambda x: 1 + 0 * x[0]), basis.project(lambda x: x[0])
    M = mass.assemble(boundary)
    assert one @ M @ one == pytest.approx(2 * element.dim)
    assert one @ LinearForm(lambda v, w: dot(w.n, w.n) * v).assemble(boundary) == pytest.approx(
        2 * element.dim
    )
    for k in range(element.dim):
        flux = LinearForm(lambda v, w, k=k: w.n[k] * v).assemble(boundary)
        assert flux @ basis.project(lambda x, k=k: x[k]) == pytest.approx(1)
    part = FacetBasis(basis.mesh, element, facets=basis.mesh.facets_around([0]))
    flux = Functional(lambda w: dot(w.n, grad(w["u"]))).assemble(part, u=x)
    assert flux == pytest.approx(0, abs=1e-12)
    volume = Functional(lambda w: w.x[0] * w.n[0]).assemble(part)
    assert volume == pytest.approx(1 / basis.mesh.nelements)


@each
def test_both_sides_of_inner_facets(element):
    basis = basis_of(element)
    x = basis.project(cubic)
    sides = [InteriorFacetBasis(basis.mesh, element, side=side) for side in (0, 1)]
    u, v = (side.interpolate(x) for side in sides)
    np.testing.assert_allclose(u, v, atol=1e-11)
    np.testing.assert_allclose(u.grad, v.grad, atol=1e-10)
    jump = BilinearForm(lambda u, v, w: (-1.0) ** sum(w.idx) * dot(u.grad, w.n) * dot(v.grad, w.n))
    assert abs(asm(jump, sides, sides) @ x).max() < 1e-10


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("element", [ELEMENTS[0], ELEMENTS[1]], ids=lambda e: type(e).__name__)
def test_trace_on_a_mesh_of_the_boundary(element, flat):
    mesh = mesh_of(element)
    boundary = FacetBasis(mesh, element, facets=lambda x: x[1] == 0)
    x = Basis(mesh, element).project(lambda x: x[0])
    line, y = boundary.trace(x, lambda p: p[0] if flat else p[:-1], target_elem=ElementQuad0())
    mean = Functional(lambda w: w["y"]).assemble(line, y=line.interpolate(y))
    assert mean == pytest.approx(0.5)


@each
def test_parts_of_a_mesh(element):
    """Cells by number, name and restriction integrate to the same, whatever the basis."""
    mesh = mesh_of(element).with_subdomains({"half": lambda x: x[0] < 0.5})
    basis = Basis(mesh, element)
    x = basis.project(cubic)
    square = Functional(lambda w: w["u"] ** 2)
    whole = square.assemble(basis, u=x)
    half, rest = (basis.with_elements(cells) for cells in ("half", lambda x: x[0] > 0.5))
    assert square.assemble(half, u=x) + square.assemble(rest, u=x) == pytest.approx(whole)
    assert half.mesh is basis.mesh
    inner = Basis(mesh.restrict("half"), element)
    assert square.assemble(inner, u=inner.project(cubic)) == pytest.approx(
        square.assemble(half, u=x)
    )
    K = laplace.assemble(half) + laplace.assemble(rest)
    assert abs(K - laplace.assemble(basis)).max() < 1e-12


@each
def test_split_of_vectors_and_composites(element):
    mesh = mesh_of(element, 1)
    vector = Basis(mesh, ElementVector(element))
    x = vector.project(lambda x: np.array([k + cubic(x) for k in range(element.dim)]))
    for k, (part, basis) in enumerate(vector.split(x)):
        np.testing.assert_allclose(part, basis.project(lambda x, k=k: k + cubic(x)), atol=1e-9)
    pair = Basis(mesh, element * element)
    u, p = pair.split(pair.project(lambda x: (cubic(x), x[0])))
    np.testing.assert_allclose(p[0], p[1].project(lambda x: x[0]), atol=1e-9)
    np.testing.assert_allclose(u[0], u[1].project(cubic), atol=1e-9)
    block = BilinearForm(lambda u, p, v, q, _: dot(grad(u), grad(v)) + p * q)
    one = Basis(mesh, element)
    assert abs(block.block(1, 1).assemble(one) - mass.assemble(one)).max() < 1e-14


@each
def test_pickle_and_mesh_files(element):
    basis = basis_of(element, 1)
    again = pickle.loads(pickle.dumps(basis))
    assert abs(laplace.assemble(again) - laplace.assemble(basis)).max() == 0
    read = from_meshio(to_meshio(basis.mesh))
    assert abs(laplace.assemble(Basis(read, element)) - laplace.assemble(basis)).max() < 1e-13
    assert not hasattr(Basis(basis.mesh, element, disable_doflocs=True), "doflocs")


# The lists of forms.


@each
def test_threads_coordinates_and_lists_of_bases(element):
    basis = basis_of(element)
    form = BilinearForm(lambda u, v, _: u.grad[0] * v + dot(u.grad, v.grad))
    threaded = BilinearForm(form.form, nthreads=2)
    K = form.assemble(basis)
    assert abs(threaded.assemble(basis) - K).max() == 0
    assert abs(form.coo_data(basis).tocsr() - K).max() < 1e-14
    x = basis.project(cubic)
    parts = Functional(lambda w: w["u"]).elemental(basis, u=x)
    assert parts.shape == (basis.mesh.nelements,)
    assert parts.sum() == pytest.approx(Functional(lambda w: w["u"]).assemble(basis, u=x))
    cells = np.arange(basis.mesh.nelements)
    halves = [basis.with_elements(part) for part in np.array_split(cells, 2)]
    assert abs(asm(form, halves) - K).max() < 1e-13


def test_several_meshes_in_one_matrix():
    left, middle, right = MeshTri().refined(), MeshQuad().refined(), MeshQuad().refined()
    meshes = left @ middle.translated((1.0, 0.0)) @ right.translated((2.0, 0.0))
    elements = [ElementTriP1(), ElementQuadAdini(), ElementQuadAdini()]
    bases = [Basis(mesh, element) for mesh, element in zip(meshes, elements, strict=True)]
    # The vertices are those of all meshes, three dofs each.
    M = asm(mass, bases[1:])
    assert M.shape == (3 * 21, 3 * 21)
    ones = np.zeros(3 * 21)
    ones[::3] = 1
    assert ones @ M @ ones == pytest.approx(2)


@each
@pytest.mark.parametrize("dtype", [np.complex64, np.complex128])
def test_complex_forms(element, dtype):
    basis = basis_of(element)
    one = basis.project(lambda x: 1 + 0 * x[0])
    M = BilinearForm(lambda u, v, _: 1j * u * v, dtype=dtype).assemble(basis)
    f = LinearForm(lambda v, _: 1j * v, dtype=dtype).assemble(basis)
    assert one @ M @ one == pytest.approx(1j, abs=1e-5)
    assert one @ f == pytest.approx(1j, abs=1e-5)


@each
def test_trilinear_form(element):
    basis = basis_of(element, 0 if element.dim == 3 else 1)
    A = TrilinearForm(lambda u, v, w, _: dot(w * grad(u), grad(v))).assemble(basis).toarray()
    k = np.random.default_rng(0).standard_normal(basis.N)
    expected = BilinearForm(lambda u, v, w: dot(w["k"] * grad(u), grad(v)))
    np.testing.assert_allclose(
        np.einsum("ijk,i->jk", A, k), expected.assemble(basis, k=k).toarray(), atol=1e-11
    )


@each
def test_ways_to_solve(element):
    basis = basis_of(element)
    K, f, D = laplace.assemble(basis), unit_load.assemble(basis), essential_dofs(basis)
    x = basis.project(cubic)
    expected = solve(*condense(K, f, x=x, D=D))
    np.testing.assert_allclose(solve(*enforce(K, f, x=x, D=D)), expected, atol=1e-9)
    np.testing.assert_allclose(solve(*mpc(K, f, S=D, g=x[D])), expected, atol=1e-9)
    penalised = solve(*penalize(K, f, x=x, D=D, epsilon=1e-9))
    np.testing.assert_allclose(penalised, expected, atol=1e-5)
    b = f.copy()
    b[D] = 0
    by_cg = laplace.coo_data(basis).solve(b, D=D, tol=1e-12)
    np.testing.assert_allclose(by_cg, solve(*condense(K, f, D=D)), atol=1e-8)


@each
def test_point_source_and_its_reciprocity(element):
    basis = basis_of(element)
    K, D = laplace.assemble(basis), essential_dofs(basis)
    a, b = np.full(element.dim, 0.3), np.full(element.dim, 0.6)
    green = [solve(*condense(K, basis.point_source(p), D=D)) for p in (a, b)]
    at = [(basis.probes(p[:, None]) @ g)[0] for p, g in zip((b, a), green, strict=True)]
    assert at[0] == pytest.approx(at[1], rel=1e-9)
    assert basis.point_source(a) @ basis.project(cubic) == pytest.approx(cubic(a))


@each
def test_refined_meshes_hold_the_coarse_function(element):
    coarse = basis_of(element, 1)
    fine = Basis(coarse.mesh.refined(), element)
    u = coarse.interpolator(coarse.project(cubic))
    np.testing.assert_allclose(fine.project(u), fine.project(cubic), atol=1e-8)
    mesh, values = coarse.refinterp(coarse.project(cubic), nrefs=1)
    np.testing.assert_allclose(values, cubic(mesh.p), atol=1e-10)


@each
def test_nonlinear_loop(element):
    """Newton's method for -div((1 + u^2) grad u) = f, with an interpolated last iterate."""
    basis = basis_of(element)

    def exact(x):
        return x[0] * (1 - x[1])

    def source(x):
        u = exact(x)
        return -2 * u * (x[0] ** 2 + (1 - x[1]) ** 2)

    jacobian = BilinearForm(
        lambda u, v, w: dot((1 + w["p"] ** 2) * grad(u) + 2 * w["p"] * u * grad(w["p"]), grad(v))
    )
    residual = LinearForm(
        lambda v, w: dot((1 + w["p"] ** 2) * grad(w["p"]), grad(v)) - source(w.x) * v
    )
    D = essential_dofs(basis)
    x = basis.zeros()
    x[D] = basis.project(exact)[D]
    for _ in range(12):
        p = basis.interpolate(x)
        step = solve(*condense(jacobian.assemble(basis, p=p), -residual.assemble(basis, p=p), D=D))
        x = x + step
        if abs(step).max() < 1e-12:
            break
    error = Functional(lambda w: (w["u"] - exact(w.x)) ** 2).assemble(basis, u=x)
    assert np.sqrt(error) < 1e-8


def test_forms_differentiated_by_jax():
    pytest.importorskip("jax")
    from skfem.autodiff import NonlinearForm
    from skfem.autodiff.helpers import dot as jdot
    from skfem.autodiff.helpers import grad as jgrad

    basis = basis_of(ElementQuadAdini())
    form = NonlinearForm(lambda u, v, _: jdot(jgrad(u), jgrad(v)))
    K, _ = form.assemble(basis.zeros(), basis)
    assert abs(K - laplace.assemble(basis)).max() < 1e-5


def test_matrix_valued_projection():
    basis = Basis(MeshQuad().refined(1), ElementVector(ElementQuadAdini()))
    tensors = basis.with_element(ElementVector(ElementVector(ElementQuadAdini(1))))
    x = basis.interpolate(basis.project(lambda x: np.array([x[0] * x[1], x[0] ** 2])))
    y = tensors.project(grad(x))
    found = tensors.interpolate(y)
    np.testing.assert_allclose(np.asarray(found), x.grad, atol=1e-8)
    np.testing.assert_allclose(mul(np.asarray(found), np.ones((2, *x.shape[1:]))), x.grad.sum(1))


# Its convergence tests of plates, with the same limits; the numbers are pinned.
PLATES = [
    (ElementQuadAdini(), (1.9, 2.1), 1.4617e-5),
    (ElementQuadBFS(), (3.9, 5.0), 2.3254e-9),
    (skfem.ElementQuadBFS(), (3.9, 5.0), None),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("element", "limits", "last"),
    PLATES,
    ids=lambda e: f"{type(e).__module__.partition('.')[0]}.{type(e).__name__}",
)
def test_simply_supported_plate(element, limits, last):
    """The Kirchhoff plate of scikit-fem's list, D = 1/12 / (1 - .3^2), no derivatives asked for."""
    nu, stiffness = 0.3, 1 / 12 / (1 - 0.3**2)

    def bending(u, v, _):
        H = dd(u)
        trace = H[0, 0] + H[1, 1]
        return stiffness * ((1 - nu) * ddot(H, dd(v)) + nu * trace * (dd(v)[0, 0] + dd(v)[1, 1]))

    def load(x):
        return np.sin(np.pi * x[0]) * np.sin(np.pi * x[1])

    errors = []
    for k in (3, 4, 5):
        basis = Basis(MeshQuad().refined(k), type(element)())
        K = BilinearForm(bending).assemble(basis)
        f = LinearForm(lambda v, w: load(w.x) * v).assemble(basis)
        x = solve(*condense(K, f, D=basis.get_dofs().all("u")))
        off = Functional(lambda w: (w["u"] - load(w.x) / (4 * stiffness * np.pi**4)) ** 2)
        errors.append(np.sqrt(off.assemble(basis, u=x)))
    order = -np.polyfit([3, 4, 5], np.log2(errors), 1)[0]
    assert limits[0] < order < limits[1]
    if last is not None:
        assert errors[-1] == pytest.approx(last, rel=0.02)
