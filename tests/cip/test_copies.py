"""Pickles and copies of all public objects, and work in children, threads and workers."""

import copy
import inspect
import multiprocessing
import os
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import cip
from cip import Grid, InputError, Solver, SplineVelocity, State, Velocity

COPIES = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}
PUBLIC = [value for name in cip.__all__ if inspect.isclass(value := getattr(cip, name))]
RING, PLACES = Grid((0, 1), 32, periodic=True), [0.1, 0.35, 0.6]
FIELD = "sin(2*pi*x1)"


def run():
    solver = Solver(
        Grid.from_coordinates([0.0, 0.3, 0.5, 0.7, 0.8, 1.0]), lambda x: 1 + x, boundary="sin(t)"
    )
    return solver.run(solver.state("x1**2"), 0.2, dt=0.1, snapshots=2)


def through():
    solver = Solver(Grid((0, 1), 8), 1.0, "advection", "csl2", boundary={"x-": 2.0})
    return solver.run(solver.state("x1**2"), 0.2, dt=0.1, snapshots=2)


def identified():
    grid = Grid((0, 1), 48, periodic=True)
    solver = Solver(grid, SplineVelocity(grid, 6, 1.0))
    start = solver.state("sin(2*pi*x1) + cos(4*pi*x1)")
    seen = Solver(grid, 1.1).run(start, 0.3, dt=0.03).final["u"]
    return cip.identify_velocity(solver, start, {0.3: seen}, dt=0.03, noise=0.01)


def around(lon, lat):
    return np.cos(lat), 0 * lon


def ball():
    return cip.SphereSolver(cip.Sphere(16, 8), around, "conservative")


def sensors():
    return cip.Sensors([0.3, 0.6], [0.1, 0.3], [[0.9, np.nan], [0.2, 0.9]], 0.1)


def covariance():
    return cip.Covariance.diffusion(RING, "cubic", deviation=1.0, length=0.15)


def analysis():
    solver = Solver(RING, 1.0)
    return cip.four_d_var(solver, solver.state(0.0), covariance(), sensors(), dt=0.05)


def placement():
    solver, plan = Solver(RING, 1.0), cip.Sensors(PLACES, [0.1], deviations=0.1)
    return cip.place_sensors(solver, solver.state(0.0), covariance(), plan, budget=2, dt=0.05)


MAKE = {
    "Analysis": analysis,
    "Budget": lambda: through().budget,
    "Covariance": covariance,
    "FlowMap": lambda: cip.flow_map(1.0, RING, 0.0, 0.2),
    "Diagnostics": lambda: run().diagnostics,
    "Identifiability": lambda: identified().identifiability,
    "IdentifiedVelocity": identified,
    "Placement": placement,
    "Sensors": sensors,
    "SplineVelocity": lambda: SplineVelocity(Grid((0, 1), 16, periodic=True), 6, 1.0),
    "Grid": lambda: Grid([(0, 1), (0, 2)], (4, 5), periodic=(True, False)),
    "Solver": lambda: run().solver,
    "Source": lambda: cip.Source(lambda x: 1 + x**2),
    "Sphere": lambda: cip.Sphere(16, 8, radius=2.0),
    "SphereSolver": lambda: cip.SphereSolver(cip.Sphere(16, 8), around),
    "State": lambda: run().final,
    "Trajectory": run,
    "Velocity": lambda: Velocity(lambda x: 1 + x**2),
}


def same(one, other):
    """Whether all that the objects hold is equal; what cannot be compared has equal types."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
    elif isinstance(one, str | int | float | complex | bool | None):
        assert one == other
    elif isinstance(one, list | tuple):
        assert len(one) == len(other)
        for pair in zip(one, other, strict=True):
            same(*pair)
    elif isinstance(one, dict):
        assert one.keys() == other.keys()
        same(list(one.values()), list(other.values()))
    elif isinstance(one, Grid | State | cip.Budget | cip.Diagnostics):
        assert vars(one).keys() == vars(other).keys()
        for name, value in vars(one).items():
            same(value, vars(other)[name])


@pytest.mark.parametrize("kind", PUBLIC)
def test_every_public_class(kind):
    if issubclass(kind, Exception):
        one = kind("velocity: of 3 numbers")
        one.note = np.arange(3)
    else:
        one = MAKE[kind.__name__]()
    assert isinstance(one, kind)
    for again in COPIES.values():
        other = again(one)
        same(one, other)
        assert str(other) == str(one) or " at 0x" in str(one)
        if issubclass(kind, Exception):
            np.testing.assert_array_equal(other.note, one.note)
        if kind is cip.Trajectory:
            same(list(one), list(other))
            same(one.times, other.times)
        if kind is Solver:
            start = one.state("x1**2")
            same(one.step(start, 0.1), other.step(again(start), 0.1))


RANDOM = np.random.default_rng(5).random((2, 9))


def speed_by_values(x):
    return np.where(x > 0.5, 1.0, 1.0 + 0.1 * (0.5 - x) ** 4)


VELOCITIES = {
    "number": lambda: Velocity(1.0),
    "text": lambda: Velocity.from_expression("1 + 0.3*sin(2*pi*x1)*cos(t)"),
    "lambda": lambda: Velocity(lambda x: 1 + 0.3 * np.sin(2 * np.pi * x) ** 2 - x / 8),
    "lambda of t": lambda: Velocity(lambda x, t: np.cos(t) + 0 * x, steady=False),
    "default for t": lambda: Velocity(lambda x, t=0.0: np.cos(t) + 0 * x),
    "list of lambdas": lambda: Velocity([lambda x: np.exp(-(x**2))]),
    "function by its values": lambda: Velocity(speed_by_values),
    "array": lambda: Velocity(np.linspace(1.0, 2.0, 33)),
    "parameters": lambda: Velocity.from_expression("a + t", parameters={"a": 0.25}),
    "splines": lambda: SplineVelocity(Grid((0, 1), 32), 7, lambda x: 1 + 0.3 * np.sin(2 * x)),
    "snapshots": lambda: Velocity.from_snapshots([0, 1], 1 + RANDOM, Grid((0, 1), 8)),
    "long sum": lambda: Velocity(lambda x: 1 + sum(np.sin(k * x) / k**3 for k in range(1, 1200))),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[pytest.mark.turns(4)] * (k == "long sum")) for k in VELOCITIES]
)
def test_velocities_and_solvers_survive(kind):
    solver = Solver(
        Grid((0, 1), 32), VELOCITIES[kind](), boundary={"x-": lambda x, t: np.sin(t), "x+": 0.0}
    )
    start = solver.state(FIELD)
    expected = solver.step(start, 0.01).data
    for again in (COPIES["pickle"], COPIES["deepcopy"]):
        peer = Solver(solver.grid, again(solver.velocity), boundary="sin(t)")
        for copied in (again(solver), peer):
            for name in ("steady", "exact", "parameters"):
                assert getattr(copied.velocity, name) == getattr(solver.velocity, name)
            np.testing.assert_array_equal(copied.step(again(start), 0.01).data, expected)


@pytest.mark.turns(4)
def test_planes_with_every_option_survive():
    solver = Solver(
        Grid([(0, 1), (0, 2)], (16, 12), periodic=(True, False)),
        Velocity(lambda x, y: (-y + 0.1, np.sin(2 * np.pi * x))), "conservative", "csl4", "bounds",
        "strang", boundary=0.0, dtype=np.float32, bounds=(0, 3), bounds_tolerance=1e-5,
    )  # fmt: skip
    run = solver.run(solver.state("1 + 0*x1"), 0.05, dt=0.02, snapshots=2)
    copied = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(copied.times, run.times)
    np.testing.assert_array_equal(copied.final.data, run.final.data)
    more = copied.solver.step(copied.final, 0.02)
    np.testing.assert_array_equal(more.data, solver.step(run.final, 0.02).data)
    assert isinstance(copied[0], State)


def test_a_function_of_another_place_than_the_unit_box():
    solver = Solver(Grid((-4, -2), 8), lambda x: np.sqrt(-1 - x))
    copied = pickle.loads(pickle.dumps(solver))
    assert copied.velocity.exact
    assert copied.velocity.on(solver.grid)[0].exact


def test_a_function_that_cannot_be_kept_says_so():
    solver = Solver(Grid((0, 1), 32, periodic=True), lambda x: np.where(x > 0.5, 1.0, 1.0))
    with pytest.raises(InputError, match=r"velocity: .* cannot be pickled.*top of a module"):
        pickle.dumps(solver)


def stepped(solver):
    return solver.step(solver.state(FIELD), 0.01).data


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_steps(monkeypatch):
    """After the parent's threads have worked: they do not exist in the child."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    solver = Solver(Grid((0, 1), 100_000, periodic=True), 1.0)
    expected = stepped(solver)
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()

    def work():
        theirs.send(np.array_equal(stepped(solver), expected))

    child = context.Process(target=work)
    child.start()
    answered = ours.poll(60)
    child.kill()
    child.join()
    assert answered, "the child hangs"
    assert ours.recv()


@pytest.mark.turns(4)
def test_two_solvers_in_two_threads_are_bit_equal_to_one(monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    field = Velocity.from_expression("1 + 0.5*sin(2*pi*x1)*cos(t)")

    def work(_):
        solver = Solver(Grid((0, 1), 90_000, periodic=True), field)
        return solver.run(solver.state(FIELD), 0.03, dt=0.01).final.data

    alone = work(0)
    with ThreadPoolExecutor(2) as threads:
        for found in threads.map(work, range(4)):
            np.testing.assert_array_equal(found, alone)


@pytest.mark.parametrize(
    ("velocity", "more"),
    [
        ("1 + 0.5*sin(2*pi*x1)", {}),
        ("1 + 0.5*sin(2*pi*x1)*cos(t)", {}),
        ("1", {"source": "0.3*(2 + cos(2*pi*x1))", "decay": "0.3*(2 + cos(2*pi*x1))"}),
    ],
)
def test_one_solver_in_many_threads_with_steps_of_many_lengths(velocity, more):
    """What was kept for one length is not taken away while another thread reads it."""
    field = Velocity.from_expression(velocity)
    solver = Solver(Grid((0, 1), 8, periodic=True), field, **more)
    start = solver.state(FIELD)

    def work(steps):
        return solver.run(start, 0.1, dt=0.1 / steps).final.data

    alone, interval = [work(steps) for steps in range(3, 43)], sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as threads:
            for found, expected in zip(threads.map(work, range(3, 43)), alone, strict=True):
                np.testing.assert_array_equal(found, expected)
    finally:
        sys.setswitchinterval(interval)


def test_runs_do_not_depend_on_runs_before():
    """Bit-equal to those of a new solver: what one run finds of sub-steps dies with it."""
    field = Velocity.from_expression("sin(2*pi*x1)*exp(5*t)")
    solver = Solver(Grid((0, 1), 64, periodic=True), field)
    start = solver.state(FIELD)
    expected = solver.run(start, 0.1, dt=0.05).final.data
    solver.run(solver.state(FIELD, t=0.3), 0.4, dt=0.05)
    np.testing.assert_array_equal(solver.run(start, 0.1, dt=0.05).final.data, expected)
