"""Residuals in pairs of numbers are those of the stored numbers: rational arithmetic says so."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from certified_cases import in_pairs
from exact_residuals import exact_block_forces, exact_residuals, exact_strained_forces
from skfem import ElementQuad1, ElementQuad2, ElementTriP1

from contact import ElasticBody, LayeredBlock, recheck
from contact.checks.paired_bodies import paired_body
from skfem_adini import ElementQuadAdini


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuadAdini], ids=lambda e: e.__name__)
def test_residuals_are_those_of_the_stored_numbers(element, make):
    """Against rational arithmetic, down to 1e-17, where those of float64 are their rounding."""
    result = make.solved(n=3, element=element)[1]
    exact, found, rounded = exact_residuals(result), recheck(result), result.kkt
    for name, value in exact.items():
        assert abs(found[name] - value) <= 1e-9 * value, name
    assert abs(rounded["equilibrium"] - exact["equilibrium"]) > 1e-3 * exact["equilibrium"]
    rng = np.random.default_rng(3)
    state = {"u": result.u, "mu": result.mu, "t": result.t}
    for size in (1e-13, 1e-8):  # of what violates the laws
        noise = {name: 1 + size * rng.standard_normal(v.shape) for name, v in state.items()}
        wrong = replace(result, **{name: v * noise[name] for name, v in state.items()})
        exact, found = exact_residuals(wrong), in_pairs(wrong)
        for name, value in exact.items():
            assert abs(found[name] - value) <= 1e-9 * value, name
            assert value > 0 or name in ("sign", "cone", "support") or size == 1e-13, name


@pytest.mark.parametrize("element", [ElementTriP1, ElementQuad1], ids=lambda e: e.__name__)
def test_forces_of_strains_are_exact(element, make):
    """Of cells a million times as long as wide, against rational arithmetic."""
    x, y = np.linspace(0, 1, 3), 1e6 * np.linspace(0, 0.5, 3)
    body = ElasticBody.from_mesh(make.box(element, x, y), element(), E=2.0, nu=0.3)
    rng = np.random.default_rng(6)
    u = rng.standard_normal(body.ndofs) * 10.0 ** rng.integers(-3, 4, body.ndofs)
    exact, found = exact_strained_forces(body, u), paired_body(body).internal(u).rounded
    size = max(abs(f) for f in exact)
    np.testing.assert_allclose(found, exact.astype(float), rtol=1e-15, atol=1e-28 * float(size))
    # Without them: the sums of float64 lose six digits of what its sums of moduli have.
    assert np.abs(body.internal(u) - exact.astype(float)).max() > 1e-18 * float(size)


def test_forces_of_a_block_are_exact():
    """Of its element matrices, against rational arithmetic."""
    block = LayeredBlock(1.0, [(0.25, 1, 1.0, 0.4), (0.5, 2, 10.0, 0.3)], columns=3)
    rng = np.random.default_rng(7)
    u = rng.standard_normal(block.ndofs) * 10.0 ** rng.integers(-3, 4, block.ndofs)
    exact, found = exact_block_forces(block, u), paired_body(block).internal(u)
    size = max(abs(f) for f in exact)
    for force, high, low in zip(exact, found.high, found.low, strict=True):
        assert abs(force - Fraction(high) - Fraction(low)) <= size / 2**98


def test_a_solution_is_equilibrated_to_the_rounding_of_its_displacement(make):
    """No rounding is added: what is left is less than that of one number among the forces."""
    for element in (ElementQuad1, ElementQuad2, ElementQuadAdini):
        result = make.solved(n=8, element=element)[1]
        assert recheck(result)["equilibrium"] < 4 * np.finfo(float).eps
