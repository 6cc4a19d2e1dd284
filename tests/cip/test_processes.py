"""What other processes and threads need: children after a fork, copies and pickles, threads."""

import copy
import multiprocessing
import os
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from cip import Grid, InputError, Solver, State, Velocity


def wave(x):
    return np.sin(2 * np.pi * x)


def stepped(solver):
    return solver.step(solver.state("sin(2*pi*x1)"), 0.01).data


def large():
    return Solver(Grid((0, 1), 100_000, periodic=True), 1.0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_steps(monkeypatch):
    """After the parent's threads have worked: they do not exist in the child."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    solver = large()
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
        return solver.run(solver.state("sin(2*pi*x1)"), 0.1, dt=0.01).final.data

    alone = work(0)
    with ThreadPoolExecutor(2) as threads:
        for found in threads.map(work, range(4)):
            np.testing.assert_array_equal(found, alone)


@pytest.mark.parametrize("velocity", ["1 + 0.5*sin(2*pi*x1)", "1 + 0.5*sin(2*pi*x1)*cos(t)"])
def test_one_solver_in_two_threads(velocity):
    solver = Solver(Grid((0, 1), 64, periodic=True), Velocity.from_expression(velocity))
    start = solver.state("sin(2*pi*x1)")

    def work(steps):
        return solver.run(start, 0.1, dt=0.1 / steps).final.data

    alone = [work(steps) for steps in range(3, 23)]
    with ThreadPoolExecutor(4) as threads:
        for found, expected in zip(threads.map(work, range(3, 23)), alone, strict=True):
            np.testing.assert_array_equal(found, expected)


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
    "long sum": lambda: Velocity(lambda x: 1 + sum(np.sin(k * x) / k**3 for k in range(1, 1200))),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("how", ["pickle", "deepcopy"])
@pytest.mark.parametrize("kind", VELOCITIES)
def test_velocities_and_solvers_survive(kind, how):
    again = copy.deepcopy if how == "deepcopy" else lambda x: pickle.loads(pickle.dumps(x))
    solver = Solver(
        Grid((0, 1), 32), VELOCITIES[kind](), boundary={"x-": lambda x, t: np.sin(t), "x+": 0.0}
    )
    start = solver.state(wave)
    for copied in (again(solver), Solver(solver.grid, again(solver.velocity), boundary="sin(t)")):
        assert copied.velocity.steady == solver.velocity.steady
        assert copied.velocity.exact == solver.velocity.exact
        np.testing.assert_array_equal(
            copied.step(again(start), 0.01).data, solver.step(start, 0.01).data
        )


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


@pytest.mark.slow
def test_a_spawned_worker_returns_a_run():
    solver = Solver(Grid((0, 1), 32, periodic=True), lambda x: 1 + 0 * x)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.apply(Solver.run, (solver, solver.state("sin(2*pi*x1)"), 0.02, 0.01))
    expected = solver.run(solver.state("sin(2*pi*x1)"), 0.02, 0.01)
    np.testing.assert_array_equal(found.final.data, expected.final.data)


def test_runs_do_not_depend_on_runs_before():
    """Bit-equal to those of a new solver: what one run finds of sub-steps dies with it."""
    field = Velocity.from_expression("sin(2*pi*x1)*exp(5*t)")
    solver = Solver(Grid((0, 1), 64, periodic=True), field)
    start = solver.state("sin(2*pi*x1)")
    expected = solver.run(start, 0.1, dt=0.05).final.data
    solver.run(solver.state("sin(2*pi*x1)", t=0.3), 0.4, dt=0.05)
    np.testing.assert_array_equal(solver.run(start, 0.1, dt=0.05).final.data, expected)
