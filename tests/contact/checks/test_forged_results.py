"""What was changed in a result after its solve is found by `recheck`, and named."""

from dataclasses import replace

import numpy as np
import pytest
from certified_cases import square

from contact import ContactProblem, InputError, NotConverged, Status, recheck


def at_bound(result):
    """A sticking point is said to slide: its friction reaches the bound."""
    point = np.flatnonzero(result.status == Status.STICK)[0]
    assert np.abs(result.slip[point]) < 1e-12
    t = result.t.copy()
    t[point] = np.sign(t[point]) * result.system.bound(result.mu)[point]
    return {"t": t}


def moved(array, index, by):
    array = array.copy()
    array[index] += by
    return array


FORGED = {
    "a multiplier": (lambda r: {"mu": moved(r.mu, r.mu.argmax(), 1e-8)}, "equilibrium"),
    "a displacement": (lambda r: {"u": moved(r.u, free_dof(r), 1e-7)}, "equilibrium"),
    "a held displacement": (lambda r: {"u": moved(r.u, held_dof(r), 1e-7)}, "support"),
    "closed to open": (lambda r: {"mu": np.where(r.mu == r.mu.max(), 0.0, r.mu)}, "balance"),
    "stick to slip": (at_bound, "equilibrium"),
    "beyond the cone": (lambda r: {"t": moved(r.t, r.t.argmax(), r.mu.max())}, "cone"),
    "against the slip": (lambda r: {"t": -r.t}, "slip"),
    "tension": (lambda r: {"mu": moved(r.mu, r.mu.argmin(), -2 * r.mu.max())}, "sign"),
    "a force without contact": (
        lambda r: {"mu": moved(r.mu, r.gap.argmax(), r.mu.max())}, "complementarity"),
    "a gap": (lambda r: {"system": of_rows(r, gap=r.system.rows.gap - 1e-3)}, "penetration"),
    "a load": (
        lambda r: {"system": replace(r.system, load=moved(r.applied, free_dof(r), 1e-6))},
        "equilibrium",
    ),
    "a coefficient": (
        lambda r: {"system": replace(r.system, friction=0.5 * r.system.friction)}, "cone"),
}  # fmt: skip


def of_rows(result, **changed):
    return replace(result.system, rows=replace(result.system.rows, **changed))


def free_dof(result):
    P = result.system.body.constraint[0]
    return np.flatnonzero(np.diff(P.indptr))[-1]


def held_dof(result):
    P = result.system.body.constraint[0]
    return np.flatnonzero(np.diff(P.indptr) == 0)[0]


@pytest.fixture(scope="module")
def lifted(make):
    """Points that are open, stick and slip."""
    body = square(make, 8).fix("top", "y", -0.02).fix("top", "x", 0.005)
    problem = ContactProblem(body, "bottom", lambda x: 0.06 * np.maximum(x[0] - 0.6, 0), 0.2)
    result = problem.solve()
    assert set(result.status) == {0, 1, 2}
    return result


@pytest.mark.parametrize("forged", FORGED)
def test_what_was_tampered_with_is_named(forged, lifted):
    change, name = FORGED[forged]
    recheck(lifted)
    with pytest.raises(NotConverged, match=f"fails its certificate.* {name} ") as caught:
        recheck(replace(lifted, **change(lifted)))
    assert caught.value.history == lifted.history


def test_tolerance(lifted):
    largest = max(recheck(lifted).values())
    with pytest.raises(NotConverged, match=f"at tolerance {largest / 2:.1e}"):
        recheck(lifted, largest / 2)
    wrong = replace(lifted, mu=lifted.mu * (1 + 1e-7))
    assert recheck(wrong, 1e-5)["equilibrium"] > 1e-10
    assert recheck(replace(wrong, tol=1e-5)) == recheck(wrong, 1e-5)
    loose = replace(wrong, tol=None, method="fixed_point")  # which is held to 1e-6
    assert recheck(loose) == recheck(wrong, 1e-5)
    for tol in (0.0, -1e-9, 1.0, np.nan, "small", [1e-9, 1e-8]):
        with pytest.raises(InputError, match="tol"):
            recheck(lifted, tol)


def test_friction_has_the_slack_of_its_method(lifted):
    wrong = replace(lifted, t=lifted.t * (1 + 1e-9), tol=1e-5)
    recheck(wrong)
    over = recheck(wrong)["cone"]
    assert 1e-10 < over < 1e-8
    tight = replace(wrong, t=lifted.t * (1 + 1e-3), tol=1e-2, slack=0.0)
    assert recheck(tight)["cone"] > 1e-5
    with pytest.raises(NotConverged, match="cone"):
        recheck(replace(tight, tol=1e-6))
    with pytest.raises(NotConverged) as caught:
        recheck(replace(tight, tol=1e-6, slack=1e-2))
    assert "cone" not in str(caught.value)
