"""Tangent and adjoint on a CUDA device: equal to those of the CPU, and the same bits again."""

from itertools import product

import numpy as np
import pytest

from cip import Grid, NotSupported, Solver, Velocity

PROFILES = [("cubic", 1), ("quintic", 1), ("adini", 2), ("bicubic", 2)]
FAST = ("cubic", False, True, "transport")
FLOW = ["0.6 + a*sin(2*pi*x1)*cos(t)", "b*cos(2*pi*x1) + 0.3"]


def solved(profile, dim, backend, steady, periodic=True, form="transport"):
    """A solver and a run of seven steps that cross about a cell each."""
    grid = Grid([(0, 1), (0, 1.5)][:dim], (41, 30)[:dim], periodic=periodic)
    flow = [part.replace("*cos(t)", "") if steady else part for part in FLOW[:dim]]
    if not periodic:  # nothing enters
        flow = ["a*(x1 - 0.5)", "b*(x2 - 0.7)"][:dim]
    values = {"a": 0.21, "b": 0.13} if dim == 2 else {"a": 0.21}
    velocity = Velocity.from_expression(*flow, parameters=values)
    solver = Solver(grid, velocity, form, profile, backend=backend)
    field = "sin(2*pi*x1)" if dim == 1 else "sin(2*pi*x1)*cos(4*pi*x2/3)"
    return solver, solver.run(solver.state(field), 0.2, dt=0.03)


SCHEMES = [
    pytest.param(
        profile, dim, steady, periodic, form,
        marks=[pytest.mark.slow] * ((profile, steady, periodic, form) != FAST),
    )
    for profile, dim in PROFILES
    for steady, periodic, form in product([True, False], [True, False], ["transport", "advection"])
]  # fmt: skip


@pytest.mark.parametrize(("profile", "dim", "steady", "periodic", "form"), SCHEMES)
def test_operators_are_those_of_the_cpu(cupy, monkeypatch, profile, dim, steady, periodic, form):
    rng = np.random.default_rng(4)
    solver, run = solved(profile, dim, "cpu", steady, periodic, form)
    on_device, its_run = solved(profile, dim, "cupy", steady, periodic, form)
    weight = rng.standard_normal(run.final.data.size)
    expected = solver.adjoint(run) @ weight
    change = rng.standard_normal(expected.size)
    tangent, adjoint = on_device.tangent(its_run), on_device.adjoint(its_run)
    gradient = adjoint @ cupy.asarray(weight)
    new = tangent @ cupy.asarray(change)
    assert isinstance(gradient, cupy.ndarray)
    close = {"rtol": 1e-12, "atol": 1e-12 * np.abs(expected).max()}
    np.testing.assert_allclose(gradient.get(), expected, **close)
    expected_new = solver.tangent(run) @ change
    atol = 1e-12 * np.abs(expected_new).max()
    np.testing.assert_allclose(new.get(), expected_new, rtol=1e-12, atol=atol)
    size = np.abs(weight) @ np.abs(new.get()) + np.abs(change) @ np.abs(gradient.get())
    assert abs(weight @ new.get() - change @ gradient.get()) <= 1e-13 * size
    # On the host: the threads of every kernel in the opposite order.
    monkeypatch.setattr(cupy, "backward", True, raising=False)
    again = on_device.adjoint(its_run, checkpoints=2) @ cupy.asarray(weight)
    assert (again == gradient).all()


@pytest.mark.slow
def test_remainder_is_of_second_order(cupy):
    """The change of a functional less its derivative falls with the square of the change."""

    def end(a):
        grid = Grid([(0, 1)] * 2, (40, 40), periodic=True)
        flow = Velocity.from_expression("0.3 + a*sin(2*pi*x2)", "0.2", parameters={"a": a})
        solver = Solver(grid, flow, profile="adini", backend="cupy")
        run = solver.run(solver.state("sin(2*pi*x1)*cos(2*pi*x2)"), 0.1, dt=0.02)
        return solver, run

    solver, run = end(0.21)
    weight = cupy.asarray(np.random.default_rng(7).standard_normal(run.final.data.size))
    slope = float((solver.adjoint(run) @ weight)[-1])
    steps = 1e-4 * 2.0 ** -np.arange(4)
    base = float(weight @ cupy.asarray(run.final.data).ravel())
    left = []
    for step in steps:
        moved = float(weight @ cupy.asarray(end(0.21 + step)[1].final.data).ravel())
        left.append(abs(moved - base - step * slope))
    order = np.polyfit(np.log(steps), np.log(left), 1)[0]
    assert abs(order - 2.0) < 0.05


def test_paths_through_walls_are_refused(cupy):
    solver = Solver(Grid((0, 1), 21), 0.4, boundary="sin(t)", backend="cupy")
    run = solver.run(solver.state("x1"), 0.1, dt=0.05)
    with pytest.raises(NotSupported, match="wall"):
        solver.adjoint(run)
