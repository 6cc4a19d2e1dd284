"""Which mode stands in the way of a stabilising Riccati solution."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from gpu.arrays.namespace import to_host
from gpu.errors import InputError, RiccatiError
from gpu.riccati.problem.lqr_problem import LQRProblem, solve
from gpu.riccati.problem.standard_form import DenseProblem, balance
from gpu.riccati.problem.state_matrix import EPS

EXAMINED = 1500  # up to this order modes are examined
WORST = 24  # how many modes, beginning with the least stable
# Smallest singular value in Hautus' test, relative to the matrix, that counts as zero.
SINGULAR = 1e-12
# An eigenvalue may lie on the imaginary axis if it is this near, relative to the matrix, and if so
# many roundings of the matrix may move it there.
AXIS, MODE_ROUNDINGS = 1e-6, 10.0


def explain(problem: LQRProblem) -> RiccatiError | None:
    """The error of `named`, or that of an eigenvalue on the imaginary axis; None without one."""
    found = named(problem)
    standard = _standard(problem)
    if found is not None or standard is None:
        return found
    whole = to_host(balance(standard))
    A, B, Q = (to_host(M) for M in standard)
    A, B, Q = A * whole / whole[:, None], B / whole[:, None], Q * whole * whole[:, None]
    H = np.block([[A, -B @ B.T], [-Q, -A.T]])
    values = np.linalg.eigvals(H)
    nearest = values[np.argmin(np.abs(values.real))]
    if abs(nearest.real) <= max(AXIS * abs(nearest), 1e3 * EPS * float(np.linalg.norm(H))):
        nearest = problem.rate(nearest)
        value = complex(0.0, abs(nearest.imag))
        return RiccatiError(
            f"the Hamiltonian has the eigenvalue {_shown(value)} on the imaginary axis (to "
            f"{abs(nearest.real):.1e}): there is no stabilising solution, or none that double "
            "precision can tell",
            eigenvalue=value,
        )
    return None


def named(problem: LQRProblem) -> RiccatiError | None:
    r"""The error that names an uncontrollable or unobservable mode, or None (Hautus 1969).

    A mode with :math:`\mathrm{Re}\,\lambda \ge 0` is not stabilisable if :math:`(A - \lambda E, B)`
    loses rank, one on the imaginary axis not detectable if :math:`(A - \lambda E; Q)` does.
    """
    standard = _standard(problem)
    if standard is None:
        return None
    A, B, Q = (to_host(M) for M in standard)
    return _not_stabilisable(problem.entries(), B) or _not_detectable(problem, A, Q)


def _standard(problem: LQRProblem) -> DenseProblem | None:
    if problem.n > EXAMINED:
        return None
    try:
        return problem.entries().standard()
    except (InputError, np.linalg.LinAlgError):
        return None


def _not_stabilisable(problem: LQRProblem, B: np.ndarray) -> RiccatiError | None:
    # No feedback changes this, so N is left out: taking it out could drown A in round-off.
    A, E, _, _ = problem.full()
    A = to_host(A if E is None else solve(E, A))
    A, own = _balanced(A)
    B = B / own[:, None]
    for value, size, _ in _unstable(A):
        if _loses_rank(A - value * np.eye(len(A)), B, size):
            value = problem.rate(value)
            return RiccatiError(
                f"the mode {_shown(value)} of A is not stabilisable: no input moves it; give it "
                "an input, or take it out of the model",
                eigenvalue=complex(value),
                cause="not stabilisable",
            )
    return None


def _not_detectable(problem: LQRProblem, A: np.ndarray, Q: np.ndarray) -> RiccatiError | None:
    A, own = _balanced(A)
    Q = Q * own * own[:, None]
    for value, size, doubt in _unstable(A):
        if abs(value.real) > min(AXIS * max(abs(value), 0.1 * size), doubt):
            continue
        if _loses_rank((A - value * np.eye(len(A))).T, Q, size):
            value = problem.rate(value)
            return RiccatiError(
                f"the mode {_shown(value)} of A lies on the imaginary axis and is not detectable: "
                "Q does not see it, so no optimal feedback moves it; give it a weight",
                eigenvalue=complex(value),
                cause="not detectable",
            )
    return None


def _balanced(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A in units that balance A alone; those that balance Q and B B^T could hide a mode."""
    own = np.diag(linalg.matrix_balance(A, permute=False)[1])
    return A * own / own[:, None], own


def _unstable(A: np.ndarray) -> list[tuple[complex, float, float]]:
    """The eigenvalues not clearly left of the axis, rightmost first, the size of A, and how far
    rounding of A may move each eigenvalue: its condition is 1 / cos of the angle between its left
    and right vectors (Wilkinson 1965)."""
    size = max(float(np.linalg.norm(A)), np.finfo(float).tiny)
    values = np.linalg.eigvals(A)
    if not np.any(values.real >= -AXIS * size):
        return []
    values, left, right = linalg.eig(A, left=True)
    cosines = np.abs((left.conj() * right).sum(axis=0))
    doubts = MODE_ROUNDINGS * EPS * size / np.maximum(cosines, np.finfo(float).tiny)
    order = np.argsort(-values.real, kind="stable")
    order = order[(values.imag >= 0.0)[order]]
    order = order[(values.real >= -np.minimum(AXIS * size, doubts))[order]][:WORST]
    return [(complex(values[i]), size, float(doubts[i])) for i in order]


def _loses_rank(M: np.ndarray, extra: np.ndarray, size: float) -> bool:
    norm = float(np.linalg.norm(extra))
    scaled = extra * (size / norm) if norm > 0.0 else extra
    smallest = np.linalg.svd(np.hstack([M, scaled]), compute_uv=False)[-1]
    return bool(smallest <= SINGULAR * size)


def _shown(value: complex) -> str:
    if value.imag == 0.0:
        return f"{value.real:.6g}"
    return f"{value.real:.6g} +- {abs(value.imag):.6g}i"
