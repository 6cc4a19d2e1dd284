"""Named parameters of formulas: the same steps as with numbers, and no compilation."""

import keyword
import re

import numpy as np
import pytest
from compilations import compilations

from cip import Grid, InputError, Solver, Source, Velocity
from cip.engines.cuda_engine import OPTIONS, device_source

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
    splitting = "strang" if grid.dim > 1 and profile not in ("adini", "bicubic") else None
    solver = Solver(grid, velocity, form, profile, splitting=splitting, **more)
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
