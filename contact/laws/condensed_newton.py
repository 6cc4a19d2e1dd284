"""Newton's method on the condensed boundary problem, with a dense compliance or an operator.

The linear system of a step is assembled and solved on the device of W; active sets and residuals
are computed on the host from products with W.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.dense_arrays import HostArrays, arrays_of
from contact.arrays.krylov import gmres
from contact.condensation.boundary_problem import Array, BoundaryProblem, Forces
from contact.condensation.factor_compliance import FactorCompliance
from contact.laws.friction import Friction, Tresca
from contact.laws.iteration import Iteration
from contact.laws.law import ContactLaw, SlipLaw, State, Zones
from contact.laws.newton import LIMITS


@dataclass(frozen=True)
class Condensed:
    """A condensed problem and its friction, for `contact.laws.newton.newton`."""

    problem: BoundaryProblem
    friction: Friction
    weak: float = 1e-9  # spring stiffness of free motions, over the square of max |C|
    anchored: bool = True  # springs act on the change of motions, else on motions

    @property
    def patience(self) -> int:
        """Steps without progress; where adhesion peels, points part one after the other."""
        surface = self.problem.compliance
        return 8 if surface is None or not surface.softens else 60

    @cached_property
    def law(self) -> ContactLaw:
        """The law of all points, in scaled units."""
        p = self.problem
        live = (p.tangent >= 0).T
        return ContactLaw(self.friction, (1.0, 1.0), live, p.bonded, p.swept, p.compliance)

    def state(self, forces: Forces) -> State:
        """Forces and the displacements that they cause."""
        u_n, u_t = self.problem.displacements(forces.mu, forces.t, forces.a)
        return State(forces, forces.mu, forces.t.T, self.problem.penetration(u_n), u_t.T)

    def residual(self, state: State) -> float:
        """Largest violation of the laws and the load balance, over the largest force."""
        p, now = self.problem, state.forces
        balance = p.balanced.T @ p.forces(now.mu, now.t) - p.s
        if p.K is not None:
            balance = balance + p.K @ now.a
        worst = max(self.law.violation(state), float(np.abs(balance).max(initial=0.0)))
        return worst / p.residual_size(now.mu, now.t)

    def rounding(self, state: State) -> float:
        """Rounding error of the residual from cancellation of its terms, over the largest force."""
        p, now = self.problem, state.forces
        l, C, a = np.abs(p.forces(now.mu, now.t)), np.abs(p.C), np.abs(now.a)
        gap = np.where(np.isfinite(p.gap), np.abs(p.gap), 0.0)
        # W is positive definite with a diagonal of about one, which bounds all entries.
        moved = np.abs(p.v0) + l.sum() + C @ a
        balanced = np.abs(p.balanced.T) @ l + np.abs(p.s)
        if p.K is not None:
            balanced = balanced + np.abs(p.K) @ a
        largest = max(float(part.max(initial=0.0)) for part in (moved, balanced, gap))
        return LIMITS.noise * largest / p.residual_size(now.mu, now.t)

    def softened(self, forces: Forces, delta: float) -> Condensed:
        """The problem with springs of compliance delta in all rows, stress-free at `forces`."""
        p = self.problem
        shifted = replace(
            p,
            W=arrays_of(p.W).shifted(p.W, delta),
            v0=p.v0 + delta * p.forces(forces.mu, forces.t),
            swept=None,  # the springs yield
            systems=None,
        )
        return replace(self, problem=shifted)

    def step(
        self,
        state: State,
        zones: Zones,
        form: str,
        size: float = 0.0,
    ) -> Forces:
        """Forces and motions that solve the linearised laws, or `LinAlgError`."""
        problem, now = self.problem, state.forces
        k = problem.s.size
        used = Used.of(problem, zones)
        rows, rubbing, n_n, n = used.rows, used.rubbing, used.count, used.rows.size

        # Displacement rows: W l - C a = v0 - d (contact) and = v0 (stick).
        # A compliance on changes of the forces, and weak springs on changes of free motions, make
        # steps unique if rows are linearly dependent or too few points support the body; both
        # vanish at convergence.
        proximal = 1e-13
        C, added = problem.C[rows], np.full(n, proximal)
        rhs = np.concatenate((problem.v0[rows], np.zeros(k)))
        rhs[:n_n] -= problem.gap[zones.active]
        if problem.compliance is not None:
            added[:n_n] += zones.slope[zones.active]
            rhs[:n_n] -= zones.opening[zones.active]
        rhs[:n] += proximal * problem.forces(now.mu, now.t)[rows]
        # At slipping points the linearised law replaces the equation for u_t.
        laws = used.laws(self.law, zones, state, form)
        for each in laws:
            rhs[each.rows] = each.right(rhs)
        springs = self.springs
        if k:
            rhs[n:] = problem.s + springs * now.a if self.anchored else problem.s
        mu, t = problem.zeros()
        if n + k == 0:
            return Forces(mu, t, np.zeros(0))
        last = np.concatenate((problem.forces(now.mu, now.t)[rows], now.a))
        # Solve for the change: its rounding error is relative to its size.
        linear = self.linear(rows, added, C, laws)
        solution = last + linear.solve(rhs - linear @ last)
        mu[zones.active] = solution[:n_n]
        t[rubbing] = solution[n_n:n]
        return Forces(mu, t, solution[n:])

    @property
    def springs(self) -> Array:
        """Stiffness of weak springs on free motions, (k,); elastic motions have their own."""
        p = self.problem
        springs = np.full(p.s.size, self.weak * float(np.abs(p.C).max(initial=0.0)) ** 2)
        return springs if p.K is None else np.where(np.diag(p.K) > 0, 0.0, springs)

    def linear(
        self, rows: NDArray[np.int64], added: Array, C: Array, laws: Sequence[SlipRows]
    ) -> DenseSystem | ProductSystem:
        """The linear system of the rows (n,) in use and of the load balance."""
        p, n, k = self.problem, rows.size, self.problem.s.size
        balance = np.hstack((p.balanced[rows].T, np.diag(self.springs))) if k else np.zeros((0, n))
        if p.K is not None:
            balance[:, n:] += p.K
        if isinstance(p.W, FactorCompliance):
            return ProductSystem(p.W, rows, added, C, balance, laws)
        kept = p.systems if not k and n <= DenseSystem.KEPT and arrays_of(p.W).xp is np else None
        if kept is None:
            return DenseSystem(p.W, rows, added, C, balance, laws)
        # In a history most steps begin in the zones of the last one.
        parts = [part for each in laws for part in each.matrices]
        key = b"".join(np.ascontiguousarray(part).tobytes() for part in (rows, added, *parts))
        for known, system in kept:
            if known == key:
                return system
        lasting = DenseSystem(p.W, rows, added, C, balance, laws, lasting=True)
        kept[:] = (key, lasting), *kept[:1]
        return lasting


@dataclass(frozen=True)
class Used:
    """The rows in use, of active and of rubbing points, and their places in a system."""

    rows: NDArray[np.int64]  # normals, then tangents, (n,)
    count: int  # number of the normals
    rubbing: NDArray[np.bool_]  # (m, dim - 1)
    place: NDArray[np.int64]  # of each tangent, -1 for others, (m, dim - 1)
    normal_place: NDArray[np.int64]  # of each normal, -1 for others, (m,)

    @classmethod
    def of(cls, problem: BoundaryProblem, zones: Zones) -> Used:
        """The rows of a problem whose points are in these zones."""
        rubbing = (zones.stick | zones.slip)[:, None] & (problem.tangent >= 0)
        rows_n = problem.normal[zones.active]
        rows = np.concatenate((rows_n, problem.tangent[rubbing]))
        place, normal_place = np.full(rubbing.shape, -1), np.full(zones.active.size, -1)
        place[rubbing] = np.arange(rows_n.size, rows.size)
        normal_place[zones.active] = np.arange(rows_n.size)
        return cls(rows, rows_n.size, rubbing, place, normal_place)

    def laws(self, law: ContactLaw, zones: Zones, state: State, form: str) -> list[SlipRows]:
        """The linearised laws of slipping points, and of points whose normal force is given."""
        found = []
        if zones.slip.any():
            at = np.flatnonzero(zones.slip)
            slip = law.slip(zones, state.t, form, at)
            found.append(SlipRows.of(slip, self.place[at], self.normal_place[at]))
        if zones.given is not None and zones.given.any():
            at = np.flatnonzero(zones.given)
            turn, known = zones.pulls(form, state.through)
            found.append(SlipRows.given(turn[at], known[at], self.normal_place[at]))
        return found


def is_stable(laws: Condensed, forces: Forces) -> bool:
    """Whether the energy has a minimum at an equilibrium, friction apart: by the inertia of the
    compliance of contact and adhering points, bordered by the free motions."""
    problem, zones = laws.problem, laws.law.zones(laws.state(forces))
    if zones.given is None or not np.any(zones.given & (zones.turn < 0)):
        return True
    at = np.flatnonzero(zones.active & (~zones.given | (zones.turn < 0)))
    if at.size > 3000 or isinstance(problem.W, FactorCompliance):  # its eigenvalues would cost more
        return True
    pulled = zones.given[at]
    size = np.where(pulled, np.sqrt(-np.where(pulled, zones.turn[at], -1.0)), 1.0)
    rows, arrays = problem.normal[at], arrays_of(problem.W)
    W = np.asarray(arrays.get(arrays.values(problem.W)[np.ix_(rows, rows)]))
    matrix = size[:, None] * W * size - np.diag(pulled.astype(float))
    C = size[:, None] * problem.C[rows]
    K = np.zeros((C.shape[1],) * 2) if problem.K is None else problem.K
    left = np.linalg.eigvalsh(np.block([[matrix, C], [C.T, -K]]))
    return int((left < 0).sum()) == int(pulled.sum()) + len(K)


def outer_step(
    problem: BoundaryProblem,
    step: int,
    phase: str,
    now: Forces,
    g: Array,
    size: float | None = None,
) -> Iteration:
    """`Iteration` of an outer step; `size` is its residual, by default for the bound g."""
    if size is None:
        laws = Condensed(problem, Tresca(g))
        size = laws.residual(laws.state(now))
    g = problem.bound(g)
    rubs = (g > 0) & np.any(problem.tangent >= 0, axis=1)
    # A point sticks if its force is below the bound by more than rounding.
    slip = rubs & (np.linalg.norm(now.t, axis=1) >= g * (1 - 1e-9))
    active = int(((now.mu > 0) | problem.ties).sum())
    return Iteration(step, phase, active, int((rubs & ~slip).sum()), int(slip.sum()), size)


@dataclass(frozen=True)
class SlipRows:
    """The law ``own t - of_v v = normal mu + known`` of p slipping points, as rows of a system; or
    of points whose normal force is given, with t and v in normal direction."""

    at: NDArray[np.int64]  # (p, dim - 1) rows of the tangents, -1 if prescribed
    of_v: Array  # (p, dim - 1, dim - 1)
    known: Array  # (p, dim - 1)
    own: Array  # (p, dim - 1, dim - 1)
    normal: Array  # (p, dim - 1, 1), in the columns `of_normal`
    of_normal: NDArray[np.int64]

    @classmethod
    def of(cls, law: SlipLaw, at: NDArray[np.int64], of_normal: NDArray[np.int64]) -> SlipRows:
        """Make the rows from tangent row numbers and normal force columns (p,)."""
        own, of_v = law.blocks()
        weighted = law.weight * law.a
        normal = (weighted * law.coefficient).T[:, :, None]
        return cls(at, of_v, (weighted * law.bound).T, own, normal, of_normal[:, None])

    @classmethod
    def given(cls, turn: Array, known: Array, at: NDArray[np.int64]) -> SlipRows:
        """The rows ``mu - turn v = known`` of the normal forces (p,)."""
        one, none = np.ones((at.size, 1, 1)), np.full((at.size, 1), -1)
        return cls(at[:, None], turn[:, None, None] * one, known[:, None], one, 0.0 * one, none)

    @property
    def matrices(self) -> tuple[NDArray[Any], ...]:
        """All but the right-hand sides."""
        return self.at, self.of_v, self.own, self.normal, self.of_normal

    @property
    def rows(self) -> NDArray[np.int64]:
        """Row numbers, flattened."""
        return self.at[self.at >= 0]

    def right(self, rhs: Array) -> Array:
        """Right-hand sides of the rows, from those of the displacement equations."""
        v_rhs = np.where(self.at >= 0, rhs[np.where(self.at >= 0, self.at, 0)], 0.0)
        new = np.einsum("pij,pj->pi", self.of_v, v_rhs) + self.known
        return np.asarray(new[self.at >= 0])


def entries(
    rows: NDArray[np.int64], columns: NDArray[np.int64], blocks: Array
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Rows, columns and values of blocks (p, i, j), omitting numbers -1."""
    row, column = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
    kept = (row >= 0) & (column >= 0)
    return row[kept], column[kept], blocks[kept]


def blocks_in(
    n: int, rows: NDArray[np.int64], columns: NDArray[np.int64], blocks: Array
) -> sparse.csr_array:
    """The blocks (p, i, j) as a matrix (n, n)."""
    row, column, value = entries(rows, columns, blocks)
    return sparse.csr_array((value, (row, column)), shape=(n, n))


class DenseSystem:
    """``[[W + D, -C], [balance]]`` with the rows of laws replaced, on the device of W; `lasting`
    for several solutions."""

    KEPT = 1500  # largest order of one whose factors are kept
    _factors: Any = None

    def __init__(
        self,
        W: Any,
        rows: Any,
        added: Array,
        C: Array,
        balance: Array,
        laws: Sequence[SlipRows],
        lasting: bool = False,
    ) -> None:
        self._lasting = lasting
        self._arrays: HostArrays = arrays_of(W)
        put = self._arrays.xp.asarray
        A = self._arrays.bordered(W, rows, added, -C)
        self._definite = not laws and not len(balance)
        for slip in laws:
            at, live = slip.at, slip.at >= 0
            if slip.of_v.any():  # a row of v = v0 - W l + C a is A x - rhs = -v
                v_rows = put(live[:, :, None]) * A[put(np.where(live, at, 0))]
                turned = self._arrays.xp.einsum("pij,pjn->pin", put(slip.of_v), v_rows)
                A[put(at[live])] = turned[put(live)]
            else:
                A[put(at[live])] = 0.0
            for columns, blocks in ((at, slip.own), (slip.of_normal, -slip.normal)):
                row, column, value = entries(at, columns, blocks)
                A[put(row), put(column)] += put(value)
        if len(balance):
            A[rows.size :] = put(balance)
        self._A = A

    def __matmul__(self, x: Array) -> Array:
        return np.asarray(self._arrays.get(self._A @ self._arrays.xp.asarray(x)))

    def solve(self, right: Array) -> Array:
        """Solve; overwrites the matrix unless it is to last."""
        if self._lasting:
            if self._factors is None:
                self._factors = self._arrays.factored(self._A, overwrite=False)
            return np.asarray(self._arrays.solve_factored(self._factors, right))
        return np.asarray(self._arrays.solve_square(self._A, right, self._definite))

    def solve_transposed(self, right: Array) -> Array:
        """Solve with the transposed matrix."""
        return np.asarray(self._arrays.solve_square(self._A.T.copy(order="F"), right.copy()))


class ProductSystem:
    """``[[M (W + D), -M C], [balance]]`` plus terms of laws, as an operator."""

    def __init__(
        self, W: Any, rows: Any, added: Array, C: Array, balance: Array, laws: Sequence[SlipRows]
    ) -> None:
        self._W, self._rows, self._added, self._C, self._balance = W, rows, added, C, balance
        self._of_rows: Any = None
        self._of_forces: Any = None
        n, kept = rows.size, np.ones(rows.size)
        for slip in laws:
            at: Any = slip.at
            before: Any = self._of_rows
            kept[slip.rows] = 0.0
            of_rows = blocks_in(n, at, at, slip.of_v)
            of_forces = blocks_in(n, at, at, slip.own)
            of_forces = of_forces - blocks_in(n, at, slip.of_normal, slip.normal)
            if before is not None:
                of_rows, of_forces = before + of_rows, self._of_forces + of_forces
            self._of_rows, self._of_forces = of_rows, of_forces
        if laws:
            self._of_rows = self._of_rows + sparse.diags_array(kept)

    def __matmul__(self, x: Array) -> Array:
        return self._times(x, self._W.__matmul__)

    def _times(self, x: Array, compliance: Callable[[Array], Array]) -> Array:
        n = self._rows.size
        forces = np.zeros(self._W.shape[0])
        forces[self._rows] = x[:n]
        moved = compliance(forces)[self._rows] + self._added * x[:n] - self._C @ x[n:]
        if self._of_rows is not None:
            moved = self._of_rows @ moved + self._of_forces @ x[:n]
        return np.concatenate((moved, self._balance @ x))

    def solve_transposed(self, right: Array) -> Array:
        """Solve with the transposed operator by a Krylov method, to twelve digits."""
        n = self._rows.size

        def product(y: Array) -> Array:
            of_v = y[:n] if self._of_rows is None else self._of_rows.T @ y[:n]
            forces = np.zeros(self._W.shape[0])
            forces[self._rows] = of_v
            moved = (self._W @ forces)[self._rows] + self._added * of_v
            if self._of_rows is not None:
                moved = moved + self._of_forces.T @ y[:n]
            result = self._balance.T @ y[n:]
            result[:n] += moved
            result[n:] -= self._C.T @ of_v
            return np.asarray(result)

        return np.asarray(gmres(product, right, lambda y: y, 1e-12, most=1000, restart=200)[0])

    def solve(self, right: Array) -> Array:
        """Approximate solution by a Krylov method, with unrefined products."""
        unit = np.ones(right.size)
        n, k = self._rows.size, len(self._balance)
        if k:  # scale motions and balance to forces and displacements
            size = float(np.abs(self._C).max(initial=0.0)) * np.sqrt(n)
            unit[n:] = 1.0 / size if size else 1.0

        def product(y: Array) -> Array:
            return np.asarray(unit * self._times(unit * y, self._W.quickly))

        step, _ = gmres(product, unit * right, lambda y: y, 1e-3, most=400, restart=120)
        return np.asarray(unit * step)
