"""The linear system of a Newton step where only products with the compliance are known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.krylov import gmres
from contact.condensation.boundary_problem import Array
from contact.laws.slip_law import SlipLaw

_REDUCTION = 1e-3  # of the residual of a step; the next step begins with what is left
_MOST = 400  # products of a step at most
_BASIS = 120  # vectors of GMRES before it starts anew


class ProductSystem:
    """``[[M (W + D), -M C], [balance]]`` plus what the laws of slip add, as an operator.

    The rows are those of `contact.laws.semismooth_newton.newton_step`. Those of slip are multiplied
    by ``(|q| - g) / |q|`` in the damped form, so that no coefficient is large where slip begins.

    Parameters
    ----------
    W : FactorCompliance
    rows : ndarray of int, shape (n,)
        The rows of W with forces.
    added : ndarray, shape (n,)
        Diagonal of D.
    C : ndarray, shape (n, k)
        Displacements of these rows for unit motions.
    balance : ndarray, shape (k, n + k)
        The last rows.
    """

    def __init__(
        self, W: Any, rows: NDArray[np.int64], added: Array, C: Array, balance: Array
    ) -> None:
        self._W, self._rows, self._added, self._C, self._balance = W, rows, added, C, balance
        n = rows.size
        self._of_rows: Any = None
        self._extra: Any = None
        self._weight = np.ones(n + len(balance))

    def impose(
        self, law: SlipLaw, at: NDArray[np.int64], of_normal: NDArray[np.int64], damped: bool
    ) -> None:
        """Replace the rows of slipping points by their law.

        Parameters
        ----------
        law : SlipLaw
        at : ndarray of int, shape (p, dim - 1)
            Rows of each point's tangents, -1 for a prescribed one.
        of_normal : ndarray of int, shape (p,)
            Column of each point's normal force.
        damped : bool
        """
        n, live = self._rows.size, at >= 0
        kept = np.ones(n)
        kept[at[live]] = 0.0
        of_rows, extra = _Entries(n), _Entries(n)
        for i in range(at.shape[1]):
            for j in range(at.shape[1]):
                both = live[:, i] & live[:, j]
                of_rows.add(at[both, i], at[both, j], law.of_v[both, i, j])
                extra.add(at[both, i], at[both, j], law.own[both, i, j])
            bound = live[:, i] & (law.coefficient != 0)
            share = -(law.coefficient * law.direction[:, i])[bound]
            extra.add(at[bound, i], of_normal[bound], share)
            if damped:
                here = live[:, i]
                self._weight[at[here, i]] = 1.0 - law.ratio[here]
        self._of_rows = of_rows.matrix() + sparse.diags_array(kept)
        self._extra = extra.matrix()

    def __matmul__(self, x: Array) -> Array:
        return self._times(x, self._W.__matmul__)

    def _times(self, x: Array, compliance: Callable[[Array], Array]) -> Array:
        n = self._rows.size
        forces = np.zeros(self._W.shape[0])
        forces[self._rows] = x[:n]
        moved = compliance(forces)[self._rows] + self._added * x[:n] - self._C @ x[n:]
        if self._of_rows is not None:
            moved = self._of_rows @ moved + self._extra @ x[:n]
        return np.concatenate((moved, self._balance @ x))

    def solve(self, right: Array) -> Array:
        """A step towards the solution, from zero; its products are quick ones."""
        unit = np.ones(right.size)
        n, k = self._rows.size, len(self._balance)
        if k:  # motions and their balance in the units of forces and displacements
            size = float(np.abs(self._C).max(initial=0.0)) * np.sqrt(n)
            unit[n:] = 1.0 / size if size else 1.0
        weight = self._weight * unit

        def product(y: Array) -> Array:
            return np.asarray(weight * self._times(unit * y, self._W.quickly))

        step, _ = gmres(product, weight * right, lambda y: y, _REDUCTION, _MOST, _BASIS)
        return np.asarray(unit * step)


class _Entries:
    """Entries of a sparse square matrix, as they are found."""

    def __init__(self, n: int) -> None:
        self._n, self._found = n, [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]

    def add(self, row: NDArray[np.int64], column: NDArray[np.int64], value: Array) -> None:
        self._found.append((row, column, value))

    def matrix(self) -> sparse.csr_array:
        row, column, value = (np.concatenate(part) for part in zip(*self._found, strict=True))
        return sparse.csr_array((value, (row, column)), shape=(self._n, self._n))
