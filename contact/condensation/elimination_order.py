"""Order in which the free unknowns of a body are eliminated."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.dof_entities import dof_entities
from contact.condensation.dissection import Dissection, counted_order, nested_dissection

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
