"""The weighted element vanishes on the boundary and has order six on the disk."""

import numpy as np
import pytest
from skfem import Basis, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdiniWeighted,
    InputError,
    lowest_eigenpairs,
)


def omega(x):
    return 0.411**2 - (x[0] - 0.5) ** 2 - (x[1] - 0.5) ** 2


def slope(x):
    return 1 - 2 * x


def test_disk(cut_problems, convergence_order):
    exact = cut_problems.disk_eigenvalues(1)[0]
    element, errors = ElementQuadAdiniWeighted(omega, slope), []
    for n in (8, 16, 32):
        mesh = cut_problems.unit_square(n)
        domain = CutDomain(mesh, lambda x: -omega(x))
        A, M = (domain.assemble(form, element) for form in (laplace, mass))
        extension = AdiniExtension(Basis(mesh, element, intorder=1), domain)
        A, M = extension.apply(A, M)
        errors.append(abs(lowest_eigenpairs(A, M, 1, shift=0.0)[0][0] / exact - 1))
    assert errors[-1] <= 5e-11
    assert convergence_order([8, 16, 32], errors) == pytest.approx(6, abs=0.4)


def test_every_function_vanishes_on_the_boundary(cut_problems):
    element = ElementQuadAdiniWeighted(omega, slope)
    domain = CutDomain(cut_problems.unit_square(8), lambda x: -omega(x))
    boundary = domain.boundary(element)
    x = np.random.default_rng(0).uniform(-1, 1, boundary.N)
    assert np.abs(np.asarray(boundary.interpolate(x))).max() < 1e-12
    assert np.abs(boundary.interpolate(x).grad).max() > 0.1


def test_derivatives_are_those_of_the_values():
    """Central differences of values and of gradients."""
    mesh = MeshQuad.init_tensor(np.array([0, 0.4, 1.0]), np.array([0, 0.7, 1.0]))
    element = ElementQuadAdiniWeighted(
        lambda x: np.exp(x[0]) * np.sin(x[1] + 1),
        lambda x: np.exp(x[0]) * np.array([np.sin(x[1] + 1), np.cos(x[1] + 1)]),
        lambda x: np.exp(x[0]) * np.array(
            [[np.sin(x[1] + 1), np.cos(x[1] + 1)], [np.cos(x[1] + 1), -np.sin(x[1] + 1)]]
        ),
        derivatives=2,
    )  # fmt: skip
    mapping, d = mesh._mapping(), 1e-5
    point = np.array([[0.3], [0.6]])
    jacobian = mapping.DF(point)[:, :, :, 0]
    for i in range(12):
        (here,) = element.gbasis(mapping, point, i)
        by_reference, second = [], []
        for k in range(2):
            step = d * np.eye(2)[:, k : k + 1]
            (plus,), (minus,) = (element.gbasis(mapping, point + s * step, i) for s in (1, -1))
            by_reference.append((np.asarray(plus) - np.asarray(minus))[:, 0] / (2 * d))
            second.append((plus.grad - minus.grad)[..., 0] / (2 * d))
        grad = np.einsum("jic,ic->jc", np.linalg.inv(jacobian.T).transpose(1, 2, 0), by_reference)
        hess = np.einsum("kic,ijc->kjc", np.linalg.inv(jacobian.T).transpose(1, 2, 0), second)
        np.testing.assert_allclose(here.grad[..., 0], grad, atol=1e-8)
        np.testing.assert_allclose(here.hess[..., 0], hess, atol=1e-8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1.0, slope), "weight: expected a function"),
        ((omega, None), "gradient: expected a function"),
        ((omega, slope, None, 2), "derivatives: expected"),
        ((omega, slope, None, 1, -1), "degree: expected"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(InputError, match=message):
        ElementQuadAdiniWeighted(*arguments)


@pytest.mark.parametrize(
    ("weight", "gradient", "message"),
    [
        (lambda x: x, slope, "weight: the function returned shape"),
        (lambda x: x[0] * np.nan, slope, "weight: the function returned NaN"),
        (omega, omega, "gradient: the function returned shape"),
    ],
)
def test_bad_functions(weight, gradient, message):
    with pytest.raises(InputError, match=message):
        Basis(MeshQuad(), ElementQuadAdiniWeighted(weight, gradient))
