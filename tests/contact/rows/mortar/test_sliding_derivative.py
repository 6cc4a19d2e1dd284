"""The derivative of the projection against central differences of the projection itself."""

import numpy as np
import pytest
from families import PLANE
from scipy import sparse
from two_blocks import block, ring

from contact.body.rigid_modes import value_dofs
from contact.rows.mortar.mortar_rows import Interface
from contact.rows.mortar.sliding_derivative import SlidingDerivative

STEP = 1e-6


def field(body, rng, size):
    """A smooth displacement, in the values of the element."""
    u, x, a = np.zeros(body.basis.N), body.basis.doflocs, size * rng.normal(size=(2, 3))
    for c in range(2):
        own = value_dofs(body) & (np.arange(u.size) % 2 == c)
        wave = a[c, 0] * np.sin(1.3 * x[0] + a[c, 1]) + a[c, 2] * np.cos(0.7 * x[0]) * x[1]
        u[own] = wave[own]
    return u


def bent(x):
    """The middle third of a half ring of outer radius 2."""
    return ring(1.0, (0.0, 0.0), np.pi / 3)(np.array([2 - x[1], x[0]]))


@pytest.mark.parametrize("element", PLANE, ids=lambda e: e.__name__)
@pytest.mark.parametrize("place", [None, bent], ids=["flat", "bent"])
def test_derivatives_of_gap_slip_and_forces(element, place):
    rng = np.random.default_rng(5)
    upper = block(element, np.linspace(0.2, 0.8, 6), [0.01, 0.3, 0.6], place=place)
    lower = block(element, np.linspace(0.0, 1.0, 11), [-0.6, -0.3, 0.0], place=place)
    interface = Interface.of(upper, upper.facets("bottom"), lower, lower.facets("top"))
    u, v, du, dv = (field(body, rng, 1e-2) for body in (upper, lower, upper, lower))
    a, b = field(upper, rng, 1.0), field(lower, rng, 1.0)
    found = interface.displaced(u, v)
    mu, t = rng.random(found.rows.gap.size), rng.normal(size=found.rows.gap.size)
    derivative = SlidingDerivative.of(interface, found, (u, v), (du, dv), (mu, t))

    def at(step):
        now = interface.displaced(u + step * a, v + step * b)
        rows = now.rows
        through = rows.G @ (u + step * a) + now.other_G @ (v + step * b) - rows.gap
        slip = rows.T @ (du + step * a) + now.other_T @ (dv + step * b)
        forces = rows.G.T @ mu + rows.T.T @ t, now.other_G.T @ mu + now.other_T.T @ t
        return through, slip, np.concatenate(forces)

    along = np.concatenate((a, b))
    G = sparse.hstack((found.rows.G, found.other_G)) @ along
    T = sparse.hstack((found.rows.T, found.other_T)) @ along
    ours = G + derivative.normal @ along, T + derivative.tangential @ along
    ours += (derivative.force @ along,)
    for mine, ahead, behind in zip(ours, at(STEP), at(-STEP), strict=True):
        exact = (ahead - behind) / (2 * STEP)
        # The ends of segments are held, which matters as much as the gap is open.
        assert np.abs(mine - exact).max() <= 2e-2 * np.abs(exact).max()
