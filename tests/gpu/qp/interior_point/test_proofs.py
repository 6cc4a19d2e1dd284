"""Proofs of infeasibility: right, and known about as soon as a solution would be."""

import numpy as np
import pytest
from scipy import sparse

from gpu import Infeasible, solve_qp

STEPS, STATES, INPUTS = 40, 6, 2


def control(reach, state=np.inf, goal=None):
    """Steer a slightly unstable system by inputs within `reach`, states within `state`."""
    rng = np.random.default_rng(5)
    F = rng.standard_normal((STATES, STATES))
    F *= 1.02 / abs(np.linalg.eigvals(F)).max()
    B = rng.standard_normal((STATES, INPUTS))
    now = np.hstack([-B, np.eye(STATES)])
    before = np.hstack([np.zeros((STATES, INPUTS)), -F])
    A = sparse.kron(sparse.eye_array(STEPS), now) + sparse.kron(
        sparse.eye_array(STEPS, k=-1), before
    )
    b = np.zeros(STEPS * STATES)
    b[:STATES] = F @ np.ones(STATES)
    ub = np.tile(np.r_[np.full(INPUTS, reach), np.full(STATES, state)], STEPS)
    lb = -ub
    if goal is not None:
        lb[-STATES:] = goal
    return {"P": sparse.eye_array(ub.size), "q": np.zeros(ub.size), "A": sparse.csr_array(A),
            "b": b, "lb": lb, "ub": ub}  # fmt: skip


@pytest.mark.parametrize(
    ("empty", "steps"),
    [(control(0.02, 0.5), 5), (control(0.02, goal=50.0), 20)],
    ids=["bounded states", "free states"],
)
def test_multipliers_that_grow_prove_a_contradiction(empty, steps):
    """A search for a proof of its own would come after forty steps that do not succeed."""
    with pytest.raises(Infeasible) as caught:
        solve_qp(**empty, max_steps=steps)
    y, A = caught.value.certificate, empty["A"]
    c = A.T @ y
    corner = np.where(c > 0, empty["ub"], empty["lb"])
    # Along variables without bounds nothing but rounding is left.
    loose = np.isinf(corner)
    assert (abs(c) <= 1e-12 * (abs(A).T @ abs(y)))[loose].all()
    assert c[~loose] @ corner[~loose] < (1 - 1e-3) * (y @ empty["b"])
