"""CPU and device agree to rounding; where there is no device, the host plays one."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from device_cases import CASES, field, solver_of

from cip import Grid, InputError, MissingDependency, Solver, State, Velocity
from cip.engines.cuda_engine import device_source

SLOW = pytest.mark.slow
FAST = {
    ("cubic", None, 1, "transport", True, "float64", False),
    ("cubic", None, 1, "advection", True, "float64", True),
    ("adini", None, 2, "transport", False, "float64", False),
    ("csl4", "bounds", 1, "advection", True, "float64", False),
}
RUNS = [
    pytest.param(*run, marks=[] if run in FAST else SLOW)
    for case in CASES
    for form in ("transport", "advection")
    for stored in (True, False)
    for dtype in ("float64", "float32")
    for uneven in (False, True)
    for run in [(*case, form, stored, dtype, uneven)]
    if not (case[0].startswith("csl") and (form == "transport" or not stored))
    and not (uneven and not stored)
]


def scaled(found, expected):
    """Errors over the largest entry of each moment and 1."""
    axes = tuple(range(1, expected.ndim))
    return np.abs(found - expected) / (np.abs(expected).max(axis=axes, keepdims=True) + 1)


@pytest.mark.parametrize(("profile", "limiter", "dim", "form", "stored", "dtype", "uneven"), RUNS)
def test_steps_and_runs_agree(cupy, profile, limiter, dim, form, stored, dtype, uneven):
    """A step of random moments, whose highest derivatives go with h^-2, and a run."""
    steps, runs = [], []
    for backend in ("cpu", "cupy"):
        solver = solver_of(
            profile, limiter, dim, dtype, form=form, backend=backend, store_feet=stored,
            uneven=uneven,
        )  # fmt: skip
        shape = State.from_function(0.0, solver.grid, profile).data.shape
        data = np.random.default_rng(11).uniform(-0.8, 1.2, shape).astype(dtype)
        start = State(solver.grid, profile, data)
        steps.append(solver.run(start, 0.21, dt=0.21).final.data)
        runs.append(solver.run(solver.state(field), 0.5, dt=0.11).final.data)
    assert isinstance(steps[1], np.ndarray)
    if dtype == "float32":
        error = scaled(steps[1], steps[0])
        # A choice between profiles may fall either way within rounding.
        assert np.mean(error > 2e-5) < 0.02 if limiter else error.max() < 2e-5
    else:
        # Feet computed in the kernel use the sines of two libraries, a rounding apart.
        assert scaled(steps[1], steps[0]).max() < (1e-13 if stored else 1e-12)
        assert scaled(runs[1], runs[0]).max() < (1e-13 if stored else 1e-12)


@SLOW
@pytest.mark.parametrize("stored", [True, False])
def test_walls_on_the_device(cupy, stored):
    """Paths that begin on walls: their data are written by the host's computation."""
    ends = []
    for backend in ("cpu", "cupy"):
        solver = Solver(
            Grid((0, 1), (16, 12)), Velocity.from_expression("1 + x2/2", "0.3*x1"),
            "advection", "bicubic", boundary="1 + sin(3*t)*x2", backend=backend, store_feet=stored,
        )  # fmt: skip
        ends.append(solver.run(solver.state(1.0), 0.5, dt=0.11).final.data)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-12 * np.abs(ends[0]).max())


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("profile", "dim", "degree"),
    [
        ("cubic", 1, 5),
        ("adini", 2, 3),
        pytest.param("bicubic", 2, 5, marks=SLOW),
        pytest.param("cubic", 3, 5, marks=SLOW),
    ],
)
def test_snapshots_and_parameters_on_the_device(cupy, profile, dim, degree):
    """Random winds at uneven times, periodic in one direction, and named numbers of a formula."""
    periodic = (False, True, False)[:dim]
    data = Grid([(-0.5, 1.5), (0, 1), (-0.5, 1.5)][:dim], (9, 8, 10)[:dim], periodic=periodic)
    winds = 0.2 * np.random.default_rng(2).uniform(size=(5, dim, *data.nodes))
    text = ["a*cos(2*pi*x1 + b*t)", "a*b*sin(2*pi*x2)", "a"][:dim]
    named = Velocity.from_expression(*text, parameters={"a": 0.3, "b": 2.0})
    grid = Grid([(0, 1)] * dim, (12, 10, 8)[:dim], periodic=periodic)
    sources = set()
    for velocity in (
        Velocity.from_snapshots([0.0, 0.1, 0.3, 0.4, 0.7], winds, data, degree),
        named,
        named.with_parameters(b=-1.0),
    ):
        ends = []
        for backend in ("cpu", "cupy"):
            solver = Solver(
                grid, velocity, profile=profile, splitting="strang" if dim == 3 else None,
                boundary=0.0, backend=backend, store_feet=False,
            )  # fmt: skip
            ends.append(solver.run(solver.state(field), 0.5, dt=0.11).final.data)
        np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-10 * np.abs(ends[0]).max())
        stage = solver._stages[0]
        sources.add(device_source(stage, f"node_{profile}", 0, True, "double", "int"))
    assert len(sources) == 2  # parameters are arguments of one kernel


class CUDARuntimeError(RuntimeError):
    """As CuPy's, which is no ValueError either."""


def test_without_a_device_that_answers(monkeypatch):
    def no_driver():
        raise CUDARuntimeError("cudaErrorInsufficientDriver: CUDA driver version is insufficient")

    runtime = SimpleNamespace(CUDARuntimeError=CUDARuntimeError, getDeviceCount=no_driver)
    grid = Grid((0, 1), 8, periodic=True)
    for fake, error, message in (
        (SimpleNamespace(cuda=SimpleNamespace(runtime=runtime)), InputError,
         r"no CUDA device answers .cudaErrorInsuff"),
        (None, MissingDependency, r"pip install 'skfem-adini\[cuda13\]'"),
    ):  # fmt: skip
        monkeypatch.setitem(sys.modules, "cupy", fake)
        with pytest.raises(error, match=message):
            Solver(grid, 1.0, backend="cupy")
