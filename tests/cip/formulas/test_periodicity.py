"""A velocity on a periodic grid is periodic itself, or is refused, or warned of."""

import ast
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cip import Grid, InputError, PeriodicityWarning, Solver, SplineVelocity, Velocity

LINE = Grid((0, 1), 16, periodic=True)
PLANE = Grid([(0, 1), (-1, 1)], (8, 8), periodic=True)
HALF = Grid([(0, 1), (-1, 1)], (8, 8), periodic=(True, False))
SPACE = Grid([(0, 1)] * 3, (8, 8, 8), periodic=True)
formulas = Velocity.from_expression

JUMPS = {
    "a formula": (LINE, formulas("1 + x1")),
    "a callable that is traced": (LINE, lambda x: x),
    "a callable by its values": (LINE, lambda x: np.where(x > -9, x, 0.0)),
    "a turning plane": (PLANE, formulas("-x2", "x1 - 0.5")),
    "one component": (PLANE, [1.0, lambda x, y: np.sin(y)]),
    "one of three": (SPACE, formulas("1", "1", "x3")),
    "a narrow stream": (
        Grid([(0, 1)] * 2, (160, 160), periodic=True),
        formulas("exp(-((x1 - 0.95)/0.02)**2 - ((x2 - 0.5)/0.02)**2)", "0"),
    ),
    "in x alone": (HALF, formulas("x2", "x1")),
    "half a wave": (LINE, formulas("cos(pi*x1)")),
    "at other times than 0": (LINE, formulas("x1*sin(t)")),
    "a wave that moves": (LINE, formulas("sin(6*x1 - t)")),
    "an unsteady callable": (LINE, Velocity(lambda x, t=0.0: t * x)),
}
FINE = {
    "a number": (LINE, 1.0),
    "a wave": (LINE, lambda x: np.sin(2 * np.pi * x)),
    "a wave by its values": (LINE, lambda x: np.where(x > -9, np.sin(2 * np.pi * x), 0.0)),
    "a constant by its values": (LINE, lambda x: np.where(x > -9, 0.3, 0.0)),
    "far from 0": (Grid((1e6, 1e6 + 1), 16, periodic=True), lambda x: np.sin(2 * np.pi * x)),
    "it turns back itself": (LINE, lambda x: np.sin(np.pi * np.mod(x, 1.0)) ** 2),
    "a narrow vortex": (
        Grid([(0, 1)] * 2, (160, 160), periodic=True),
        formulas(*["exp(-((x1 - 0.95)/0.01)**2 - ((x2 - 0.5)/0.01)**2)"] * 2),
    ),
    "a narrow vortex by its values": (
        Grid([(0, 1)] * 2, (160, 160), periodic=True),
        [lambda x, y: np.where(x > -9, np.exp(-2500 * ((x - 0.12) ** 2 + (y - 0.9) ** 2)), 0.0)]
        * 2,
    ),
    "far tails": (LINE, lambda x: np.exp(-200 * (x - 0.4) ** 2)),
    "a wave that moves": (LINE, formulas("sin(2*pi*(x1 - t))")),
    "not periodic across the walls": (HALF, formulas("x2", "sin(2*pi*x1)*(1 - x2)")),
    "nodal values": (LINE, [np.linspace(0, 1, 16)]),
    "snapshots": (LINE, Velocity.from_snapshots([0, 1], np.arange(32.0).reshape(2, 16), LINE)),
    "splines": (LINE, SplineVelocity(LINE, 6, lambda x: x)),
    "undefined at some times": (LINE, formulas("sin(2*pi*x1)*log(t - 1)")),
}


@pytest.mark.parametrize("name", JUMPS)
def test_jumps_are_refused(name):
    grid, velocity = JUMPS[name]
    with pytest.raises(InputError, match=r"velocity: c\d is not periodic in [xyz]"):
        Solver(grid, velocity)


@pytest.mark.parametrize(("turn", "walls"), [(PLANE, "xy"), (HALF, "x")])
def test_the_remedy_that_the_message_names_is_one(turn, walls):
    """A body that turns about the middle of the box, and the tracer vanishes at the sides."""
    flow = formulas("-x2", "x1 - 0.5")
    for wall in walls:
        with pytest.raises(InputError) as said:
            Solver(turn, flow)
        known = turn.periodic
        assert f"not periodic in {wall} (periodic=" in str(said.value)
        text = re.search(r"\(periodic=(.*?)\) and", str(said.value))[1]
        turn = Grid(turn.bounds, turn.cells, periodic=ast.literal_eval(text))
        assert sum(turn.periodic) == sum(known) - 1
    solver = Solver(turn, flow, boundary=0.0)
    state = solver.step(solver.state("exp(-40*(x1 - 0.5)**2 - 40*x2**2)"), 0.05)
    assert np.isfinite(state.data).all()


@pytest.mark.parametrize("name", FINE)
def test_no_false_alarm(name):
    """Warnings are errors in these tests."""
    Solver(*FINE[name])


@pytest.mark.parametrize(
    ("c", "what"),
    [
        (lambda x: x * (1 - x), "the derivative of c1 across the side"),
        (lambda x: 1 + 5e-4 * x, "c1"),
        (lambda x: np.abs(np.sin(np.pi * x)), "the derivative of c1 across the side"),
    ],
)
def test_kinks_and_small_jumps_are_warned_of(c, what):
    with pytest.warns(PeriodicityWarning, match=f"velocity: {what} is not periodic in x"):
        Solver(LINE, c)


def test_a_parameter_may_not_open_the_field():
    solver = Solver(LINE, formulas("a*x1", parameters={"a": 0.0}))
    with pytest.raises(InputError, match="not periodic"):
        solver.with_parameters(a=1.0)


@given(st.integers(1, 5), st.floats(0.02, 0.98), st.floats(-1e3, 1e3), st.floats(0.01, 1e3))
def test_waves_of_whole_and_broken_numbers(count, part, low, length):
    """A wave of a whole number of periods is taken in any box, others are not."""
    grid = Grid((low, low + length), 16, periodic=True)
    text = f"1.5 + sin(2*pi*{{}}*(x1 - ({low!r}))/{length!r})"
    Solver(grid, formulas(text.format(count)))
    if abs(np.sin(2 * np.pi * part)) > 0.01:
        with pytest.raises(InputError, match="not periodic"):
            Solver(grid, formulas(text.format(count + part)))
