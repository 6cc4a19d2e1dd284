"""`assemble` gives what `skfem.asm` gives, on the fast path: elements x forms x meshes."""

import numpy as np
import pytest
import skfem
from hypothesis import given
from hypothesis import strategies as st
from skfem import Basis, BilinearForm, LinearForm, MeshHex, MeshQuad, MeshTet, MeshTri, asm
from skfem.helpers import ddot, div, dot, eye, sym_grad, trace
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS, assemble
from skfem_adini.assembly import csr_scatter
from skfem_adini.assembly.dof_blocks import DofBlocks

# Sums of up to 64 quadrature points and 8 cells, of terms no larger than the largest entry.
CLOSE = 1e-14

advection = BilinearForm(lambda u, v, w: v * (0.3 * u.grad[0] - 2.0 * u.grad[1]))
load = LinearForm(lambda v, w: v)
vector_mass = BilinearForm(lambda u, v, w: dot(u, v))
vector_load = LinearForm(lambda v, w: v[0] - 2.0 * v[1])
elasticity = linear_elasticity(1.3, 0.7)
hermitian = BilinearForm(
    lambda u, v, w: (1 + 2j) * u * v + 1j * u.grad[0] * v.grad[1], dtype=np.complex128
)


def agrees(found, expected):
    assert found.shape == expected.shape
    assert found.dtype == expected.dtype
    if found.ndim == 2:
        assert type(found) is type(expected)
        found.check_format(full_check=True)
        assert found.has_canonical_format
    largest = np.abs(expected).max()
    assert largest > 0
    return np.abs(found - expected).max() <= CLOSE * largest


def permuted(mesh, seed=3):
    order = np.random.default_rng(seed).permutation(mesh.t.shape[1])
    return type(mesh)(mesh.p, mesh.t[:, order])


def same(form, mesh, element, fields=(), **options):
    """The fast path gives scikit-fem's matrix."""
    fields = dict(fields)
    found = assemble(form, mesh, element, fallback=False, **options, **fields)
    assert agrees(found, asm(form, Basis(mesh, element, **options), **fields))


hessians = BilinearForm(lambda u, v, w: ddot(u.hess, v.hess))
SCALAR_QUADS = {
    "Adini": (ElementQuadAdini(), laplace),
    "Adini's Hessian": (ElementQuadAdini(derivatives=2), hessians),
    "Quad0": (skfem.ElementQuad0(), mass),
    "Quad1": (skfem.ElementQuad1(), laplace),
    "Quad2": (skfem.ElementQuad2(), laplace),
    "QuadP": (skfem.ElementQuadP(4), laplace),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SCALAR_QUADS)
def test_scalar_elements_on_any_quadrilaterals(any_quads, name):
    element, form = SCALAR_QUADS[name]
    for mesh in (any_quads, permuted(any_quads)):
        same(form, mesh, element)


def test_forms_of_scalars_and_vectors(parallelograms):
    for form in (mass, advection, load, hermitian):
        same(form, parallelograms, ElementQuadAdini())
    for inner in (ElementQuadAdini(), skfem.ElementQuad2()):
        for form in (elasticity, vector_mass, vector_load):
            same(form, parallelograms, skfem.ElementVector(inner))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", [ElementHexAdini, skfem.ElementHex1, skfem.ElementHex2])
def test_bricks(any_hexes, element):
    same(laplace, any_hexes, element())


# Of scikit-fem, with the mesh each belongs to; those with oriented facets in any order of cells.
MESHES = {"RefTri": MeshTri, "RefQuad": MeshQuad, "RefTet": MeshTet, "RefHex": MeshHex}
SCALAR = "TriP0 TriP1 TriP2 TriP3 TriP4 TriCR TriMini TetP1 TetP2 TetCR"
ORIENTED = "TriRT1 TriRT2 TriBDM1 TriN1 TriN2 TriN3 QuadRT1 QuadN1 TetRT1 TetN1 HexRT1"


@pytest.mark.parametrize("name", f"{SCALAR} {ORIENTED}".split())
def test_elements_of_scikit_fem(name):
    element = getattr(skfem, f"Element{name}")()
    solid = element.refdom.dim() == 3
    mesh = MESHES[element.refdom.__name__]().refined(1 if solid else 2)
    if name in ORIENTED.split():
        same(vector_mass, permuted(mesh), element)
        return
    same(laplace if solid else mass, mesh, element)
    for mesh in () if solid else (MeshTri.init_symmetric().refined(1), MeshTri.init_circle(2)):
        same(mass, mesh, element)


GRADED = MeshQuad.init_tensor(np.array([0, 0.2, 0.5, 1.4]), np.array([0, 0.3, 1.0]))
HALVES = MeshQuad().refined(3).with_subdomains({"left": lambda x: x[0] < 0.5})
SOME = {"elements": "left", "quadrature": skfem.quadrature.get_quadrature(HALVES.refdom, 5)}
RING = skfem.MeshQuad1DG.init_tensor(np.linspace(0, 1, 6), np.linspace(0, 2, 5), periodic=[0])
BLOCKS, P1 = skfem.ElementDG(skfem.ElementQuadP(8)), skfem.ElementTriP1()
stokes = BilinearForm(
    lambda u, p, v, q, w: ddot(sym_grad(u), sym_grad(v)) - div(v) * p - div(u) * q
)
OTHERS = {
    "elastic bricks": (
        elasticity, MeshHex().refined(1), skfem.ElementVector(ElementHexAdini()), {"intorder": 4}
    ),
    "BFS": (mass, GRADED, ElementQuadBFS(), {}),
    "composite": (
        stokes, MeshTri().refined(2), skfem.ElementVector(skfem.ElementTriP2()) * P1, {}
    ),
    "discontinuous": (laplace, MeshQuad().refined(2), skfem.ElementDG(ElementQuadAdini()), {}),
    "more dofs than a word has bits": (laplace, MeshQuad().refined(1), BLOCKS, {}),
    "part and quadrature": (laplace, HALVES, ElementQuadAdini(), SOME),
    "periodic mesh": (laplace, RING, skfem.ElementQuad2(), {}),
    "curved triangles": (laplace, skfem.MeshTri2.init_circle(2), skfem.ElementTriP2(), {}),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_other_elements_and_meshes(name):
    form, mesh, element, options = OTHERS[name]
    same(form, mesh, element, **options)


def test_rectangular():
    mesh = MeshQuad().refined(2)
    u, p = skfem.ElementVector(ElementQuadAdini()), skfem.ElementQuad1()
    form = BilinearForm(lambda u, q, w: div(u) * q)
    bases = [Basis(mesh, element, intorder=6) for element in (u, p)]
    for given_as in ((mesh, u, p), bases):
        assert agrees(assemble(form, *given_as, fallback=False), asm(form, *bases))


def test_existing_basis_with_its_own_cells_dofs_and_quadrature():
    mesh, element = MeshQuad().refined(3), ElementQuadAdini()
    dofs, glue = skfem.Dofs(mesh, element), np.arange(skfem.Dofs(mesh, element).N)
    left, right = (np.flatnonzero(mesh.p[0] == x) for x in (0, 1))
    left, right = (side[np.argsort(mesh.p[1, side])] for side in (left, right))
    glue[dofs.nodal_dofs[:, right]] = dofs.nodal_dofs[:, left]
    dofs.element_dofs = glue[dofs.element_dofs]
    some = Basis(mesh, element, intorder=4, elements=np.array([3, 9, 40, 41, 7]))
    for basis in (some, Basis(mesh, element, dofs=dofs)):
        assert agrees(assemble(laplace, basis, fallback=False), asm(laplace, basis))


def test_entries_that_only_get_zeros_are_left_out():
    element, mesh = skfem.ElementVector(skfem.ElementQuad1()), MeshQuad().refined(3)
    form = BilinearForm(lambda u, v, w: ddot(u.grad, v.grad))
    found, expected = assemble(form, mesh, element), asm(form, Basis(mesh, element))
    np.testing.assert_array_equal(found.indices, expected.indices)
    np.testing.assert_array_equal(found.indptr, expected.indptr)


def test_trace_terms_of_a_tensor_coefficient():
    """The form indexes a coefficient that is a tensor in each cell, and one without cells."""
    mesh = MeshQuad().refined(3)
    element = skfem.ElementVector(ElementQuadAdini())
    A = np.random.default_rng(5).uniform(1, 2, (2, 2, mesh.t.shape[1], 1))
    C = np.array([[2.0, 0.5], [0.25, 1.0]])

    @BilinearForm
    def form(u, v, w):
        e = sym_grad(u)
        stress = e + eye(trace(e), 2) * w.lam
        return ddot(np.einsum("ij...,jk...->ik...", w.A, stress), v.grad) + w.C[0, 1] * dot(u, v)

    same(form, mesh, element, {"A": A, "C": C, "lam": 0.5})


steps = st.lists(st.sampled_from([0.5, 1.0, 0.3, 0.1, 0.7]), min_size=1, max_size=6)


@given(steps, steps, st.floats(-1, 1), st.floats(-0.5, 0.5), st.integers(0, 2**32 - 1))
def test_random_tensor_meshes(dx, dy, origin, shear, seed):
    """Also clockwise cells, turned numberings of the vertices, shear, and cells in any order."""
    random = np.random.default_rng(seed)
    mesh = MeshQuad.init_tensor(*(origin + np.cumsum([0, *steps]) for steps in (dx, dy)))
    t = permuted(mesh, seed).t.copy()
    for c in np.flatnonzero(random.random(t.shape[1]) < 0.3):
        t[:, c] = np.roll(t[:: random.choice([-1, 1]), c], random.integers(4))
    mesh = MeshQuad(np.array([mesh.p[0] + shear * mesh.p[1], mesh.p[1]]), t)
    k = random.choice([1.0, 2.5, 7.0], mesh.t.shape[1])
    form = BilinearForm(lambda u, v, w: dot(u.grad, v.grad) * np.sqrt(w.k) + w.k**2 * u * v)
    element = ElementQuadAdini()
    found = assemble(form, mesh, element, k=k[:, None])
    expected = asm(form, Basis(mesh, element), k=k[:, None])
    # Jacobians from coordinates x are rounded by eps x / h: cells of a class are not equal there.
    narrow = min(*dx, *dy)
    rounding = 8 * np.finfo(float).eps * (1 + np.abs(mesh.p).max() / narrow)
    assert np.abs(found - expected).max() <= max(CLOSE, rounding) * np.abs(expected).max()


@pytest.mark.parametrize("shift", [1e-9, 1e-12, 1e-15])
def test_slightly_different_cells_are_told_apart(shift):
    ticks = np.array([0.0, 0.25, 0.5, 0.75 + shift, 1.0])
    mesh = MeshQuad.init_tensor(ticks, ticks)
    found = assemble(laplace, mesh, ElementQuadAdini(), fallback=False)
    assert agrees(found, asm(laplace, Basis(mesh, ElementQuadAdini())))
    even = MeshQuad.init_tensor(*[np.linspace(0, 1, 5)] * 2)
    assert (assemble(laplace, even, ElementQuadAdini()) != found).nnz > 0


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_do_not_change_a_bit(threads, monkeypatch):
    mesh, element = permuted(MeshQuad().refined(4)), ElementQuadAdini()
    alone = assemble(laplace, mesh, element)
    monkeypatch.setattr(csr_scatter, "LIMITS", csr_scatter.LIMITS._replace(pairs=1))
    monkeypatch.setattr(csr_scatter, "cores", lambda: 2 * threads)
    found = assemble(laplace, mesh, element)
    for name in ("indptr", "indices", "data"):
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


@pytest.mark.turns(4)
def test_long_integers_where_32_bits_do_not_suffice(monkeypatch):
    assert csr_scatter.index_type(2**31 - 1, 5) is np.int32
    assert csr_scatter.index_type(2**31, 5) is np.int64
    monkeypatch.setattr(csr_scatter, "index_type", lambda entries, size: np.int64)
    mesh, element = MeshQuad().refined(2), skfem.ElementQuad1()
    basis, blocks = Basis(mesh, element), DofBlocks.from_mesh(mesh, element)
    local = np.swapaxes(laplace.elemental(basis).tolocal(), 1, 2).copy()
    cells = np.arange(mesh.t.shape[1], dtype=np.int32)
    found = csr_scatter.scatter_matrix(local, cells, blocks, blocks)
    # SciPy shortens the indices again where it can.
    assert agrees(found, asm(laplace, basis))
