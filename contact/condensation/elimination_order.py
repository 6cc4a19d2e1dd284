"""Order in which the free unknowns of a body are eliminated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact.body.rigid_modes import dof_entities
from contact.condensation import bisection
from skfem_adini.ground.jit import compiled_later

Index = NDArray[np.int64]


class _Limits(NamedTuple):  # limits of the tree for cuDSS
    deepest: int = 10  # levels, as many as cuDSS's own tree has
    flattest: int = 6  # levels; with fewer, cuDSS is slower than without a tree
    unknowns: int = 20_000  # with fewer cuDSS finds its own order in milliseconds


LIMITS = _Limits()


def elimination_order(body: Any) -> Index:
    """Free unknowns in the nested-dissection order of their mesh entities, shape (n,)."""
    entity, dissection = dissected(body)
    rank = np.empty_like(dissection.part)
    rank[dissection.order] = np.arange(rank.size)
    return counted_order(rank[entity], rank.size)


def elimination_tree(
    parts: tuple[Index, Dissection] | None, kept: Index
) -> tuple[Index, Index] | None:
    """Elimination order by levels, (n,), and the sizes of its blocks, (2**levels - 1,).
    Blocks are the leaves of the tree, then the separators of ever larger sets; the unknowns `kept`
    (nb,), ascending, end the last block. None for small bodies or where a block is empty."""
    if parts is None:
        return None
    entity, dissection = parts
    entities = dissection.part.size
    others = np.bincount(entity, minlength=entities) - np.bincount(entity[kept], minlength=entities)
    for depth in range(min(LIMITS.deepest, dissection.levels + 1), LIMITS.flattest - 1, -1):
        order, block = dissection.breadth_first(depth)
        sizes = np.bincount(block, others, minlength=(1 << depth) - 1).astype(np.int64)
        sizes[-1] += kept.size
        if sizes.min() > 0:
            # Ranks ascend with the blocks; kept unknowns stay in their order.
            rank = np.empty(entities, dtype=np.int32)
            rank[order] = np.arange(entities)
            ranks = rank[entity]
            ranks[kept] = entities
            return counted_order(ranks, entities + 1), sizes
    return None


def dissected_if_large(body: Any) -> tuple[Index, Dissection] | None:
    """As `dissected`; None for small bodies, for which cuDSS is fast without it."""
    return dissected(body) if body.constraint[0].shape[1] >= LIMITS.unknowns else None


def dissected(body: Any) -> tuple[Index, Dissection]:
    """The entity of each free unknown, and the dissection of all entities."""
    entity, points, cells = dof_entities(body.basis)
    dissection, leading = nested_dissection(points, cells), body.chosen
    if leading is None:
        picked = body.picked.tocsc()
        leading = picked.indices[picked.indptr[:-1]]
    return entity[leading], dissection


@dataclass(frozen=True)
class Dissection:
    """The vertices of a mesh graph as parts of a binary tree of sets of cells.
    A vertex belongs to the smallest set that contains all of its cells: to a leaf, or to the
    separator of a set that is cut between its cells."""

    levels: int  # cuts from the whole mesh to a leaf
    height: Index  # 0 in leaves, h in the separator of a set of 2**h leaves, shape (n,)
    part: Index  # number of that set among those of its height, shape (n,)

    @property
    def order(self) -> Index:
        """Vertices in the order of elimination, (n,): both halves of a set, then its separator."""
        heights = self.levels + 1
        end = (self.part + 1) << self.height  # leaves before the end of the set
        return counted_order(heights * end + self.height, heights * ((1 << self.levels) + 1))

    def breadth_first(self, depth: int) -> tuple[Index, Index]:
        """Order of elimination, (n,), from the leaves to the largest separator, and its blocks.
        The tree is cut off at `depth` levels, 1 to ``levels + 1``; each vertex belongs to one of
        ``2**depth - 1`` blocks, shape (n,), within which `order` is kept."""
        cut = self.levels - depth + 1  # height of the subtrees merged into leaves
        height = np.maximum(self.height, cut)
        part = self.part >> (height - self.height)
        before = (2 << (self.levels - cut)) - (2 << (self.levels - height))
        block = before + part
        order = self.order
        return order[counted_order(block[order], (1 << depth) - 1)], block


def counted_order(keys: NDArray[np.integer], count: int) -> Index:
    """``numpy.argsort(keys, kind="stable")`` of many integers below a count, by counting."""
    order: Index = _kernel("order_of")(keys, count)
    return order


def nested_dissection(points: NDArray[np.float64], cells: Index, leaf_size: int = 8) -> Dissection:
    """Bisect a mesh recursively: each set of cells (k, ncells) across its longest extent.
    Cuts run between different coordinates, so that separators of a grid are planes; points (dim, n)
    are the vertices, which carry the unknowns. A. George, SIAM J. Numer. Anal. 10 (1973)."""
    n = points.shape[1]
    levels = max(0, int(np.ceil(np.log2(max(cells.shape[1], 1) / leaf_size))))
    middles = np.zeros((len(points), cells.shape[1]))
    for row in cells:
        middles += points[:, row] / len(cells)
    low = middles.min(axis=1, keepdims=True, initial=np.inf)
    size = float((middles - low).max(initial=0.0)) or 1.0
    steps = np.rint((middles - low) / size * 2.0**26).astype(np.int32)  # coarser than rounding
    leaf = _kernel("leaves_of")(steps, levels)
    first, last = _kernel("spans_of")(leaf, np.ascontiguousarray(cells), n)
    height = np.frexp((first ^ last).astype(np.float64))[1].astype(np.int64)
    return Dissection(levels, height, first >> height)


@cache
def _kernel(name: str) -> Callable[..., Any]:
    parts = [bisection.sort_steps] if name == "leaves_of" else []
    return compiled_later(getattr(bisection, name), parts)
