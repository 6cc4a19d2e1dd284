"""Closed forms of a sphere that adheres to a half space, in units a* = R = 1: pi w = K = 4 E* / 3.

D. Maugis, J. Colloid Interface Sci. 150 (1992), 243-269: with lambda = 2 sigma_0 / K, the contact
radius A and the outer radius m A of the cohesive zone, P over pi w R. The limit of large lambda is
JKR's, -1.5, that of small lambda DMT's, -2.
"""

import numpy as np
from scipy.optimize import brentq, minimize_scalar

E, NU = 0.91, 0.3
STAR = E / (1 - NU**2)
K = 4 * STAR / 3
WORK = K / np.pi


def state(lam, m):
    """Force over pi w R, contact radius, approach."""
    s = np.sqrt(m * m - 1)
    t = np.arctan(s)
    p, q = lam / 2 * (s + (m * m - 2) * t), 4 * lam**2 / 3 * (s * t - m + 1)
    A = (-q + np.sqrt(q * q + 4 * p)) / (2 * p)
    return A**3 - lam * A * A * (s + m * m * t), A, A * A - 4 / 3 * lam * A * s


def pull_off(lam):
    """Least force over pi w R."""
    found = minimize_scalar(
        lambda x: state(lam, 1 + np.exp(x))[0], bounds=(-10, 9), method="bounded",
        options={"xatol": 1e-10},
    )  # fmt: skip
    return found.fun


def at_radius(lam, A):
    """Force over pi w R at a contact radius."""
    x = brentq(lambda x: state(lam, 1 + np.exp(x))[1] - A, -12, 6)
    return state(lam, 1 + np.exp(x))[0]
