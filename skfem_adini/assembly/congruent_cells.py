"""Classes of congruent cells of a Basis, and the sum of local matrices known for each class."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import CellBasis, MeshHex, MeshQuad
from skfem.mapping import MappingAffine

from skfem_adini.assembly.congruence_classes import congruence_classes
from skfem_adini.assembly.csr_scatter import index_type, scatter_matrix
from skfem_adini.assembly.dof_blocks import DofBlocks
from skfem_adini.assembly.form_parameters import words_of
from skfem_adini.assembly.local_tensors import (
    Space,
    orientations,
    why_not_element,
    why_not_mapping,
)
from skfem_adini.errors import InputError


@dataclass(frozen=True)
class CongruentCells:
    """Classes of cells that have the same local matrix, because they are translates of each other.

    Congruence is that of `assemble`: coordinates, the orientation of facets and fields agree bit by
    bit. So local matrices that no form of scikit-fem gives, such as those with a mean dilatation,
    are computed for a few cells only and added by the kernels of `assemble`.

    Attributes
    ----------
    cells
        Numbers of one cell of each class in the mesh, shape (classes,).
    labels
        Class of each cell, shape (cells,).

    Examples
    --------
    >>> import numpy as np
    >>> from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad
    >>> mesh = MeshQuad.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> basis = Basis(mesh, ElementQuad1())
    >>> classes = CongruentCells.of(basis)
    >>> len(classes.cells)
    1
    >>> mass = BilinearForm(lambda u, v, w: u * v).elemental(classes.part)
    >>> M = classes.matrix(mass.tolocal())
    >>> round(float(M.sum()), 12)
    1.0
    """

    cells: NDArray[np.integer]
    labels: NDArray[np.integer]
    _basis: Any

    @classmethod
    def of(cls, basis: Any, *fields: ArrayLike) -> CongruentCells | None:
        """Return the classes of all cells of a basis; None if functions depend on the position.

        Parameters
        ----------
        basis
            `skfem.CellBasis` of all cells of its mesh.
        *fields
            What local matrices depend on besides the shape: numbers, or arrays of shape (cells,).
        """
        mesh, element, mapping = basis.mesh, basis.elem, basis.mapping
        if basis.tind is not None or why_not_element(element) or why_not_mapping(mapping, mesh):
            return None
        words = [orientations([element], mapping)]
        words += [words_of(np.asarray(f)[:, None]) for f in fields if np.ndim(f)]
        straight = isinstance(mapping, MappingAffine) or type(mapping.mesh) in (MeshQuad, MeshHex)
        nodes = mapping.mesh.t if straight else mapping.mesh.dofs.element_dofs
        labels, cells = congruence_classes(
            np.ascontiguousarray(mapping.mesh.doflocs),
            np.ascontiguousarray(nodes),
            np.ascontiguousarray(np.hstack(words)),
        )
        return cls(cells, labels, basis)

    @cached_property
    def part(self) -> Any:
        """Basis of one cell of each class."""
        return self.basis_of(self._basis.elem)

    def basis_of(self, element: Any) -> CellBasis:
        """Return a basis of one cell of each class with another element, say of a component.

        Parameters
        ----------
        element
            Element of the same cells, whose functions depend on nothing else.
        """
        quadrature = self._basis.quadrature
        on, own = Space(element, self._basis.mapping, *quadrature).on(self.cells)
        return CellBasis(
            on.mesh, element, on, elements=own, quadrature=quadrature, disable_doflocs=True
        )

    @cached_property
    def _blocks(self) -> DofBlocks:
        return DofBlocks.of_basis(self._basis)

    def matrix(self, local: NDArray[Any], xp: Any = np) -> Any:
        """Return the sum of the local matrices of all cells.

        Parameters
        ----------
        local
            Local matrix of each class, shape (classes, dofs of a cell, dofs of a cell), the test
            functions by rows.
        xp
            NumPy, or CuPy for a matrix on a CUDA device.

        Returns
        -------
        csr_matrix
            In canonical form, of SciPy or CuPy, shape (dofs, dofs). The values are the same bits on
            both.

        Raises
        ------
        InputError
            Another shape.
        """
        size = int(self._blocks.local[-1])
        if np.shape(local) != (len(self.cells), size, size):
            raise InputError(
                f"local: expected shape {(len(self.cells), size, size)}, got {np.shape(local)}"
            )
        local = np.ascontiguousarray(local)
        if xp is np:
            return scatter_matrix(local, self.labels, self._blocks, self._blocks)
        return scatter_on(xp, local, self.labels, self._blocks, self._blocks)


def scatter_on(
    xp: Any, local: NDArray[Any], labels: NDArray[Any], rows: DofBlocks, columns: DofBlocks
) -> Any:
    """Return what `scatter_matrix` returns, bit by bit, computed by NumPy or CuPy. Each cell
    adds a small matrix, a tile, for each pair of its blocks. A stable sort brings equal pairs
    together in the order of the cells, so that the order of sums is that of the host."""
    pairs = _Pairs.of(xp, len(local), labels, rows, columns)
    starts, total, corner = _places(xp, pairs, rows, columns)
    column_start = xp.asarray(columns.start)
    heights, widths = np.diff(rows.local), np.diff(columns.local)
    tall, wide = (xp.asarray(np.diff(of.start)) for of in (rows, columns))
    size, kind = int(starts[-1]), index_type(int(starts[-1]), max(rows.size, columns.size))
    data, where = xp.empty(size, dtype=local.dtype), xp.empty(size, dtype=kind)
    hit = None if np.all(local != 0) else xp.empty(size, dtype=bool)
    for h, w in set(product(heights.tolist(), widths.tolist())):
        tiles = xp.asarray(_tiles(local, rows, columns, h, w))
        down, across = xp.arange(h), xp.arange(w)
        fits = xp.flatnonzero((tall[pairs.row] == h) & (wide[pairs.column] == w))
        for i in range(0, fits.size, step := max(1, 2**24 // (h * w))):  # 100 MB at a time
            some = fits[i : i + step]
            row, first = pairs.row[some], column_start[pairs.column[some]]
            place = (corner[some, None] + down * total[row, None])[:, :, None] + across
            data[place] = pairs.gathered(xp, some, tiles, xp.add).reshape(place.shape)
            where[place] = (first[:, None, None] + across).astype(kind)
            if hit is not None:
                found = pairs.gathered(xp, some, tiles != 0, xp.logical_or)
                hit[place] = found.reshape(place.shape)
    if hit is not None:
        keep = xp.flatnonzero(hit)
        before = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(hit, dtype=np.int64)])
        data, where, starts = data[keep], where[keep], before[starts]
        kind = index_type(int(keep.size), max(rows.size, columns.size))
    csr = importlib.import_module("scipy.sparse" if xp is np else "cupyx.scipy.sparse").csr_matrix
    parts = data, where.astype(kind, copy=False), starts.astype(kind)
    matrix = csr(parts, shape=(rows.size, columns.size))
    matrix.has_canonical_format = True
    return matrix


class _Pairs(NamedTuple):
    """The distinct pairs of blocks of all cells, in order, on the device."""

    row: Any  # row block of each pair, shape (pairs,)
    column: Any  # column block of each pair
    begin: Any  # where each pair's tiles begin, then their number, (pairs + 1,)
    tiles: Any  # class times pairs in a cell plus pair in the cell; last the zero tile

    @classmethod
    def of(cls, xp: Any, classes: int, labels: Any, rows: DofBlocks, columns: DofBlocks) -> _Pairs:
        blocks, kind = len(columns.start) - 1, np.int64
        R, C = xp.asarray(rows.of_cells.T), xp.asarray(columns.of_cells.T)
        key = (R.astype(kind)[:, :, None] * blocks + C[:, None, :]).ravel()
        order = xp.argsort(key, kind="stable") if xp is np else xp.argsort(key)
        key, inside = key[order], R.shape[1] * C.shape[1]
        new = xp.concatenate([xp.ones(1, dtype=bool), key[1:] != key[:-1], xp.ones(1, dtype=bool)])
        begin = xp.flatnonzero(new)
        cell, pair = order // inside, order % inside
        tiles = xp.empty(order.size + 1, dtype=kind)
        tiles[:-1] = xp.asarray(labels)[cell].astype(kind) * inside + pair
        tiles[-1] = classes * inside
        key = key[begin[:-1]]
        return cls(key // blocks, key % blocks, begin, tiles)

    def gathered(self, xp: Any, some: Any, of_tiles: Any, add: Any) -> Any:
        """Return the sums of the tiles of some pairs, or the result of `add`, one by one."""
        begin, end = self.begin[some], self.begin[some + 1]
        total = of_tiles[self.tiles[begin]]
        for k in range(1, int((end - begin).max())):
            total = add(total, of_tiles[self.tiles[xp.where(begin + k < end, begin + k, -1)]])
        return total


def _places(xp: Any, pairs: _Pairs, rows: DofBlocks, columns: DofBlocks) -> tuple[Any, Any, Any]:
    """Return the starts of the rows, their lengths in each row block, and the start of each pair.
    All rows of a block have the same columns; a pair begins in the first of its rows."""
    row_start, width = xp.asarray(rows.start), xp.asarray(np.diff(columns.start))[pairs.column]
    past = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(width, dtype=np.int64)])
    block = past[xp.searchsorted(pairs.row, xp.arange(len(rows.start)), side="left")]
    total = block[1:] - block[:-1]
    of_row = xp.searchsorted(row_start, xp.arange(rows.size), side="right") - 1
    starts = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(total[of_row])])
    return starts, total, starts[row_start[pairs.row]] + past[:-1] - block[pairs.row]


def _tiles(
    local: NDArray[Any], rows: DofBlocks, columns: DofBlocks, h: int, w: int
) -> NDArray[Any]:
    """Return the tiles of one size of all classes, then one of zeros, shape (tiles, h w).
    Tiles of another size are zero."""
    tall, wide = (range(len(of.local) - 1) for of in (rows, columns))
    tiles = np.zeros((len(local) + 1, len(tall), len(wide), h * w), dtype=local.dtype)
    for i, j in product(tall, wide):
        (a, b), (c, d) = rows.local[i : i + 2], columns.local[j : j + 2]
        if (b - a, d - c) == (h, w):
            tiles[:-1, i, j] = local[:, a:b, c:d].reshape(len(local), -1)
    return tiles.reshape(-1, h * w)[: len(local) * len(tall) * len(wide) + 1]
