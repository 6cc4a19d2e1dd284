"""Boxes in space that face each other, straight, bent, or with curved cells."""

import numpy as np
from families import mapped

from contact import ElasticBody
from contact.rows.mortar.mortar_rows import mortar_rows


def box(
    element, cells, corner=(0.0, 0.0, 0.0), sizes=(1.0, 1.0, 1.0), place=None, curved=False, E=2.0
):
    """A box of cells with named sides, mapped by `place`."""
    ticks = [a + np.linspace(0, l, n + 1) for a, l, n in zip(corner, sizes, cells, strict=True)]
    return ElasticBody.from_mesh(mapped(element, ticks, place, curved), element(), E=E, nu=0.3)


def pair(element, other=None, shift=(0.0, 0.0), unit=1.0, place=None, **more):
    """An upper box of 3 x 2 facets above a lower one of 4 x 5."""

    def scaled(x):
        return unit * (x if place is None else place(x))

    upper = box(element, (3, 2, 1), (*shift, 1.0), place=scaled, **more)
    return upper, box(other or element, (4, 5, 1), place=scaled, **more)


def rows(upper, lower, **more):
    return mortar_rows(upper, upper.facets("bottom"), lower, lower.facets("top"), **more)
