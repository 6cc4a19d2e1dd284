"""Formulas: derivatives against SymPy, and cost linear in length."""

import numpy as np
import pytest
import sympy

from cip import Grid, Solver, Velocity
from cip.formulas.expression import (
    ordered,
)

TEXTS = [
    "x1**3*sin(x2) - exp(-t)*x2/(2 + x1**2)",
    "sqrt(1 + x1**2)*tanh(x2*t) + log(3 + x2) - abs(x1 - 2)",
    "(2 + x1)**(x2/3) + arctan(x1*x2)*cosh(t) - arcsin(x1/4)*cos(x2)",
    "tan(x1/3) + sinh(x2)**2 - 3*x1**0.5*pi + e**x2",
]


@pytest.mark.parametrize("text", TEXTS)
def test_derivatives_against_sympy(text):
    names = sympy.symbols("x1 x2 t", real=True)
    known = dict(zip(("x1", "x2", "t"), names, strict=True))
    known |= {"arctan": sympy.atan, "arcsin": sympy.asin, "abs": sympy.Abs, "e": sympy.E}
    reference = sympy.sympify(text.replace("**0.5", "**Rational(1,2)"), locals=known)
    (formula, _) = Velocity.from_expression(text, "0").on(Grid([(0, 1)] * 2, (4, 4)))
    point = (0.7, 0.4, 0.9)
    for orders in (
        (0, 0, 0, 0),
        (1, 0, 0, 0),
        (1, 1, 0, 0),
        (0, 2, 0, 0),
        (2, 1, 0, 0),
        (0, 0, 0, 1),
    ):
        exact = reference
        for name, times in zip(names, (orders[0], orders[1], orders[3]), strict=True):
            exact = sympy.diff(exact, name, times) if times else exact
        exact = float(exact.subs(dict(zip(names, point, strict=True))).evalf())
        found = formula.derivative(orders, (1.0,) * 4)(point[0], point[1], 0.0, point[2])
        assert found == pytest.approx(exact, rel=1e-11, abs=1e-12)


def test_sums_longer_than_the_stack():
    def series(x):
        return sum(np.sin(k * x) / k**3 for k in range(1, 2000))

    (formula,) = Velocity(series).on(Grid((0, 1), 4))
    assert formula.exact
    slope = formula.derivative((1, 0, 0, 0), (1.0,) * 4)(0.3, 0.0, 0.0, 0.0)
    assert slope == pytest.approx(sum(np.cos(0.3 * k) / k**2 for k in range(1, 2000)), rel=1e-12)


@pytest.mark.parametrize("c", [np.int64(2), np.float32(2), np.array(2.0), [np.int64(2)], 2])
def test_every_kind_of_number(c):
    (formula,) = Velocity(c).on(Grid((0, 1), 4))
    assert formula.derivative((0, 0, 0, 0), (1.0,) * 4)(0.3, 0.0, 0.0, 0.0) == 2.0


def series(count):
    waves = range(1, count + 1)
    return " + ".join(f"{1 / k**3!r}*sin({k}*x1 + {k % 7}*t)" for k in waves)


def test_a_sum_of_two_hundred_sines():
    """Unsteady, so that its feet would be compiled: against the same sum by its values."""
    grid = Grid((0, 2 * np.pi), 32, periodic=True)
    solver = Solver(grid, Velocity.from_expression(series(200)))
    state = solver.state("sin(x1)")
    k = np.arange(1, 200 + 1)

    def phase(x, t):
        return np.multiply.outer(x, k) + np.multiply.outer(np.broadcast_to(t, x.shape), k % 7)

    def by_values(x, t):
        return np.sin(phase(x, t)) @ (1 / k**3)

    def slope(x, t):
        return np.cos(phase(x, t)) @ (1 / k**2)

    peer = Solver(grid, Velocity(by_values, jacobian=slope, steady=False))
    found, expected = solver.step(state, 0.1), peer.step(state, 0.1)
    np.testing.assert_allclose(found.data, expected.data, rtol=0, atol=1e-7)


def test_equations_grow_with_the_formula_and_no_faster():
    """Counted in operations, not in seconds."""
    sizes = []
    for count in (50, 100, 200):
        field = Velocity.from_expression(series(count), series(count).replace("x1", "x2"))
        solver = Solver(
            Grid([(0, 2 * np.pi)] * 2, (8, 8), periodic=True), field, "advection", "bicubic",
            store_feet=False,
        )  # fmt: skip
        sizes.append(len(ordered(solver._stages[0].system.rates)))
    assert sizes[1] <= 2.1 * sizes[0]
    assert sizes[2] <= 2.1 * sizes[1]
