"""What other processes and threads need: children after a fork, copies and pickles, threads."""

import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from cip import Grid, Solver, Velocity


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
