"""The dofs of cells as blocks of consecutive numbers: those of a vertex, edge, facet or cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.integer]


@dataclass(frozen=True)
class DofBlocks:
    """The dofs of the cells of a mesh in blocks of consecutive numbers."""

    of_cells: Integers  # block numbers, shape (blocks of a cell, cells)
    local: Integers  # where blocks begin in a cell's dofs, then their number
    start: Integers  # first dof of each block, then the number of dofs, shape (blocks + 1,)
    size: int  # number of dofs

    @classmethod
    def from_mesh(cls, mesh: Any, element: Any) -> DofBlocks:
        """Number the dofs of an element as `skfem.Dofs` does: vertices, edges, facets, cells."""
        tables: list[tuple[Integers, int, int]] = []
        if element.nodal_dofs > 0:
            tables.append((mesh.t, mesh.nvertices, element.nodal_dofs))
        if element.dim == 3 and element.edge_dofs > 0:
            tables.append((mesh.t2e, mesh.nedges, element.edge_dofs))
        if element.dim >= 2 and element.facet_dofs > 0:
            tables.append((mesh.t2f, mesh.nfacets, element.facet_dofs))
        if element.interior_dofs > 0:
            cells = mesh.t.shape[1]
            tables.append((np.arange(cells, dtype=np.int32)[None], cells, element.interior_dofs))
        rows: list[Integers] = []
        local, sizes = [0], [np.zeros(1, dtype=np.int64)]
        blocks = 0
        for numbers, count, dofs in tables:
            # At most 64 dofs a block, so that each has one bit of a word.
            pieces = [min(64, dofs - begin) for begin in range(0, dofs, 64)]
            for row in numbers:
                for k, piece in enumerate(pieces):
                    rows.append(blocks + len(pieces) * row + k)
                    local.append(local[-1] + piece)
            sizes.append(np.tile(pieces, count))
            blocks += count * len(pieces)
        start = np.cumsum(np.concatenate(sizes))
        return cls(np.array(rows, dtype=np.int32), np.array(local), start, int(start[-1]))

    @classmethod
    def from_dofs(cls, dofs: Any) -> DofBlocks:
        """Make each dof a separate block, for any numbering."""
        numbers = np.ascontiguousarray(dofs.element_dofs, dtype=np.int32)
        return cls(numbers, np.arange(len(numbers) + 1), np.arange(dofs.N + 1), int(dofs.N))

    @classmethod
    def of_basis(cls, basis: Any) -> DofBlocks:
        """Return the blocks of all cells of the mesh of a basis, whatever its numbering."""
        blocks = cls.from_mesh(basis.mesh, basis.elem)
        numbers = basis.dofs.element_dofs
        same = len(numbers) == blocks.local[-1] and all(
            np.array_equal(first + k, numbers[begin + k])
            for first, begin, size in blocks._firsts()
            for k in range(size)
        )
        return blocks if same else cls.from_dofs(basis.dofs)

    def _firsts(self) -> Iterator[tuple[Integers, int, int]]:
        """First dof of a block in each cell, its number among the cell's dofs, and its size."""
        start = self.start.astype(np.int32) if self.size < 2**31 else self.start
        for blocks, begin, size in zip(
            self.of_cells, self.local[:-1].tolist(), np.diff(self.local).tolist(), strict=True
        ):
            yield start[blocks], begin, size

    def restricted(self, cells: Integers | None) -> DofBlocks:
        """Return the blocks of some of the cells; None means all cells."""
        if cells is None:
            return self
        of_cells = np.ascontiguousarray(self.of_cells[:, cells])
        return DofBlocks(of_cells, self.local, self.start, self.size)
