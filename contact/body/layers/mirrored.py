"""Blocks without a mesh between mirror images: the dofs that symmetry holds at their sides."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.elastic_body import ElasticBody
from contact.body.layers.lateral_sides import odd_unknowns, read_sides
from contact.body.layers.layers import PER_NODE, grid
from contact.errors import InputError
from skfem_adini import ElementQuadAdini

KINDS = np.array([-1, -1, 0, 0, 1, 1])  # `dof_kinds` of the unknowns of a node


def odd_of(block: Any) -> NDArray[np.bool_]:
    """Unknowns of a node that are odd about the sides of a `LayeredBlock`, shape (6,)."""
    (odd,) = odd_unknowns(read_sides(_of_both(block.sides), 2), KINDS)
    if odd is None:
        raise InputError("sides: periodic ones have a mesh")
    return odd


def _of_both(sides: Any) -> Any:
    """One entry for both sides, where they are alike."""
    pair = isinstance(sides, tuple | list) and len(sides) == 2
    return sides[0] if pair and sides[0] == sides[1] else sides


def vanishing(block: Any, rows: int) -> NDArray[np.int64]:
    """Dofs of the lowest rows of nodes that the block's mirror images make zero, ascending."""
    if block.path is None:
        return np.zeros(0, dtype=np.int64)
    nodes = (block.columns + 1) * np.arange(rows)[:, None] + np.array([0, block.columns])
    return (PER_NODE * nodes[..., None] + np.flatnonzero(odd_of(block))).ravel()


def hold(body: ElasticBody, dofs: NDArray[np.int64]) -> ElasticBody:
    """Hold those of the dofs at zero that the supports of a body leave free."""
    left = dofs[np.diff(body.constraint[0].indptr)[dofs] > 0]
    if left.size:
        body.constrain(sparse.eye_array(body.basis.N, format="csr")[left])
    return body


def meshed_of(block: Any) -> ElasticBody:
    """The cells of a block as an `ElasticBody` without supports and loads; dofs numbered alike."""
    mesh = grid(block.x, block.y)
    cells = [block.columns * layer.cells for layer in block.layers]
    E, nu = (np.repeat([getattr(l, key) for l in block.layers], cells) for key in ("E", "nu"))
    return ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=E, nu=nu, plane=block.plane)


def elastic_of(block: Any) -> ElasticBody:
    """The `ElasticBody` that a block without a mesh stands for; dofs are numbered alike."""
    body = meshed_of(block)
    for name, c, value in block._supports:
        body.fix(name, c, value)
    body.f = block.f.copy()
    return hold(body, vanishing(block, block.node_rows))
