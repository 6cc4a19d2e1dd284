"""Many quadratic programs with one matrix and one set of rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gpu.qp.active_set.dual import Kept, plain_array, plain_sides, result_of, rows_of, stored
from gpu.qp.data.qp_problem import FactoredMatrix, Rows, check_problem
from gpu.qp.data.qp_result import QPResult
from gpu.qp.data.standard_qp import ROUNDING
from gpu.qp.solve_qp import solve_qp
from skfem_adini.ground.arrays import namespace


class QPFactor(FactoredMatrix):
    """The parts of quadratic programs that a sequence shares, checked, scaled and factored once.

    `solve` takes the linear term and the sides of one problem. Where problems are small and dense
    it begins at the active set of the last one, whose factors are kept, so that a problem like the
    last costs a few products of matrix and vector. `solve_qp` takes a `QPFactor` in place of `P`;
    its rows serve `solve` only.

    Parameters
    ----------
    P : (n, n) array_like, SciPy sparse array or CuPy array
        The matrix; it is copied, but for a symmetric CuPy array.
    G : (l, n) array_like or sparse array, optional
        Inequality rows of `solve`; copied.
    A : (m, n) array_like, optional
        Equality rows of `solve`; copied.
    semidefinite : bool, optional
        Whether a matrix that is not positive definite to working precision is accepted.

    Attributes
    ----------
    P : (n, n) array
        The matrix.
    G, A : array or None
        The rows.
    definite : bool
        Whether a Cholesky factor exists and is kept; never for a sparse matrix.
    nearly_convex : bool
        Whether eigenvalues are negative, by less than 3e-5 of the diagonal.

    Raises
    ------
    InputError
        If `P` is not square, finite, symmetric up to rounding and positive semidefinite, or rows
        have another number of columns.

    Notes
    -----
    Threads may share one: each continues from an active set of its own.

    Examples
    --------
    The input nearest to a growing load that keeps its sum below one:

    >>> import numpy as np
    >>> from gpu import QPFactor, solve_qp
    >>> factor = QPFactor(np.eye(2), G=[[1.0, 1.0]])
    >>> [factor.solve([-load, -load], h=1.0, lb=0.0).x.tolist() for load in (0.25, 1.0)]
    [[0.25, 0.25], [0.5, 0.5]]
    >>> solve_qp(factor, [-1.0, -1.0], ub=0.5).x.tolist()
    [0.5, 0.5]
    """

    def __init__(
        self,
        P: ArrayLike,
        *,
        G: ArrayLike | None = None,
        A: ArrayLike | None = None,
        semidefinite: bool = True,
    ) -> None:
        super().__init__(P, semidefinite=semidefinite)
        xp, n = namespace(self.P), self.P.shape[0]
        sides = None if G is None else 0.0, None if A is None else xp.zeros(_count(A))
        checked = check_problem(self, xp.zeros(n), G, sides[0], A, sides[1], None, None, None)
        self.G = None if G is None else checked.G.copy()
        self.A = None if A is None else checked.A.copy()
        small = rows_of(checked)
        self._rows: Rows | None = small
        self._free: list[Kept] = []  # each is used by one thread at a time

    def solve(
        self,
        q: ArrayLike,
        h: ArrayLike | None = None,
        b: ArrayLike | None = None,
        lb: ArrayLike | None = None,
        ub: ArrayLike | None = None,
        *,
        h_low: ArrayLike | None = None,
        start: QPResult | ArrayLike | None = None,
        tol: float = 1e-9,
    ) -> QPResult:
        """Solve the problem with this linear term and these sides, as `solve_qp` does.

        Parameters
        ----------
        q : (n,) array_like
            Linear term.
        h, h_low : float or (l,) array_like, optional
            Upper and lower sides of ``G x``.
        b : (m,) array_like, optional
            Right-hand side of ``A x = b``.
        lb, ub : float or (n,) array_like, optional
            Bounds.
        start : QPResult or (n,) array_like, optional
            Where to begin instead of the last active set, as in `solve_qp`.
        tol : float, optional
            Largest accepted residual.

        Returns
        -------
        QPResult
            The solution, its multipliers and its residuals.

        Raises
        ------
        GpuError
            As `solve_qp` does.
        """
        plain = start is None and type(tol) is float and ROUNDING.sharp <= tol < 1.0
        rows = self._plain(q, h, b, lb, ub, h_low) if plain else None
        if rows is None:
            return solve_qp(
                self, q, self.G, h, self.A, b, lb, ub, h_low=h_low, start=start, tol=tol
            )
        try:
            kept = self._free.pop()
        except IndexError:
            kept = Kept(rows.P, rows.C)
        result = result_of(rows, kept.solve(rows))
        self._free.append(kept)
        if result is not None:
            return result
        return solve_qp(self.P, q, self.G, h, self.A, b, lb, ub, h_low=h_low, tol=tol)

    def __getstate__(self) -> dict[str, Any]:
        """Without the factors of active sets, which each copy makes for itself."""
        return self.__dict__ | {"_free": []}

    def _plain(self, q: Any, *sides: Any) -> Rows | None:
        """The problem for the compiled method, if all is plain."""
        kept = self._rows
        if kept is None:
            return None
        q, h, b, lb, ub, h_low = (plain_array(value) for value in (q, *sides))
        if (b is None) != (self.A is None) or (h is None and h_low is None) != (self.G is None):
            return None
        pair = plain_sides(kept.q.size, kept.equal, kept.general, h, b, lb, ub, h_low)
        if pair is None or type(q) is not np.ndarray or q.shape != kept.q.shape:
            return None
        if q.dtype != float:
            return None
        return kept._replace(q=stored(q.copy()), low=pair[0], high=pair[1])


def _count(A: Any) -> int:
    """Number of rows, as far as it can be told before the check."""
    shape = np.shape(A) if not hasattr(A, "shape") else A.shape
    return int(shape[0]) if shape else 0
