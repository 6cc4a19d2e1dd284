"""The edges of a block without a mesh, as lines of cells: supports and tractions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementVector, MeshQuad

from contact.body.deferred_basis import DeferredBasis
from contact.body.elastic_body import ElasticBody
from contact.body.layers.layers import PER_NODE, grid
from contact.body.layers.mirrored import vanishing
from contact.errors import InputError
from skfem_adini import ElementQuadAdini

Array = NDArray[np.float64]
SIDES = ("left", "right", "top")


def built_edge(block: Any, name: str) -> tuple[ElasticBody, NDArray[np.int64]]:
    """One line of cells along an edge of a `LayeredBlock`, and its dofs in the block."""
    y = block.y
    if name in ("top", "bottom"):
        at = slice(-2, None) if name == "top" else slice(0, 2)
        cell = block.cell_bodies[-1 if name == "top" else 0]
        row = strip(block, grid(block.x, y[at]), cell, intorder=1)
        start = block.ndofs - row.ndofs if name == "top" else 0
        return row, start + np.arange(row.ndofs)
    i = np.array([0, 1] if name == "left" else [block.columns - 1, block.columns])
    nodes = (block.columns + 1) * np.arange(y.size)[:, None] + i
    dofs = PER_NODE * nodes.ravel()[:, None] + np.arange(PER_NODE)
    # Its material is not looked at: edges serve supports and tractions.
    return strip(block, grid(block.x[i], y), block.cell_bodies[0], intorder=1), dofs.ravel()


def strip(block: Any, mesh: MeshQuad, cell: ElasticBody, intorder: int | None) -> ElasticBody:
    """A body of some cells of a block, without supports."""
    element = ElementVector(ElementQuadAdini(1))
    # Edges serve supports and tractions, which need no shape functions inside the cells.
    basis = Basis(mesh, element) if intorder is None else DeferredBasis(mesh, element, intorder)
    return ElasticBody(basis, E=cell.E, nu=cell.nu, plane=block.plane)


def prescribed_on_edges(block: Any) -> tuple[NDArray[np.int64], Array]:
    """Dofs of a block with a prescribed displacement, ascending, and its values.

    Raises
    ------
    InputError
        Two prescriptions contradict each other.
    """
    dofs, values = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for name in SIDES:
        own = [(c, value) for b, c, value in block._supports if b == name]
        if own:
            edge, place = block._edge(name)
            for c, value in own:
                edge.fix(edge.facets(name), c, value)
            P, u0 = edge.constraint
            held = np.diff(P.indptr) == 0
            dofs.append(place[held])
            values.append(u0[held])
    besides = vanishing(block, block.node_rows)
    besides = np.setdiff1d(besides, np.concatenate(dofs))
    dofs.append(besides)
    values.append(np.zeros(besides.size))
    where, value = np.concatenate(dofs), np.concatenate(values)
    found, first, inverse = np.unique(where, return_index=True, return_inverse=True)
    # A derivative is compared as the displacement it makes along a cell.
    cell = np.tile([1.0, 1.0, *[block.cell_size] * 4], 1)[found % PER_NODE]
    size = float(np.abs(value * cell[inverse]).max(initial=0.0))
    if np.any(np.abs(value - value[first][inverse]) * cell[inverse] > 1e-10 * size):
        raise InputError("value: two prescribed displacements differ where they meet")
    return found, value[first]
