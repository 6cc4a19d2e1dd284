"""What `assemble` leaves to scikit-fem, how one sees it, and that the result is right then too."""

import logging

import numpy as np
import pytest
import skfem
from skfem import Basis, BilinearForm, Functional, MeshQuad, MeshTri, asm
from skfem.element import DiscreteField
from skfem.helpers import dot, jump

from skfem_adini import ElementQuadAdini, InputError, assemble

MESH = MeshQuad.init_tensor(np.linspace(0, 1, 6), np.linspace(0, 1.5, 4))
ELEMENT = ElementQuadAdini()
BASIS = Basis(MESH, ELEMENT)
CELLS = MESH.t.shape[1]
VARYING = BASIS.global_coordinates()[0]


def laplace(u, v, w):
    return dot(u.grad, v.grad)


def caught(u, v, w):
    try:
        return w.x[0] * u * v
    except Exception:
        return u * v


def unpacked(u, v, w):
    known = {**w}
    return known.get("x", [1.0])[0] * u * v


NEED_SCIKIT_FEM = {
    "x": lambda u, v, w: w.x[0] * u * v,
    "item": lambda u, v, w: w["x"][1] * u * v,
    "get": lambda u, v, w: w.get("x", [1.0])[0] * u * v,
    "h": lambda u, v, w: u * v / w.h,
    "hasattr": lambda u, v, w: u * v * (2 if hasattr(w, "x") else 1),
    "idx": lambda u, v, w: jump(w, u) * v,
    "field": lambda u, v, w: w.varying * u * v,
    "dofs": lambda u, v, w: w.dofs * u * v,
    "held": lambda u, v, w: VARYING * u * v,
    "held cellwise": lambda u, v, w: np.arange(1.0, 1 + CELLS)[:, None] * u * v,
    "caught": caught,
    "copied": lambda u, v, w: w.copy().get("x", [1.0])[0] * u * v,
    "unpacked": unpacked,
    "items": lambda u, v, w: len(list(w.items())) * u * v,
}


def same(found, expected):
    return np.abs(found - expected).max() <= 1e-14 * np.abs(expected).max()


@pytest.mark.parametrize("name", NEED_SCIKIT_FEM)
def test_forms_that_vary_inside_a_cell(name, caplog, capsys):
    form = BilinearForm(NEED_SCIKIT_FEM[name])
    fields = {"varying": VARYING, "dofs": np.random.default_rng(1).random(BASIS.N)}
    if name in ("items", "unpacked", "copied"):
        fields = {}
    with caplog.at_level(logging.DEBUG, logger="skfem_adini.assembly.assemble"):
        found = assemble(form, MESH, ELEMENT, verbose=True, **fields)
    assert same(found, asm(form, BASIS, **fields))
    assert "by scikit-fem" in caplog.text
    assert "by scikit-fem" in capsys.readouterr().out
    with pytest.raises(InputError, match="fallback"):
        assemble(form, MESH, ELEMENT, fallback=False, **fields)


def test_constant_integrands_and_unused_fields_are_fine(caplog):
    form = BilinearForm(lambda u, v, w: 1.0)
    assert same(assemble(form, MESH, ELEMENT, fallback=False), asm(form, BASIS))
    with caplog.at_level(logging.DEBUG, logger="skfem_adini.assembly.assemble"):
        found = assemble(laplace, MESH, ELEMENT, fallback=False, varying=VARYING)
    assert same(found, asm(laplace, BASIS))
    assert "classes of 15 cells" in caplog.text


def test_a_form_that_holds_an_array_over_as_many_cells_as_there_are_entries():
    """The fast path must not take the 144 entries of one local matrix for the 144 cells."""
    ticks = np.linspace(0, 1, 13)
    mesh = MeshQuad.init_tensor(ticks, ticks)
    basis = Basis(mesh, ELEMENT)
    held = np.random.default_rng(2).uniform(1, 2, (144, 1))
    for form in (
        BilinearForm(lambda u, v, w: held * u * v),
        BilinearForm(lambda u, v, w: (held + basis.global_coordinates()[0]) * u * v),
    ):
        assert same(assemble(form, mesh, ELEMENT), asm(form, basis))


NUMBERS = {
    "column": np.linspace(1, 2, CELLS)[:, None],
    "field": DiscreteField(np.repeat(np.linspace(1, 2, CELLS)[:, None], BASIS.W.size, axis=1)),
    "vector": np.linspace(1, 2, CELLS),
    "one column": DiscreteField(np.linspace(1, 2, CELLS)[:, None]),
    "few": np.where(np.arange(CELLS) % 2, 1.0, 3.0)[:, None],
    "whole": np.arange(1, 1 + CELLS)[:, None],
    "complex": np.linspace(1, 2, CELLS)[:, None] * (1 + 1j),
    "scalar": 2.5,
}


@pytest.mark.parametrize("name", NUMBERS)
def test_coefficients_that_enter_in_any_way(name):
    dtype = np.complex128 if name == "complex" else np.float64
    k = np.asarray(NUMBERS[name])
    meant = k[:, None] if k.ndim == 1 else NUMBERS[name] if k.ndim == 0 else k
    for power in (1.0, 2.0, -0.5):
        form = BilinearForm(lambda u, v, w, p=power: np.array(w.k) ** p * u * v, dtype=dtype)
        found = assemble(form, MESH, ELEMENT, fallback=False, k=NUMBERS[name])
        assert same(found, asm(form, BASIS, k=meant))


def test_interpolated_constants_with_their_gradient():
    """A field that is constant in each cell comes with a gradient, which is zero and constant."""
    steps = Basis(MESH, skfem.ElementQuad0(), quadrature=BASIS.quadrature)
    field = steps.interpolate(np.arange(1.0, 1 + CELLS))
    form = BilinearForm(lambda u, v, w: w.k * u * v + w.k.grad[0] * u * v)
    assert same(assemble(form, MESH, ELEMENT, fallback=False, k=field), asm(form, BASIS, k=field))


class Shifted(skfem.ElementQuad1):
    """An element whose functions depend on where the cell lies."""

    def gbasis(self, mapping, X, i, tind=None):
        (field,) = super().gbasis(mapping, X, i, tind)
        x = mapping.F(X, tind)[0]
        return (DiscreteField((1 + x) * np.array(field), grad=field.grad),)


def test_elements_and_bases_that_need_scikit_fem():
    mass = BilinearForm(lambda u, v, w: u * v)
    mesh = MeshQuad().refined(2)
    triangles = MeshTri().refined(1)
    cases = [
        (mesh, Shifted()),
        (triangles, skfem.ElementTriArgyris()),
        (skfem.FacetBasis(mesh, ELEMENT), None),
    ]
    for where, element in cases:
        basis = where if element is None else Basis(where, element)
        assert same(assemble(mass, where, element), asm(mass, basis))
        with pytest.raises(InputError, match="needs scikit-fem"):
            assemble(mass, where, element, fallback=False)


def test_functionals_pairs_of_bases_no_cells_and_broken_forms():
    area = Functional(lambda w: 1.0 + 0 * w.x[0])
    assert assemble(area, MESH, ELEMENT) == pytest.approx(1.5, rel=1e-14)
    pair = [BASIS, BASIS]
    assert same(assemble(laplace, pair, pair), asm(laplace, pair, pair))
    found = assemble(laplace, MESH, ELEMENT, elements=np.empty(0, dtype=int))
    assert found.shape == (BASIS.N, BASIS.N)
    assert found.nnz == 0
    with pytest.raises(AttributeError, match="missing"):
        assemble(lambda u, v, w: u * v * w.missing, MESH, ELEMENT)
