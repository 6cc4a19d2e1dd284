"""The derivative of a stage in the velocity's parameters, from those of its feet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cip.profiles.locate_nodes import cells_of, nodes_around
from cip.sensitivities.blocks import Block
from cip.sensitivities.foot_derivatives import foot_derivatives
from cip.sensitivities.mass_derivatives import mean_changes
from cip.sensitivities.profile_derivatives import CORNERS, slopes_in_foot, traced
from cip.stages.stage import StageFeet
from cip.stages.state import on_host

Array = Any  # arrays of NumPy or CuPy


@dataclass(frozen=True)
class ParameterPart:
    """The derivative of new moments of one stage with respect to the velocity's parameters.

    Attributes
    ----------
    block : Block
        The feet and the moments that they move.
    nodes : ndarray of int, shape (roles, nodes)
        The nodes at the corners of the cell of each foot and, in a sweep, around it.
    cell : ndarray, shape (rows, nodes)
        The place of each foot in its cell, the widths of the cell, places of nodes around it.
    feet : ndarray, shape (components - directions, nodes)
        Components of the feet after the displacements.
    by_parameter : ndarray, shape (parameters, components, nodes)
        Derivatives of the components; of displacements in the unit of the place in the cell.
    """

    block: Block
    nodes: np.ndarray[Any, np.dtype[np.int64]]
    cell: Array
    feet: Array
    by_parameter: Array

    @classmethod
    def of(cls, block: Block, feet: StageFeet, xp: Any = np) -> ParameterPart:
        """That of a block, from the feet that the stage itself uses.

        It is made on the host; `xp` is the module of its arrays, NumPy or CuPy.
        """
        stage, grid, moving = block.stage, block.stage.grid, block.stage.moving
        components = np.asarray(on_host(feet.data), dtype=float).reshape(-1, grid.size)
        components = components[block.components]
        found = [cells_of(grid, axis, components[q]) for q, axis in enumerate(moving)]
        widths = [grid.widths[axis][cells[0]] for axis, cells in zip(moving, found, strict=True)]
        cell = [*(cells[2] for cells in found), *widths]
        if stage.axis is None:
            nodes = [
                np.ravel_multi_index([found[q][side] for q, side in enumerate(sides)], grid.nodes)
                for sides in CORNERS[grid.dim]
            ]
        else:
            ends = list(found[0][:2])
            if traced(*block.scheme).around:
                more, places = nodes_around(grid, stage.axis, ends[0])
                ends += list(more)
                cell += list(places)
            stride = int(np.prod(grid.nodes[stage.axis + 1 :]))
            first = np.arange(grid.size) - np.indices(grid.nodes)[stage.axis].ravel() * stride
            nodes = [first + one * stride for one in ends]
        by_parameter = foot_derivatives(block, feet)
        by_parameter[:, : len(moving)] /= np.stack(widths)
        by_parameter[..., ~feet.interior(grid.size, block.number)] = 0.0
        arrays = np.stack(nodes), np.stack(cell), components[len(moving) :], by_parameter
        return cls(block, *(xp.asarray(one) for one in arrays))

    def along(self, z: Array, direction: Array, xp: Any = np) -> Array:
        """Change of the block's new moments, of shape (moments, nodes), with the parameters.

        `xp` is the module of all arrays, NumPy or CuPy.
        """
        grid, scheme, read = self.block.stage.grid, self.block.scheme, self.block.read(z)
        old = [read[q][self.nodes[role]] for q, role in traced(*scheme).sources]
        values = slopes_in_foot(*scheme)(*self.cell, *self.feet, *old)
        rows = xp.empty((len(values), grid.size))
        for row, value in zip(rows, values, strict=True):
            row[:] = value
        change = xp.einsum("pcn,p->cn", self.by_parameter, direction)
        found = xp.einsum("qcn,cn->qn", rows.reshape(-1, *change.shape), change)
        if self.block.stage.conservative:
            found[-1] = mean_changes(grid, self.block.stage.axis or 0, found[-1], xp)
        return found
