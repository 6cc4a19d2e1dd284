"""A quarter of a ring, radii A < B, plane strain, and Lame's pressure on its sides.

S. P. Timoshenko and J. N. Goodier, Theory of Elasticity, 3rd ed., McGraw-Hill 1970, article 28.
"""

import numpy as np
from families import SOLID, mapped

from contact import ElasticBody

A, B, NU, DEPTH = 1.0, 2.0, 0.3, 0.3


def ring(make, element, n, curved=False, a=A, angles=None, size=1.0, turn=0.0):
    """The ring, n facets on its outer side, held in its planes of symmetry; its bore is "left"."""
    solid = element in SOLID
    angles = np.linspace(0, np.pi / 2, n + 1) if angles is None else angles
    ticks = [np.linspace(a, B, max(2, n // 2) + 1), angles]
    ticks += [np.array([0.0, DEPTH])] if solid else []
    ends = ("front", "back") if solid else ("bottom", "top")

    def polar(x):
        r, angle, *depth = x
        return size * np.array([r * np.cos(angle + turn), r * np.sin(angle + turn), *depth])

    body = ElasticBody.from_mesh(mapped(element, ticks, polar, curved), element(), E=1.0, nu=NU)
    body.fix(ends[0], "y").fix(ends[1], "x")
    return body.fix(["bottom", "top"], "z") if solid else body


def lame(side, d):
    """Pressure on the side that a rigid hole ("right") or shaft ("left") moves by d."""
    E, nu, k = 1 / (1 - NU**2), NU / (1 - NU), (B**2 + A**2) / (B**2 - A**2)
    return d * E / (B * (k - nu)) if side == "right" else d * E / (A * (k + nu))
