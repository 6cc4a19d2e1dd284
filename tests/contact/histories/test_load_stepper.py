"""Load histories: the law in increments, paths, interruptions, files."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementTriP2

from contact import (
    ClosestPoint,
    ContactProblem,
    Cylinder,
    ElasticBody,
    InputError,
    LoadStepper,
    NotConverged,
    Plane,
    Rigid,
    Status,
    cross_check,
    uniqueness,
)
from contact.histories import load_stepper
from skfem_adini import ElementQuadAdini

TIMES = np.linspace(0.125, 2.0, 16)


def law_of_increments(history, friction):
    """Largest violation of the incremental Coulomb law, from its definition."""
    worst, before = 0.0, 0.0
    for result in history.results:
        u_t = (result.system.rows.T @ result.u).reshape(result.t.shape)
        step = u_t - before
        before = u_t
        bound = friction * result.mu
        force = np.abs(result.mu).max()
        size = np.linalg.norm(result.t, axis=1)
        power = np.sum(result.t * step, axis=1) - bound * np.linalg.norm(step, axis=1)
        length = np.abs(result.u).max()
        worst = max(worst, np.max(size - bound) / force, np.abs(power).max() / force / length)
    return worst


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementTriP2, ElementQuad1, ElementHex1])
def test_every_step_meets_the_law_in_increments(element, make):
    n = 3 if element is ElementHex1 else 6
    history = make.dragged(element, n=n).run(TIMES)
    # Newton's tolerance on the condensed problem is 1e-12.
    assert law_of_increments(history, 0.3) < 1e-10
    assert max(max(result.kkt.values()) for result in history.results) < 1e-10
    last = history.results[-1]
    # The oracle sees the difference: one solve at the end of the path breaks it.
    direct = ContactProblem(last.system.body, "bottom", 0.0, 0.3).solve()
    assert np.abs(direct.t - last.t).max() > 0.1 * np.abs(last.t).max()
    kinds = {Status(s) for result in history.results for s in result.status}
    assert {Status.STICK, Status.SLIP} <= kinds


def test_sliding_block_dissipates(make):
    """A closed cycle of dragging: work of friction = what the top put in (elastic at the ends)."""
    element = ElementQuadAdini
    ticks = np.linspace(0, 1, 7)
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks), element(), E=1.0, nu=0.3)
    body.fix("top")
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, 0.3))
    stepper.move("top", "y", -0.05, lambda t: 1.0).move("top", "x", 0.2, lambda t: np.sin(t))
    history = stepper.run(np.linspace(0, 4 * np.pi, 129)[1:])
    friction, before = [], 0.0
    for result in history.results:
        friction.append(float(np.sum(result.t * (result.slip - before))))
        before = result.slip
    assert min(friction) > -1e-15  # friction never gives energy back
    # Over the second cycle the elastic energy returns to itself; work by the trapezoidal rule.
    force = -history.resultant[:, 0]  # of the top on the body
    shift = 0.2 * np.sin(history.times)
    work = 0.5 * (force[1:] + force[:-1]) * np.diff(shift)
    put_in, lost = work[63:].sum(), sum(friction[64:])
    assert lost > 0.01 * put_in > 0
    # The rule's error in the step, 64 steps a cycle.
    assert abs(put_in / lost - 1) < 0.05


def test_cross_check_of_a_step(make):
    stepper = make.dragged()
    history = stepper.run(TIMES[:9])
    last = history.results[-1]
    for condensed in (False, True):  # the supports of the step are not those of the problem
        check = cross_check(stepper.problem, last, "osqp", condensed=condensed)
        assert check.displacement < 1e-7
        assert check.multipliers < 1e-6


def test_after_is_a_step(make):
    stepper = LoadStepper(make.problem(8, 0.3)).load("top", (0.2, -0.5))
    history = stepper.run([1.0, 2.0])
    problem = make.problem(8, 0.3)
    assert np.array_equal(LoadStepper(problem).run([1.0])[0].u, problem.solve().u)
    load, result = problem.body.f.copy(), None
    problem.body.load("top", (0.2, -0.5))
    extra = problem.body.f - load
    for t in (1.0, 2.0):
        problem.body.f = load + t * extra
        result = problem.solve(after=result)
    # Newton's tolerance of 1e-12 times the condition of the body.
    assert np.abs(result.u - history.results[-1].u).max() < 1e-10 * np.abs(result.u).max()


@pytest.mark.filterwarnings("ignore:displacements reach")
def test_body_force_and_supports_as_functions_of_time(make):
    """Without contact a step is linear elasticity under that step's data."""
    body = make.block(6, sides=()).fix("top", "y", lambda x: 0.1 * x[0])
    stepper = LoadStepper(ContactProblem(body, "bottom", 10.0))
    stepper.body_force((0.03, 0.01), lambda t: t**2).load(
        "left", lambda x: 0.1 * np.array([x[1], 0 * x[1]])
    )
    stepper.move("top", "y", lambda x: 0.2 * x[0] ** 2, lambda t: 3 * t)
    result = stepper.run([0.5, 2.0]).results[-1]
    other = make.block(6, sides=()).fix("top", "y", lambda x: 0.1 * x[0] + 1.2 * x[0] ** 2)
    other.body_force((0.12, 0.04)).load("left", lambda x: 0.2 * np.array([x[1], 0 * x[1]]))
    expected = ContactProblem(other, "bottom", 10.0).solve()
    # One solve with a matrix of condition 1e4.
    assert np.abs(result.u - expected.u).max() < 1e-12 * np.abs(expected.u).max()


@pytest.mark.parametrize(
    "obstacle",
    [lambda t: 0.01 * (1 - t), lambda t: Rigid(0.0, force=(0.0, 0.1 * t), rotation=0.0)],
    ids=["gap", "force"],
)
def test_from_rest(obstacle, make):
    """Nothing moves until the obstacle does; what it does then is another step, and unique."""
    body = ElasticBody.from_mesh(make.box(ElementQuad1, *(np.linspace(0, 1, 5),) * 2), E=1.0, nu=0)
    problem = ContactProblem(body.fix("top", "xy"), "bottom", obstacle(0.0), 0.05)
    rest, pressed = LoadStepper(problem).obstacle(obstacle).run([0.0, 2.0]).results
    assert not rest.u.any()
    direct = ContactProblem(body, "bottom", obstacle(2.0), 0.05).solve()
    assert np.abs(pressed.u - direct.u).max() < 1e-12
    assert pressed.contact_force > 1e-3
    assert not uniqueness(problem, pressed, starts=2).others


def test_progress_and_callback(make, capsys):
    lines = []
    make.dragged(n=4).run(TIMES[:3], progress=True, callback=lines.append)
    assert [line.number for line in lines] == [1, 2, 3]
    assert all(line.count == 3 and line.seconds > 0 for line in lines)
    printed = capsys.readouterr().out.splitlines()
    assert printed == [str(line) for line in lines]
    assert "slip" in printed[0]


def test_resume_of_another_problem(make, tmp_path):
    make.dragged().run(TIMES[:2], path=tmp_path / "run")
    with pytest.raises(InputError, match="another problem"):
        make.dragged(friction=0.2).resume(tmp_path / "run")
    with pytest.raises(InputError, match="another problem"):
        make.dragged(gap=0.01).resume(tmp_path / "run")
    other_way = make.dragged()
    other_way._motions[-1] = other_way._motions[-1][0], np.cos
    with pytest.raises(InputError, match="another problem"):
        other_way.resume(tmp_path / "run")
    assert len(other_way.history) == 0
    with pytest.raises(InputError, match="no load history"):
        make.dragged().resume(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="not empty"):
        make.dragged().run(TIMES, path=tmp_path / "run")


def test_steps_of_other_supports_or_places_are_refused(make):
    """What moves supports was made for them; as many points elsewhere say nothing of slip."""
    stepper = make.dragged(n=2)
    body = stepper.problem.body
    stepper.run(TIMES[:1])
    other = ContactProblem(body, "left", 0.0, 0.3).solve()
    with pytest.raises(InputError, match="other places"):
        ContactProblem(body, "bottom", 0.0, 0.3).solve(after=other)
    body.fix("left", "x")
    with pytest.raises(InputError, match="make a new one"):
        stepper.run(TIMES[1:2])


def test_closest_points_keep_their_directions(make):
    """A roller measured to its closest points rolls on within a Rigid, not by another place."""

    def roller(x):
        return ClosestPoint(Cylinder((x, -2.0), 2.01))

    body = make.dragged(n=4).problem.body
    stepper = LoadStepper(ContactProblem(body, "bottom", roller(0.5), 0.3))
    with pytest.raises(InputError, match=r"other directions.*Rigid"):
        stepper.obstacle(lambda t: roller(0.5 + 0.1 * t)).run([1.0])
    with pytest.raises(InputError, match="other directions"):
        stepper.obstacle(lambda t: Cylinder((0.5, -2.0), 2.01)).run([1.0])
    moved = stepper.obstacle(lambda t: Rigid(roller(0.5), displacement=(0.01 * t, 0.0))).step(1.0)
    assert moved.resultant[0] > 0
    floor = LoadStepper(ContactProblem(body, "bottom", ClosestPoint(Plane((0, 0), (0, 1))), 0.3))
    rising = floor.obstacle(lambda t: ClosestPoint(Plane((0, 0.02 * t), (0, 1)))).step(1.0)
    plain = ContactProblem(body, "bottom", Plane((0, 0.02), (0, 1)), 0.3)
    moving = LoadStepper(plain).obstacle(lambda t: Plane((0, 0.02 * t), (0, 1))).step(1.0)
    for found in (rising, moving):
        assert np.abs(found.u - plain.solve().u).max() < 1e-12


def test_step_that_fails_leaves_the_history(make, tmp_path):
    stepper = make.dragged()
    stepper.run(TIMES[:3])
    stepper.halvings = 0
    stepper.options = type(stepper.options)("newton", 1e-300, 1, None)
    with pytest.raises(NotConverged):
        stepper.run(TIMES[3:])
    assert len(stepper.history) == 3


def test_failing_steps_are_halved(make, monkeypatch):
    stepper = make.dragged()
    stepper.run(TIMES[:2])
    solve, asked = load_stepper.solve_system, []

    def moody(system, condensed, options, start):
        asked.append(system.body.constraint[1].max())
        if len(asked) == 1:
            raise NotConverged("a bad day")
        return solve(system, condensed, options, start)

    monkeypatch.setattr(load_stepper, "solve_system", moody)
    stepper.run(TIMES[2:3])
    assert len(asked) == 3
    assert asked[1] < asked[0] == asked[2]
