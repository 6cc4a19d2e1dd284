"""Bodies of a mesh compute shape functions in all cells only when they are used."""

import numpy as np
import pytest
from skfem import (
    Basis,
    ElementHex1,
    ElementHex2,
    ElementHexS2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriCR,
    ElementTriMini,
    ElementTriMorley,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
    MeshHex,
    MeshQuad,
    MeshTet,
    MeshTri,
)
from skfem.assembly import Dofs
from skfem.models.elasticity import linear_elasticity
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

from contact import ContactProblem, ElasticBody
from contact.body.deferred_basis import DeferredBasis, DofNumbers
from skfem_adini import ElementHexAdini, ElementQuadAdini

TICKS = np.array([0.0, 0.3, 0.5, 0.9, 1.0])
MESHES = {
    "Adini": (MeshQuad.init_tensor(TICKS, TICKS), ElementQuadAdini()),
    "Quad2": (MeshQuad.init_tensor(TICKS, TICKS), ElementQuad2()),
    "TriP2": (MeshTri().refined(2), ElementTriP2()),
    "Hex1": (MeshHex.init_tensor(*[TICKS[1:]] * 3), ElementHex1()),
    "HexAdini": (MeshHex.init_tensor(*[TICKS[1:]] * 3), ElementHexAdini()),
    "TetP2": (MeshTet().refined(1), ElementTetP2()),
}

ELEMENTS = [element for _, element in MESHES.values()] + [
    *(
        ElementTriP1(),
        ElementTriMorley(),
        ElementTetP1(),
        ElementQuad1(),
        ElementHex2(),
        ElementHexS2(),
    ),
    *(ElementTriCR(), ElementTriMini()),
]


def skewed():
    mesh = MeshHex.init_tensor(*[np.linspace(0, 1, 4)] * 3)
    return type(mesh)(mesh.p + 0.05 * np.sin(5 * mesh.p[::-1]), mesh.t)


@pytest.mark.parametrize("case", MESHES)
def test_tables_are_those_of_a_basis(case):
    mesh, element = MESHES[case]
    vector = ElementVector(element)
    ours, whole = DeferredBasis(mesh, vector, 4), Basis(mesh, vector, intorder=4)
    assert not {"basis", "dx"} & set(vars(ours))
    np.testing.assert_array_equal(ours.dx, whole.dx)
    np.testing.assert_array_equal(ours.doflocs, whole.doflocs)
    for one, other in zip(ours.basis, whole.basis, strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[0].grad, other[0].grad)


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda element: type(element).__name__)
def test_dofs_are_numbered_as_scikit_fem_does(element):
    mesh = {RefTri: MeshTri, RefQuad: MeshQuad, RefTet: MeshTet, RefHex: MeshHex}[element.refdom]
    lonely = np.array([[5.0]] * element.dim)  # a vertex of no cell
    mesh = mesh().refined(1)
    mesh = type(mesh)(np.hstack([mesh.p, lonely]), mesh.t)
    for one in (element, ElementVector(element)):
        ours, theirs = DofNumbers(mesh, one), Dofs(mesh, one)
        assert ours.N == theirs.N
        for name in ("nodal", "edge", "facet", "interior", "element"):
            numbers, expected = (getattr(dofs, f"{name}_dofs") for dofs in (ours, theirs))
            np.testing.assert_array_equal(numbers, expected)
            assert numbers.dtype == expected.dtype


@pytest.mark.parametrize("mesh", [skewed(), MESHES["Adini"][0], MESHES["TetP2"][0]])
def test_the_volume_is_that_of_all_points(mesh):
    element = {"MeshHex1": ElementHex1, "MeshQuad1": ElementQuad2, "MeshTet1": ElementTetP2}
    basis = DeferredBasis(mesh, ElementVector(element[type(mesh).__name__]()), 8)
    volume = basis.volume
    assert abs(volume - basis.dx.sum()) < 1e-14 * volume


@pytest.mark.sampled(3)
@pytest.mark.parametrize("case", MESHES)
def test_stiffness_of_classes_of_cells(case):
    mesh, element = MESHES[case]
    E = np.where(np.arange(mesh.nelements) < 3, 1.0, 5.0)
    body = ElasticBody.from_mesh(mesh, element, E=E, nu=0.3)
    K = body.stiffness
    cell = np.asarray(body.lam)[:, None], np.asarray(body.mu)[:, None]
    form = linear_elasticity(*cell)
    expected = form.assemble(Basis(mesh, body.basis.elem, intorder=body.basis.elem.maxdeg * 2))
    assert abs(K - expected).max() <= 1e-14 * abs(expected).max()


def test_a_block_is_solved_without_tables_of_its_cells():
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 9)] * 2).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=1.0, nu=0.3).fix("top", "xy", -0.01)
    result = ContactProblem(body, "bottom", 0.0, 0.3).solve()
    assert result.mu.max() > 0
    assert "basis" not in vars(body.basis)
