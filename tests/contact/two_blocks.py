"""Two bodies whose facing sides do not match: blocks of given ticks, straight, turned or bent."""

import numpy as np
from families import mapped

from contact import ElasticBody

E, NU = 2.0, 0.3
UPPER, LOWER = "bottom", "top"  # the sides that face each other


def block(element, xs, ys, *, place=None, curved=False, size=1.0, E=E, nu=NU, **more):
    """A block with ticks xs and ys and named sides, its places mapped by `place`, then scaled."""
    mesh = mapped(element, (xs, ys), lambda x: size * (x if place is None else place(x)), curved)
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=nu, **more)


def growing(step, fine, far, ratio):
    """Ticks from 0 to far: equal steps up to `fine`, then growing."""
    found = list(np.arange(round(fine / step) + 1) * step)
    while found[-1] < far:
        step *= ratio
        found.append(found[-1] + step)
    found[-1] = far
    if found[-1] - found[-2] < 0.5 * (found[-2] - found[-3]):
        del found[-2]
    return np.array(found)


def graded(rng, low, high, n):
    """Ends of n facets, neighbours up to three times as long."""
    size = rng.uniform(1, 3, n)
    return low + (high - low) * np.r_[0.0, np.cumsum(size) / size.sum()]


def turned(angle, centre=(0.0, 0.0)):
    """A rotation, as `place` of `block`."""
    c, s = np.cos(angle), np.sin(angle)
    return lambda x: np.array([[c, -s], [s, c]]) @ x + np.array(centre)[:, None]


def ring(radius, centre, angles):
    """Polar coordinates (radius, angle), as `place` of `block`; angles is added to theirs."""
    return lambda x: np.array(
        [
            centre[0] + radius * x[0] * np.cos(angles + x[1]),
            centre[1] + radius * x[0] * np.sin(angles + x[1]),
        ]
    )


def facing(element, n, m, other=None, shift=0.0, gap=0.0, curved=False, **more):
    """An upper block of n facets on [0, 1], a lower one of m on [shift, 1 + shift]."""
    other = element if other is None else other
    upper = block(element, np.linspace(0, 1, n + 1), [gap, gap + 0.4, gap + 1.0], **more)
    lower = block(other, np.linspace(shift, 1 + shift, m + 1), [-1.0, -0.5, 0.0], **more)
    return upper, lower


def sides(upper, lower, multipliers="upper"):
    """The first four arguments of `mortar_rows`."""
    pair = [upper, upper.facets(UPPER), lower, lower.facets(LOWER)]
    return pair if multipliers == "upper" else pair[2:] + pair[:2]
