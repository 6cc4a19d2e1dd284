"""Adhesion, hardness and wear under rigid tools that move far."""

import numpy as np
from far_blocks import ROLLER, R, block, run
from scipy.integrate import solve_ivp
from skfem import ElementQuad1

from contact import (
    ContactProblem,
    Moved,
    Wear,
)

DEEP, C, K = 0.02, 2.0, 0.4  # depth, stiffness of the springs, coefficient of wear


def springs(wear, count, n=40, way=0.6, **more):
    """A roller along springs on a stiff block, in steps of way / count; c is c(x) at its axis."""
    body = block(ElementQuad1, n, E=1e6)
    tool = lambda t: Moved(ROLLER, (way * max(t - 1, 0) - way / 2, -DEEP * min(t, 1)))  # noqa: E731
    problem = ContactProblem(body, "top", tool(0), overclosure=C, wear=wear, **more)
    return run(problem, tool, np.r_[1.0, 1 + np.arange(1, count + 1) / count])


def compressed(x):
    return np.maximum(DEEP - (R - np.sqrt(np.maximum(R**2 - x**2, 0.0))), 0.0)


def test_what_is_worn_off_a_tool_stays_with_it():
    """Points of the roller wear under springs that pass: w = c (1 - exp(-k C s)), place by place."""
    errors = []
    for n, count in ((20, 15), (40, 30), (80, 60)):
        last = springs(Wear(0.0, K), count, n).results[-1]
        x = last.x[0] - 0.3
        there = np.abs(x) < 0.7 * np.sqrt(2 * R * DEEP)
        exact = compressed(x) * -np.expm1(-K * C * 0.6)
        errors.append(np.abs(last.worn[1] - exact)[there].max() / exact.max())
    print(errors)
    assert errors[2] < 0.03
    assert errors[0] > 1.5 * errors[1] > 2 * errors[2]


def test_what_is_worn_off_a_body_stays_behind():
    """Places of the body wear as the roller passes: dw/ds = k C (c(x - s) - w)."""
    errors = []
    for n, count in ((40, 30), (80, 120)):
        last = springs(Wear(K), count, n).results[-1]
        x, way = last.x[0], 0.6
        there = np.flatnonzero(np.abs(x) < 0.4)
        found = solve_ivp(
            lambda s, w: K * C * np.maximum(compressed(x[there] + way / 2 - s) - w, 0.0),
            (0, way), 0.0 * there, max_step=1e-3,
        ).y[:, -1]  # fmt: skip
        errors.append(np.abs(last.worn[0][there] - found).max() / found.max())
    print(errors)
    assert errors[1] < 0.03
    assert errors[0] > 2 * errors[1]
