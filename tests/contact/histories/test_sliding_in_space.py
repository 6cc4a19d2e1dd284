"""Finite sliding of bodies in space: quadratic steps, friction, energy, files."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skfem
from families import SOLID

from contact import ContactProblem, ElasticBody, InputError, LoadHistory, LoadStepper

elements = pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)
DEPTH = 0.02


def slider(
    element: Any, friction: float = 0.3, unit: float = 1.0, sliding: str = "finite", E: float = 3.0
) -> tuple[Any, Any, LoadStepper]:
    """A block pressed on a larger one of other cells by t = 1, then pushed across it."""
    tets = element in SOLID[:2]
    kind: Any = skfem.MeshTet if tets else skfem.MeshHex
    named = {
        "low": lambda x: x[2] < x[2].min() + 1e-9 * unit,
        "high": lambda x: x[2] > x[2].max() - 1e-9 * unit,
    }
    above = [np.linspace(0.5, 1.5, 4), np.linspace(0.3, 1.1, 3), np.linspace(1.0, 1.6, 3)]
    below = [np.linspace(0.0, 3.0, 7), np.linspace(0.0, 1.5, 4), np.linspace(0.0, 1.0, 3)]
    bodies = [
        ElasticBody.from_mesh(
            kind.init_tensor(*[unit * ticks for ticks in sides]).with_boundaries(named),
            element(), E=modulus / unit**2, nu=0.3,
        ).named(name)
        for sides, modulus, name in ((above, 1.0, "upper"), (below, E, "lower"))
    ]  # fmt: skip
    upper, lower = bodies[0].fix("high", "xyz"), bodies[1].fix("low", "xyz")
    problem = ContactProblem(upper, "low", lower.surface("high"), friction=friction)
    stepper = LoadStepper(problem, sliding=sliding)
    stepper.move("high", "z", -DEPTH * unit, lambda t: min(t, 1.0), body=upper)
    return upper, lower, stepper


def pushed(stepper: LoadStepper, upper: Any, x: float, y: float = 0.0) -> LoadStepper:
    """Pushed by (x, y) in each unit of time after the first."""
    stepper.move("high", "x", x, lambda t: max(t - 1.0, 0.0), body=upper)
    return stepper.move("high", "y", y, lambda t: max(t - 1.0, 0.0), body=upper)


@pytest.mark.sampled(4)
@elements
def test_newton_is_quadratic_over_many_facets(element: Any) -> None:
    upper, _, stepper = slider(element)
    pushed(stepper, upper, 0.35, 0.1)
    for time in (1.0, 2.0):
        result = stepper.step(time)
        assert max(result.kkt.values()) <= 1e-10
        changes = [line.residual for line in result.history if line.phase == "projection"]
        assert len(changes) <= 6
        # After the first projections each change is of the order of the square of the last.
        assert changes[-1] <= 1e-8
        assert all(b <= 10 * a**2 + 1e-9 for a, b in pairwise(changes[1:]))
    # Fully sliding: the friction force is F times the pressing one.
    shear = np.linalg.norm(result.t, axis=1)
    assert (shear[result.mu > 0] >= 0.3 * result.mu[result.mu > 0] * (1 - 1e-9)).all()
    force = result.resultant
    # The pressed face is bent, so that not all of its normals are vertical.
    assert np.hypot(force[0], force[1]) / force[2] == pytest.approx(0.3, rel=0.06)


@pytest.mark.sampled(9)
@elements
def test_without_friction_the_path_does_not_matter(element: Any) -> None:
    there, _, one = slider(element, friction=0.0)
    pushed(one, there, 0.45, 0.15)
    steps = [one.step(t) for t in (1.0, 2.0)]
    back, _, other = slider(element, friction=0.0)
    other.move("high", "x", 0.45, lambda t: [0.0, -0.5, 1.0][int(t) - 1], body=back)
    other.move("high", "y", 0.15, lambda t: [0.0, 2.0, 1.0][int(t) - 1], body=back)
    for time in (1.0, 2.0, 3.0):
        last = other.step(time)
    assert steps[-1].mu.shape == last.mu.shape
    assert np.abs(steps[-1].mu - last.mu).max() <= 1e-8 * last.mu.max()
    assert np.abs(steps[-1].u - last.u).max() <= 1e-9


def test_small_slips_are_those_of_small_sliding() -> None:
    forces = []
    for sliding in ("small", "finite"):
        upper, _, stepper = slider(skfem.ElementHex1, sliding=sliding)
        stepper.move("high", "x", 1e-7, lambda t: max(t - 1.0, 0.0), body=upper)
        scale = 1e-4
        stepper._motions = [(scale * moved, factor) for moved, factor in stepper._motions]
        forces.append(stepper.run([1.0, 2.0]).results[-1].resultant)
    assert np.abs(forces[0] - forces[1]).max() <= 1e-3 * np.abs(forces[0]).max()


@pytest.mark.slow
def test_the_work_of_the_supports_is_stored_or_rubbed_off() -> None:
    """Both sides of the balance of energy, whose difference falls with the size of the steps."""
    left = []
    for count in (4, 8, 16):
        upper, _, stepper = slider(skfem.ElementHex1)
        pushed(stepper, upper, 0.35)
        times = np.concatenate(
            (np.linspace(0, 1, count // 2 + 1)[1:], np.linspace(1, 2, count)[1:])
        )
        work = rubbed = 0.0
        body = stepper.problem.body
        u = forces = np.zeros_like(body.f)
        for result in stepper.run(times):
            now = body.internal(result.u) + result.contact_forces - result.applied
            work += 0.5 * (forces + now) @ (result.u - u)
            slip = result.system.slip_increment((result.system.rows.T @ result.u).reshape(-1, 2))
            rubbed += float(np.sum(result.t * slip))
            u, forces = result.u, now
        stored = 0.5 * u @ (body.stiffness @ u)
        left.append(abs(work - stored - rubbed) / work)
        assert stored > 0
        assert rubbed > 0.05 * work
    assert left[2] < left[1] < left[0]
    assert left[2] <= 0.02


@pytest.mark.turns(4)
def test_a_history_is_stored_and_resumed(tmp_path: Path) -> None:
    upper, _, stepper = slider(skfem.ElementHex1)
    times, path = [0.5, 1.0, 1.5, 2.0], tmp_path / "run"
    history = pushed(stepper, upper, 0.35, 0.1).run(times, path=path)
    read = LoadHistory.load(path)
    assert len(read) == 4
    for one, other in zip(history, read, strict=True):
        assert np.array_equal(one.mu, other.mu)
        assert np.array_equal(one.gap, other.gap)
        assert max(other.kkt.values()) <= 1e-10
    for step in (3, 4):
        (path / f"step_{step:05d}.npz").unlink()
    upper, _, again = slider(skfem.ElementHex1)
    resumed = pushed(again, upper, 0.35, 0.1).resume(path)
    assert len(resumed) == 4
    assert np.abs(resumed[3].mu - history[3].mu).max() <= 1e-9 * history[3].mu.max()
    upper, _, another = slider(skfem.ElementHex1)
    with pytest.raises(InputError, match="another problem"):
        pushed(another, upper, 0.3, 0.1).resume(path)


@pytest.mark.turns(4)
def test_facets_leave_the_edge_and_then_the_body() -> None:
    upper, _, stepper = slider(skfem.ElementHex1)
    pushed(stepper, upper, 1.0)
    forces = [stepper.step(time).resultant[2] for time in (1.0, 2.0, 2.7, 2.9, 3.2)]
    assert forces[-1] < forces[-2] < forces[-3] < forces[0]
    with pytest.raises(InputError, match="no facet lies opposite"):
        stepper.step(4.5)
    upper, _, stepper = slider(skfem.ElementHex1)
    turn = lambda t: 0.2 * max(t - 1.0, 0.0)  # noqa: E731
    stepper.move("high", "x", lambda x: 0.7 - x[1], turn, body=upper)
    stepper.move("high", "y", lambda x: x[0] - 1.0, turn, body=upper)
    stepper.run([1.0, 1.3])
    with pytest.raises(InputError, match="'upper' turns by"):
        stepper.step(2.0)
