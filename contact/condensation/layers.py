"""Condensation of layers of equal cells onto their bottom."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.dense_arrays import HostArrays
from contact.body.free_motions import RIGID, unseen_motion
from contact.body.layers.layered_block import LayeredBlock
from contact.body.layers.layers import PER_NODE, CellRows
from contact.body.rigid_modes import describe_motion, reduced_echelon, rigid_modes
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.errors import InputError

Array = NDArray[np.float64]


class CondensedLayers(CondensedBody):
    """A `LayeredBlock`, condensed onto its bottom by slab doubling, on the CPU or a GPU."""

    serial = False  # recovery has large products

    def __init__(self, body: LayeredBlock, rows: BodyRows, arrays: HostArrays) -> None:
        self.arrays = arrays
        size, held = body.row_size, body.prescribed[0]
        free = np.ones((2, size), dtype=bool)  # of all node rows but the top, and of the top
        free[0, held[held < size]] = False
        top = body.ndofs - size
        free[1, held[held >= top] - top] = False
        own = np.flatnonzero(free[0])
        per_length = 1.0 / np.tile([1.0, 1.0, *[body.cell_size] * 4], body.columns + 1)[own]
        self._P = sparse.csr_array((per_length, (own, np.arange(own.size))), shape=(size, own.size))
        self._prescribe(body)
        B = self._touch(rows)
        if body.path is not None:  # keep each kind of unknown at all nodes
            kinds = np.unique(own[self._boundary] % PER_NODE)
            self._boundary = np.flatnonzero(np.isin(own % PER_NODE, kinds))
        self.path = "slabs" if body.path is None else body.path
        self.B = sparse.csr_array(B[:, self._boundary])
        self._per_length, self._kinds = per_length[self._boundary], own[self._boundary] % PER_NODE
        self._factor: Any = FACTORS[self.path](body, free, own[self._boundary], arrays)
        bottom, plain = self._free_motions()
        of_unit = self._motion_sizes()[:, None]
        unseen = unseen_motion(of_unit * plain, bottom[self._boundary])
        self._refuse(None if unseen is None else unseen / of_unit[:, 0])
        with one_blas_thread(max(self.B.shape)):
            self._hold(bottom[self._boundary], plain)

    def _prescribe(self, body: Any) -> None:
        self.body = body
        dofs, values = body.prescribed
        self._u0 = self._lifted = None
        if values.any():
            u0 = self.arrays.xp.zeros(body.ndofs)
            u0[self.placed(dofs)] = self.placed(values)
            self._u0, self._lifted = u0, body.stiffness @ u0

    def _free_motions(self) -> tuple[Array, Array]:
        """Free rigid motions on the free unknowns of the bottom row, and their coefficients.
        The coefficients, (3, k), are those of both translations and the rotation about the
        middle."""
        body = self.body
        held = body.prescribed[0]
        node, kind = np.divmod(held, PER_NODE)
        j, i = np.divmod(node, body.columns + 1)
        of_bottom = _motions(np.repeat(body.x, PER_NODE), 0.0, body)
        of_held = _motions(body.x[i], body.y[j], body, kind)
        length = np.where(kind < 2, 1.0, body.cell_size)[:, None]
        # Scale each motion to unit displacement, the rotation at the corners.
        size = np.array([1.0, 1.0, 0.5 * np.hypot(body.width, body.height)])
        scaled = np.vstack((length * of_held / size, np.zeros((3, 3))))
        _, singular, V = np.linalg.svd(scaled, full_matrices=False)
        plain = reduced_echelon(V[singular < RIGID * np.sqrt(max(held.size, 1))] / size).T
        free: Array = self._P.T @ (of_bottom @ plain) / (self._P**2).sum(axis=0)[:, None]
        return free, plain

    def _motion_sizes(self) -> Array:
        """Norms of the translations and the rotation on all dofs, shape (3,)."""
        x, y = self._about_middle()
        turn = x.size * np.sum(y**2) + y.size * np.sum(x**2) + 2.0 * x.size * y.size
        return np.sqrt([x.size * y.size, x.size * y.size, turn])

    def _about_middle(self) -> tuple[Array, Array]:
        """Coordinates of the columns and rows of nodes, from the middle of the body."""
        return self.body.x - 0.5 * self.body.width, self.body.y - 0.5 * self.body.height

    def _invert(self) -> None:
        """Invert wave by wave; by a dense factor if a wave is not positive definite."""
        moves = np.abs(self.N).max(axis=1, initial=0.0)
        free = np.unique(self._kinds[moves > RIGID * moves.max(initial=0.0)])
        self._by_waves = (
            self.body.path is not None and free.size == self.N.shape[1] and self._factor.hold(free)
        )
        self.thin = False
        if not self._by_waves:
            super()._invert()

    def compliance(self) -> Any:
        """``B S_b^-1 B^T`` on the device, shape (n, n)."""
        if not self._by_waves:
            return super().compliance()
        per_length = sparse.diags_array(1.0 / self._per_length)
        return self.arrays.congruent(sparse.csr_array(self.B @ per_length), self._factor.compliance)

    def flexed(self, r: Array) -> Array:
        """Displacement of the boundary's unknowns under forces r on them."""
        if not self._by_waves:
            return super().flexed(r)
        flexed: Array = self._factor.flexed(r / self._per_length) / self._per_length
        return flexed

    def _in_unknowns(self, rows: BodyRows) -> sparse.csr_array:
        size = self.body.row_size
        lowest = BodyRows(rows.normal[:, :size], rows.tangential[:, :size])
        return super()._in_unknowns(lowest)

    def restrict(self, rows: Any) -> Array:
        """Rows on all dofs, expressed in the contact boundary's unknowns, shape (nrows, nb)."""
        return super().restrict(rows[:, : self.body.row_size])

    def placed(self, v: Any) -> Any:
        """Move a vector to the device, on which the body computes from now on."""
        self.body.compute_with(self.arrays)
        return self.body.placed(v)

    def prescribed(self) -> Array:
        """The prescribed displacements on all dofs, zero elsewhere, on the host."""
        dofs, values = self.body.prescribed
        u0 = np.zeros(self.body.ndofs)
        if values.any():
            u0[dofs] = values
        return u0

    def reduce(self, load: Any) -> Array:
        """Load on all dofs, condensed onto the contact boundary's unknowns, shape (nb,)."""
        return super().reduce(self.placed(load))

    def expand(self, load: Any, z_b: Array) -> Any:
        """Displacement of all dofs from the boundary's unknowns, on the device of the load."""
        u = super().expand(self.placed(load), z_b)
        return self.arrays.get(u) if isinstance(load, np.ndarray) else u

    def carried(self, forces: Any) -> Array:
        """Forces on all dofs, condensed with zero supports onto the boundary's unknowns, (nb,)."""
        carried: Array = self._per_length * self._factor.reduce(forces)
        return carried

    def moved(self, forces: Any, z_b: Array) -> Any:
        """Displacement of all dofs under forces, with zero supports."""
        return self._factor.expand(forces, self._per_length * z_b)

    def unbalanced(self, rest: Any, u: Any) -> Any:
        """Residual forces on free dofs, for one step of iterative refinement.
        Smooth motions of n rows have stiffness 1/n^2 times the largest entries, whose rounding
        causes a relative error n^2 eps; the cell-by-cell product has no such error."""
        left = rest - self.body.stiffness @ u
        held = self.body.prescribed[0]
        left[held if isinstance(left, np.ndarray) else self.placed(held)] = 0.0
        return left

    def motion_of(self, motion: Array) -> tuple[str, Array]:
        """Name, and displacement of all dofs, of translations and rotation `motion`, shape (3,)."""
        body, (x, y) = self.body, self._about_middle()
        name = describe_motion(body.trace, rigid_modes(body.trace) @ _about(motion, body))
        u = np.zeros((y.size, x.size, PER_NODE))
        u[..., 0] = motion[0] - motion[2] * y[:, None]
        u[..., 1] = motion[1] + motion[2] * x
        u[..., 3], u[..., 4] = motion[2], -motion[2]
        return name, u.ravel()

    def resultants(self, load: Array) -> Array:
        """Work of a load on the rigid motions, from the load before condensation."""
        if not self.modes.shape[1]:
            return np.zeros(0)
        xp, (x, y) = self.arrays.xp, map(self.arrays.xp.asarray, self._about_middle())
        f = self.placed(load).copy()
        f[xp.asarray(self.body.prescribed[0])] = 0.0
        f = f.reshape(y.size, x.size, PER_NODE)
        turn = x @ f[..., 1].sum(axis=0) - y @ f[..., 0].sum(axis=1)
        turn += f[..., 3].sum() - f[..., 4].sum()
        work = xp.stack((f[..., 0].sum(), f[..., 1].sum(), turn))
        return np.asarray(self.modes.T @ self.arrays.get(work))

    def scaled_schur(self) -> Any:
        """S_b on the device, a copy."""
        per_length = self.arrays.put(self._per_length)
        return per_length[:, None] * self._factor.schur * per_length


def _doubled(
    body: LayeredBlock, free: NDArray[np.bool_], boundary: NDArray[np.int64], arrays: HostArrays
) -> Any:
    return SlabDoubling(body.columns, body.cell_rows, free[0], free[1], boundary, arrays)


# Factor classes by the path of a block, called with the free unknowns of all node rows but the top,
# and of the top. Other modules register theirs.
FACTORS: dict[str, Callable[..., Any]] = {"slabs": _doubled}


def _motions(
    x: Array, y: Array | float, body: LayeredBlock, kind: NDArray[np.int64] | None = None
) -> Array:
    """Both translations and the rotation about the middle, at dofs with coordinates x, y, (n,
    3)."""
    if kind is None:
        kind = np.arange(x.size) % PER_NODE
    x, y = x - 0.5 * body.width, y - 0.5 * body.height
    turn = np.select([kind == 0, kind == 1, kind == 3, kind == 4], [-y + 0 * x, x, 1.0, -1.0], 0.0)
    return np.column_stack((kind == 0, kind == 1, turn)).astype(np.float64)


def _about(motion: Array, body: LayeredBlock) -> Array:
    """The same motion with its rotation about the middle of the lowest row of cells."""
    drop = 0.5 * (body.height - body.y[1])
    return motion + np.array([drop * motion[2], 0.0, 0.0])


# Schur complement of a stack of layers of equal cells, by doubling slabs.
#
# A slab of 2^k equal cell rows, its inner node rows eliminated, has on its bottom and top node rows
# the matrix
#
# .. math:: \begin{pmatrix} a_k & b_k \\ b_k^T & c_k \end{pmatrix} .
#
# A slab of one material is symmetric up-down: with the signs P of unknowns under this reflection,
# ``a = P c P`` and ``b^T = P b P``, so that the matrix ``c_k + a_k`` of the row between two slabs
# splits into blocks of sign + and -. With its Cholesky factor L and ``Y = L^-1 b_k``,
#
# .. math::
#     c_{k+1} = c_k - Y_+^T Y_+ - Y_-^T Y_-, \qquad b_{k+1} = -P (Y_+^T Y_+ - Y_-^T Y_-),
#
# about 1.6 m^3 operations for m unknowns per node row. Layers, split into powers of two, are added
# from the top: a slab below a body of stiffness A has the stiffness ``a - b (c + A)^-1 b^T``. All
# factored matrices belong to slabs clamped below, so they are definite without supports too.
#
# G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., section 4.5.4 (cyclic reduction);
# R. W. Hockney, J. ACM 12 (1965) 95-113 (doubling of equal blocks).


Index = NDArray[np.int64]
Pair = tuple[Any, Any]

# Signs by which a reflection up-down multiplies the unknowns of a node: u, v, u_x, v_x, u_y, v_y.
REFLECTION = np.array([1.0, -1.0, 1.0, -1.0, -1.0, 1.0])


class Slab(NamedTuple):
    """Blocks ++, --, +- of c and b of one slab; those of -+ are c_+-^T and -b_+-^T."""

    c: tuple[Any, Any, Any]  # ++, --, +-
    b: tuple[Any, Any, Any]


class Middle(NamedTuple):
    """Factors that recover the node row between two slabs: L_+, L_- and the four blocks of Y."""

    L: Pair
    Y: tuple[Pair, Pair]


@dataclass(frozen=True)
class Fold:
    """A slab of 2^levels cell rows, eliminated together with everything above it."""

    row: int  # number of its bottom node row
    middles: tuple[Middle, ...]  # one for each level, finest first
    L: Any  # factor of its top row: L L^T = c + A
    Y: Any  # L^-1 b^T
    free: Any  # free unknowns of its top row: all, except at the top of the body

    @property
    def height(self) -> int:
        """Number of cell rows."""
        return int(2 ** len(self.middles))


class SlabDoubling:
    """A `contact.condensation.schur.SchurFactor` of a stack of layers, given from the bottom up.
    `free` and `free_top`, (6 (columns + 1),), mark free unknowns of every node row and of the top
    one; `boundary`, ascending, are those of the bottom row to keep."""

    def __init__(
        self,
        columns: int,
        layers: list[CellRows],
        free: NDArray[np.bool_],
        free_top: NDArray[np.bool_],
        boundary: Index,
        arrays: HostArrays,
    ) -> None:
        self.arrays, self.width = arrays, free.size
        sign = np.tile(REFLECTION, columns + 1)
        self._plus = np.flatnonzero(free & (sign > 0))
        self._minus = np.flatnonzero(free & (sign < 0))
        order = np.concatenate((self._plus, self._minus))
        self.rows = 1 + sum(layer.height for layer in layers)
        self._order = arrays.xp.asarray(order)
        try:
            A = self._factor(columns, layers, free_top[order])
            place = np.full(free.size, -1)
            place[order] = np.arange(order.size)
            kept = place[boundary]
            rest = np.setdiff1d(np.arange(order.size), kept)
            self._kept, self._rest = arrays.xp.asarray(kept), arrays.xp.asarray(rest)
            self._L = arrays.cholesky(_part(arrays, A, self._rest, self._rest))
            self._Y = arrays.solve(self._L, _part(arrays, A, self._rest, self._kept))
            self.schur = _part(arrays, A, self._kept, self._kept) - arrays.gram(self._Y)
        except np.linalg.LinAlgError as error:
            raise InputError(
                f"stiffness: a slab is not positive definite ({error}); the material or the shape "
                "of the cells is not admissible"
            ) from None
        self._last: tuple[Array, Pair] | None = None

    def _factor(self, columns: int, layers: list[CellRows], free_top: NDArray[np.bool_]) -> Any:
        """Fold all layers; returns the stiffness on the bottom row."""
        k, xp = self.arrays, self.arrays.xp
        self.folds: list[Fold] = []
        row = self.rows - 1
        A: Any = None
        known: dict[bytes, tuple[list[Slab], list[Middle]]] = {}
        free: Any = slice(None) if free_top.all() else xp.asarray(np.flatnonzero(free_top))
        for layer in reversed(layers):
            key = layer.stiffness.tobytes()
            slabs, middles = known.get(key) or known.setdefault(
                key, ([self._one_row(columns, layer.stiffness)], [])
            )
            while 2 ** len(slabs) <= layer.height:
                slab, middle = doubled(k, slabs[-1])
                slabs.append(slab)
                middles.append(middle)
            for level, slab in enumerate(slabs):
                if not layer.height >> level & 1:
                    continue
                row -= 2**level
                L, Y, A = folded(k, slab, A, free)
                self.folds.append(Fold(row, tuple(middles[:level]), L, Y, free))
                free = slice(None)
        return A

    def _one_row(self, columns: int, stiffness: Array) -> Slab:
        """The slab of one row of cells."""
        # Average with the mirror image to make the symmetry exact.
        corners = np.split(np.arange(4 * PER_NODE), 4)
        top, bottom = np.r_[corners[3], corners[2]], np.r_[corners[0], corners[1]]
        P = np.tile(REFLECTION, 2)
        c = 0.5 * (stiffness[np.ix_(top, top)] + P[:, None] * stiffness[np.ix_(bottom, bottom)] * P)
        b = stiffness[np.ix_(bottom, top)]
        b = 0.5 * (b + P[:, None] * b.T * P)
        sets = self._plus, self._minus
        return Slab(
            tuple(
                self._assembled(columns, c, sets[i], sets[j]) for i, j in ((0, 0), (1, 1), (0, 1))
            ),
            tuple(
                self._assembled(columns, b, sets[i], sets[j]) for i, j in ((0, 0), (1, 1), (0, 1))
            ),
        )

    def _assembled(self, columns: int, block: Array, rows: Index, cols: Index) -> Any:
        """Selected rows and columns of the dense matrix of a row of equal cells."""
        xp = self.arrays.xp
        dense = xp.zeros(rows.size * cols.size)
        place_r, place_c = np.full(self.width, -1), np.full(self.width, -1)
        place_r[rows], place_c[cols] = np.arange(rows.size), np.arange(cols.size)
        dofs = PER_NODE * np.arange(columns)[:, None] + np.arange(2 * PER_NODE)
        # Neighbouring cells share entries: add even cells first, so that indices are distinct.
        for cells in (dofs[::2], dofs[1::2]):
            i, j = place_r[cells][:, :, None], place_c[cells][:, None, :]
            live = (i >= 0) & (j >= 0)
            at = (i + rows.size * j)[live]
            values = np.broadcast_to(block, live.shape)[live]
            dense[xp.asarray(at)] += xp.asarray(values)
        return dense.reshape((rows.size, cols.size), order="F")

    def reduce(self, load: Array) -> Array:
        """Reduce a load of all dofs to the kept unknowns, shape (nb,)."""
        k = self.arrays
        bottom = k.xp.concatenate([part[0] for part in self._forward(load)])
        reduced = bottom[self._kept] - self._Y.T @ bottom[self._rest]
        return np.asarray(k.get(reduced))

    def expand(self, load: Any, z_b: Array) -> Any:
        """All dofs, (rows * width,), from the kept unknowns, on the device of the load."""
        k, xp = self.arrays, self.arrays.xp
        w = self._forward(load)
        split = self._plus.size
        bottom = xp.concatenate([part[0] for part in w])
        kept = xp.asarray(z_b)
        bottom[self._kept] = kept
        bottom[self._rest] = _solved(k, self._L, bottom[self._rest] - self._Y @ kept, True)
        z = tuple(part.copy() for part in w)
        z[0][0], z[1][0] = bottom[:split], bottom[split:]
        for fold in reversed(self.folds):
            low, high = fold.row, fold.row + fold.height
            below = xp.concatenate((z[0][low], z[1][low]))
            above = xp.concatenate((z[0][high], z[1][high]))
            above[fold.free] = _solved(k, fold.L, above[fold.free] - fold.Y @ below, True)
            z[0][high], z[1][high] = above[:split], above[split:]
            for level in range(len(fold.middles), 0, -1):
                _recover(k, fold, level, z)
        full = xp.zeros((self.rows, self.width))
        full[:, self._order] = xp.hstack(z)
        return k.get(full).ravel() if isinstance(load, np.ndarray) else full.ravel()

    def _forward(self, load: Any) -> Pair:
        """Forward elimination of a load; row 0 contains the reduced load.
        The last result is cached, since `reduce` and `expand` both need it."""
        k, xp = self.arrays, self.arrays.xp
        load = xp.asarray(load)
        if self._last is not None and bool(xp.array_equal(self._last[0], load)):
            return self._last[1]
        rows = load.reshape(self.rows, self.width)
        at = xp.flatnonzero(rows.any(axis=1))
        loaded = np.asarray(k.get(at))
        f = tuple(xp.zeros((self.rows, part.size)) for part in (self._plus, self._minus))
        for part, own in zip(f, (self._plus, self._minus), strict=True):
            part[at] = rows[at[:, None], xp.asarray(own)]
        split = self._plus.size
        for fold in self.folds:
            low, high = fold.row, fold.row + fold.height
            if np.any((loaded > low) & (loaded < high)):
                for level in range(1, len(fold.middles) + 1):
                    _eliminate(k, fold, level, f)
            given = xp.concatenate((f[0][high], f[1][high]))
            w = _solved(k, fold.L, given[fold.free])
            top = xp.zeros_like(given)
            top[fold.free] = w
            f[0][high], f[1][high] = top[:split], top[split:]
            below = fold.Y.T @ w
            f[0][low] -= below[:split]
            f[1][low] -= below[split:]
        bottom = xp.concatenate((f[0][0], f[1][0]))
        bottom[self._rest] = _solved(k, self._L, bottom[self._rest])
        f[0][0], f[1][0] = bottom[:split], bottom[split:]
        self._last = load.copy(), f
        return f


def doubled(k: HostArrays, slab: Slab) -> tuple[Slab, Middle]:
    """Two equal slabs on top of each other, and how to recover the row between them."""
    (c_p, c_m, c_x), (b_p, b_m, b_x) = slab
    L_p, L_m = k.cholesky(2.0 * c_p), k.cholesky(2.0 * c_m)
    Y_pp, Y_pm = k.solve(L_p, b_p.copy("F")), k.solve(L_p, b_x.copy("F"))
    Y_mp, Y_mm = k.solve(L_m, -b_x.T.copy("F")), k.solve(L_m, b_m.copy("F"))
    G, H = k.gram(Y_pp), k.gram(Y_mp)
    c_p, b_p = c_p - G - H, H - G
    G, H = k.gram(Y_pm), k.gram(Y_mm)
    c_m, b_m = c_m - G - H, G - H
    G, H = k.product(Y_pp, Y_pm, True), k.product(Y_mp, Y_mm, True)
    c_x, b_x = c_x - G - H, H - G
    middle = Middle((L_p, L_m), ((Y_pp, Y_pm), (Y_mp, Y_mm)))
    return Slab((c_p, c_m, c_x), (b_p, b_m, b_x)), middle


def folded(k: HostArrays, slab: Slab, above: Any, free: Any) -> tuple[Any, Any, Any]:
    """L, Y and the stiffness on the bottom row of a slab below a body of stiffness `above`."""
    xp = k.xp
    (c_p, c_m, c_x), (b_p, b_m, b_x) = slab
    M = _blocks(xp, c_p, c_m, c_x, c_x.T)
    if above is not None:
        M = M + above
    b_T = _blocks(xp, b_p, b_m, -b_x, b_x.T)
    if not isinstance(free, slice):
        M, b_T = xp.asfortranarray(M[free][:, free]), xp.asfortranarray(b_T[free])
    L = k.cholesky(M)
    Y = k.solve(L, b_T)
    return L, Y, _blocks(xp, c_p, c_m, -c_x, -c_x.T) - k.gram(Y)


def _blocks(xp: Any, pp: Any, mm: Any, pm: Any, mp: Any) -> Any:
    split, n = pp.shape[0], pp.shape[0] + mm.shape[0]
    whole = xp.empty((n, n), order="F")
    whole[:split, :split], whole[split:, split:] = pp, mm
    whole[:split, split:], whole[split:, :split] = pm, mp
    return whole


def _part(k: HostArrays, A: Any, rows: Any, columns: Any) -> Any:
    return k.xp.asfortranarray(A[rows[:, None], columns])


def _solved(k: HostArrays, L: Any, r: Any, transposed: bool = False) -> Any:
    return k.solve(L, k.xp.asfortranarray(r[:, None]), transposed)[:, 0]


def _levels(fold: Fold, level: int) -> tuple[slice, slice, slice]:
    """Rows at the bottom, middle and top of the slabs of one level."""
    low, high, step = fold.row, fold.row + fold.height, 2**level
    return (
        slice(low, high, step),
        slice(low + step // 2, high, step),
        slice(low + step, high + 1, step),
    )


def _eliminate(k: HostArrays, fold: Fold, level: int, f: Pair) -> None:
    """Eliminate the loads of the middle rows of one level: f becomes L^-1 f there."""
    bottom, middle, top = _levels(fold, level)
    (L, Y) = fold.middles[level - 1]
    w = [k.solve(L[i], k.xp.asfortranarray(f[i][middle].T)) for i in (0, 1)]
    for j, sign in ((0, -1.0), (1, 1.0)):
        plus, minus = (k.product(Y[i][j], w[i], True).T for i in (0, 1))
        f[j][top] -= plus + minus
        f[j][bottom] += sign * (plus - minus)
    for i in (0, 1):
        f[i][middle] = w[i].T


def _recover(k: HostArrays, fold: Fold, level: int, z: Pair) -> None:
    """Displacement of the middle rows of one level from the rows below and above them."""
    bottom, middle, top = _levels(fold, level)
    (L, Y) = fold.middles[level - 1]
    for i, sign in ((0, 1.0), (1, -1.0)):
        same = z[0][top] + sign * z[0][bottom], z[1][top] - sign * z[1][bottom]
        r = z[i][middle].T.copy("F")
        for j in (0, 1):
            r -= k.product(Y[i][j], k.xp.asfortranarray(same[j].T))
        z[i][middle] = k.solve(L[i], r, True).T
