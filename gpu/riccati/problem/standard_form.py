"""The standard form of a dense problem, and scalings of its states that balance the Hamiltonian."""

from __future__ import annotations

from typing import Any, NamedTuple

from gpu.arrays.namespace import namespace


class DenseProblem(NamedTuple):
    r"""The standard form :math:`A^T X + X A - X B B^T X + Q = 0`, dense."""

    A: Any
    B: Any
    Q: Any


def balance(standard: DenseProblem, sweeps: int = 12) -> Any:
    r"""Powers of two s, shape (n,), that balance the Hamiltonian (James, Langou and Lowery 2014).

    :math:`x = \mathrm{diag}(s) x'` is a symplectic similarity: the blocks become :math:`a_{ij} s_j
    / s_i`, :math:`g_{ij} / (s_i s_j)`, :math:`q_{ij} s_i s_j`, with nearly equal sums of moduli of
    rows and columns. The sums include the diagonal, so that much smaller entries, mostly rounding,
    do not count.
    """
    A, B, Q = standard
    xp = namespace(A)
    inner, G, Q = abs(A), abs(B @ B.T), abs(Q)
    log = xp.zeros(len(A))
    for _ in range(sweeps):
        s = xp.exp2(log)
        rising = (inner.T @ (1.0 / s)) * s + (Q @ s) * s
        falling = (inner @ s) / s + (G @ (1.0 / s)) / s
        known = (rising > 0.0) & (falling > 0.0)
        ratio = xp.where(known, falling, 1.0) / xp.where(known, rising, 1.0)
        log = xp.clip(log + 0.25 * xp.log2(ratio), -300.0, 300.0)
    return xp.exp2(xp.round(log))


def scaled_hamiltonian(standard: DenseProblem, unit: Any) -> tuple[Any, Any, Any]:
    """The blocks A, G, Q of the Hamiltonian balanced with the scale factors `unit`."""
    A, B, Q = standard
    B = B / unit[:, None]
    return A * unit / unit[:, None], B @ B.T, Q * unit * unit[:, None]
