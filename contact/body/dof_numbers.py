"""The numbering of dofs that scikit-fem has, written into one array."""

from __future__ import annotations

from typing import Any

import numpy as np
from skfem.assembly import Dofs


class DofNumbers(Dofs):
    """A `skfem.assembly.Dofs` that is made without stacking its rows one after another."""

    def __init__(self, topo: Any, element: Any) -> None:
        self.topo, self.element = topo, element
        cells, none = topo.t.shape[1], np.empty((0, 0), dtype=np.int32)
        self.edge_dofs = self.facet_dofs = none
        kinds: list[tuple[str, Any, int]] = [("nodal", topo.t, topo.nvertices)]
        if element.dim == 3 and element.edge_dofs > 0:
            kinds.append(("edge", topo.t2e, topo.nedges))
        if element.dim >= 2 and element.facet_dofs > 0:
            kinds.append(("facet", topo.t2f, topo.nfacets))
        kinds.append(("interior", np.arange(cells)[None], cells))
        of_each = [getattr(element, f"{name}_dofs") for name, *_ in kinds]
        rows = sum(
            count * len(of_cells) for count, (_, of_cells, _) in zip(of_each, kinds, strict=True)
        )
        self.element_dofs = np.empty((rows, cells), dtype=np.int32)
        first, row = 0, 0
        for count, (name, of_cells, entities) in zip(of_each, kinds, strict=True):
            numbers = np.arange(first, first + count * entities, dtype=np.int32)
            setattr(self, f"{name}_dofs", numbers.reshape(entities, count).T)
            for entity in of_cells:
                begin = entity.astype(np.int32) * count + first
                for k in range(count):
                    np.add(begin, k, out=self.element_dofs[row + k])
                row += count
            first += count * entities
        self.N = np.max(self.element_dofs) + 1
