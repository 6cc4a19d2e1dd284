"""Nearly incompressible bodies: how far each element goes, and mean dilatation all the way.

The oracles are Hertz' closed form, the mixed method with one pressure a cell, and uniform strain.
"""

import warnings
from contextlib import nullcontext

import numpy as np
import pytest
from convergence import order
from example_scripts import load
from scipy import sparse
from skfem import (
    Basis,
    BilinearForm,
    ElementHex0,
    ElementHex1,
    ElementHex2,
    ElementQuad0,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
)
from skfem.helpers import ddot, div, sym_grad

from contact import ContactProblem, ContactWarning, ElasticBody, Parabola
from skfem_adini import ElementHexAdini, ElementQuadAdini


@pytest.fixture(scope="module")
def half_space():
    """The helpers of the validation examples."""
    return load("half_space")


@pytest.fixture(scope="module")
def hertz(half_space):
    def error(element, nu, cells, dilatation="pointwise"):
        """Rms of the pressure over p0 in |x| < .8 a, Hertz' line contact."""
        mesh = half_space.quarter(1 / cells, 1.25, 100.0)
        locks = element is ElementQuad1 and dilatation == "pointwise" and nu > 0.48
        with pytest.warns(ContactWarning, match="locks") if locks else nullcontext():
            body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=nu, dilatation=dilatation)
        force = np.pi / (1 - nu**2) / 80
        half_space.load_far_field(body.fix("left", "x"), (0.0, force), "right top")
        result = ContactProblem(body, "bottom", Parabola((0.0, 0.0), 20.0)).solve()
        x = result.x[0]
        inside = x < 0.8
        missed = result.pressure[inside] * np.pi / (2 * force) - np.sqrt(1 - x[inside] ** 2)
        return float(np.sqrt(np.mean(missed**2)))

    return error


@pytest.mark.parametrize(
    ("element", "nu", "dilatation"),
    [
        (ElementQuadAdini, 0.499, "pointwise"),
        (ElementQuad2, 0.49, "pointwise"),
        (ElementQuad1, 0.45, "pointwise"),
        (ElementQuad1, 0.4999, "mean"),
    ],
)
def test_elements_can_be_trusted_as_far_as_the_table_says(element, nu, dilatation, hertz):
    """Within .6 % of p0 at a / h = 8."""
    assert hertz(element, nu, 8, dilatation) < 0.006


@pytest.mark.parametrize("nu", [0.3, 0.4999])
def test_mean_dilatation_keeps_its_order(nu, hertz):
    """2.5 over a factor of four in h, and the size of the error forgets nu."""
    cells = [4, 8, 16]
    errors = [hertz(ElementQuad1, nu, n, "mean") for n in cells]
    assert order(cells, errors) == pytest.approx(2.4, abs=0.4)
    assert errors[-1] < 6e-4
    # The table's other side: pointwise dilatation locks.
    if nu > 0.4:
        assert hertz(ElementQuad1, nu, 16) > 0.2


def body_of(make, element, nu, dilatation="mean"):
    dim = element().dim
    mesh = make.box(element, *(make.graded,) * (dim - 1), make.graded[:5])
    return ElasticBody.from_mesh(mesh, element(), E=2.0, nu=nu, dilatation=dilatation)


@pytest.mark.parametrize("distorted", [False, True])
@pytest.mark.parametrize(
    ("element", "constant"), [(ElementQuad1, ElementQuad0), (ElementHex1, ElementHex0)]
)
def test_same_as_the_mixed_method_with_a_pressure_a_cell(element, constant, distorted, make):
    nu, rng = 0.49, np.random.default_rng(1)
    mesh = make.box(element, *(np.linspace(0, 1, 4),) * element().dim)
    if distorted:
        mesh = make.remesh(mesh, mesh.p + 0.05 * rng.uniform(-1, 1, mesh.p.shape))
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=nu, dilatation="mean")
    basis = Basis(mesh, ElementVector(element()))
    pressure = basis.with_element(constant())
    lam, mu = 2.0 * nu / (1 + nu) / (1 - 2 * nu), 1.0 / (1 + nu)
    A = BilinearForm(lambda u, v, w: 2 * mu * ddot(sym_grad(u), sym_grad(v))).assemble(basis)
    B = BilinearForm(lambda u, q, w: div(u) * q).assemble(basis, pressure)
    M = BilinearForm(lambda p, q, w: p * q / lam).assemble(pressure)
    mixed = A + B.T @ sparse.diags_array(1 / M.diagonal()) @ B
    assert abs(body.stiffness - mixed).max() < 1e-12 * abs(mixed).max()


@pytest.mark.parametrize("nu", [0.3, 0.4999])
@pytest.mark.parametrize("element", [ElementQuad1, ElementHex1])
def test_contact_patch_test(element, nu, make):
    """Uniform pressure on a graded mesh: pressure, displacement and every stress exact."""
    body = body_of(make, element, nu)
    dim = body.dim
    body.fix("left", "x").load("top", (0.0,) * (dim - 1) + (-0.1,))
    if dim == 3:
        body.fix("front", "y")
    result = ContactProblem(body, "bottom", 0.0).solve()
    # Rounding times the condition, which grows like 1 / (1 - 2 nu).
    np.testing.assert_allclose(result.pressure, 0.1, rtol=1e-9)
    exact = np.zeros((3, 3))
    exact[dim - 1, dim - 1] = -0.1
    if dim == 2:
        exact[2, 2] = -0.1 * nu
    for found in (result.cell_stress(), result.nodal_stress()):
        np.testing.assert_allclose(found, np.broadcast_to(exact[..., None], found.shape), atol=1e-8)
    at = result.stress(np.full((dim, 1), 0.31))[..., 0]
    np.testing.assert_allclose(at, exact[:dim, :dim], atol=1e-8)


def test_stress_takes_the_mean_too(make):
    """A bent body: lambda times the mean of div u, in every point of a cell."""
    body = body_of(make, ElementQuad1, 0.4999).fix("top", "xy", lambda x: -0.02 * x[0])
    result = ContactProblem(body, "bottom", 0.0, 0.3).solve()
    gradient = np.asarray(body.basis.interpolate(result.u).grad)
    lam, mu = 2.0 * 0.4999 / 1.4999 / 0.0002, 1.0 / 1.4999
    mean = np.average(np.trace(gradient), axis=1, weights=body.basis.dx)
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    expected = 2 * mu * strain + lam * mean[:, None] * np.eye(2)[:, :, None, None]
    np.testing.assert_allclose(result.stress(), expected, atol=1e-10 * np.abs(expected).max())
    middle = body.mesh.p[:, body.mesh.t].mean(axis=1)
    np.testing.assert_allclose(
        np.trace(result.stress(middle)),
        2 * lam * mean + 2 * mu * np.trace(body.gradient(result.u, middle)),
        rtol=1e-9,
    )


def stiffer(make, element, nu, cells, dilatation="pointwise"):
    """By how much a bonded block, compressed by a tenth, is stiffer than with finer P2."""

    def force(element, cells, dilatation="pointwise"):
        dim = element().dim
        mesh = make.box(element, *(np.linspace(0, 1, cells + 1),) * dim)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ContactWarning)
            body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=nu, dilatation=dilatation)
        body.fix("top", "xyz"[: dim - 1]).fix("top", dim - 1, -0.1)
        return ContactProblem(body, "bottom", 0.0).solve().contact_force

    fine = {2: ElementTriP2, 3: ElementTetP2}[element().dim]
    return force(element, cells, dilatation) / force(fine, 5 * cells // 3) - 1


def warned(make, element, nu, dilatation, plane="strain"):
    mesh = make.box(element, *(np.linspace(0, 1, 2),) * element().dim)
    options = {"plane": plane} if element().dim == 2 else {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ElasticBody.from_mesh(mesh, element(), E=1.0, nu=nu, dilatation=dilatation, **options)
    assert all(w.category is ContactWarning and w.filename == __file__ for w in caught)
    return " ".join(str(w.message) for w in caught)


LOCKING = [
    (ElementTriP1, "pointwise", "second order"),
    (ElementTetP1, "pointwise", "second order"),
    (ElementQuad1, "pointwise", "dilatation='mean'"),
    (ElementHex1, "pointwise", "dilatation='mean'"),
    (ElementQuad1, "mean", None),
    (ElementHex1, "mean", None),
    *((e, "pointwise", None) for e in (ElementTriP2, ElementQuad2, ElementQuadAdini)),
    *((e, "pointwise", None) for e in (ElementTetP2, ElementHexAdini)),
]


@pytest.mark.parametrize(("element", "dilatation", "remedy"), LOCKING)
def test_elements_that_lock_say_so(element, dilatation, remedy, make):
    """By a quarter at least at .499, on few cells; the warning names the way out."""
    plane = element().dim == 2
    cells = (12 if remedy else 6) if plane else 3
    off = stiffer(make, element, 0.499, cells, dilatation)
    said = warned(make, element, 0.499, dilatation)
    if remedy is None:
        assert abs(off) < 0.06
        assert not said
    else:
        assert off > 0.25
        assert remedy in said
        assert stiffer(make, element, 0.3, cells) < 0.05
        assert not warned(make, element, 0.45, "pointwise")
        assert not plane or not warned(make, element, 0.499, "pointwise", "stress")


@pytest.mark.parametrize("element", [ElementQuad2, ElementHex2])
def test_biquadratic_pressure_oscillates_at_last(element, make):
    assert "oscillates" in warned(make, element, 0.4999, "pointwise")
    assert not warned(make, element, 0.499, "pointwise")


def test_material_set_anew_warns_too(make):
    body = body_of(make, ElementQuad1, 0.3, "pointwise")
    with pytest.warns(ContactWarning, match="locks"):
        body.nu = 0.4999
