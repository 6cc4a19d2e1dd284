"""Gradients in reverse mode: against derivatives taken forward, one variable at a time."""

import numpy as np
import pytest

from cip.formulas.expression import (
    COORDINATES,
    apply,
    gradient,
    numpy_function,
    opaque,
    ordered,
    variable,
)

NAMES = ("x1", "x2", "a", "b")
X, Y, A, B = (variable(name) for name in NAMES)
FORMULAS = {
    "sums": A + 2.0 * B - X + (X - Y) + A,
    "products": (A * X + B) * (X * Y - A) * (A * X + B),
    "quotients": (A + X) / (2.0 + B * B) - 1.0 / (Y + 3.0),
    "powers": (2.0 + X) ** 3.0 + (2.0 + A) ** B,
    "functions": apply("sin", A * X) * apply("exp", apply("cos", B * Y)) + apply("sqrt", 3.0 + X),
    "no variable": X * 0.0 + 1.0,
}
# A function known by its values and slopes: f = x1^2 x2.
OPAQUE = {
    "f_0000": lambda x1, x2, x3, t: x1**2 * x2,
    "f_1000": lambda x1, x2, x3, t: 2 * x1 * x2,
    "f_0100": lambda x1, x2, x3, t: x1**2,
}


@pytest.mark.parametrize("name", FORMULAS)
def test_reverse_is_forward(name):
    formula, point = FORMULAS[name], np.random.default_rng(5).uniform(-1, 1, (4, 7))
    expected = numpy_function([formula.derivative(v) for v in NAMES], NAMES)(*point)
    found = numpy_function(gradient(formula, NAMES), NAMES)(*point)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one + 0 * point[0], other + 0 * point[0], rtol=1e-13, atol=1e-14)


def test_functions_known_by_values():
    formula = A * opaque("f", (0, 0, 0, 0)) * X + B
    arguments = [*COORDINATES, "a", "b"]
    point = np.random.default_rng(6).uniform(-1, 1, (6, 9))
    x, y, a = point[0], point[1], point[4]
    found = numpy_function(gradient(formula, ["x1", "x2", "a", "b"]), arguments, OPAQUE)(*point)
    expected = (3 * a * x**2 * y, a * x**3, x**3 * y, np.ones(9))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one + 0 * x, other, rtol=1e-13, atol=1e-15)


def test_the_work_does_not_grow_with_the_number_of_variables():
    """The gradient of a product of n factors has about 3 n operations, not n^2."""

    def operations(n):
        names = [f"y{q}" for q in range(n)]
        product = variable(names[0])
        for name in names[1:]:
            product = product * variable(name)
        return len(ordered(gradient(product, names)))

    assert operations(80) <= 4 * 80
    assert operations(80) <= 2.2 * operations(40)
