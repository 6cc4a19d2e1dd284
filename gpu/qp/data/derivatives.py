r"""Derivatives of solutions of quadratic programs by their data.

With the held bounds E and the active rows C of a solution, the optimality conditions are equations,
which the implicit function theorem differentiates ([1]_). For cotangents :math:`\bar x, \bar y,
\bar z` one solves

.. math:: Pu + C^Tv + E^Tw = \bar x, \quad Cu = \bar y, \quad Eu = \bar z:

the gradients by q, the sides of rows, the sides of bounds, P and C are :math:`-u`, v, w,
:math:`-(ux^T + xu^T)/2` and :math:`-(yu^T + vx^T)`.

References
----------
.. [1] B. Amos, J. Z. Kolter, "OptNet: differentiable optimization as a layer in neural networks",
   ICML 2017, PMLR 70, 136-145.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from gpu.arrays.sparse_factor import SuperLUFactor
from gpu.errors import InputError, NotConverged
from gpu.qp.data.qp_problem import real_array
from gpu.qp.data.standard_qp import is_sparse
from skfem_adini.ground.arrays import namespace, to_host


class _Limits(NamedTuple):  # what counts as rounding
    changed: float = 1e-6  # residual of a solution in its problem: its arrays were changed
    weak: float = 1e-12  # of the largest forces and lengths: nothing tells held from free
    solved: float = 1e-9  # residual of the linear system over its terms


LIMITS = _Limits()


class Gradients(NamedTuple):
    """Gradients by the arguments of `solve_qp`.

    Parameters
    ----------
    P, q, G, h, h_low, A, b, lb, ub : array or sparse array
        The gradients; that by P is symmetric, those by sides and bounds are vectors. None by rows
        that the problem does not have.
    degenerate : bool
        Whether rows or bounds are touched without force, or active rows depend on each other: the
        solution has one-sided derivatives only, and these are those of one side.

    References
    ----------
    B. Amos, J. Z. Kolter, "OptNet: differentiable optimization as a layer in neural networks",
    ICML 2017, PMLR 70, 136-145.

    Examples
    --------
    The first of two variables is held at its bound, with which it moves:

    >>> import numpy as np
    >>> from gpu import solve_qp
    >>> gradients = solve_qp(np.eye(2), [1.0, -1.0], lb=0.0).vjp([1.0, 1.0])
    >>> gradients.lb.tolist(), gradients.q.tolist(), gradients.degenerate
    ([1.0, 0.0], [-0.0, -1.0], False)
    """

    P: Any
    q: Any
    G: Any
    h: Any
    h_low: Any
    A: Any
    b: Any
    lb: Any
    ub: Any
    degenerate: Any


def gradients(
    data: tuple[Any, ...], x: Any, y: Any, z_box: Any, cotangents: tuple[Any, ...]
) -> Gradients:
    """Gradients of one problem or of a batch (all with one more dimension in front, of length 1
    where shared). `data` are P, C, q, low, high and the number of equality rows at the beginning
    of C; `cotangents` those of x, z, y and z_box."""
    P, C, _, low, high, equal = data
    xp, m = namespace(x), C.shape[-2]
    gx, gy, gbox = _cotangents(xp, x, m, equal, cotangents)
    side_low, side_high = low[..., :m], high[..., :m]
    act = (y != 0.0) | (side_low == side_high)
    held = (z_box != 0.0) | (low[..., m:] == high[..., m:])
    weak = _weak(data, x, y, z_box, act, held)
    solver = _sparse if is_sparse(P) else _dense
    u, v, singular = solver(P, C, act, held, gx, gy, gbox)
    rest = gx - (_times(P, u) + _times(C, v, transposed=True))
    w = xp.where(held, rest, 0.0)
    v = xp.where(act, v, 0.0)
    upper = (y > 0.0) | (act & (y == 0.0))
    upper_box = (z_box > 0.0) | (held & (z_box == 0.0))
    h, h_low = xp.where(upper, v, 0.0)[..., equal:], xp.where(upper, 0.0, v)[..., equal:]
    lb, ub = xp.where(upper_box, 0.0, w), xp.where(upper_box, w, 0.0)
    dP, dC = _outer(P, -u / 2.0, x, x, -u / 2.0), _outer(C, -y, u, -v, x)
    flag: Any = weak | singular
    rows = m > equal
    return Gradients(
        dP, -u, dC[..., equal:, :] if rows else None, h if rows else None, h_low if rows else None,
        dC[..., :equal, :] if equal else None, v[..., :equal] if equal else None, lb, ub,
        flag if x.ndim > 1 else bool(flag),
    )  # fmt: skip


def _cotangents(xp: Any, x: Any, m: int, equal: int, given: tuple[Any, ...]) -> tuple[Any, ...]:
    """Checked cotangents of x, of all rows and of the bounds."""
    dx, dz, dy, dz_box = given
    n, front = x.shape[-1], x.shape[:-1]
    found = []
    for name, value, size in (
        ("dx", dx, n), ("dy", dy, equal), ("dz", dz, m - equal), ("dz_box", dz_box, n)
    ):  # fmt: skip
        array = xp.zeros((*front, size)) if value is None else xp.asarray(real_array(name, value))
        if array.shape != (*front, size) or not bool(xp.isfinite(array).all()):
            raise InputError(
                f"{name} has shape {array.shape}: it must be {(*front, size)}, of finite numbers"
            )
        found.append(array)
    return found[0], xp.concatenate(found[1:3], axis=-1), found[3]


def _weak(data: Any, x: Any, y: Any, z_box: Any, act: Any, held: Any) -> Any:
    """Whether something is touched with no force, in units where P has a diagonal of ones;
    `InputError` where x solves another problem."""
    P, C, q, low, high, _ = data
    xp, m, D = namespace(x), C.shape[-2], _scale(P, x)
    parts = _times(P, x), q + 0.0 * x, _times(C, y, transposed=True), z_box
    terms = _times(abs(P), abs(x)) + abs(q) + _times(abs(C), abs(y), transposed=True) + abs(z_box)
    size = (D * terms).max(axis=-1)
    if bool(((D * abs(sum(parts))).max(axis=-1) > LIMITS.changed * size).any()):
        raise InputError(
            "the arrays of this problem were changed since it was solved: its derivatives are "
            "those of another problem, solve it again"
        )
    weak, length = xp.zeros(x.shape[:-1], dtype=bool), (abs(x) / D).max(axis=-1)[..., None]
    for value, side, multiplier, holds, unit in (
        (_times(C, x), slice(None, m), y, act, _norms(C, D)), (x, slice(m, None), z_box, held, D)
    ):  # fmt: skip
        room = xp.minimum(abs(value - low[..., side]), abs(high[..., side] - value))
        equal = low[..., side] == high[..., side]
        idle = ~holds & (room <= LIMITS.weak * unit * length)
        idle |= holds & ~equal & (abs(multiplier) * unit <= LIMITS.weak * size[..., None])
        weak = weak | idle.any(axis=-1)
    return weak


def _scale(P: Any, x: Any) -> Any:
    """diag(P)^-1/2, one without curvature."""
    xp = namespace(x)
    diagonal = P.diagonal() if is_sparse(P) else xp.diagonal(P, axis1=-2, axis2=-1)
    return 1.0 / xp.sqrt(xp.where(diagonal > 0.0, diagonal, 1.0)) + 0.0 * x


def _norms(C: Any, D: Any) -> Any:
    """Norms of the rows of CD."""
    if is_sparse(C):
        return np.sqrt(np.asarray((C @ sparse.diags_array(D)).power(2).sum(axis=1)).ravel())
    return namespace(D).sqrt(((C * D[..., None, :]) ** 2).sum(axis=-1))


def _times(M: Any, x: Any, transposed: bool = False) -> Any:
    """M x, or M'x, of one matrix or of many."""
    if is_sparse(M):
        return (M.T if transposed else M) @ x
    if transposed:
        M = namespace(x).swapaxes(M, -1, -2)
    return (M @ x[..., None])[..., 0]


def _outer(M: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """ab' + cd', on the entries of a sparse M, summed over problems that share M."""
    if is_sparse(M):
        part = sparse.coo_array(M)
        i, j = part.coords
        return sparse.csr_array((a[i] * b[j] + c[i] * d[j], (i, j)), shape=M.shape)
    if a.ndim > 1 and len(M) == 1 and len(a) > 1:
        return (a.T @ b + c.T @ d)[None]
    return a[..., None] * b[..., None, :] + c[..., None] * d[..., None, :]


def _dense(
    P: Any, C: Any, act: Any, held: Any, gx: Any, gy: Any, gbox: Any
) -> tuple[Any, Any, Any]:
    """u, v and whether rows depend on each other, from one matrix a problem."""
    xp, n, m = namespace(gx), gx.shape[-1], gy.shape[-1]
    front = gx.shape[:-1]
    K = xp.zeros((*front, n + m, n + m))
    K[..., :n, :n], K[..., n:, :n], K[..., :n, n:] = P, C, xp.swapaxes(C, -1, -2)
    D = _scale(P, gx)
    norms = _norms(C, D)
    S = xp.concatenate([D, 1.0 / xp.where(norms > 0.0, norms, 1.0)], axis=-1)
    K *= S[..., :, None] * S[..., None, :]
    free = xp.concatenate([~held, act], axis=-1)
    K *= free[..., None]  # other rows say what the unknown is
    at = xp.arange(n + m)
    K[..., at, at] = xp.where(free, K[..., at, at], 1.0)
    right = S * xp.concatenate([gx, xp.where(act, gy, 0.0)], axis=-1)
    known = xp.concatenate([gbox / D, xp.zeros_like(gy)], axis=-1)
    right = xp.where(free, right, known)
    t, singular = _solve(xp, K, right)
    t = t * S
    return t[..., :n], t[..., n:], singular


def _solve(xp: Any, K: Any, right: Any) -> tuple[Any, Any]:
    """Solve systems; the least solution of those that are singular and have one."""
    try:
        t = xp.linalg.solve(K, right[..., None])[..., 0]
    except np.linalg.LinAlgError:
        if right.ndim > 1:  # NumPy does not say which
            parts = [_solve(xp, *one) for one in zip(K, right, strict=True)]
            return tuple(
                xp.stack([xp.asarray(part) for part in both]) for both in zip(*parts, strict=True)
            )
        t = xp.full_like(right, np.nan)

    def bad(t: Any) -> Any:
        terms = _times(abs(K), abs(t)) + abs(right)
        size = xp.maximum(terms.max(axis=-1), np.finfo(float).tiny)
        error = abs(_times(K, t) - right).max(axis=-1)
        grown = abs(t).max(axis=-1) > abs(right).max(axis=-1) / LIMITS.solved**1.5
        return ~(error <= LIMITS.solved * size) | grown

    singular = bad(t)
    if not bool(singular.any()):
        return t, singular
    if right.ndim == 1:
        t = xp.linalg.lstsq(K, right, rcond=LIMITS.solved**1.5)[0]
    for i in to_host(xp.flatnonzero(singular)) if right.ndim > 1 else ():
        t[i] = xp.linalg.lstsq(K[i], right[i], rcond=LIMITS.solved**1.5)[0]
    if bool(bad(t).any()):
        raise NotConverged(
            "the solution, or a multiplier with a cotangent, is not unique: it has no derivative"
        )
    return t, singular


def _sparse(
    P: Any, C: Any, act: Any, held: Any, gx: Any, gy: Any, gbox: Any
) -> tuple[Any, Any, Any]:
    """The same for one sparse problem: held variables and rows that are not active are left out."""
    free, rows = np.flatnonzero(~held), np.flatnonzero(act)
    known = np.where(held, gbox, 0.0)
    C_act = sparse.csr_array(C)[rows]
    top, side = sparse.csr_array(P)[free][:, free], sparse.csc_array(C_act)[:, free]
    nothing = sparse.csr_array((rows.size, rows.size))
    blocks: Any = [[top, side.T], [side, nothing]]
    K = sparse.csc_array(sparse.block_array(blocks, format="csc"))
    right = np.concatenate([(gx - P @ known)[free], gy[rows] - C_act @ known])
    try:
        factors = SuperLUFactor(K, threshold=1.0)
        factors.factor(K.diagonal())
        t = factors.solve(right)
        if not abs(K @ t - right).max(initial=0.0) <= LIMITS.solved * abs(right).max(initial=1.0):
            raise RuntimeError("singular")
    except (RuntimeError, np.linalg.LinAlgError):
        raise NotConverged(
            "the active rows depend on each other, or the solution is not unique: multipliers have "
            "no derivative"
        ) from None
    u, v = known.copy(), np.zeros(act.size)
    u[free], v[rows] = t[: free.size], t[free.size :]
    return u, v, np.zeros((), dtype=bool)
