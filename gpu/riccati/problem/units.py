r"""Units of time, state, input and cost in which the numbers of a dense problem are moderate.

With :math:`A = a A'`, :math:`E = e E'`, :math:`B = b B'`, :math:`Q = q Q'` and

.. math:: R = q b^2 a^{-2} R', \qquad N = q b a^{-1} N'

the equation of :math:`S = q (ae)^{-1} S'` is the same; gains are :math:`K = a b^{-1} K'` and poles
:math:`\lambda = a e^{-1} \lambda'`. All factors are powers of two, so that nothing is rounded.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ParamSpec, TypeVar

import numpy as np

from gpu.errors import GpuError, NotConverged
from gpu.riccati.problem.lqr_problem import LQRProblem, inverse_of
from gpu.riccati.problem.state_matrix import StateMatrix
from gpu.riccati.problem.weights import Weight
from skfem_adini.ground.arrays import namespace

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

# Largest exponent of two of a moderate number, whose square is far from overflow and underflow.
MODERATE = 150


@dataclass(frozen=True)
class Units:
    """Exponents of two: of A, E, B and Q, the last one even."""

    a: int
    e: int
    b: int
    q: int

    @property
    def gain(self) -> int:
        """Exponent of the unit of K."""
        return self.a - self.b

    @property
    def value(self) -> int:
        """Exponent of the unit of S."""
        return self.q - self.a - self.e

    @property
    def rate(self) -> int:
        """Exponent of the unit of poles."""
        return self.a - self.e


def in_moderate_units(problem: LQRProblem) -> LQRProblem:
    """The problem in units where no square overflows; unchanged if none does or it is not dense."""
    if problem.units is not None or not problem.dense or hasattr(problem.weight.Q, "matvec"):
        return problem
    state, B, R = problem.state, problem.B, problem.R
    C = problem.weight.C
    Q = problem.weight.Q if C is None else C
    sizes = [_exponent(M) for M in (state.A, state.E, B, Q, R, problem.N)]
    if all(size is None or abs(size) <= MODERATE for size in sizes):
        return problem
    units = _units(problem, *sizes[:5])
    cost = units.q + 2 * units.b - 2 * units.a
    E = None if state.E is None else power_of_two(state.E, -units.e)
    state = StateMatrix(power_of_two(state.A, -units.a), E)
    if C is None:
        weight = Weight(state, power_of_two(Q, -units.q))
    else:
        weight = Weight(state, C=power_of_two(C, -units.q // 2))
    root, R = power_of_two(problem.root, -cost // 2), power_of_two(R, -cost)
    B = power_of_two(B, -units.b)
    N = problem.N
    return replace(
        problem,
        state=state,
        B=B,
        input=_of_unit_cost(B, root),
        root=root,
        weight=weight,
        N=None if N is None else power_of_two(N, units.a - units.b - units.q),
        R=R,
        units=units,
    )


def _units(
    problem: LQRProblem, A: int | None, E: int | None, B: int | None, Q: int | None, R: int | None
) -> Units:
    """Units in which the larger of A and of the root of ``B R^-1 B^T Q`` has size one."""
    e, b, r = E or 0, B or 0, 2 * ((R or 0) // 2)
    unit_cost = _of_unit_cost(power_of_two(problem.B, -b), power_of_two(problem.root, -r // 2))
    reach = _exponent(unit_cost)
    effect = None if reach is None else 2 * (b + reach - e) - r
    if Q is not None and problem.weight.C is not None:
        Q = 2 * Q
    sizes = [] if A is None else [A - e]
    if effect is not None and Q is not None:
        sizes.append((effect + Q) // 2)
    rate = max(sizes, default=0)
    if effect is None:
        q = Q or 0
    elif Q is None:
        q = 2 * rate - effect
    else:
        # Make both terms equal in size, but the quadratic one not too small.
        q = max(rate + (Q - effect) // 2, 2 * rate - effect - 2 * MODERATE)
    return Units(rate + e, e, b, 2 * (q // 2))


def power_of_two(M: Any, exponent: int) -> Any:
    """``2^exponent M``, real or complex, dense or sparse; the factor alone may be out of range."""
    if hasattr(M, "tocsr"):
        M = M.copy()
        M.data = power_of_two(M.data, exponent)
        return M
    if not hasattr(M, "view"):
        return float(np.ldexp(M, exponent))
    xp = namespace(M)
    return xp.ldexp(xp.ascontiguousarray(M).view(float), exponent).view(M.dtype)


def _of_unit_cost(B: Any, root: np.ndarray) -> Any:
    return B @ namespace(B).asarray(inverse_of(root).T)


def _exponent(M: Any) -> int | None:
    """The exponent of two of the largest entry; None where all are zero, or there is none."""
    size = 0.0 if M is None else float(abs(M).max())
    return int(np.frexp(size)[1]) if 0.0 < size < np.inf else None


def within_range(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorator: suppresses warnings of overflow, which the certificates detect; where LAPACK's
    wrappers reject overflowed numbers first, `NotConverged` is raised.
    """

    @functools.wraps(function)
    def judged(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            with np.errstate(all="ignore"):
                return function(*args, **kwargs)
        except ValueError as error:
            if isinstance(error, GpuError) or "infs or NaNs" not in str(error):
                raise
            raise NotConverged(
                "numbers beyond the range of double precision came up: measure states, inputs or "
                "costs in other units"
            ) from None

    return judged
