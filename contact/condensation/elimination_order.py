"""Order in which the free unknowns of a body are eliminated."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.dof_entities import dof_entities
from contact.condensation.dissection import cell_graph, nested_dissection


def elimination_order(body: Any) -> NDArray[np.int64]:
    """Free unknowns in the nested-dissection order of their mesh entities."""
    entity, points, cells = dof_entities(body.basis)
    picked = body.picked.tocsc()
    leading = picked.indices[picked.indptr[:-1]]
    count = points.shape[1]
    rank = np.empty(count, dtype=np.int64)
    rank[nested_dissection(cell_graph(cells, count), points)] = np.arange(count)
    return np.argsort(rank[entity[leading]], kind="stable").astype(np.int64)
