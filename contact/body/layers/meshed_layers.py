"""The mesh of layers with the conditions at their sides, for the same body on the sparse path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.elastic_body import ElasticBody
from contact.body.layers.lateral_sides import Sides, odd_unknowns
from contact.body.layers.layers import Layer, named_by_place
from contact.body.rigid_modes import dof_kinds

SIDES = (("left", "right"), ("front", "back"))  # across x and across y


def meshed(
    kind: Any, lengths: Sequence[float], shape: Sequence[int], layers: Sequence[Layer]
) -> tuple[Any, NDArray[np.int64]]:
    """Tensor mesh with the boundaries "bottom", "top" and those of `SIDES`, and the layer of
    each cell."""
    dim = len(lengths) + 1
    ticks = [np.linspace(0, length, n + 1) for length, n in zip(lengths, shape, strict=True)]
    levels = np.concatenate(
        [
            np.linspace(layer.bottom, layer.bottom + layer.height, layer.cells + 1)[k > 0 :]
            for k, layer in enumerate(layers)
        ]
    )
    mesh = kind.init_tensor(*ticks, levels)
    ends = {"bottom": (dim - 1, 0.0), "top": (dim - 1, levels[-1])}
    for axis, length in enumerate(lengths):
        ends |= {SIDES[axis][0]: (axis, 0.0), SIDES[axis][1]: (axis, length)}
    mesh = named_by_place(mesh, ends)
    middle = mesh.p[-1][mesh.t].mean(axis=0)
    tops = [layer.bottom + layer.height for layer in layers[:-1]]
    return mesh, np.searchsorted(tops, middle)


def supported(body: ElasticBody, sides: Sides) -> None:
    """Tie the sides of a body on such a mesh, or hold on them what is odd about them."""
    nodal = body.basis.nodal_dofs
    odd = odd_unknowns(sides, np.asarray(dof_kinds(body.basis)[nodal[:, 0]]))
    vanishing = np.zeros(body.basis.N, dtype=bool)
    for axis, (fixed, parity) in enumerate(zip(sides, odd, strict=True)):
        if parity is not None:
            for component in fixed or ():
                body.fix(list(SIDES[axis]), "xyz"[component])
            place = body.mesh.p[axis]
            ends = np.abs(place - np.mean(place)) > (0.5 - 1e-9) * np.ptp(place)
            vanishing[nodal[np.ix_(parity, ends)]] = True
    left = np.flatnonzero(vanishing & (np.diff(body.constraint[0].indptr) > 0))
    for axis, fixed in enumerate(sides):
        if fixed is None:
            body.periodic(SIDES[axis][1], SIDES[axis][0])
    if left.size:
        body.constrain(sparse.eye_array(body.basis.N, format="csr")[left])
