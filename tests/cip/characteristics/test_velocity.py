"""Formulas, their derivatives, and the characteristics against independent answers."""

import numpy as np
import pytest
import sympy
from convergence import order
from problems import foot_inside, speed

from cip import Grid, Solver, Velocity
from cip.characteristics.feet import FEET, integrate
from cip.characteristics.flow_derivatives import System, foot
from cip.engines.engine import LIMITS

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


@pytest.mark.parametrize(
    "c",
    [
        lambda x: np.sinc(x),
        lambda x: np.where(x == 0, 1.0, 1.5 + np.sin(x)),
        lambda x: 2.0 * (x != 0.5),
        np.vectorize(lambda x: 0.0 if x == 0 else np.cos(x)),
    ],
)
def test_a_comparison_is_not_decided_once_for_all_points(c):
    grid = Grid((-1, 1), 8, periodic=True)
    (formula,) = Velocity(c).on(grid)
    assert not formula.exact
    x = grid.coordinates[0]
    np.testing.assert_array_equal(formula.derivative((0, 0, 0, 0), (1.0,) * 4)(x, 0, 0, 0.0), c(x))


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


def test_characteristics_against_the_closed_form():
    grid = Grid((-2, 2), 60)
    formulas = Velocity(speed).on(grid)
    system = System([f.expression for f in formulas], [0], [foot(0, 0), foot(0, 0, 0)])
    found = integrate(grid, formulas, system, grid.mesh(), 0.0, 0.3)
    x = grid.coordinates[0]
    exact = foot_inside(x, 0.3)
    inside = np.isfinite(exact)
    assert set(np.flatnonzero(~inside)) <= set(found.exits.nodes)
    inside[found.exits.nodes] = False
    np.testing.assert_allclose((x + found.jets[foot(0)])[inside], exact[inside], atol=1e-10)
    d = np.where(inside, 1 - x**2 + x**2 * np.exp(-0.6), 1)
    np.testing.assert_allclose(
        found.jets[foot(0, 0)][inside], (np.exp(-0.3) * d**-1.5)[inside], rtol=1e-8
    )
    # Age of a path that comes in through the wall: from 2 to |x| along dx/dt = x - x^3.
    inner = (found.exits.nodes > 0) & (found.exits.nodes < 60)

    def clock(x):
        return np.log(x) - np.log(np.abs(1 - x**2)) / 2

    age = clock(np.abs(x[found.exits.nodes[inner]])) - clock(2.0)
    np.testing.assert_allclose(found.exits.ages[inner], age, atol=1e-8)


SLOW = pytest.mark.slow
KINDS = ["traced", pytest.param("values", marks=SLOW), "jacobian", "arrays", "expression"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_velocity_gives_the_same_step(kind):
    grid = Grid([(0, 2 * np.pi)] * 2, (24, 24), periodic=True)

    def c(x, y):
        return np.sin(y) + 0.3, 0.4 * np.cos(x)

    def branched(x, y):
        return np.where(x > 1e9, x, np.sin(y) + 0.3), 0.4 * np.cos(x)

    def jacobian(x, y):
        return [[0 * x, np.cos(y)], [-0.4 * np.sin(x), 0 * x]]

    velocity = {
        "traced": lambda: Velocity(c),
        "values": lambda: Velocity(branched),
        "jacobian": lambda: Velocity(branched, jacobian=jacobian),
        "arrays": lambda: Velocity(np.array(c(*grid.mesh()))),
        "expression": lambda: Velocity.from_expression("sin(x2) + 0.3", "0.4*cos(x1)"),
    }[kind]()
    assert all(f.exact for f in velocity.on(grid)) == (kind in ("traced", "expression"))
    solver = Solver(grid, velocity, profile="bicubic")
    after = solver.step(solver.state("sin(x1)*cos(2*x2)"), 0.4)
    reference = Solver(
        grid, Velocity.from_expression("sin(x2)+0.3", "0.4*cos(x1)"), profile="bicubic"
    )
    expected = reference.step(reference.state("sin(x1)*cos(2*x2)"), 0.4)
    # Quintic splines and sixth-order differences on 24 nodes a period.
    tolerance = {"arrays": 2e-5, "values": 1e-6, "jacobian": 1e-6}.get(kind, 1e-12)
    np.testing.assert_allclose(after.data, expected.data, atol=tolerance)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("stored", [True, False])
def test_unsteady_velocity_has_order_three(stored):
    """u_t + cos(t) u_x = 0: the exact shift is sin t."""
    errors, sizes = [], (20, 40, 80)
    for n in sizes:
        grid = Grid((0, 1), n, periodic=True)
        solver = Solver(grid, Velocity.from_expression("cos(t)"), store_feet=stored)
        run = solver.run(solver.state("sin(2*pi*x1)"), 1.0, dt=0.7 / n)
        exact = np.sin(2 * np.pi * (grid.coordinates[0] - np.sin(1.0)))
        errors.append(np.abs(run.final["u"] - exact).max())
    assert 2.9 <= order(sizes, errors) <= 3.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "shift"), [("20*exp(-((t-0.5)/0.02)**2)", 0.4 * np.sqrt(np.pi)), ("t**7", 0.125)]
)
def test_substeps_of_a_velocity_that_changes_between_two_counts(text, shift):
    """A pulse between two of the times at which sub-steps are counted anew."""
    grid = Grid((0, 1), 64, periodic=True)
    solver = Solver(grid, Velocity.from_expression(text), profile="quintic")
    run = solver.run(solver.state("sin(2*pi*x1)"), 1.0, dt=0.05)
    exact = np.sin(2 * np.pi * (grid.coordinates[0] - shift))
    np.testing.assert_allclose(run.final["u"], exact, atol=1e-7)


@pytest.mark.slow
def test_compiled_feet_of_a_vortex_between_the_sampled_nodes(monkeypatch):
    """Against NumPy's feet, whose sub-steps are found on all nodes; a sample of four sees none."""
    monkeypatch.setattr("cip.engines.engine.LIMITS", LIMITS._replace(compiled=0))
    monkeypatch.setattr("cip.stages.stage.FEET", FEET._replace(sample=4))
    bell = "exp(-200*((x1-0.3)**2 + (x2-0.6)**2))"
    field = Velocity.from_expression(f"-9*(x2-0.6)*{bell}", f"9*(x1-0.3)*{bell}")
    solver = Solver(Grid((0, 1), (20, 20), periodic=True), field, profile="adini")
    (stage,) = solver._stages
    compiled = solver.feet(stage, 0.0, 0.5).data
    assert solver._kernels._counts[stage.part(0.5)][-1] > stage.substeps(0.0, 0.5)
    np.testing.assert_allclose(compiled, stage.feet(0.0, 0.5).data, rtol=0, atol=1e-8)


def test_partial_steps_have_their_own_feet():
    """The cache is keyed by dt: a short last step must not use the feet of a long one."""
    grid = Grid((0, 1), 64, periodic=True)
    solver = Solver(grid, lambda x: 1 + 0 * x, profile="quintic")
    run = solver.run(solver.state("sin(2*pi*x1)"), 0.25, dt=0.1)
    exact = np.sin(2 * np.pi * (grid.coordinates[0] - 0.25))
    np.testing.assert_allclose(run.final["u"], exact, atol=1e-8)


@pytest.mark.parametrize("steepness", [0.1, 3.0, 10.0])
def test_substeps_follow_the_steepness(steepness):
    """dx/dt = k sin(2 pi x) has tan(pi x(t)) = tan(pi x) exp(2 pi k t); |c'| dt is `steepness`."""
    grid, dt = Grid((0.01, 1.01), 40, periodic=True), 0.5  # no node where c = 0
    k = steepness / (2 * np.pi * dt)
    formulas = Velocity.from_expression(f"{k!r}*sin(2*pi*x1)").on(grid)
    system = System([f.expression for f in formulas], [0], [foot(0, 0)])
    x = grid.coordinates[0]
    found = integrate(grid, formulas, system, [x], 0.0, dt)
    shrink = np.exp(-steepness)
    exact = np.arctan2(shrink * np.sin(np.pi * x), np.cos(np.pi * x)) / np.pi
    miss = x + found.jets[foot(0)] - exact
    np.testing.assert_allclose(miss - np.round(miss), 0, atol=3e-11)
    slope = shrink / (np.cos(np.pi * x) ** 2 + (shrink * np.sin(np.pi * x)) ** 2)
    np.testing.assert_allclose(found.jets[foot(0, 0)], slope, rtol=3e-9)
    assert steepness / 2 <= found.substeps <= 512 * (1 + steepness)


@pytest.mark.parametrize(
    ("profile", "dim", "splitting"),
    [
        ("adini", 2, None),
        pytest.param("bicubic", 2, None, marks=SLOW),
        pytest.param("quintic", 1, None, marks=SLOW),
        pytest.param("csl4", 1, None, marks=SLOW),
        pytest.param("cubic", 3, "strang", marks=SLOW),
    ],
)
def test_single_precision_follows_double(profile, dim, splitting):
    grid = Grid([(0, 1)] * dim, (32,) * dim, periodic=True)
    field = ("0.3 + 0.1*sin(2*pi*x1)",) if dim == 1 else ("sin(2*pi*x2)", "cos(2*pi*x1)", "0.4")
    ends = []
    for dtype in (np.float64, np.float32):
        form = "advection" if profile == "csl4" else "transport"
        solver = Solver(
            grid, Velocity.from_expression(*field[:dim]), form, profile, splitting=splitting,
            dtype=dtype,
        )  # fmt: skip
        final = solver.run(solver.state("sin(2*pi*x1)"), 0.3, dt=0.05).final
        assert final["u"].dtype == dtype
        ends.append(final["u"])
    np.testing.assert_allclose(ends[1], ends[0], atol=5e-6)
