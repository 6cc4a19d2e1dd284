"""Limits of steps and of time end a solve with the best point and its residuals."""

import numpy as np
import pytest
from scipy import sparse

from gpu import Infeasible, InputError, NotConverged, QPFactor, Unbounded, solve_qp


def boxes():
    n = 60
    i = np.arange(n)
    return {"P": 1.0 / (1.0 + abs(i - i[:, None])), "q": np.cos(i), "lb": -0.5, "ub": 0.1}


def rows():
    rng = np.random.default_rng(3)
    G = rng.standard_normal((40, 20))
    return {"P": np.eye(20), "q": 3.0 * rng.standard_normal(20), "G": G, "h": G.sum(axis=1) + 0.1}


def stored_sparsely():
    n = 80
    P = sparse.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    return {"P": P, "q": np.full(n, 0.01), "lb": -0.3, "A": np.ones((1, n)), "b": [1.0]}


def empty():
    """Contradictory rows, which no two of them show."""
    G = sparse.csr_array([[1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [-1.0, 0.0, -1.0]])
    return {"P": sparse.eye_array(3), "q": np.ones(3), "G": G, "h": [1.0, 1.0, -3.0]}


@pytest.mark.parametrize("problem", [boxes, rows, stored_sparsely])
@pytest.mark.parametrize("limit", [{"max_steps": 1}, {"time_limit": 1e-9}], ids=str)
def test_the_first_step_is_the_last(problem, limit):
    data = problem()
    if "time_limit" in limit:  # the compiled method ends before one looks at the clock
        data["P"] = QPFactor(data["P"])
    with pytest.raises(NotConverged, match=r"^time_limit, max_steps: after 1 steps") as caught:
        solve_qp(**data, **limit)
    x, kkt = caught.value.x, caught.value.kkt
    assert x.shape == data["q"].shape
    assert 1e-9 < kkt.worst < np.inf
    assert f"{kkt}" in str(caught.value)
    # From there it goes on to the same answer.
    result = solve_qp(**data)
    np.testing.assert_allclose(solve_qp(**data, start=x).x, result.x, atol=1e-10)


@pytest.mark.parametrize("problem", [boxes, rows, stored_sparsely])
def test_the_best_point_counts_and_more_steps_find_a_better_one(problem):
    data, errors = problem(), []
    exact = solve_qp(**data)
    assert exact.iterations > 2
    for steps in range(1, exact.iterations):
        try:
            found = solve_qp(**data, max_steps=steps)
        except NotConverged as error:
            errors.append(error.kkt.worst)
        else:
            np.testing.assert_allclose(found.x, exact.x, atol=1e-10)
    assert errors[-1] == min(errors) < errors[0]


def test_limits_that_are_not_reached_change_nothing():
    for problem in (boxes, rows, stored_sparsely):
        data = problem()
        limited = solve_qp(**data, max_steps=1000, time_limit=1000)
        assert (limited.x == solve_qp(**data).x).all()


def test_proofs_are_counted():
    with pytest.raises(Infeasible):
        solve_qp(**empty())
    with pytest.raises(NotConverged) as caught:
        solve_qp(**empty(), max_steps=3)
    assert caught.value.kkt.primal > 1e-3
    falling = {"P": sparse.csr_array((2, 2)), "q": [-1.0, 0.0], "G": [[0.0, 1.0]], "h": [1.0]}
    with pytest.raises(Unbounded):
        solve_qp(**falling)
    with pytest.raises(NotConverged):
        solve_qp(**falling, max_steps=2)


@pytest.mark.parametrize(
    ("name", "value"),
    [("time_limit", 0.0), ("time_limit", np.nan), ("time_limit", "1"), ("max_steps", 0),
     ("max_steps", 1.5), ("polish", "bits")],
)  # fmt: skip
def test_a_wrong_limit_is_named(name, value):
    with pytest.raises(InputError, match=rf"^{name}"):
        solve_qp(np.eye(2), np.zeros(2), **{name: value})
