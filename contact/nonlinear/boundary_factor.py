"""Factors of a tangent whose last unknowns are those of the contact points, and their compliance:
by PARDISO or SuperLU on the host, by cuDSS on a device."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgWarning
from scipy.sparse.linalg import splu

from contact.arrays.dense_arrays import DeviceArrays, HostArrays
from contact.condensation.device_schur import DeviceParts, Rows
from contact.errors import NotConverged
from contact.nonlinear.free_unknowns import Matrix, entries, on_host, with_values
from skfem_adini.ground.arrays import host, namespace
from skfem_adini.ground.pardiso import GENERAL, Pardiso, SolverError, has_pardiso

Array = NDArray[np.float64]
Csr = sparse.csr_array
Index = NDArray[np.int64]
SINGULAR = 1e-13  # pivots of a matrix with a diagonal of one that are rounding errors


class SuperLUParts:
    """SuperLU without row exchanges, with some unknowns last: the trailing block of L U is S."""

    turn = 0  # of the factorisations that share an analysis

    def __init__(self, A: Csr, order: Index, last: Index) -> None:
        n, nb = A.shape[0], last.size
        inner = np.ones(n, dtype=bool)
        inner[last] = False
        self._order, self._start = np.concatenate((order[inner[order]], last)), n - nb
        permuted = sparse.csc_array(A)[self._order][:, self._order]
        if sparse.csgraph.connected_components(permuted, directed=False)[0] > 1:
            permuted = _linked(permuted, n - nb)
        try:
            self._lu = splu(permuted, "NATURAL", diag_pivot_thresh=0.0)
        except RuntimeError:  # a pivot is zero
            raise _singular() from None
        tail = np.arange(n - nb, n)
        moved = [self._lu.perm_c[tail], self._lu.perm_r[tail]]
        if not all(np.array_equal(one, tail) for one in moved):
            raise NotConverged("large strain: SuperLU moved the contact points; report the mesh")
        U, L = self._lu.U, self._lu.L
        if not np.abs(U.diagonal()[: n - nb]).min(initial=1.0) >= SINGULAR:
            raise _singular()
        self.fill = L.nnz + U.nnz
        self.schur = L[:, n - nb :][n - nb :].toarray() @ U[:, n - nb :][n - nb :].toarray()

    def forward(self, load: Array) -> tuple[Array, Array]:
        """What is left of a load on the last unknowns, and what `backward` needs."""
        own, start = load[self._order], self._start
        mine = own[start:].copy()
        own[start:] = 0.0
        carried = -self.schur @ self._lu.solve(own)[start:] if np.any(own) else np.zeros(mine.size)
        own[start:] = carried
        return mine - carried, own

    def backward(self, own: Array, last: Array) -> Array:
        """All unknowns, shape (n,), from the last ones."""
        own[self._start :] += self.schur @ last
        found = np.empty_like(own)
        found[self._order] = self._lu.solve(own)
        found[self._order[self._start :]] = last
        return found


class PardisoParts:
    """PARDISO's partial factorisation of a general matrix, whose analysis serves several."""

    def __init__(self, A: Csr, last: Index) -> None:
        self.pattern, self.last = (A.indptr, A.indices), last
        # As `PardisoSchur`; without scaling and matching, which a Schur complement excludes.
        parameters = {1: 3, 9: 13, 17: -1, 23: 1, 24: 1, 35: 2}
        self._pardiso = Pardiso(A, GENERAL, parameters, chosen=last)
        self._pardiso(11)
        self.fill, self.turn = self._pardiso.fill, 0
        self.refactor(A)

    def fits(self, A: Csr, last: Index) -> bool:
        """Whether a matrix has the pattern and the last unknowns of this one."""
        same = zip(self.pattern, (A.indptr, A.indices), strict=True)
        return np.array_equal(last, self.last) and all(np.array_equal(*pair) for pair in same)

    def refactor(self, A: Csr) -> None:
        """Factor other values of the same pattern."""
        self._pardiso.values[:], self.turn = A.data, self.turn + 1
        self.schur = np.zeros((self.last.size, self.last.size))
        self._pardiso(22, x=self.schur)
        if self._pardiso.perturbed:
            raise _singular()

    def forward(self, load: Array) -> tuple[Array, Array]:
        """What is left of a load on the last unknowns, and what `backward` needs."""
        halfway = np.zeros_like(load)
        self._pardiso(331, np.ascontiguousarray(load), halfway)
        return halfway[self.last], halfway

    def backward(self, halfway: Array, last: Array) -> Array:
        """All unknowns, shape (n,), from the last ones."""
        halfway[self.last] = last
        found = np.zeros_like(halfway)
        self._pardiso(333, halfway, found)
        found[self.last] = last
        return found


@contextmanager
def _pivots() -> Iterator[None]:
    """Errors of the factors for pivots that are zero up to rounding, as NotConverged."""
    try:
        yield
    except SolverError as error:
        if error.pivot:
            raise _singular() from error
        raise


class BoundaryFactor:
    """The factors of a `FreeUnknowns.matrix` with some unknowns last, and their Schur complement S.

    A shift of its diagonal keeps pivots there from zero; dense factors with row exchanges solve for
    S itself. `analysis` is a list that keeps PARDISO's or cuDSS's for matrices of the same pattern;
    a new one is made for the unknowns `spare`, so that it serves as long as `last` is among
    them."""

    def __init__(
        self, A: Matrix, order: Index, last: Index, analysis: list[Any], spare: Index | None = None
    ) -> None:
        last = last if last.size else np.sort(order[-1:])
        parts: Any = DeviceParts if isinstance(A, Rows) else PardisoParts
        kept = isinstance(A, Rows) or has_pardiso()
        known = analysis[0] if analysis and isinstance(analysis[0], parts) else None
        if known is not None and known.pattern[0].size != A.indptr.size:
            known = None  # of a path, whose time is an unknown too, or of a step without it
        if known is not None and np.isin(last, known.last).all():
            last = known.last
        elif kept and spare is not None:
            last = np.union1d(last, spare)
        self.last = last
        A, xp = with_values(A, A, A.data.copy()), namespace(A.data)
        at, keys = entries(A, last)
        A.data[xp.asarray(at[keys % (A.shape[0] + 1) == 0])] += 1.0  # on the diagonal
        if kept and last.size < A.shape[0]:
            with _pivots():
                if known is not None and known.fits(A, last):
                    known.refactor(A)
                else:
                    analysis[:] = [parts(A, last)]
            self._parts: Any = analysis[0]
        else:
            A = on_host(A)
            self._parts = SuperLUParts(A, order, last)
        self._turn, S = self._parts.turn, self._parts.schur.copy()
        self.arrays = HostArrays() if namespace(S) is np else _GeneralArrays()
        S[(self.arrays.xp.arange(last.size),) * 2] -= 1.0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LinAlgWarning)  # singular: the pivots tell
            self._dense = self._lu.lu_factor(S, check_finite=False)
        pivots = host(self._dense[0].diagonal())
        if not np.abs(pivots).min(initial=1.0) >= SINGULAR:
            raise _singular()

    @property
    def _lu(self) -> Any:
        """Dense factors of SciPy, or of CuPy."""
        on_host = self.arrays.xp is np
        return scipy.linalg if on_host else importlib.import_module("cupyx.scipy.linalg")

    def serves(self, last: Index) -> bool:
        """Whether it is the factor of its `analysis` still, and has these unknowns last."""
        return self._turn == self._parts.turn and bool(np.isin(last, self.last).all())

    @property
    def fill(self) -> int:
        """Entries of the sparse factors."""
        return int(self._parts.fill)

    def compliance(self, loads: Any) -> Any:
        """Solutions at the last unknowns for loads there, both of `arrays`, shape (nb, k)."""
        return self._lu.lu_solve(self._dense, loads, check_finite=False)

    def forward(self, load: Array) -> tuple[Array, Array]:
        """The last unknowns under a load, and what `backward` needs."""
        left, halfway = self._parts.forward(load)
        return host(self.compliance(self.arrays.xp.asarray(left))), halfway

    def backward(self, halfway: Array, last: Array) -> Array:
        """All unknowns, shape (n,), from the last ones."""
        return np.asarray(self._parts.backward(halfway, last))


class _GeneralArrays(DeviceArrays):
    """Arrays of CuPy for compliances without symmetry."""

    def solve_square(self, A: Any, b: Any, definite: bool = False) -> Any:
        """Solve ``A x = b`` by LU; b and x are on the host."""
        return super().solve_square(A, b)


def _linked(A: Any, first: int) -> Any:
    """A matrix of several parts with zeros that link all unknowns to number `first`, so that
    SuperLU's order by elimination trees leaves the last unknowns last."""
    n = A.shape[0]
    others, at = np.delete(np.arange(n), first), np.full(n - 1, first)
    place = np.concatenate((others, at)), np.concatenate((at, others))
    A = A.tocoo()
    rows, columns = np.concatenate((A.row, place[0])), np.concatenate((A.col, place[1]))
    data = np.concatenate((A.data, np.zeros(2 * n - 2)))
    return sparse.csc_array((data, (rows, columns)), shape=A.shape)


def _singular() -> NotConverged:
    return NotConverged(
        "large strain: the tangent is singular; the body is not held (contact alone does not hold "
        "it), or it buckles: add a support, or take smaller steps"
    )
