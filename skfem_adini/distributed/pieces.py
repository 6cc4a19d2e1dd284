"""The piece of a mesh that a process works on: its own cells and those around them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import Mesh, MeshHex, MeshQuad

from skfem_adini.distributed.communicator import Communicator
from skfem_adini.distributed.partition import partition
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of, finite_numbers

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Piece:
    """Cells of one process: all that touch a vertex of its own cells.
    So the process assembles complete rows, and conditions on the boundary see all facets that
    meet in a vertex."""

    mesh: Any
    cells: Indices  # numbers in the whole mesh, ascending, shape (ncells,)
    owner: Indices  # process that each cell belongs to, shape (ncells,)
    total: int  # number of cells of the whole mesh


class TensorGrid:
    """A grid of rectangles or bricks, of which each process builds only its own strip.

    Parameters
    ----------
    *ticks : array_like
        Ascending coordinates of the grid lines along x, y and, in space, z.

    Raises
    ------
    InputError
        Not two or three sets of ascending numbers.

    Notes
    -----
    The cells are numbered as by ``MeshQuad.init_tensor`` and ``MeshHex.init_tensor``. Boundaries
    have the names of `skfem.Mesh.with_defaults`: left and right along x, bottom and top along y,
    front and back along z. Strips lie across x in the plane and across z in space.

    Examples
    --------
    >>> grid = TensorGrid(np.linspace(0, 2, 9), np.linspace(0, 1, 5))
    >>> grid.mesh().t.shape
    (4, 32)
    """

    def __init__(self, *ticks: ArrayLike) -> None:
        if len(ticks) not in (2, 3):
            raise InputError(f"ticks: expected those along 2 or 3 axes, got {len(ticks)}")
        self.ticks = tuple(
            finite_numbers("ticks", array_of("ticks", t), (np.size(t),)) for t in ticks
        )
        if any(t.size < 2 or not np.all(np.diff(t) > 0) for t in self.ticks):
            raise InputError("ticks: expected two or more ascending numbers along each axis")

    def mesh(self) -> Any:
        """The whole grid as a mesh with named boundaries."""
        return self._between(0, self._slow.size - 1)

    @property
    def _axis(self) -> int:
        return self._order[-1]

    @property
    def _slow(self) -> NDArray[np.float64]:
        return self.ticks[self._axis]

    def _between(self, low: int, high: int) -> Any:
        """The cells between two ticks of the axis along which they are counted last."""
        ticks = list(self.ticks)
        ticks[self._axis] = self._slow[low : high + 1]
        return self._on(ticks)

    def _on(self, ticks: Sequence[NDArray[np.float64]]) -> Any:
        """A mesh on some of the ticks, with those named boundaries of the grid that it touches."""
        mesh = (MeshQuad if len(ticks) == 2 else MeshHex).init_tensor(*ticks)
        middle, found = mesh.p[:, mesh.facets].mean(axis=1), {}
        for name, (axis, end) in self.sides.items():
            found[name] = np.flatnonzero(middle[axis] == self.ticks[axis][end])
        return mesh.with_boundaries(found)

    @property
    def sides(self) -> dict[str, tuple[int, int]]:
        """Axis and end, 0 or -1, of each boundary."""
        names = ("left", "right"), ("bottom", "top"), ("front", "back")
        pairs = [(name, (k, -e)) for k, ends in enumerate(names) for e, name in enumerate(ends)]
        return dict(pairs[: 2 * len(self.ticks)])

    def side(self, name: str) -> tuple[Any, Indices]:
        """The cells along one boundary as a mesh, and their numbers in the grid."""
        axis, end = self.sides[name]
        counts = [t.size - 1 for t in self.ticks]
        ticks = list(self.ticks)
        ticks[axis] = ticks[axis][:2] if end == 0 else ticks[axis][-2:]
        number = np.arange(np.prod(counts)).reshape(self._in_order(counts))
        along = number.ndim - 1 - self._order.index(axis)
        cells = np.take(number, [0 if end == 0 else counts[axis] - 1], axis=along)
        return self._on(ticks), cells.ravel()

    @property
    def _order(self) -> tuple[int, ...]:
        """Axes in the order in which cells are counted, the fastest first."""
        return (1, 0) if len(self.ticks) == 2 else (1, 0, 2)

    def _in_order(self, counts: Sequence[int]) -> list[int]:
        return [counts[axis] for axis in self._order[::-1]]

    def piece(self, rank: int, size: int) -> Piece:
        """The strip of one of several processes.

        Raises
        ------
        InputError
            More processes than rows of cells.
        """
        rows = self._slow.size - 1
        if size > rows:
            raise InputError(f"ticks: {size} processes are more than the {rows} rows of cells")
        ends = np.linspace(0, rows, size + 1).round().astype(int)
        low, high = max(ends[rank] - 1, 0), min(ends[rank + 1] + 1, rows)
        row = int(np.prod([t.size - 1 for k, t in enumerate(self.ticks) if k != self._axis]))
        owner = np.searchsorted(ends, np.arange(low, high), side="right") - 1
        return Piece(
            self._between(low, high),
            np.arange(low * row, high * row),
            np.repeat(owner, row).astype(np.int64),
            rows * row,
        )


def whole_mesh(mesh: Any) -> Any:
    """The mesh itself, or that made by a function or a `TensorGrid`."""
    if isinstance(mesh, TensorGrid):
        return mesh.mesh()
    return mesh if isinstance(mesh, Mesh) else mesh()


def strip_of(mesh: Any, names: Sequence[str], comm: Communicator) -> tuple[Any, Indices]:
    """All cells that touch the named boundaries, on every process, and their numbers in the
    whole mesh."""
    if isinstance(mesh, TensorGrid) and len(names) == 1 and names[0] in mesh.sides:
        return mesh.side(names[0])
    found = comm.bcast(_strip(mesh, names) if comm.rank == 0 else None)
    if isinstance(found, str):
        raise InputError(found)
    strip: tuple[Any, Indices] = found
    return strip


def _strip(mesh: Any, names: Sequence[str]) -> tuple[Any, Indices] | str:
    whole = whole_mesh(mesh)
    known = whole.boundaries or {}
    near = np.zeros(whole.p.shape[1], dtype=bool)
    for name in names:
        if name not in known or not np.size(known[name]):
            return f"contact: no facets called {name!r}; there are {sorted(known)}"
        near[whole.facets[:, known[name]]] = True
    cells = np.flatnonzero(near[whole.t].any(axis=0))
    return whole.restrict(cells), cells


def own_piece(mesh: Mesh | TensorGrid | Callable[[], Mesh] | None, comm: Communicator) -> Piece:
    """Return the piece of this process.
    The mesh is a `TensorGrid`, the same mesh on all processes, or a function that makes it,
    called on the first process alone, which sends the pieces to the others."""
    if isinstance(mesh, TensorGrid):
        return mesh.piece(comm.rank, comm.size)
    if isinstance(mesh, Mesh):
        part = comm.bcast(partition(mesh, comm.size) if comm.rank == 0 else None)
        if part.size != mesh.t.shape[1]:
            raise InputError(
                f"mesh: {mesh.t.shape[1]} cells on process {comm.rank} and {part.size} on the "
                "first one; give the same mesh to all, or a function that makes it"
            )
        return _cut(mesh, part, comm.rank)
    if not callable(mesh):
        raise InputError(
            f"mesh: expected a mesh, a function that makes it, or a TensorGrid, got "
            f"{type(mesh).__name__}"
        )
    if comm.rank:
        made: Piece | str = comm.scatter(None)
    else:
        made = comm.scatter(_all_pieces(mesh, comm.size))
    if isinstance(made, str):
        raise InputError(made)
    return made


def _all_pieces(make: Callable[[], Mesh], size: int) -> list[Any]:
    """The pieces, or the error, for each process: all processes must raise the same error."""
    try:
        whole = make()
        part = partition(whole, size)
        return [_cut(whole, part, rank) for rank in range(size)]
    except Exception as error:
        return [f"mesh: on the first process: {error}"] * size


def _cut(mesh: Any, part: Indices, rank: int) -> Piece:
    near = np.zeros(mesh.p.shape[1], dtype=bool)
    near[mesh.t[:, part == rank]] = True
    cells = np.flatnonzero(near[mesh.t].any(axis=0))
    return Piece(mesh.restrict(cells), cells, part[cells], part.size)
