"""Formulas, their parameters, callables: derivatives, what is no function of the place, periods."""

import ast
import keyword
import re

import numpy as np
import pytest
import sympy
from compilations import compilations
from hypothesis import given
from hypothesis import strategies as st

import cip
from cip import Grid, InputError, PeriodicityWarning, Solver, Source, State, Velocity
from cip.engines.cuda_kernels import OPTIONS, device_source
from cip.formulas.expression import ordered

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
    for orders in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 2, 0), (2, 1, 0), (0, 0, 1)):
        exact = reference
        for name, times in zip(names, orders, strict=True):
            exact = sympy.diff(exact, name, times) if times else exact
        exact = float(exact.subs(dict(zip(names, point, strict=True))).evalf())
        all_four = (*orders[:2], 0, orders[2])
        found = formula.derivative(all_four, (1.0,) * 4)(point[0], point[1], 0.0, point[2])
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


# Callables: functions of the place alone are taken, and what they say of time.


RANDOM = np.random.default_rng(3)


def wave(x):
    return 1.5 + np.sin(2 * np.pi * x)


COMPANY = {
    "mean": lambda x: wave(x) - np.mean(wave(x)),
    "slight mean": lambda x: wave(x) - 1e-6 * np.mean(wave(x)),
    "median": lambda x: wave(x) - np.median(wave(x)),
    "largest": lambda x: wave(x) / np.max(wave(x)),
    "norm": lambda x: wave(x) / np.linalg.norm(x),
    "roll": lambda x: np.roll(wave(x), 1),
    "flip": lambda x: np.flip(wave(x)),
    "sort": lambda x: np.sort(wave(x)),
    "cumsum": lambda x: np.cumsum(wave(x)) / 50,
    "method": lambda x: np.asarray(x) - np.asarray(x).mean(),
    "ravel": lambda x: wave(x) + np.ravel(x)[0],
    "item": lambda x: wave(x) + np.asarray(x).flat[0],
    "size": lambda x: wave(x) / np.size(x),
    "fixed array": lambda x: np.linspace(1, 2, 33),
    "fixed value of an array": lambda x: 0 * x + np.linspace(1, 2, np.size(x)),
    "chance": lambda x: wave(x) + RANDOM.random(np.shape(x)),
    "interpolated from what came": lambda x: np.interp(x, np.sort(x), np.arange(np.size(x)) * 1.0),
}


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("kind", COMPANY)
def test_refused(kind, periodic):
    f = COMPANY[kind]
    grid = Grid((0, 1), 33 - (not periodic), periodic=periodic)
    assert not Velocity(f).exact
    for attempt in (
        lambda: Solver(grid, f),
        lambda: Solver(grid, [f]),
        lambda: Solver(grid, lambda x, t: f(x) * np.cos(t), boundary=0.0),
        lambda: Solver(grid, Velocity(lambda x, t: f(x) * np.cos(t), steady=False)),
        lambda: State.from_function(f, grid),
        lambda: State.from_function("x1", grid, derivatives={"u_x": f}),
    ):
        with pytest.raises(InputError, match=r"no function of the place|must return|it raised"):
            attempt()


def test_refused_in_planes_and_on_walls():
    grid = Grid([(0, 1)] * 2, (16, 12))
    with pytest.raises(InputError, match=r"c1: .* no function of the place"):
        Solver(grid, lambda x, y: (y - np.mean(y), x), boundary=0.0)
    with pytest.raises(InputError, match=r"c2: .* no function of the place"):
        Solver(grid, [lambda x, y: y, lambda x, y: x - np.mean(x)], boundary=0.0)
    with pytest.raises(InputError, match=r"f: .* no function of the place"):
        State.from_function(lambda x, y: np.roll(np.sin(x) * y, 1, axis=1), grid)
    with pytest.raises(InputError, match=r"boundary 'x-': .* no function of the place"):
        Solver(grid, (1.0, 0.5), boundary={"x-": lambda x, y, t: y - np.mean(y), "y-": 0.0})


PLACE = {
    "where": lambda x: np.where(x > 0.4, np.sin(x), x),
    "comparison": lambda x: (x > 0.4) * np.cos(x),
    "interpolation": lambda x: np.interp(x, [0, 0.3, 1], [1, 2, 1.0]),
    "search": lambda x: np.searchsorted([0.2, 0.5], x) * 0.5,
    "sum over components": lambda x: np.sum([np.sin(x), np.cos(x)], axis=0),
    "polynomial": lambda x: np.polyval([1.0, 2.0, 3.0], x),
    "constant": lambda x: 2.0,
    "filled mask": lambda x: np.ma.masked_where(x > 0.5, x).filled(0.5),
    "mask of nothing": lambda x: np.ma.masked_where(x > 5, x),
}


@pytest.mark.parametrize("kind", PLACE)
def test_functions_of_the_place_are_taken(kind):
    grid = Grid((0, 1), 33, periodic=True)
    x, f = grid.coordinates[0], PLACE[kind]
    (formula,) = Velocity(f).on(grid)
    values = formula.derivative((0, 0, 0, 0), (1.0,) * 4)(x, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(values, np.broadcast_to(f(x), x.shape), rtol=1e-15)
    np.testing.assert_allclose(State.from_function(f, grid)["u"], values, rtol=1e-15)


def test_masks_that_callables_return_are_not_dropped():
    grid, f = Grid((0, 1), 32), lambda x, *t: np.ma.masked_where(x > 0.5, x)
    for attempt in (
        lambda: Solver(grid, f),
        lambda: State.from_function(f, grid),
        lambda: Solver(grid, 1.0, boundary=lambda x, t: np.ma.masked_where(t < 9, t + x)),
    ):
        with pytest.raises(InputError, match="masked"):
            attempt()


def test_formulas_stay_formulas():
    assert Velocity(lambda x: x - x**3).exact
    assert Velocity(lambda x: np.array([1 + np.zeros_like(x)])).exact
    assert all(
        c.exact for c in Velocity(lambda x, y: np.array([-y, x])).on(Grid([(0, 1)] * 2, (8, 8)))
    )
    assert Velocity(lambda x: np.sqrt(1e6 + x**0.5) / 3 - 1000 / 3).exact


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


def shifted(velocity):
    """The field after a turn of cos t from 0 to 1, by quintic profiles."""
    grid = Grid((0, 1), 64, periodic=True)
    solver = Solver(grid, velocity, profile="quintic")
    run = solver.run(solver.state("sin(2*pi*x1)"), 1.0, dt=0.1)
    exact = np.sin(2 * np.pi * (grid.coordinates[0] - np.sin(1.0)))
    return np.abs(run.final["u"] - exact).max()


def default(x, t=0.0):
    return np.cos(t) + 0 * x


def third(x, strength=1.0, t=0.0):
    return strength * np.cos(t) + 0 * x


def by_name(x, *, time=0.0):
    return np.cos(time) + 0 * np.where(x > 3, x, 1.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("c", [default, third, by_name, [default]])
@pytest.mark.parametrize("steady", [None, False])
def test_a_default_for_t_is_no_steady_velocity(c, steady):
    velocity = Velocity(c, steady=steady)
    assert not velocity.steady
    assert shifted(velocity) < 1e-6


def test_steadiness_of_callables_and_of_parts():
    assert Velocity(default, steady=True).steady
    assert Velocity(lambda x, k=2.0: k * x).steady
    assert Velocity(lambda x: x).steady
    velocity = Velocity([lambda x, y, t=0.0: np.cos(t) + 0 * x, lambda x, y: 0 * y])
    found = velocity.on(Grid([(0, 1)] * 2, (8, 8)))
    assert not velocity.steady
    assert found[0].derivative((0, 0, 0, 0), (1.0,) * 4)(0.1, 0.2, 0.0, 2.0) == np.cos(2.0)


def test_fields_and_walls_with_a_default_for_t():
    """A field is one of the place: what it binds to t stays bound."""
    grid = Grid((0, 1), 8)
    state = State.from_function(lambda x, t=3.0: x + t, grid, t=2.0)
    np.testing.assert_allclose(state["u"], grid.coordinates[0] + 3.0)
    solver = Solver(grid, 1.0, boundary={"x-": lambda x, k=3.0, t=0.0: k * t + 0 * x})
    end = solver.step(solver.state(0.0), 0.5)
    np.testing.assert_allclose(end["u"][0], 1.5)


@pytest.mark.parametrize(
    ("name", "same"), [("conservative", "advection"), ("advective", "transport")]
)
def test_common_names_of_the_equations(name, same):
    grid = Grid((0, 1), 32, periodic=True)
    found = []
    for form in (name, same):
        solver = Solver(grid, lambda x: 1 + 0.5 * np.sin(2 * np.pi * x), form)
        assert solver.form == same
        found.append(solver.step(solver.state(1.0), 0.1).data)
    np.testing.assert_array_equal(found[0], found[1])
    # Only the conservative form changes a constant where the velocity does.
    assert (np.ptp(found[0][0]) > 0.01) == (same == "advection")


# A velocity on a periodic grid is periodic itself, or is refused, or warned of.


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
    "splines": (LINE, cip.SplineVelocity(LINE, 6, lambda x: x)),
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


# Named parameters: the same steps as with numbers, and no compilation.


VALUES = {"a": 0.7, "b": 0.3, "w": 2.5}
FIELDS = {
    1: ["a + b*sin(2*pi*x1)*cos(w*t)"],
    2: ["a*cos(2*pi*x2)", "b*sin(2*pi*x1)*exp(-w*t)"],
    3: ["a*cos(2*pi*x2)", "b*sin(2*pi*x3)", "a*b*cos(2*pi*x1 + w*t)"],
}


def numbers_for_names(text, values):
    for name, value in values.items():
        text = text.replace(f"{name}*", f"{value!r}*").replace(f"{name} ", f"{value!r} ")
    return text


def final(velocity, grid, profile, form="transport", **more):
    solver = Solver(grid, velocity, form, profile, **more)
    return solver.run(solver.state("sin(2*pi*x1) + 0.2"), 0.2, dt=0.05).final.data


CASES = [
    (1, "cubic", "transport"),
    (2, "bicubic", "transport"),
    pytest.param(1, "quintic", "advection", marks=pytest.mark.slow),
    pytest.param(1, "csl4", "advection", marks=pytest.mark.slow),
    pytest.param(2, "adini", "advection", marks=pytest.mark.slow),
    pytest.param(3, "cubic", "transport", marks=pytest.mark.slow),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("dim", "profile", "form"), CASES)
def test_same_steps_as_with_numbers_in_the_text(dim, profile, form):
    grid = Grid([(0, 1)] * dim, (16,) * dim, periodic=True)
    named = Velocity.from_expression(*FIELDS[dim], parameters=VALUES)
    other = named.with_parameters(a=-0.4, w=1.5)
    texts = FIELDS[dim]
    for velocity in (named, other):
        values = velocity.parameters
        plain = [numbers_for_names(text, values) for text in texts]
        assert not any(name + end in text for text in plain for name in "abw" for end in "* ")
        expected = final(Velocity.from_expression(*plain), grid, profile, form)
        found = final(velocity, grid, profile, form)
        # Products of constants are combined in the text with numbers: equal up to rounding.
        scale = np.abs(expected).max(axis=tuple(range(1, dim + 1)), keepdims=True)
        assert np.max(np.abs(found - expected) / scale) < 1e-12
    assert other.parameters == {"a": -0.4, "b": 0.3, "w": 1.5}
    assert named.parameters == VALUES


def test_steady_feet_and_walls_take_the_values_too():
    """c = a on (0, 1) with u = sin(t) at x = 0: u = sin(t - x / a) behind the front."""
    grid = Grid((0, 1), 40)
    velocity = Velocity.from_expression("a + 0*x1", parameters={"a": 1.0})
    for a in (1.0, 2.0):
        solver = Solver(grid, velocity.with_parameters(a=a), boundary={"x-": "sin(t)"})
        end = solver.run(solver.state(lambda x, a=a: -np.sin(x / a)), 0.5, dt=0.02).final
        # The cubic's error, at most h^3 times a derivative of order 4 over all steps.
        np.testing.assert_allclose(end["u"], np.sin(0.5 - grid.coordinates[0] / a), atol=1e-6)


@pytest.mark.parametrize("store", [True, False])
def test_new_values_compile_nothing(store):
    grid = Grid((0, 1), 16, periodic=True)
    text = "c0 + c1*sin(2*pi*x1 + shift)*cos(t)"
    velocity = Velocity.from_expression(text, parameters={"c0": 1, "c1": 0.5, "shift": 0})
    first = final(velocity, grid, "cubic", store_feet=store)
    with compilations() as names:
        ends = [
            final(velocity.with_parameters(c0=c0, shift=c0), grid, "cubic", store_feet=store)
            for c0 in (0.5, 1.5, 2.5)
        ]
    assert names == []
    assert all(np.abs(end - first).max() > 0.01 for end in ends)
    with compilations() as names:
        import numba

        numba.njit("int64(int64)")(lambda x: x)
    assert len(names) == 1  # the listener does count


RESERVED = (
    "int double __global__ threadIdx _ __device__ __shared__ blockDim warpSize dim3 float4 "
    "longlong2 struct typedef register restrict volatile template namespace this bool wchar_t "
    "size_t uint32_t None True False async await nonlocal match type case _a a__b __init__ "
    "NAN INFINITY HUGE_VAL M_PI M_SQRT1_2 NULL EOF errno DBL_MAX FLT_EPSILON FP_NAN CUDART_PI "
    "pow atan2 fma fmaf sinf coshl erfc lgamma hypot floor fabsf rsqrt min max nan inf isnan "
    "cudaMalloc "
)


def test_reserved_names_are_refused():
    """Keywords and reserved names of Python, C and CUDA, by every way to a parameter."""
    for name in {*RESERVED.split(), *keyword.kwlist, *keyword.softkwlist}:
        for make in (Velocity.from_expression, Source.from_expression):
            with pytest.raises(InputError, match=f"parameters: '{name}' is no name .* reserved in"):
                make("x1", parameters={name: 1.0})


@pytest.mark.parametrize(
    "text",
    [
        *("True", "x1*False", "x1**True", "sin(True)", True, np.True_, "1j*x1", "None", "not x1"),
        *("\uff581", "x\uff11", "\uff53in(x1)", "\u212f*x1", "\U0001d431", "x1 \u2212 1", "\xa0x1"),
    ],
)  # full-width, script and mathematical letters, the minus of print, a space that does not break
def test_what_only_looks_like_a_formula(text):
    """Python takes True for 1, and letters of other scripts for the Latin ones."""
    for make in (Velocity.from_expression, Source, Source.from_expression):
        with pytest.raises(InputError, match=r"component 1|source"):
            make(text)
    if isinstance(text, str):
        with pytest.raises(InputError, match="boundary"):
            Solver(Grid((0, 1), 8), 1.0, boundary=text)
        with pytest.raises(InputError, match="f: "):
            Solver(Grid((0, 1), 8), 1.0).state(text)


def odd_names(source):
    """Every name in some code that a parameter may have."""
    names = sorted({*re.findall(r"[A-Za-z_]\w*", source)} - {"x", "y", "z", "t", "e", "pi"})
    found = []
    for name in names:
        try:
            Velocity.from_expression(f"{name}*x1", parameters={name: 1.0})
        except InputError:
            continue
        found.append(name)
    assert len(found) > 50
    return found


def velocity_of(names):
    values = {name: 0.01 * (q + 1) for q, name in enumerate(names)}
    text = "+".join(f"{name}*{q + 1}" for q, name in enumerate(names))
    return Velocity.from_expression(f"({text})*sin(2*pi*x1 + t)", parameters=values)


def cuda_source(velocity):
    (stage,) = Solver(Grid((0, 1), 8, periodic=True), velocity)._stages
    return device_source(stage, "node_cubic", 0, True, "double", "int")


def test_the_oddest_names_compile_for_the_device(compile_cuda):
    """Parameters named as everything in the kernel's own source."""
    names = odd_names(cuda_source(velocity_of(["a"])))
    assert b".text.run" in compile_cuda(cuda_source(velocity_of(names)), "sm_90", OPTIONS)


def test_the_oddest_names_have_their_values_on_the_host():
    """Names of the device's code, of its C, and of the generated Python."""
    grid = Grid((0, 1), 16, periodic=True)
    odd = odd_names(cuda_source(velocity_of(["a"])))
    names = list(dict.fromkeys([*odd, "numba", "np", "evaluate", "out0", "p_a"]))
    found = velocity_of(names).on(grid)[0].derivative((1, 0, 0, 0), (1.0,) * 4)
    total = sum(0.01 * (q + 1) ** 2 for q in range(len(names)))
    expected = total * 2 * np.pi * np.cos(2 * np.pi * grid.coordinates[0] + 0.3)
    np.testing.assert_allclose(found(grid.coordinates[0], 0.0, 0.0, 0.3), expected, rtol=1e-12)


@pytest.mark.turns(4)
def test_names_of_unknowns_do_not_collide():
    """Parameters named as the variables of the generated code are."""
    grid = Grid((0, 1), 16, periodic=True)
    names = ["j0_000", "f_000", "v0", "r0", "y0", "step", "box", "self"]
    text = "+".join(f"{name}*cos({q}*t)" for q, name in enumerate(names))
    values = {name: 0.1 * (q + 1) for q, name in enumerate(names)}
    plain = "+".join(f"{values[name]!r}*cos({q}*t)" for q, name in enumerate(names))
    named = Velocity.from_expression(text, parameters={**values, "self": 0.0})
    found = final(named.with_parameters(self=values["self"]), grid, "cubic")
    expected = final(Velocity.from_expression(plain), grid, "cubic")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
