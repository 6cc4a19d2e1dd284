"""Friction where supports and given motions prescribe the slip: F p against it, in every sum."""

from dataclasses import replace

import numpy as np
import pytest
from families import PLANE_AND_BFS, STRAIGHT
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import ElementHex1, ElementQuad1, MeshHex

from contact import (
    ContactProblem,
    ContactResult,
    ElasticBody,
    LoadStepper,
    NotConverged,
    Plane,
    Rigid,
    Status,
    cross_check,
    recheck,
    uniqueness,
)
from contact.result.certify import certify

F = 0.3
METHODS = ["newton", "pdas", "fixed_point", "tresca_loop", "qp:osqp"]
LAWS = {"coulomb": F, "tresca": 0.01}


def block(n=4, element=ElementQuad1, push=0.1):
    """A block of unit width, pushed to the right at its left end and pressed from above."""
    ticks = np.linspace(0, 1, n + 1), np.linspace(0, 1, 5)
    mesh = STRAIGHT[element].init_tensor(*ticks).with_defaults()
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    return body.fix("left", "x", push).fix("top", "y", -0.05)


def cube(n=3):
    ticks = np.linspace(0, 1, n + 1)
    mesh = MeshHex.init_tensor(ticks, ticks, ticks).with_boundaries(
        {
            "bottom": lambda x: x[2] < 1e-9,
            "top": lambda x: x[2] > 1 - 1e-9,
            "left": lambda x: x[0] < 1e-9,
        }
    )
    return ElasticBody.from_mesh(mesh, ElementHex1(), E=1.0, nu=0.3)


def balanced(result):
    """Contact forces and those of the supports; the certificate."""
    reactions = result.body.total(result.reactions)
    np.testing.assert_allclose(reactions, -result.resultant, atol=1e-12)
    assert max(result.kkt.values()) < 1e-10


@pytest.mark.parametrize("element", PLANE_AND_BFS)
@pytest.mark.parametrize("n", [4, 8])
def test_a_block_pushed_along_a_wall_has_all_of_its_friction(element, n) -> None:
    result = ContactProblem(block(n, element), "bottom", 0.0, F).solve()
    assert np.all(result.status == Status.SLIP)
    assert result.resultant[0] == pytest.approx(-F * result.resultant[1], rel=1e-10)
    np.testing.assert_allclose(result.shear[:, 0], -F * result.pressure, rtol=1e-9)
    balanced(result)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("method", METHODS)
def test_every_method_and_law(method, law) -> None:
    if (law, method) == ("tresca", "tresca_loop"):
        pytest.skip("given friction needs no loop")
    problem = ContactProblem(block(push=-0.1), "bottom", 0.0, LAWS[law], law=law)
    result = problem.solve(method=method)
    bound = F * result.resultant[1] if law == "coulomb" else 0.01
    rel = {"fixed_point": 1e-4, "qp:osqp": 1e-6}.get(method, 1e-9)
    assert result.resultant[0] == pytest.approx(bound, rel=rel)
    corner = result.x_nominal[0] < 1e-9
    assert np.all(result.status[corner] == Status.SLIP)
    expected = F * result.pressure[corner] if law == "coulomb" else 0.01
    np.testing.assert_allclose(result.shear[corner, 0], expected, rtol=1e-9)


def test_points_held_at_rest_are_undetermined() -> None:
    result = ContactProblem(block(push=0.0), "bottom", 0.0, F).solve()
    corner = result.x_nominal[0] < 1e-9
    assert np.array_equal(result.status == Status.UNDETERMINED, corner)
    assert np.all(result.shear[corner] == 0.0)
    assert "1 undetermined" in result.summary()
    smooth = ContactProblem(block(push=0.0), "bottom", 0.0).solve()
    assert not np.any(smooth.status == Status.UNDETERMINED)


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.0])
def test_a_direction_in_space(turn) -> None:
    slip = 0.1 * np.array([np.cos(turn), np.sin(turn)])
    body = cube().fix("bottom", "x", slip[0]).fix("bottom", "y", slip[1]).fix("top", "z", -0.05)
    result = ContactProblem(body, "bottom", 0.0, F).solve()
    expected = -F * result.resultant[2] * np.array([np.cos(turn), np.sin(turn)])
    np.testing.assert_allclose(result.resultant[:2], expected, atol=1e-12)
    balanced(result)


@pytest.mark.parametrize("moves", ["body", "obstacle", "both"])
def test_motions_of_the_obstacle_count(moves) -> None:
    own = {"body": 0.1, "obstacle": 0.0, "both": 0.03}[moves]
    body = block(push=own).fix("bottom", "x", own)
    ground = Rigid(Plane((0, 0), (0, 1)), displacement=(own - 0.1, 0))
    result = ContactProblem(body, "bottom", ground, F).solve()
    assert result.resultant[0] == pytest.approx(-F * result.resultant[1], rel=1e-12)


def test_an_obstacle_pulled_over_held_points_is_held_by_their_friction() -> None:
    """Below F N the foundation sticks to points that supports hold; the force is theirs."""
    body = block(push=0.0).fix("bottom", "x", 0.0)
    ground = Rigid(Plane((0, 0), (0, 1)), displacement=(None, 0.0), force=(0.01, None))
    result = ContactProblem(body, "bottom", ground, F).solve()
    assert F * result.resultant[1] > 0.01
    assert result.resultant[0] == pytest.approx(0.01, rel=1e-9)
    assert max(result.kkt.values()) < 1e-10


def test_a_history_that_grows_returns_and_stops() -> None:
    path = [0.0, 0.01, 0.02, 0.015, 0.015, 0.0, 0.005]
    body = block(push=0.0)
    problem = ContactProblem(body, "bottom", 0.0, F)
    stepper = LoadStepper(problem)
    stepper.move("left", "x", 1.0, lambda t: float(np.interp(t, range(len(path)), path)))
    history = stepper.run(np.arange(1.0, len(path)))
    corner = history[0].x_nominal[0] < 1e-9
    for result, step in zip(history, np.diff(path), strict=True):
        expected = -np.sign(step) * F * result.pressure[corner]
        np.testing.assert_allclose(result.shear[corner, 0], expected, atol=1e-12)
        state = Status.SLIP if step else Status.UNDETERMINED
        assert np.all(result.status[corner] == state)
        assert max(result.kkt.values()) < 1e-10


def test_the_certificate_misses_the_shear() -> None:
    result = ContactProblem(block(), "bottom", 0.0, F).solve()
    forged = result.t.copy()
    forged[result.x_nominal[0] < 1e-9] = 0.0
    system = result.system
    assert system.kkt(result.u, result.mu, forged)["slip"] > 1e-2
    with pytest.raises(NotConverged, match="slip"):
        certify(replace(result, t=forged), 1e-10, 0.0)
    turned = np.where(result.x_nominal[0, :, None] < 1e-9, -result.t, result.t)
    with pytest.raises(NotConverged, match="slip"):
        recheck(replace(result, t=turned))


@pytest.mark.parametrize("push", [0.0, 0.1])
@pytest.mark.parametrize("law", LAWS)
def test_checks_agree_and_files_keep_it(law, push, tmp_path) -> None:
    problem = ContactProblem(block(push=push), "bottom", 0.0, LAWS[law], law=law)
    result = problem.solve()
    assert max(recheck(result).values()) < 1e-10
    for condensed in (True, False):
        assert cross_check(problem, result, condensed=condensed).verdict == "agrees"
    assert uniqueness(problem, result, starts=2).others == ()
    again = ContactResult.load(result.save(tmp_path / "held"))
    np.testing.assert_array_equal(again.status, result.status)
    np.testing.assert_array_equal(again.shear, result.shear)


SLIPS = st.floats(-5.0, -1.0).flatmap(lambda e: st.sampled_from((-(10.0**e), 10.0**e)))


@settings(max_examples=15, deadline=None)
@given(push=SLIPS, friction=st.floats(0.05, 0.9), law=st.sampled_from(tuple(LAWS)))
def test_any_push_in_the_plane(make, push, friction, law) -> None:
    given_bound = friction if law == "coulomb" else 0.02 * friction
    result = ContactProblem(block(push=push), "bottom", 0.0, given_bound, law=law).solve()
    assert make.law_error(result) < 1e-9
    corner = result.x_nominal[0] < 1e-9
    bound = friction * result.pressure[corner] if law == "coulomb" else given_bound
    np.testing.assert_allclose(result.shear[corner, 0], -np.sign(push) * bound, rtol=1e-9)
    balanced(result)


@settings(max_examples=10, deadline=None)
@given(
    slip=SLIPS,
    drag=st.floats(-0.1, 0.1),
    where=st.sampled_from(("bottom", "left")),
    friction=st.floats(0.05, 1.0),
    law=st.sampled_from(tuple(LAWS)),
)
def test_any_slip_of_one_component_in_space(make, slip, drag, where, friction, law) -> None:
    body = cube(2).fix(where, "x", slip).fix("top", "z", -0.05).fix("top", "y", drag)
    bound = friction if law == "coulomb" else 0.02 * friction
    result = ContactProblem(body, "bottom", 0.0, bound, law=law).solve()
    assert make.law_error(result) < 1e-9
    balanced(result)
