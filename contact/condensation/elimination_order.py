"""Order in which the free unknowns of a body are eliminated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.rigid_modes import dof_entities
from contact.condensation import bisection
from skfem_adini.jit import compiled

Index = NDArray[np.int64]
# Levels of the tree that cuDSS gets: its own have ten. With fewer than six its factorisation is
# slower than with those of its own order.
_DEEPEST, _FLATTEST = 10, 6
_FEWEST = 20_000  # unknowns below which cuDSS has its own order in milliseconds


def elimination_order(body: Any) -> Index:
    """Free unknowns in the nested-dissection order of their mesh entities, shape (n,)."""
    entity, dissection = dissected(body)
    rank = np.empty_like(dissection.part)
    rank[dissection.order] = np.arange(rank.size)
    return counted_order(rank[entity], rank.size)


def elimination_tree(
    parts: tuple[Index, Dissection] | None, kept: Index
) -> tuple[Index, Index] | None:
    """An order of elimination of the free unknowns by levels, in the blocks of a binary tree.

    Parameters
    ----------
    parts : tuple, optional
        What `dissected_if_large` returned.
    kept : ndarray, shape (nb,)
        Ascending numbers of unknowns that come last, as a part of the last block.

    Returns
    -------
    order : ndarray, shape (n,)
        Its blocks are the leaves of the tree, then the separators of ever larger sets.
    sizes : ndarray, shape (2**levels - 1,)
        Unknowns in each block. None instead of both for small bodies, and where one is empty.
    """
    if parts is None:
        return None
    entity, dissection = parts
    entities = dissection.part.size
    others = np.bincount(entity, minlength=entities) - np.bincount(entity[kept], minlength=entities)
    for depth in range(min(_DEEPEST, dissection.levels + 1), _FLATTEST - 1, -1):
        order, block = dissection.breadth_first(depth)
        sizes = np.bincount(block, others, minlength=(1 << depth) - 1).astype(np.int64)
        sizes[-1] += kept.size
        if sizes.min() > 0:
            # Ranks ascend with the blocks; those that are kept stay in their own order.
            rank = np.empty(entities, dtype=np.int32)
            rank[order] = np.arange(entities)
            ranks = rank[entity]
            ranks[kept] = entities
            return counted_order(ranks, entities + 1), sizes
    return None


def dissected_if_large(body: Any) -> tuple[Index, Dissection] | None:
    """As `dissected`; None for a body of so few unknowns that cuDSS is quick without it."""
    return dissected(body) if body.constraint[0].shape[1] >= _FEWEST else None


def dissected(body: Any) -> tuple[Index, Dissection]:
    """The entity of each free unknown, and the dissection of all entities."""
    entity, points, cells = dof_entities(body.basis)
    dissection, leading = nested_dissection(points, cells), body.chosen
    if leading is None:
        picked = body.picked.tocsc()
        leading = picked.indices[picked.indptr[:-1]]
    return entity[leading], dissection


_STEPS = 2.0**26  # coordinates this part of a body's size apart are one: rounding differs less


@dataclass(frozen=True)
class Dissection:
    """The vertices of a mesh graph as parts of a binary tree of sets of cells.

    A vertex belongs to the smallest set that holds all of its cells: to a leaf, or to the separator
    of a set that is cut between its cells.

    Attributes
    ----------
    levels : int
        Cuts from the whole mesh to a leaf.
    height : ndarray, shape (n,)
        0 for a vertex of a leaf, h for one of the separator of a set of 2**h leaves.
    part : ndarray, shape (n,)
        Number of that set among those of its height.
    """

    levels: int
    height: Index
    part: Index

    @property
    def order(self) -> Index:
        """Vertices in the order of elimination, (n,): both halves of a set, then its separator."""
        heights = self.levels + 1
        end = (self.part + 1) << self.height  # leaves before the end of the set
        return counted_order(heights * end + self.height, heights * ((1 << self.levels) + 1))

    def breadth_first(self, depth: int) -> tuple[Index, Index]:
        """An order of elimination that ends with the separators of the largest sets.

        Parameters
        ----------
        depth : int
            Levels of the tree that are told apart, from 1 to ``levels + 1``; smaller sets are
            parts of its leaves, with their vertices in the order of `order`.

        Returns
        -------
        order : ndarray, shape (n,)
            First all leaves, then the separators of their pairs, and so on to that of the mesh.
        block : ndarray, shape (n,)
            Number of the block of this order, of ``2**depth - 1``, to which a vertex belongs.
        """
        cut = self.levels - depth + 1  # height of the leaves that are told apart
        height = np.maximum(self.height, cut)
        part = self.part >> (height - self.height)
        before = (2 << (self.levels - cut)) - (2 << (self.levels - height))
        block = before + part
        order = self.order
        return order[counted_order(block[order], (1 << depth) - 1)], block


def counted_order(keys: NDArray[np.integer], count: int) -> Index:
    """``numpy.argsort(keys, kind="stable")`` of many whole numbers below a count, by counting."""
    order: Index = _kernel("order_of")(keys, count)
    return order


def nested_dissection(points: NDArray[np.float64], cells: Index, leaf_size: int = 8) -> Dissection:
    """Cut a mesh in two again and again, each set of cells across its longest coordinate.

    The cut is between different coordinates of the cells' middles, next to the median: on a grid
    the separators are whole lines or planes.

    Parameters
    ----------
    points : ndarray, shape (dim, n)
        Coordinates of the vertices: nodes, edges, facets or cells that carry unknowns.
    cells : ndarray, shape (k, ncells)
        Vertices of each cell; unknowns of one cell are neighbours.
    leaf_size : int
        Sets are cut until they have about so many cells.

    Returns
    -------
    Dissection
        Of the n vertices; those without cells are in a leaf.

    References
    ----------
    A. George, Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10 (1973).

    Examples
    --------
    A path of seven vertices, whose cells are its edges: the middle one is eliminated last.

    >>> import numpy as np
    >>> path = nested_dissection(np.arange(7.0)[None], np.array([np.arange(6), np.arange(1, 7)]), 2)
    >>> int(path.order[-1])
    3
    """
    n = points.shape[1]
    levels = max(0, int(np.ceil(np.log2(max(cells.shape[1], 1) / leaf_size))))
    middles = np.zeros((len(points), cells.shape[1]))
    for row in cells:
        middles += points[:, row] / len(cells)
    low = middles.min(axis=1, keepdims=True, initial=np.inf)
    size = float((middles - low).max(initial=0.0)) or 1.0
    steps = np.rint((middles - low) / size * _STEPS).astype(np.int32)
    leaf = _kernel("leaves_of")(steps, levels)
    first, last = _kernel("spans_of")(leaf, np.ascontiguousarray(cells), n)
    height = np.frexp((first ^ last).astype(np.float64))[1].astype(np.int64)
    return Dissection(levels, height, first >> height)


@cache
def _kernel(name: str) -> Callable[..., Any]:
    parts = [bisection.sort_steps] if name == "leaves_of" else []
    return compiled(getattr(bisection, name), parts)
