"""The device's C, compiled for the CPU by a C compiler: its body against numba's."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from device_cases import CASES, solver_of

from cip import Grid, Solver, Velocity
from cip.engines.cuda_engine import device_source
from cip.profiles.catalogue import LIMITER_CODES

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")

# The device's grid of threads as a loop.
CPU = """
#include <math.h>
typedef struct { int x, y; } place;
static place blockIdx, blockDim, threadIdx;
#define __device__
#define __global__
#define __forceinline__ inline
"""
LOOP = """
void all(%s, int nx, int ny) {
    blockDim.x = 1; blockDim.y = 1; threadIdx.x = 0; threadIdx.y = 0;
    for (blockIdx.y = 0; blockIdx.y < ny; blockIdx.y++)
        for (blockIdx.x = 0; blockIdx.x < nx; blockIdx.x++) run(%s);
}
"""


def compiled(source, folder):
    """The kernel as a function that runs all its threads."""
    head = source[source.index("void run(") :]
    parameters = head[len("void run(") : head.index(") {")]
    names = [part.split()[-1].lstrip("*") for part in parameters.split(", ")]
    code = CPU + source.replace('extern "C"', "static") + LOOP % (parameters, ", ".join(names))
    (folder / "kernel.c").write_text(code)
    subprocess.run(
        [COMPILER, "-O1", "-ffp-contract=off", "-Wall", "-Wno-unused", "-Wno-maybe-uninitialized",
         "-Werror=incompatible-pointer-types",
         "-shared", "-fPIC", "-o", folder / "kernel.so", folder / "kernel.c", "-lm"],
        check=True, capture_output=True,
    )  # fmt: skip
    return ctypes.CDLL(str(folder / "kernel.so")).all


def pointer(array):
    return ctypes.c_void_p(array.ctypes.data)


def random_state(solver, seed=11):
    state = solver.state(0.0)
    state.data[...] = np.random.default_rng(seed).uniform(-1, 1, state.data.shape)
    return state


FAST = [("cubic", None, 1, "transport"), ("adini", None, 2, "transport")]
EVERY = [
    pytest.param(*case, dtype, marks=[] if case in FAST else pytest.mark.slow)
    for case in [
        (*case, form)
        for case in CASES
        for form in ("transport", "advection")
        if form == "advection" or not case[0].startswith("csl")
    ]
    for dtype in (np.float64, np.float32)
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("profile", "limiter", "dim", "form", "dtype"), EVERY)
def test_stored_feet(profile, limiter, dim, form, dtype, tmp_path):
    check(solver_of(profile, limiter, dim, dtype, form=form), tmp_path)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("profile", "limiter", "dim"),
    [
        ("cubic", None, 1),
        pytest.param("cubic", "eno", 1, marks=SLOW),
        pytest.param("bicubic", "eno", 2, marks=SLOW),
        pytest.param("quintic", None, 2, marks=SLOW),
        pytest.param("csl4", "bounds", 2, marks=SLOW),
    ],
)
def test_cells_of_many_widths(profile, limiter, dim, tmp_path):
    """Widths are an array then, where they are a constant else."""
    solver = solver_of(profile, limiter, dim, form="advection", uneven=True)
    assert not any(solver.grid.uniform)
    check(solver, tmp_path)


def check(solver, folder):
    """One launch of both with stored feet and random moments."""
    limiter, dtype = solver.limiter, solver.dtype
    state = random_state(solver)
    stage = solver._stages[0]
    feet = solver.feet(stage, 0.0, 0.21)
    m, out = state.data.reshape(-1), np.full_like(state.data, np.nan).reshape(-1)
    expected = np.full_like(out, np.nan)
    solver._kernels.launch(stage, m, expected, feet.data)
    real = "double" if dtype == np.float64 else "float"
    source = device_source(
        stage, solver._kernels.name(stage), LIMITER_CODES[limiter], False, real, "int"
    )
    run = compiled(source, folder)
    arguments = [pointer(m), pointer(out), pointer(feet.data)]
    widths = [] if all(solver.grid.uniform) else solver.grid.widths
    widths = [width.astype(dtype) for width in widths]
    arguments += [pointer(width) for width in widths]
    kind = ctypes.c_double if dtype == np.float64 else ctypes.c_float
    if stage.conservative:
        arguments += [kind(value) for value in (*solver.bounds, solver.bounds_tolerance)]
    nodes = solver.grid.nodes
    blocks = (nodes[1], nodes[0]) if stage.axis is None else (solver.grid.size, 1)
    run(*arguments, *blocks)
    assert np.isfinite(expected).all()
    # Second derivatives of random data: up to h^-2 times rounding, in units of the largest moment.
    tolerance = 1e-13 if dtype == np.float64 else 2e-5
    scale = np.abs(expected.reshape(len(state.data), -1)).max(axis=1, keepdims=True) + 1
    error = np.abs(out - expected).reshape(len(state.data), -1) / scale
    if limiter in ("eno", "clamp", "bounds", "rational") and dtype == np.float32:
        # A choice between profiles may fall either way within rounding.
        assert np.mean(error > tolerance) < 0.02
    else:
        assert error.max() < tolerance


@pytest.mark.parametrize(
    ("profile", "dim", "form"),
    [
        ("adini", 2, "transport"),
        pytest.param("bicubic", 2, "advection", marks=pytest.mark.slow),
        pytest.param("cubic", 3, "advection", marks=pytest.mark.slow),
    ],
)
def test_feet_computed_in_the_kernel(profile, dim, form, tmp_path):
    solver = solver_of(profile, None, dim, form=form, store_feet=False)
    state = random_state(solver)
    stage = solver._stages[0]
    m, out = state.data.reshape(-1), np.full_like(state.data, np.nan).reshape(-1)
    expected = np.full_like(out, np.nan)
    assert not solver._kernels.launch_path(stage, m, expected, 0.3, 0.2, 3)
    source = device_source(stage, solver._kernels.name(stage), 0, True, "double", "int")
    run = compiled(source, tmp_path)
    grid, left = solver.grid, np.zeros(1, np.int32)
    clock = [ctypes.c_double(0.3), ctypes.c_double(0.2 / 3), ctypes.c_int(3), pointer(left)]
    lines = [pointer(line) for line in grid.coordinates]
    blocks = (grid.nodes[1], grid.nodes[0]) if stage.axis is None else (grid.size, 1)
    run(pointer(m), pointer(out), *lines, *clock, *blocks)
    scale = np.abs(expected.reshape(len(state.data), -1)).max(axis=1, keepdims=True) + 1
    error = np.abs(out - expected).reshape(len(state.data), -1) / scale
    assert error.max() < 1e-12
    assert left[0] == 0


@pytest.mark.turns(4)
def test_parameters_are_arguments_of_the_kernel(tmp_path):
    """One compiled source for several values, each against the CPU's kernel."""
    grid = Grid((0, 1), 24, periodic=True)
    velocity = Velocity.from_expression("a + b*sin(2*pi*x1)*t", parameters={"a": 0.4, "b": 0.2})
    run, sources = None, set()
    for b in (0.2, -0.7):
        solver = Solver(grid, velocity.with_parameters(b=b), store_feet=False)
        state, stage = random_state(solver), solver._stages[0]
        m, out = state.data.reshape(-1), np.full_like(state.data, np.nan).reshape(-1)
        expected = np.full_like(out, np.nan)
        assert not solver._kernels.launch_path(stage, m, expected, 0.3, 0.2, 3)
        sources.add(device_source(stage, solver._kernels.name(stage), 0, True, "double", "int"))
        run = run or compiled(min(sources), tmp_path)
        clock = [ctypes.c_double(0.3), ctypes.c_double(0.2 / 3), ctypes.c_int(3)]
        values = [ctypes.c_double(value) for value in (0.4, b)]
        said = np.zeros(1, np.int32)
        line = pointer(grid.coordinates[0])
        run(pointer(m), pointer(out), line, *clock, pointer(said), *values, grid.size, 1)
        np.testing.assert_allclose(out, expected, rtol=0, atol=1e-11)
    assert len(sources) == 1


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("dim", "profile", "degree"),
    [
        (1, "cubic", 5),
        (2, "adini", 3),
        pytest.param(2, "bicubic", 5, marks=pytest.mark.slow),
        pytest.param(3, "cubic", 5, marks=pytest.mark.slow),
    ],
)
def test_snapshots_in_the_kernel(dim, profile, degree, tmp_path):
    """Splines of random winds, periodic in one direction and not in the others."""
    rng = np.random.default_rng(2)
    periodic = (False, True, False)[:dim]
    data = Grid([(-0.5, 1.5), (0, 1), (-0.5, 1.5)][:dim], (9, 8, 10)[:dim], periodic=periodic)
    times = [0.0, 0.1, 0.3, 0.4, 0.7]
    winds = 0.2 * rng.uniform(size=(5, dim, *data.nodes))
    grid = Grid([(0, 1)] * dim, (12, 10, 8)[:dim], periodic=[p and dim > 1 for p in periodic])
    velocity = Velocity.from_snapshots(times, winds, data, degree)
    splitting = "strang" if dim == 3 else None
    solver = Solver(
        grid, velocity, profile=profile, splitting=splitting, boundary=0.0, store_feet=False
    )
    state, stage = random_state(solver), solver._stages[0]
    m, out = state.data.reshape(-1), np.full_like(state.data, np.nan).reshape(-1)
    expected = np.full_like(out, np.nan)
    solver._kernels.launch_path(stage, m, expected, 0.5, 0.35, 6)
    source = device_source(stage, solver._kernels.name(stage), 0, True, "double", "int")
    run = compiled(source, tmp_path)
    clock = [ctypes.c_double(0.5), ctypes.c_double(0.35 / 6), ctypes.c_int(6)]
    lines, said = [pointer(line) for line in grid.coordinates], np.zeros(1, np.int32)
    table = velocity.on(grid)[0].field.table
    blocks = (grid.nodes[1], grid.nodes[0]) if stage.axis is None else (grid.size, 1)
    run(pointer(m), pointer(out), *lines, *clock, pointer(said), pointer(table), *blocks)
    # Paths that enter through a wall have no finite foot in either.
    known = np.isfinite(expected)
    np.testing.assert_array_equal(np.isfinite(out), known)
    assert known.mean() > 0.7
    scale = np.abs(expected[known]).max()
    assert np.abs(out - expected)[known].max() < 1e-11 * scale
