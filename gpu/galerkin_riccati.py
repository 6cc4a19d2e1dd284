"""Riccati equations projected onto a basis, and what they leave of the whole equation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg

from gpu.arrays import to_host
from gpu.errors import RiccatiError
from gpu.lqr_problem import LQRProblem


@dataclass(frozen=True)
class Projected:
    r"""The problem on a basis W: :math:`W^T E W, W^T A W, W^T B, W^T Q W`, on the host.

    Attributes
    ----------
    problem : LQRProblem
    W, AW, EW, QW : arrays, shape (n, r)
        Products of the whole matrices with the basis.
    E, A, Q : (r, r) numpy.ndarray
    B : (r, m) numpy.ndarray
    """

    problem: LQRProblem
    W: Any
    AW: Any
    EW: Any
    QW: Any
    E: np.ndarray
    A: np.ndarray
    B: np.ndarray
    Q: np.ndarray

    @classmethod
    def of(cls, problem: LQRProblem, W: Any, before: Projected | None = None) -> Projected:
        """Project; products with the first columns are taken from an earlier, smaller basis."""
        state, xp = problem.state, problem.xp
        known = 0 if before is None else before.W.shape[1]
        new = W[:, known:]
        fresh = [state.apply(new), state.mass(new), problem.weight.apply(new)]
        if before is not None:
            kept = (before.AW, before.EW, before.QW)
            fresh = [xp.concatenate(pair, axis=1) for pair in zip(kept, fresh, strict=True)]
        AW, EW, QW = fresh
        A, E, Q = (to_host(W.T @ product) for product in fresh)
        return cls(problem, W, AW, EW, QW, E, A, to_host(W.T @ problem.input), (Q + Q.T) / 2)

    def solve(self) -> np.ndarray:
        """P of the projected equation, shape (r, r): the value is ``W P W^T``.

        Raises
        ------
        RiccatiError
        """
        # Costs and reach of equal size; P scales with their ratio.
        reach, cost = float(np.linalg.norm(self.B)), float(np.linalg.norm(self.Q))
        if cost == 0.0:
            cost = reach = 1.0
        rho = cost**0.5 / reach if reach > 0.0 else 1.0
        unit = np.eye(self.B.shape[1])
        try:
            # SciPy's own e loses digits where it is not symmetric: E^T P E is solved for.
            moved = np.linalg.solve(self.E, np.hstack([self.A, self.B * np.sqrt(rho)]))
            A, B = moved[:, : len(self.A)], moved[:, len(self.A) :]
            P = linalg.solve_continuous_are(A, B, self.Q / rho, unit)
            # One Newton step takes the residual of QZ down to rounding.
            half = P @ A - P @ B @ (B.T @ P) / 2
            step = linalg.solve_continuous_lyapunov(
                (A - B @ (B.T @ P)).T, -(half + half.T + self.Q / rho)
            )
            P = P + (step + step.T) / 2
            P = np.linalg.solve(self.E.T, np.linalg.solve(self.E.T, P).T)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise RiccatiError(
                f"the problem on {len(self.A)} basis vectors has no stabilising solution ({error})"
            ) from error
        return rho * (P + P.T) / 2

    def gain(self, P: np.ndarray) -> Any:
        """``B^T W P W^T E`` in the inputs of unit cost, shape (m, n)."""
        return self.problem.xp.asarray(self.B.T @ P) @ self._EtW().T

    def _EtW(self) -> Any:
        return self.problem.state.mass_transposed(self.W)

    def residual(self, P: np.ndarray, C: Any) -> float:
        r"""``|A^T X E + E^T X A - E^T X B B^T X E + C^T C| / |C^T C|`` of ``X = W P W^T``, exactly.

        All four terms live on the columns of :math:`A^T W, E^T W, C^T`.
        """
        state, xp = self.problem.state, self.problem.xp
        AtW, EtW = state.apply_transposed(self.W), self._EtW()
        R = to_host(xp.linalg.qr(xp.concatenate([AtW, EtW, C.T], axis=1), mode="r"))
        r, p = len(P), C.shape[0]
        core = np.zeros((2 * r + p,) * 2)
        core[:r, r : 2 * r] = core[r : 2 * r, :r] = P
        core[r : 2 * r, r : 2 * r] = -P @ self.B @ self.B.T @ P
        core[2 * r :, 2 * r :] = np.eye(p)
        cost = np.linalg.norm(R[:, 2 * r :] @ R[:, 2 * r :].T)
        return float(np.linalg.norm(R @ core @ R.T) / (cost or 1.0))
