"""Boxes in space that face each other, straight, bent, or with curved cells."""

import numpy as np
from families import CURVED, STRAIGHT

from contact import ElasticBody
from contact.rows.mortar.mortar_rows import mortar_rows


def box(element, cells, corner=(0.0, 0.0, 0.0), sizes=(1.0, 1.0, 1.0), place=None, curved=False):
    """A box of cells, mapped by `place`."""
    ticks = [a + np.linspace(0, l, n + 1) for a, l, n in zip(corner, sizes, cells, strict=True)]
    mesh = STRAIGHT[element].init_tensor(*ticks)
    last = ticks[2]
    named = mesh.with_boundaries(
        {
            "bottom": lambda x: np.abs(x[2] - last[0]) < 1e-9,
            "top": lambda x: np.abs(x[2] - last[-1]) < 1e-9,
        }
    )
    names = dict(named.boundaries)
    if curved:
        named = CURVED[element].from_mesh(named)
    x = named.doflocs if place is None else place(named.doflocs)
    mesh = type(named)(x, named.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)


def pair(element, other=None, shift=(0.0, 0.0), unit=1.0, place=None, **more):
    """An upper box of 3 x 2 facets above a lower one of 4 x 5."""

    def scaled(x):
        return unit * (x if place is None else place(x))

    upper = box(element, (3, 2, 1), (*shift, 1.0), place=scaled, **more)
    return upper, box(other or element, (4, 5, 1), place=scaled, **more)


def rows(upper, lower, **more):
    return mortar_rows(upper, upper.facets("bottom"), lower, lower.facets("top"), **more)
