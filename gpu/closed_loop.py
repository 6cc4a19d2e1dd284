"""The closed loop of a gain: its matrix in balanced units, its poles, whether it is stable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gpu.arrays import array_module, to_host
from gpu.errors import GpuError, NotConverged
from gpu.hamiltonian_balance import balance
from gpu.lqr_problem import DenseProblem, LQRProblem
from gpu.lyapunov import SCHUR, LyapunovSolver, lyapunov_solver
from gpu.state_matrix import EPS, StateMatrix

ALL_POLES = 1500  # up to this order all poles are computed
FEW = 12
RESTARTS = 30
# Left of the axis by so much of the matrix, no meeting of eigenvalues there can be in question.
FAR = 1e-3


@dataclass(frozen=True)
class DenseLoop:
    """``E^-1 (A - B K)`` in balanced units.

    Attributes
    ----------
    matrix : array, shape (n, n)
    rounding : float
        What round-off of A and of the feedback may move an entry of it by.
    value : array, shape (n, n), or None
        The Riccati solution in the same units, where it is known.
    doubt : tuple (B, W) or None
        The inputs, and what round-off leaves of the Riccati equation, entry by entry.
    """

    matrix: Any
    rounding: float
    value: Any = None
    doubt: Any = None

    @cached_property
    def poles(self) -> np.ndarray:
        """Eigenvalues, rightmost first: all of a small matrix, else those nearest to zero."""
        if len(self.matrix) <= SCHUR and isinstance(self.matrix, np.ndarray):
            values = self.lyapunov.poles
            assert values is not None
        elif len(self.matrix) <= ALL_POLES:
            values = np.linalg.eigvals(to_host(self.matrix))
        else:
            try:
                values = _nearest(self.matrix, sigma=0.0, k=FEW)
            except NotConverged:  # a cluster: slow, but all of them
                values = np.linalg.eigvals(to_host(self.matrix))
        return values[np.argsort(-values.real, kind="stable")]

    @cached_property
    def lyapunov(self) -> LyapunovSolver:
        """Lyapunov equations of this matrix."""
        return lyapunov_solver(self.matrix)

    @property
    def abscissa(self) -> float:
        """The largest real part."""
        return float(self.poles[0].real)

    def is_stable(self) -> bool:
        """Whether every pole lies left of the imaginary axis, beyond round-off."""
        if len(self.matrix) <= ALL_POLES:
            return self.abscissa < -self.rounding and not self._on_the_axis()
        return self._lyapunov_stable() or self._powers_vanish()

    def _on_the_axis(self) -> bool:
        """Whether a Riccati solution as good as this one may have a pole on the axis.

        Where eigenvalues of the Hamiltonian meet there, round-off parts them by its square root.
        """
        xp = array_module(self.matrix)
        if self.doubt is None or len(self.matrix) > SCHUR:
            return False
        if self.abscissa < -FAR * float(xp.linalg.norm(self.matrix)):
            return False
        B, W = self.doubt
        D = self.lyapunov(W)
        return not float(xp.linalg.norm(B @ (B.T @ D))) < -self.abscissa

    def _lyapunov_stable(self) -> bool:
        """Lyapunov: X > 0 and ``A^T X + X A < 0`` by two Cholesky factorisations."""
        if self.value is None:
            return False
        half = self.value @ self.matrix
        return _definite(self.value) and _definite(-(half + half.T))

    def _powers_vanish(self) -> bool:
        try:
            _ = self.lyapunov
        except np.linalg.LinAlgError:
            return False
        return True


def closed_loop_of(
    problem: LQRProblem,
    standard: DenseProblem,
    unit: Any,
    S: Any = None,
    K: Any = None,
    residual: Any = None,
) -> DenseLoop:
    """The closed loop of a dense problem with S, or with the gain K, in the units given.

    ``residual``, shape (n, n), is what S leaves of its equation.
    """
    xp = problem.xp
    A, B, _ = standard
    value = doubt = None
    if K is None:
        E = problem.full()[1]
        Y = S if E is None else E.T @ S @ E
        gain = B.T @ Y
        value = Y * unit * unit[:, None]
    else:
        # The standard form has fed R^-1 N^T back already.
        gain = xp.asarray(problem.root.T) @ K
        if problem.N is not None:
            gain = gain - xp.asarray(np.linalg.inv(problem.root)) @ problem.N.T
    A, B, gain = A * unit / unit[:, None], B / unit[:, None], gain * unit
    if value is not None and len(A) <= ALL_POLES:
        half = abs(value @ A)
        W = half + half.T + abs(gain.T @ gain) + abs(standard.Q * unit * unit[:, None])
        left = 0.0 if residual is None else abs(residual * unit * unit[:, None])
        doubt = (B, EPS * W + left)
    rounding = 4 * EPS * float(xp.linalg.norm(A) + xp.linalg.norm(B) * xp.linalg.norm(gain))
    return DenseLoop(A - B @ gain, rounding, value, doubt)


def dense_loop(problem: LQRProblem, K: Any) -> DenseLoop:
    """The closed loop of any problem whose entries can be stored, with the gain K."""
    standard = problem.standard()
    return closed_loop_of(problem, standard, balance(standard), K=K)


def nearest_poles(state: StateMatrix, B: Any, K: Any, count: int = FEW) -> np.ndarray:
    """The poles of ``E^-1 (A - B K)`` nearest to zero, rightmost first, by solves with A alone.

    Raises
    ------
    GpuError
        The iteration does not converge.
    """
    xp, n, m = state.xp, state.n, B.shape[1]
    shift, factors = 0.0, state.factor()
    for digits in (-8, -6, -4):
        if factors is not None:
            solved = factors.solve(B)
            core = to_host(xp.eye(m) - K @ solved)
            if np.isfinite(core).all() and np.linalg.cond(core) < 1e10:
                break
        if state.kind == "operator":
            raise GpuError("the closed loop of an operator with a pole at zero is not examined")
        shift = 10.0**digits * (state.size() or 1.0)
        factors = state.factor(shift)
    else:
        raise GpuError("the closed loop could not be factored near zero")
    inverse = xp.asarray(np.linalg.inv(core))

    def apply(x: Any) -> Any:
        y = factors.solve(state.mass(x))
        return y + solved @ (inverse @ (K @ y))

    start = xp.asarray(np.random.default_rng(0).standard_normal(n))
    theta = _nearest(apply, k=min(count, n), v0=start)
    poles = shift + 1.0 / theta
    return poles[np.argsort(-poles.real, kind="stable")]


def _nearest(matrix: Any, **options: Any) -> np.ndarray:
    """What converged of the wanted eigenvalues in a few restarts: repeated ones may never all."""
    from gpu.eigs import eigs

    try:
        found = eigs(matrix, return_eigenvectors=False, maxiter=RESTARTS, tol=1e-8, **options)
    except NotConverged as error:
        found = error.eigenvalues
        if found is None or not len(found):
            raise
    return to_host(found)


def _definite(M: Any) -> bool:
    from gpu.dense import cholesky

    xp = array_module(M)
    diagonal = M.diagonal()
    if not bool((diagonal > 0.0).all()):
        return False
    unit = xp.sqrt(diagonal)
    scaled = M / unit / unit[:, None]
    places = xp.arange(len(M))
    scaled[places, places] -= 4 * len(M) * EPS
    try:
        cholesky(xp.ascontiguousarray(scaled))
    except np.linalg.LinAlgError:
        return False
    return True
