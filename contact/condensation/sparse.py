"""Condensation of the body onto its contact boundary by one sparse factorisation."""

from __future__ import annotations

from contextlib import AbstractContextManager
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.dense_arrays import HostArrays
from contact.body.free_motions import free_motions, not_held, unseen_motion
from contact.body.rigid_modes import describe_motion
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.condensation.elimination_order import elimination_order
from contact.condensation.held_factor import held_factor
from contact.condensation.point_rows import PointRows
from contact.condensation.schur import SchurFactor, schur_factor
from contact.condensation.strain_factor import factor_of_strains, strains_can_be_factored
from contact.errors import Infeasible, InputError
from contact.obstacles.rigid import ObstacleMotion
from contact.rows.contact_rows import ContactRows

Array = NDArray[np.float64]

# Added to the compliance for the functional ``thesis``, whose rows are linearly dependent, relative
# to its largest entry: selects the multipliers of least norm. They remain unstable; the functional
# serves to reproduce the dissertation.
REGULARISATION = 1e-10


class CondensedContact:
    """A body and its contact rows, reduced to a dense problem on the contact boundary.

    Everything here depends on the stiffness, the supports and the rows alone; loads, gaps and
    friction come later, so one condensation serves a whole load history.

    `ContactProblem.condense` creates and caches it.

    Parameters
    ----------
    body : ElasticBody
    rows : ContactRows
    solver : {"auto", "pardiso", "superlu"}
        Sparse factorisation; see `contact.condensation.schur`.

    Attributes
    ----------
    points : PointRows
        Which rows of B belong to which contact point.
    B : csr_array, shape (n, nb)
        Live contact rows in the contact boundary's unknowns.
    N : ndarray, shape (nb, k)
        Rigid motions of the boundary that no support resists.
    slender, thin : bool
        Cells, or the body, are so thin that digits are lost.

    Raises
    ------
    InputError
        The contact boundary is fixed entirely.
    Unbounded
        A piece of the body is neither fixed nor connected to the contact boundary.

    Notes
    -----
    With the contact boundary's unknowns z_b (those that a row touches) and their Schur complement
    S_b, the compliance of the rows B is ``W = B S_b^-1 B^T``. A body held by contact alone has
    rigid motions N with S_b N = 0: then S_b + rho N N^T takes the place of S_b, and the motion N a
    is an unknown of its own, with the balance of loads ``N^T (r - B^T l) = 0``.

    References
    ----------
    R. J. Guyan, Reduction of stiffness and mass matrices, AIAA Journal 3 (1965), 380.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    >>> condensed = problem.condense()
    >>> problem.friction = 0.5  # the same factorisation serves
    >>> problem.condense() is condensed
    True
    """

    _arrays = HostArrays()
    _factor: SchurFactor
    slender: bool = False

    def __init__(self, body: Any, rows: ContactRows, solver: str = "auto") -> None:
        self.rows, self.slender = rows, body.slender
        P, _ = body.constraint
        if P.nnz == P.shape[1] and np.all(P.data == 1.0):
            free = P.tocsc().indices
            S = body.stiffness[free][:, free]
        else:
            S = sparse.csr_array(P.T @ body.stiffness @ P)
        # Scale the unknowns to unit stiffness: the magnitudes of values and derivatives, and of
        # directions, then depend neither on the unit of length nor on the aspect ratio of cells.
        # Powers of two cause no rounding.
        diagonal = S.diagonal()
        exponent = np.round(-0.5 * np.log2(np.where(diagonal > 0, diagonal, 1.0)))
        unit = np.ldexp(1.0, exponent.astype(np.int64))
        self._P = sparse.csr_array(P @ sparse.diags_array(unit))
        S = sparse.csr_array(S)
        S.data *= np.repeat(unit, np.diff(S.indptr)) * unit[S.indices]
        self._prescribe(body)
        G, tangents = (sparse.csr_array(part @ self._P) for part in (rows.G, rows.T))
        B = self._choose(G, tangents, body.live(rows.G), body.live(rows.T))
        self.B = sparse.csr_array(B[:, self._boundary])
        modes = free_motions(body) / unit[:, None]
        self._refuse(unseen_motion(modes, modes[self._boundary]))
        if strains_can_be_factored(body, S.shape[0]):
            self._factor, change, back = factor_of_strains(body, self._P, self._boundary)
            self._P = sparse.csr_array(self._P @ change)
            self.B = sparse.csr_array(B @ change[:, self._boundary])
            modes = back @ modes
        else:
            self._factor = schur_factor(S, self._boundary, lambda: elimination_order(body), solver)
        with one_blas_thread(self.size):
            self._condense(modes[self._boundary], modes)

    def _choose(
        self,
        G: sparse.csr_array,
        tangents: sparse.csr_array,
        live_n: NDArray[np.bool_],
        live_t: NDArray[np.bool_],
    ) -> sparse.csr_array:
        """Number the live rows and the unknowns in them; returns the live rows."""
        if not live_n.any() and not live_t.any():
            raise InputError(
                "boundary: every displacement of the contact boundary is prescribed; "
                "fix less of it or choose another contact boundary"
            )
        normal = np.where(live_n, np.cumsum(live_n) - 1, -1)
        # If supports prescribe one component of the slip, it still affects the direction of
        # friction: its row is kept, without compliance. If they prescribe all of it, friction acts
        # on supports alone, and the rows are dropped.
        alive = live_t.reshape(live_n.size, -1)
        self._stiff: NDArray[np.bool_] = ~alive & np.any(alive, axis=1, keepdims=True)
        seen = self._stiff.ravel() | live_t
        tangents = sparse.csr_array(sparse.diags_array(live_t.astype(float)) @ tangents)
        tangents.eliminate_zeros()
        number = live_n.sum() + np.cumsum(seen) - 1
        self.points = PointRows(normal, np.where(seen, number, -1).reshape(alive.shape))
        B = sparse.vstack([G[live_n], tangents[seen]], format="csr")
        self._boundary = np.unique(B.indices).astype(np.int64)
        return B

    def _prescribe(self, body: Any) -> None:
        u0, rows = body.constraint[1], self.rows
        self.body: Any = body
        self._u0: Array | None = u0
        self._lifted: Array | None = body.internal(u0) if u0.any() else None
        self._fixed_normal = rows.G @ u0
        self._fixed_tangent = (rows.T @ u0).reshape(rows.gap.size, body.dim - 1)

    def under(self, body: Any) -> CondensedContact:
        """The same factorisation for a body that `ElasticBody.under` made of this one."""
        other = copy(self)
        other._prescribe(body)
        return other

    def _condense(self, N: Array, modes: Array) -> None:
        """Compute the compliance of the rows.

        N, shape (nb, k), and modes are the free rigid motions on the boundary's unknowns and on all
        of them.
        """
        arrays = self._arrays
        if N.shape[1]:
            N, R = np.linalg.qr(N)
            modes = np.linalg.solve(R.T, modes.T).T
        self._L, self.thin = held_factor(arrays, self._scaled_schur, N)
        W = arrays.gram(arrays.solve(self._L, arrays.dense(self.B.T)))
        diagonal = arrays.get(W.diagonal())
        if "thesis" in self.rows.functional.split(","):  # rank 2N + 2: see REGULARISATION
            i = arrays.xp.arange(diagonal.size)
            W[i, i] += REGULARISATION * diagonal.max()
        self._scale = scale = self.points.lengths(diagonal)
        W /= arrays.put(scale)
        W /= arrays.put(scale)[:, None]
        self._W = arrays.matrix(W)
        # With this factor the balance of loads is in the units of scaled forces.
        self.N, self._modes = N * float(np.mean(scale)), modes * float(np.mean(scale))
        self._C = (self.B @ self.N) / scale[:, None]

    @property
    def size(self) -> int:
        """Order of the largest dense matrix."""
        return max(self.B.shape)

    @property
    def unknowns(self) -> int:
        """Number of the contact boundary's unknowns."""
        return self.B.shape[1]

    @property
    def point_scale(self) -> Array:
        """Physical force = scaled force / point_scale; physical displacement = scaled * it."""
        return self.points.of_points(self._scale)

    def boundary_problem(
        self,
        load: Array,
        gap: Array,
        slip_from: Array | None = None,
        motion: ObstacleMotion | None = None,
    ) -> BoundaryProblem:
        """The dense problem for one load vector and one gap.

        Parameters
        ----------
        load : ndarray, shape (ndofs,)
        gap : ndarray, shape (m,)
        slip_from : ndarray, shape (m, dim - 1), optional
            Tangential displacement that counts as zero, see `ContactSystem`.
        motion : ObstacleMotion, optional
            Prescribed motions shift the displacements, free ones are unknowns of a.

        Raises
        ------
        Infeasible
            A point whose normal displacement is prescribed lies behind the obstacle.
        """
        fixed_n, fixed_t = self.prescribed(gap, slip_from, motion)
        v0 = self.B @ self._flexed(self.reduce(load)) + self.points.stacked(fixed_n, fixed_t)
        scale = self.point_scale
        R, per_unit = self.driven(motion, self._scale)
        force = np.zeros(0) if motion is None else motion.force[motion.free]
        return BoundaryProblem(
            W=self._W,
            v0=v0 / self._scale,
            C=np.hstack((self._C, R)) if R.size else self._C,
            s=np.concatenate((self.resultants(load), per_unit * force)),
            gap=gap / scale,
            normal=self.points.normal,
            tangent=self.points.tangent,
            prescribed_slip=fixed_t / scale[:, None],
        )

    def prescribed(
        self, gap: Array, slip_from: Array | None, motion: ObstacleMotion | None
    ) -> tuple[Array, Array]:
        """Displacements of the points that supports and obstacles prescribe, (m,), (m, dim - 1)."""
        fixed_n, fixed_t = self._fixed_normal, self._fixed_tangent
        largest = float(np.abs(fixed_t).max(initial=0.0))
        if motion is not None:
            w_n, w_t = motion.displacement(motion.prescribed)
            fixed_n, fixed_t = fixed_n - w_n, fixed_t - w_t
            largest = max(largest, float(np.abs(w_t).max(initial=0.0)))
        if slip_from is not None:
            fixed_t = fixed_t - slip_from
            largest = max(largest, float(np.abs(slip_from).max(initial=0.0)))
        # Prescribed slips this small, relative to the displacements, are rounding.
        fixed_t = np.where(self._stiff & (np.abs(fixed_t) <= 1e-12 * largest), 0.0, fixed_t)
        prescribed = self.points.normal < 0
        # Rounding of the coordinates.
        round_off = 1e-12 * float(np.ptp(self.body.trace.mesh.p, axis=1).max())
        through = prescribed & (fixed_n - gap > round_off)
        if np.any(through):
            i = int(np.flatnonzero(through)[0])
            raise Infeasible(
                f"obstacle: contact point {i} at {self.rows.x_nominal[:, i]} is fixed at normal "
                f"displacement {fixed_n[i]:.6g}, beyond its gap {gap[i]:.6g}"
            )
        return fixed_n, fixed_t

    def driven(self, motion: ObstacleMotion | None, scale: Array) -> tuple[Array, Array]:
        """Columns of C for the free motions of obstacles, and physical over scaled motion."""
        if motion is None or not np.any(motion.free):
            return np.zeros((scale.size, 0)), np.zeros(0)
        free, R = motion.free, np.zeros((scale.size, int(motion.free.sum())))
        normal, tangent = self.points.normal, self.points.tangent
        R[normal[normal >= 0]] = -motion.normal[normal >= 0][:, free]
        R[tangent[tangent >= 0]] = -motion.tangent[tangent.ravel() >= 0][:, free]
        R /= scale[:, None]
        size = np.abs(R).max(axis=0)
        per_unit = 1.0 / np.where(size > 0, size, 1.0)
        return R * per_unit, per_unit

    def recover(
        self, load: Array, problem: BoundaryProblem, forces: Forces
    ) -> tuple[Array, Array, Array]:
        """Displacement of all dofs and physical forces: (u, mu, t)."""
        stacked = problem.forces(forces.mu, forces.t) / self._scale
        reduced = self.reduce(load) - self.B.T @ stacked
        of_body = forces.a[: self.N.shape[1]]
        z_b = self._flexed(reduced) + self.N @ of_body
        scale = self.point_scale
        return self.expand(load, z_b), forces.mu / scale, forces.t / scale[:, None]

    def unbalanced(self, load: Array, u: Array, mu: Array, t: Array) -> Array | None:
        """Forces on free dofs that nothing balances, where a step of refinement is worth it."""
        return None

    def obstacle_motion(self, motion: ObstacleMotion | None, forces: Forces) -> Array | None:
        """Motions of the obstacles in physical units, prescribed and found, shape (k,)."""
        if motion is None:
            return None
        found = motion.prescribed.copy()
        found[motion.free] = self.driven(motion, self._scale)[1] * forces.a[self.N.shape[1] :]
        return found

    def blas_threads(self) -> AbstractContextManager[None]:
        """Threads of BLAS while a problem is solved, recovered and certified.

        Its vectors are long and its matrices small: a second thread gains nothing there, and would
        contend with PARDISO's for the cores.
        """
        return one_blas_thread(self.size)

    def _flexed(self, r: Array) -> Array:
        """Displacement of the boundary's unknowns under forces r on them."""
        arrays = self._arrays
        half = arrays.solve(self._L, arrays.put(r[:, None]))
        return np.asarray(arrays.get(arrays.solve(self._L, half, transposed=True)))[:, 0]

    def resultants(self, load: Array) -> Array:
        """Work of a load on the rigid motions, as it is given and not as elimination carries it."""
        work: Array = self._modes.T @ (self._P.T @ load)
        return work

    def _scaled_schur(self) -> Any:
        """S_b on the device, a copy."""
        return 1.0 * self._factor.schur

    @property
    def stiffness(self) -> Array:
        """Schur complement S_b of the contact boundary's unknowns, shape (nb, nb)."""
        return np.asarray(self._arrays.get(self._scaled_schur()))

    def reduce(self, load: Array) -> Array:
        """Load vector of all dofs, carried to the contact boundary's unknowns, shape (nb,)."""
        return self.carried(self._from_rest(load))

    def carried(self, forces: Array) -> Array:
        """Forces on all dofs, carried to the contact boundary's unknowns, shape (nb,)."""
        return self._factor.reduce(self._P.T @ forces)

    def restrict(self, rows: sparse.csr_array) -> Array:
        """Rows of all dofs in the contact boundary's unknowns, shape (nrows, nb)."""
        reduced: Array = (rows @ self._P)[:, self._boundary].toarray()
        return reduced

    def expand(self, load: Array, z_b: Array) -> Array:
        """Displacement of all dofs from the contact boundary's unknowns."""
        u = self.moved(self._from_rest(load), z_b)
        return u if self._u0 is None else u + self._u0

    def moved(self, forces: Array, z_b: Array) -> Array:
        """Displacement of all dofs under forces on them and supports at rest."""
        u: Array = self._P @ self._factor.expand(self._P.T @ forces, z_b)
        return u

    def _from_rest(self, load: Array) -> Array:
        """The load less the forces that prescribed displacements cause."""
        return load if self._lifted is None else load - self._lifted

    def rigid_motion(self, a: Array) -> tuple[str, Array]:
        """Name and all dofs of the body's part of a motion a of the boundary problem."""
        return self._motion_of(self._modes @ a[: self._modes.shape[1]])

    def moves_obstacle(self, a: Array) -> bool:
        """Whether a motion a of the boundary problem is one of an obstacle, not of the body."""
        k = self._modes.shape[1]
        return bool(np.abs(a[k:]).max(initial=0.0) > np.abs(a[:k]).max(initial=0.0))

    def _refuse(self, motion: Array | None) -> None:
        if motion is not None:
            raise not_held(self.body, *self._motion_of(motion))

    def _motion_of(self, motion: Array) -> tuple[str, Array]:
        """Name and all dofs of a rigid motion in free unknowns."""
        u: Array = self._P @ motion
        return describe_motion(self.body, u), u
