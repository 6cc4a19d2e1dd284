"""Conditions on the sides of each lateral direction, and symmetry about the sides."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.elastic_body import ElasticBody
from contact.body.layers.layers import PER_NODE, grid
from contact.errors import InputError
from skfem_adini import ElementQuadAdini

Sides = tuple[tuple[int, ...] | None, ...]  # components fixed in each direction; None: periodic


def read_sides(sides: Any, dim: int) -> Sides:
    """Components fixed on both sides of each lateral direction; None where they are periodic.
    Either the normal one (rollers) or all others, so that transforms diagonalise the stiffness."""
    lateral = dim - 1
    given = [sides] * lateral if sides == "periodic" or lateral == 1 else sides
    if isinstance(given, tuple | list) and lateral == 1 and isinstance(given[0], tuple | list):
        given = list(given[0])
    if not isinstance(given, tuple | list) or len(given) != lateral:
        raise InputError(f"sides={sides!r}: expected 'periodic' or {lateral} entries, a direction "
                         "each, such as ('periodic', 'y')")  # fmt: skip
    found: list[tuple[int, ...] | None] = []
    for axis, entry in enumerate(given):
        others = tuple(c for c in range(dim) if c != axis)
        names = "".join("xyz"[c] for c in others)
        if entry == "periodic":
            found.append(None)
        elif entry == "xyz"[axis]:
            found.append((axis,))
        elif isinstance(entry, str) and "".join(sorted(entry)) == names:
            found.append(others)
        else:
            raise InputError(
                f"sides={sides!r}: transforms diagonalise sides across {'xyz'[axis]} that are "
                f"'periodic', on rollers ({'xyz'[axis]!r}: no normal displacement, no shear) or "
                f"held tangentially ({names!r}), not {entry!r}; LayeredBlock in the plane and "
                "ElasticBody take any"
            )
    return tuple(found)


def odd_unknowns(sides: Sides, kinds: NDArray[np.int64]) -> list[NDArray[np.bool_] | None]:
    """For each direction the node unknowns that are odd about its sides; None: periodic.
    The kinds (r,) of the unknowns are those of `dof_kinds`; components alternate."""
    component = np.arange(kinds.size) % (len(sides) + 1)
    return [
        None if fixed is None
        else np.isin(component, fixed) ^ ((kinds == axis) | ((kinds == -2) & (axis < 2)))
        for axis, fixed in enumerate(sides)
    ]  # fmt: skip


def unsupported(sides: Sides, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Translation components that neither the top nor a side prevents, shape (dim,)."""
    loose = ~held
    for fixed in sides:
        loose[list(fixed or ())] = False
    return loose


KINDS = np.array([-1, -1, 0, 0, 1, 1])  # `dof_kinds` of the unknowns of a node


def odd_of(block: Any) -> NDArray[np.bool_]:
    """Node unknowns that are odd about the sides of a `LayeredBlock`, shape (6,)."""
    (odd,) = odd_unknowns(read_sides(of_both(block.sides), 2), KINDS)
    if odd is None:
        raise InputError("sides: periodic ones have a mesh")
    return odd


def of_both(sides: Any) -> Any:
    """Merge the entries of two sides if they are equal."""
    pair = isinstance(sides, tuple | list) and len(sides) == 2
    return sides[0] if pair and sides[0] == sides[1] else sides


def vanishing(block: Any, rows: int) -> NDArray[np.int64]:
    """Dofs of the lowest node rows that vanish by symmetry about the sides, ascending."""
    if block.path is None:
        return np.zeros(0, dtype=np.int64)
    nodes = (block.columns + 1) * np.arange(rows)[:, None] + np.array([0, block.columns])
    return (PER_NODE * nodes[..., None] + np.flatnonzero(odd_of(block))).ravel()


def hold(body: ElasticBody, dofs: NDArray[np.int64]) -> ElasticBody:
    """Set those of the dofs to zero that the supports of a body leave free."""
    left = dofs[np.diff(body.constraint[0].indptr)[dofs] > 0]
    if left.size:
        body.constrain(sparse.eye_array(body.basis.N, format="csr")[left])
    return body


def meshed_of(block: Any) -> ElasticBody:
    """A block as an `ElasticBody` without supports and loads, with the same dof numbers."""
    mesh = grid(block.x, block.y)
    cells = [block.columns * layer.cells for layer in block.layers]
    E, nu = (np.repeat([getattr(l, key) for l in block.layers], cells) for key in ("E", "nu"))
    return ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=E, nu=nu, plane=block.plane)


def elastic_of(block: Any) -> ElasticBody:
    """The `ElasticBody` equivalent to a block without a mesh, with the same dof numbers."""
    body = meshed_of(block)
    for name, c, value in block._supports:
        body.fix(name, c, value)
    body.f = block.f.copy()
    return hold(body, vanishing(block, block.node_rows))
