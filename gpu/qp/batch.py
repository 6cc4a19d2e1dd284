"""Many quadratic programs with one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gpu.arguments import flag, shown, unmasked
from gpu.errors import GpuError, InputError
from gpu.qp.data.qp_problem import QPFactor
from gpu.qp.data.qp_result import QPResult
from gpu.qp.solve_qp import solve_qp


def batch_solve_qp(
    P: Any,
    q: Sequence[Any],
    G: Any = None,
    h: Sequence[Any] | None = None,
    A: Any = None,
    b: Sequence[Any] | None = None,
    lb: Any = None,
    ub: Any = None,
    *,
    h_low: Sequence[Any] | None = None,
    tol: float = 1e-9,
    warm_start: bool = True,
    host_below: int = 0,
) -> list[QPResult]:
    """Solve problems that share P, G, A and the bounds, and differ in q, h, b and h_low.

    P is checked and factored once, and each problem begins at the active set of the one before:
    that saves steps where the problems are alike, and does not change the answers.

    Parameters
    ----------
    P, G, A, lb, ub
        Shared by all problems, as in `solve_qp`.
    q : (k, n) array_like
        Linear terms, one a row.
    h, h_low : (k, l) array_like, optional
    b : (k, m) array_like, optional
    tol, host_below
        As in `solve_qp`.
    warm_start : bool, optional
        Whether to begin at the last active set.

    Returns
    -------
    list of QPResult

    Raises
    ------
    GpuError
        As `solve_qp` does; its attribute `index` is the number of the problem.
    InputError
        As for `solve_qp`, or numbers of rows that differ.

    Examples
    --------
    >>> from gpu import batch_solve_qp
    >>> results = batch_solve_qp([[2.0]], [[-1.0], [-4.0]], lb=0.0, ub=1.0)
    >>> [result.x.tolist() for result in results]
    [[0.5], [1.0]]
    """
    factor = P if isinstance(P, QPFactor) else QPFactor(P)
    warm_start = flag("warm_start", warm_start)
    count = _rows("q", q)
    for name, value in {"h": h, "b": b, "h_low": h_low}.items():
        if value is not None and _rows(name, value) != count:
            raise InputError(f"{name} has {len(value)} rows: there are {count} linear terms q")
    results: list[QPResult] = []
    for k in range(count):
        sides = [None if side is None else side[k] for side in (h, b, h_low)]
        try:
            results.append(
                solve_qp(
                    factor, q[k], G, sides[0], A, sides[1], lb, ub,
                    h_low=sides[2], tol=tol, host_below=host_below,
                    start=results[-1] if results and warm_start else None,
                )
            )  # fmt: skip
        except GpuError as error:
            error.index = k  # type: ignore[attr-defined]
            raise
    return results


def _rows(name: str, value: Any) -> int:
    """Number of problems for which an argument holds a vector."""
    unmasked(name, value)
    dense = getattr(value, "ndim", 0) > 0 and not hasattr(value, "tocsr")
    dense = dense and hasattr(value, "__len__")
    if not dense and not (isinstance(value, Sequence) and not isinstance(value, str | bytes)):
        raise InputError(
            f"{name} is {shown(value)}: it must hold one vector for each problem, in a list or in "
            "the rows of a dense array"
        )
    return len(value)
