"""Arguments of layers in Fourier space, read and checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.elastic_body import ElasticBody
from contact.body.layers.lateral_sides import Sides
from contact.body.layers.layers import Layer
from contact.body.rigid_modes import dof_kinds
from contact.errors import InputError
from skfem_adini.ground.arguments import array_of


def node_kinds(body: ElasticBody) -> NDArray[np.int64]:
    """Kinds of the unknowns of a node, by `dof_kinds`."""
    nodal = body.basis.nodal_dofs
    if nodal.size != body.basis.N:
        name = type(body.basis.elem.elem).__name__
        raise InputError(f"element {name}: has unknowns that belong to no vertex; take an element "
                         "such as ElementQuad1 or ElementQuadAdini")  # fmt: skip
    return np.asarray(dof_kinds(body.basis)[nodal[:, 0]])


def node_lengths(
    kinds: NDArray[np.int64], spacing: Sequence[float], layers: Sequence[Layer]
) -> NDArray[np.float64]:
    """Length that scales each node unknown to a displacement, shape (r,)."""
    sizes = np.array([*spacing, min(layer.height / layer.cells for layer in layers)])
    mixed = np.prod(sizes[:2])
    return np.array([1.0 if k == -1 else mixed if k < 0 else sizes[k] for k in kinds])


def named(components: Sequence[int]) -> str:
    """Names of components for a message."""
    return " and ".join("xyz"[c] for c in components)


def read_base(base: Any) -> tuple[float, float]:
    """Young's modulus and Poisson's ratio of the half space; `HalfSpace` checks their ranges."""
    if not isinstance(base, tuple | list) or len(base) != 2:
        raise InputError(f"base={base!r}: expected a pair (E, nu)")
    return base[0], base[1]


def read_cells(cells: Any, sides: Sides) -> tuple[int, ...]:
    """Numbers of cells in the lateral directions: one at least, between periodic sides two."""
    given, least = (
        np.atleast_1d(array_of("cells", cells)),
        [2 if fixed is None else 1 for fixed in sides],
    )
    if given.shape != (len(sides),) or given.dtype.kind not in "iu" or np.any(given < least):
        raise InputError(
            f"cells={cells!r}: expected {len(sides)} whole numbers from "
            + (", ".join(map(str, least)) if len(set(least)) > 1 else str(least[0]))
        )
    return tuple(map(int, given))
