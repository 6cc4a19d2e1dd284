"""Riccati equations projected onto a basis, and the residual of their solutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg

from gpu.arrays.namespace import to_host
from gpu.errors import RiccatiError
from gpu.riccati.problem.lqr_problem import LQRProblem


@dataclass(frozen=True)
class Projected:
    """The problem on a basis W: :math:`W^T E W, W^T A W, W^T B, W^T Q W`, on the host."""

    problem: LQRProblem
    W: Any  # shape (n, r)
    E: np.ndarray  # shape (r, r), as A and Q
    A: np.ndarray
    B: np.ndarray  # shape (r, m)
    Q: np.ndarray

    @classmethod
    def of(cls, problem: LQRProblem, W: Any, before: Projected | None = None) -> Projected:
        """Project; if `before` is a projection on the first columns of W, only extend it."""
        state = problem.state
        known = 0 if before is None else before.W.shape[1]
        old, new = W[:, :known], W[:, known:]

        def grown(small: Any, right: Any, left: Any = None) -> np.ndarray:
            right = to_host(W.T @ right)
            if small is None:
                return right
            left = right[:known].T if left is None else to_host(left.T @ old)
            return np.block([[small, right[:known]], [left, right[known:]]])

        A, E, Q, B = (None,) * 4 if before is None else (before.A, before.E, before.Q, before.B)
        A = grown(A, state.apply(new), state.apply_transposed(new) if known else None)
        if state.E is None:
            E = np.eye(W.shape[1])
        else:
            E = grown(E, state.mass(new), state.mass_transposed(new) if known else None)
        Q = grown(Q, problem.weight.apply(new))
        fresh = to_host(new.T @ problem.input)
        B = fresh if B is None else np.concatenate([B, fresh])
        return cls(problem, W, E, A, B, (Q + Q.T) / 2)

    def solve(self) -> np.ndarray:
        """P of the projected equation, shape (r, r): the value is ``W P W^T``."""
        # Scale B and Q to equal size; P scales with rho.
        reach, cost = float(np.linalg.norm(self.B)), float(np.linalg.norm(self.Q))
        if cost == 0.0:
            cost = reach = 1.0
        rho = cost**0.5 / reach if reach > 0.0 else 1.0
        unit = np.eye(self.B.shape[1])
        try:
            # SciPy's argument e loses digits if it is not symmetric: solve for E^T P E instead.
            moved = np.linalg.solve(self.E, np.hstack([self.A, self.B * np.sqrt(rho)]))
            A, B = moved[:, : len(self.A)], moved[:, len(self.A) :]
            P = linalg.solve_continuous_are(A, B, self.Q / rho, unit)
            # One Newton step reduces the residual of SciPy's result (by QZ) to rounding.
            half = P @ A - P @ B @ (B.T @ P) / 2
            step = linalg.solve_continuous_lyapunov(
                (A - B @ (B.T @ P)).T, -(half + half.T + self.Q / rho)
            )
            P = P + (step + step.T) / 2
            P = np.linalg.solve(self.E.T, np.linalg.solve(self.E.T, P).T)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise RiccatiError(
                f"the problem on {len(self.A)} basis vectors has no stabilising solution "
                f"({error}); method='doubling' stores all entries and needs no projection"
            ) from error
        return rho * (P + P.T) / 2

    def gain(self, P: np.ndarray) -> Any:
        """The gain ``B^T W P W^T E`` for the inputs of unit cost, shape (m, n)."""
        return self.problem.xp.asarray(self.B.T @ P) @ self._EtW().T

    def change(self, P: np.ndarray, before: np.ndarray) -> float:
        """Relative change of the gain from the P of the first columns of W to this one."""
        new = self.B.T @ P
        moved = new.copy()
        moved[:, : len(before)] -= self.B[: len(before)].T @ before
        norm = np.linalg.norm
        if self.problem.state.E is not None:
            # The columns of E^T W are not orthonormal: measure the products with them.
            xp, EtW = self.problem.xp, self._EtW()
            new, moved = (EtW @ xp.asarray(D.T) for D in (new, moved))
            norm = xp.linalg.norm
        return float(norm(moved)) / (float(norm(new)) or 1.0)

    def _EtW(self) -> Any:
        return self.problem.state.mass_transposed(self.W)

    def residual(self, P: np.ndarray, C: Any) -> float:
        """``|A^T X E + E^T X A - E^T X B B^T X E + C^T C| / |C^T C|`` of ``X = W P W^T``, exactly,
        because the columns of :math:`A^T W, E^T W, C^T` span the range of all terms.
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
