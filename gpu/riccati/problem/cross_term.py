"""Elimination of the cross term N of a linear-quadratic problem by low-rank updates of A and Q.

A sparse A stays sparse.
"""

from __future__ import annotations

import functools
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import linalg

from gpu.errors import InputError, NotSupported
from gpu.riccati.problem.lqr_problem import NOT_SEMIDEFINITE, LQRProblem, semidefinite
from gpu.riccati.problem.state_matrix import (
    Factors,
    StateMatrix,
    as_sparse,
    factor,
    factor_bordered,
    linear_operator,
    woodbury,
)
from gpu.riccati.problem.weights import Weight, low_rank_factor
from skfem_adini.ground.arrays import to_host


class UpdatedMatrix(StateMatrix):
    """``A - U V^T`` with a sparse A; solves use factors of A bordered by U and V."""

    def __init__(self, A: Any, E: Any, U: Any, V: Any) -> None:
        super().__init__(A, E)
        self.U, self.V = U, V

    def apply(self, x: Any) -> Any:
        """``A x - U V^T x``."""
        return super().apply(x) - self.U @ (self.V.T @ x)

    def apply_transposed(self, x: Any) -> Any:
        """Its transpose."""
        return super().apply_transposed(x) - self.V @ (self.U.T @ x)

    def size(self) -> float:
        """An upper bound of the largest modulus of an entry."""
        rows = (self.xp.linalg.norm(M, axis=1).max() for M in (self.U, self.V))
        return super().size() + float(np.prod([float(row) for row in rows]))

    def is_symmetric(self) -> bool:
        """False, as it is not checked."""
        return False

    def factor(self, shift: complex = 0.0, explicit: bool | None = None) -> Factors | None:
        """Factor ``A - U V^T - shift E``."""
        return factor_bordered(self.shifted(shift), self.U, self.V)

    def factor_updated(self, U: Any, V: Any) -> Factors | None:
        """Solves with this matrix minus ``U V^T``."""
        join = self.xp.concatenate
        return factor_bordered(self.A, join([self.U, U], axis=1), join([self.V, V], axis=1))


def without_cross_term(problem: LQRProblem) -> LQRProblem:
    """The problem in the inputs :math:`v = L^T u + F^T x` of unit cost, where it has no N. With
    :math:`R = L L^T`, :math:`F = N L^{-T}`, it has :math:`A - B L^{-T} F^T` for A, :math:`Q - F
    F^T` for Q, the same solution, and a gain that `LQRProblem.gain` converts."""
    state, B = problem.state, problem.input
    F = problem.N @ problem.xp.asarray(np.linalg.inv(problem.root).T)
    unit = np.eye(B.shape[1])
    return replace(
        problem, state=_state(state, B, F), B=B, root=unit, R=unit, N=None,
        weight=_weight(problem, F),
    )  # fmt: skip


def _state(state: StateMatrix, B: Any, F: Any) -> StateMatrix:
    if state.kind == "dense":
        moved = copy(state)
        moved.A = state.A - B @ F.T
        return moved
    if state.kind != "operator":
        A, E = (as_sparse(M, state.xp) for M in (state.A, state.E))
        return UpdatedMatrix(A, E, B, F)
    factors = state.factor()
    assert factors is not None
    inverse = woodbury(factors, B, F)
    if inverse is None:
        raise NotSupported("N: A - B R^-1 N^T of an operator A is singular; shift the model")
    operator = functools.partial(linear_operator, state.xp, state.n)
    product = operator(
        lambda x: state.apply(x) - B @ (F.T @ x),
        lambda x: state.apply_transposed(x) - F @ (B.T @ x),
    )
    return StateMatrix(product, state.E, operator(inverse.solve, inverse.solve_transposed))


def _weight(problem: LQRProblem, F: Any) -> Weight:
    """The new weight, by a factor if Q has low rank."""
    C = low_rank_factor(problem.weight)
    if C is None:
        _check(problem, F)
        return problem.weight.less(F)
    # A semidefinite joint weight has N in the range of Q: F = C^T Y with |Y| <= 1, up to rounding.
    Y = problem.xp.linalg.lstsq(C.T, F, rcond=None)[0]
    if float(abs(C.T @ Y - F).max()) > 1e-9 * float(abs(F).max()):
        raise InputError(NOT_SEMIDEFINITE)
    values, vectors = np.linalg.eigh(to_host(Y @ Y.T))
    if values[-1] > 1.0 + 1e-11:
        raise InputError(NOT_SEMIDEFINITE)
    root = vectors * np.sqrt(np.maximum(1.0 - values, 0.0)) @ vectors.T
    return Weight(problem.state, C=problem.xp.asarray(root) @ C)


def _check(problem: LQRProblem, F: Any) -> None:
    """Raise `InputError` unless the joint weight of states and inputs is semidefinite: the whole
    weight of a dense problem, otherwise ``F^T Q^-1 F <= I`` if Q can be factored.
    """
    if problem.dense:
        good = semidefinite(problem)
    else:
        Q = problem.weight.entries
        factors = None if Q is None else factor(Q)
        if factors is None:
            return
        good = linalg.eigvalsh(to_host(F.T @ factors.solve(F)))[-1] <= 1.0 + 1e-9
    if not good:
        raise InputError(NOT_SEMIDEFINITE)
