"""The cost of a formula is linear in its length."""

import numpy as np

from cip import Grid, Solver, Velocity
from cip.formulas.expression import ordered

WAVES = 200


def series(count):
    waves = range(1, count + 1)
    return " + ".join(f"{1 / k**3!r}*sin({k}*x1 + {k % 7}*t)" for k in waves)


def test_a_sum_of_two_hundred_sines():
    """Unsteady, so that its feet would be compiled: against the same sum by its values."""
    grid = Grid((0, 2 * np.pi), 32, periodic=True)
    solver = Solver(grid, Velocity.from_expression(series(WAVES)))
    state = solver.state("sin(x1)")
    k = np.arange(1, WAVES + 1)

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
