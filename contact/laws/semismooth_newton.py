r"""Semismooth Newton methods for contact with friction, on the condensed boundary problem.

The contact law is imposed by an active set: ``u_n = d`` where ``mu + u_n - d > 0``, and ``mu = 0``
elsewhere, with gap d. On compliant surfaces ``u_n - d = h(mu)``: the step linearises h at the
solution of ``mu + h(mu) = q`` for the last q = mu + u_n - d. For friction with bound g let
q = t + u_t and b = q / |q|:

* g = 0: t = 0;
* stick, |q| <= g: u_t = 0;
* slip, |q| > g: the linearised law, in one of two forms,

  - radial return, the exact Newton step of t = g q / |q|:
    ``t+ = g b + P (t+ + u_t+)`` with ``P = (g / |q|) (I - b b^T)``;
  - damped, equation (4.16) of the dissertation, in its corrected
    form: ``t+ = g / (|q| - g) (I - a b^T) u_t+ + g a`` with ``a = t / max(g, |t|)``.

The damped form converges from far away, radial return is fast near the solution. The default,
"switched", takes the damped form until the residual falls below .1 and radial return from there. It
needs 3 to 9 steps on blocks, curved parts and 3-D bodies for friction .1 to 3, where radial return
alone cycles in a third of the cases.

For Coulomb's law g = F mu+ on active points is an unknown of the same linear system (monolithic).
In two dimensions radial return is an active-set method on the sign of the slip: where it
converges, it ends after finitely many steps.

The linear system of a step is gathered, changed and solved where W lies, on the host or a device;
active sets and residuals are computed on the host from products with W.

References
----------
S. Hueeber, G. Stadler and B. Wohlmuth, A primal-dual active set algorithm for three-dimensional
contact problems with Coulomb friction, SIAM J. Sci. Comput. 30 (2008). The dissertation: S. A.
King, Multi-Moment Methods for PDEs and GPUs for Large-Scale Scientific Computations, North Carolina
State University, 2012.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.dense_arrays import HostArrays, arrays_of
from contact.arrays.krylov import gmres
from contact.condensation.boundary_problem import Array, BoundaryProblem, Forces
from contact.condensation.factor_compliance import FactorCompliance
from contact.laws.friction import Coulomb, Friction
from contact.laws.iteration import Iteration, Report
from contact.laws.progress import NEAR, Progress
from contact.laws.residual import residual
from contact.laws.zones import Zones

# Compliance that acts on the change of the forces; that of each row is one. It makes the step
# unique where rows are linearly dependent, has no effect at convergence, and is too small to cost a
# step.
PROXIMAL = 1e-13
# Stiffness, relative to the square of the largest entry of C, that acts on the change of free
# motions: it makes the step unique while too few points are in contact to hold the body, and has no
# effect at convergence either.
WEAK = 1e-9


def semismooth_newton(
    problem: BoundaryProblem,
    start: Forces,
    friction: Friction,
    *,
    form: str = "switched",
    tol: float = 1e-12,
    max_iterations: int = 50,
    phase: str = "newton",
    report: Report = lambda iteration: None,
) -> Forces:
    """Solve for contact with Coulomb's friction or with a given friction bound.

    Parameters
    ----------
    problem : BoundaryProblem
    start : Forces
    friction : Friction
        The law, in the scale of the problem.
    form : {"switched", "radial", "damped"}
    tol : float
        On the relative residual of `contact.laws.residual.residual`.
    max_iterations : int
    phase : str
        Label in the history.
    report : callable
        Receives each `Iteration`.

    Returns
    -------
    Forces

    Raises
    ------
    NotConverged
        The limit of iterations is reached, or the residual stalls.
    """
    now = start
    size = residual(problem, now.mu, now.t, now.a, friction.bound(now.mu))
    progress = Progress(tol)
    for step in range(1, max_iterations + 1):
        zones = Zones.of(problem, now, friction)
        kind = ("radial" if size < NEAR else "damped") if form == "switched" else form
        now = newton_step(problem, now, zones, friction, kind)
        size = residual(problem, now.mu, now.t, now.a, friction.bound(now.mu))
        report(
            Iteration(
                step,
                phase,
                int(zones.active.sum()),
                int(zones.stick.sum()),
                int(zones.slip.sum()),
                size,
            )
        )
        if progress.ended(problem, now, size):
            break
    return progress.best_of(problem, phase)


def newton_step(
    problem: BoundaryProblem,
    now: Forces,
    zones: Zones,
    friction: Friction,
    form: str,
    weak: float = WEAK,
    anchored: bool = True,
) -> Forces:
    """Solve the linearised laws for new forces and rigid motion.

    Parameters
    ----------
    problem : BoundaryProblem
    now : Forces
    zones : Zones
        Contact, stick and slip at these forces.
    friction : Friction
    form : {"radial", "damped"}
    weak : float
        Stiffness of the springs on free motions, relative to the square of the largest entry of C.
    anchored : bool
        The springs act on the change of the motions, else on the motions.

    Raises
    ------
    LinAlgError
        The system is singular.
    """
    tangent, k, arrays = problem.tangent, problem.s.size, arrays_of(problem.W)
    rubbing = (zones.stick | zones.slip)[:, None] & (tangent >= 0)
    rows_n = problem.normal[zones.active]
    rows_t = tangent[rubbing]
    rows = np.concatenate((rows_n, rows_t))
    n_n, n = rows_n.size, rows.size

    # Displacement rows: W l - C a = v0 - d (contact) and = v0 (stick).
    C, added = problem.C[rows], np.full(n, PROXIMAL)
    rhs = np.concatenate((problem.v0[rows], np.zeros(k)))
    rhs[:n_n] -= problem.gap[zones.active]
    if problem.compliance is not None:
        added[:n_n] += zones.slope[zones.active]
        rhs[:n_n] -= zones.opening[zones.active]
    rhs[:n] += PROXIMAL * problem.forces(now.mu, now.t)[rows]
    # At slipping points the linearised law replaces the equation for u_t.
    place = np.full(tangent.shape, -1)
    place[rubbing] = n_n + np.arange(rows_t.size)
    normal_place = np.full(zones.active.size, -1)
    normal_place[zones.active] = np.arange(n_n)
    law = SlipLaw.of(now, zones, friction, form)
    at, of_normal = place[law.points], normal_place[law.points]
    _impose_bound(rhs, law, at)

    balance = np.zeros((k, n + k))
    if k:
        # The balance of loads.
        springs = np.full(k, weak * float(np.abs(problem.C).max()) ** 2)
        balance[:, :n] = C.T
        if problem.K is not None:
            springs[np.diag(problem.K) > 0] = 0.0  # elastic motions have their own stiffness
            balance[:, n:] = problem.K
        balance[:, n:] += np.diag(springs)
        rhs[n:] = problem.s + springs * now.a if anchored else problem.s
    mu, t = problem.zeros()
    if n + k == 0:
        return Forces(mu, t, np.zeros(0))
    last = np.concatenate((problem.forces(now.mu, now.t)[rows], now.a))
    # Solve for the change: its rounding error is relative to its own size, and the next step
    # corrects it.
    if isinstance(problem.W, FactorCompliance):
        system = ProductSystem(problem.W, rows, added, C, balance)
        if law.points.size:
            system.impose(law, at, of_normal, form == "damped")
        solution = last + system.solve(rhs - system @ last)
    else:
        A = arrays.bordered(problem.W, rows, added, -C)
        _impose_slip(arrays, A, law, at, of_normal, form)
        if k:
            A[n:] = arrays.xp.asarray(balance)
        left = rhs - arrays.get(A @ arrays.xp.asarray(last))
        definite = k == 0 and not zones.slip.any()
        solution = last + arrays.solve_square(A, left, definite)
    mu[zones.active] = solution[:n_n]
    t[rubbing] = solution[n_n:n]
    return Forces(mu, t, solution[n:])


def _impose_bound(rhs: Array, law: SlipLaw, at: NDArray[np.int64]) -> None:
    """Overwrite the right sides of slipping points, which hold their displacement."""
    live = at >= 0
    v_rhs = np.where(live, rhs[np.where(live, at, 0)], 0.0)
    new = np.einsum("pij,pj->pi", law.of_v, v_rhs) + law.bound[:, None] * law.direction
    rhs[at[live]] = new[live]


def _impose_slip(
    arrays: HostArrays,
    A: Any,
    law: SlipLaw,
    at: NDArray[np.int64],
    of_normal: NDArray[np.int64],
    form: str,
) -> None:
    """Overwrite the displacement rows of slipping points by their linearised friction law.

    Each such row contains v = v0 - W l + C a as ``A x - rhs = -v``.

    Parameters
    ----------
    arrays : HostArrays
    A : array, shape (n + k, n + k)
    law : SlipLaw
    at : ndarray of int, shape (p, dim - 1)
        Rows of the points' tangents, -1 for a prescribed one.
    of_normal : ndarray of int, shape (p,)
        Columns of their normal forces.
    form : {"radial", "damped"}
    """
    if law.points.size == 0:
        return
    live, dim_t = at >= 0, at.shape[1]
    safe = np.where(live, at, 0)
    put, every = arrays.xp.asarray, np.arange(law.points.size)
    if dim_t > 1 or form != "radial":
        v_rows = put(live[:, :, None]) * A[put(safe)]  # -v = A x - rhs
        new_rows = arrays.xp.einsum("pij,pjn->pin", put(law.of_v), v_rows)
    else:
        new_rows = arrays.xp.zeros((law.points.size, dim_t, A.shape[1]))
    for i in range(dim_t):
        for j in range(dim_t):
            both = live[:, i] & live[:, j]
            new_rows[put(every[both]), i, put(at[both, j])] += put(law.own[both, i, j])
        bound = law.coefficient != 0
        new_rows[put(every[bound]), i, put(of_normal[bound])] -= put(
            (law.coefficient * law.direction[:, i])[bound]
        )
    A[put(at[live])] = new_rows[put(live)]


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


@dataclass(frozen=True)
class SlipLaw:
    """``own t - of_v v = bound * direction``; the bound is g or, for Coulomb's law, F mu.

    Attributes
    ----------
    points : ndarray of int, shape (p,)
        The slipping points.
    own, of_v : ndarray, shape (p, dim - 1, dim - 1)
    direction : ndarray, shape (p, dim - 1)
    bound : ndarray, shape (p,)
        g where it is known, else zero.
    coefficient : ndarray, shape (p,)
        F of Coulomb's law, else zero.
    ratio : ndarray, shape (p,)
        g / |q|, which is one where slip begins.
    """

    points: NDArray[np.int64]
    own: Array
    of_v: Array
    direction: Array
    bound: Array
    coefficient: Array
    ratio: Array

    @classmethod
    def of(cls, now: Forces, zones: Zones, friction: Friction, form: str) -> SlipLaw:
        """The law at forces, see `contact.laws.semismooth_newton`.

        Parameters
        ----------
        now : Forces
        zones : Zones
        friction : Friction
        form : {"radial", "damped"}
        """
        points = np.flatnonzero(zones.slip)
        q, g = zones.q[points], zones.g[points]
        length = np.linalg.norm(q, axis=1)
        b, identity = q / length[:, None], np.eye(q.shape[1])
        if form == "radial":
            P = (g / length)[:, None, None] * (identity - b[:, :, None] * b[:, None, :])
            own, of_v, direction = identity - P, P, b
        else:
            a = now.t[points] / np.maximum(g, np.linalg.norm(now.t[points], axis=1))[:, None]
            own = np.broadcast_to(identity, (points.size, *identity.shape))
            of_v = (g / (length - g))[:, None, None] * (identity - a[:, :, None] * b[:, None, :])
            direction = a
        of_v = zones.c[points, None, None] * of_v
        zero = np.zeros(points.size)
        if isinstance(friction, Coulomb):
            bound, coefficient = zero, friction.coefficient[points]
        else:
            bound, coefficient = g, zero
        return cls(points, own, of_v, direction, bound, coefficient, g / length)
