"""CPU and device agree to rounding, whole runs of every profile."""

import numpy as np
import pytest
from device_cases import CASES, field, solver_of

FAST = ("csl4", "bounds", 1, True)
RUNS = [
    pytest.param(*case, stored, marks=[pytest.mark.slow] * ((*case, stored) != FAST))
    for case in CASES
    for stored in (True, False)
]


@pytest.mark.parametrize(("profile", "limiter", "dim", "stored"), RUNS)
def test_runs_agree(cupy, profile, limiter, dim, stored):
    if profile.startswith("csl") and not stored:
        pytest.skip("conservative kernels take stored feet")
    ends = []
    for backend in ("cpu", "cupy"):
        solver = solver_of(
            profile, limiter, dim, form="advection", backend=backend, store_feet=stored
        )
        run = solver.run(solver.state(field), 0.5, dt=0.11)
        ends.append(run.final)
    assert isinstance(ends[1].data, np.ndarray)
    for name in ends[0].names:
        scale = np.abs(ends[0][name]).max() + 1
        # Feet computed in the kernel use the sines of two libraries, a rounding apart.
        np.testing.assert_allclose(
            ends[1][name], ends[0][name], rtol=0, atol=(1e-13 if stored else 1e-12) * scale
        )


@pytest.mark.slow
@pytest.mark.parametrize(("profile", "dim"), [("cubic", 1), ("bicubic", 2), ("csl4", 3)])
def test_single_precision_on_the_device(cupy, profile, dim):
    ends = []
    for dtype in (np.float64, np.float32):
        solver = solver_of(profile, None, dim, dtype, form="advection", backend="cupy")
        ends.append(solver.run(solver.state(field), 0.5, dt=0.11).final["u"])
    np.testing.assert_allclose(ends[1], ends[0], atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("stored", [True, False])
def test_walls_on_the_device(cupy, stored):
    """Paths that begin on walls: their data are written by the host's computation."""
    from cip import Grid, Solver, Velocity

    ends = []
    for backend in ("cpu", "cupy"):
        solver = Solver(
            Grid((0, 1), (16, 12)), Velocity.from_expression("1 + x2/2", "0.3*x1"),
            "advection", "bicubic", boundary="1 + sin(3*t)*x2", backend=backend, store_feet=stored,
        )  # fmt: skip
        ends.append(solver.run(solver.state(1.0), 0.5, dt=0.11).final.data)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-12 * np.abs(ends[0]).max())


@pytest.mark.slow
@pytest.mark.parametrize(("profile", "dim"), [("cubic", 1), ("bicubic", 2), ("cubic", 3)])
def test_snapshots_and_parameters_on_the_device(cupy, profile, dim):
    """Random winds at uneven times, and named numbers of a formula."""
    from cip import Grid, Solver, Velocity

    grid = Grid([(0, 1)] * dim, (12,) * dim, periodic=True)
    winds = 0.3 * np.random.default_rng(4).uniform(size=(4, dim, *grid.nodes))
    text = ["a*cos(2*pi*x1 + b*t)"] * dim
    velocities = [
        Velocity.from_snapshots([0, 0.1, 0.4, 0.6], winds, grid),
        Velocity.from_expression(*text, parameters={"a": 0.3, "b": 2.0}),
    ]
    splitting = "strang" if dim == 3 else None
    for velocity in velocities:
        ends = []
        for backend in ("cpu", "cupy"):
            solver = Solver(grid, velocity, profile=profile, splitting=splitting, backend=backend)
            ends.append(solver.run(solver.state(field), 0.5, dt=0.11).final.data)
        np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-10 * np.abs(ends[0]).max())
