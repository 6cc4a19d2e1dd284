"""The contact rows of one or several bodies, reduced to a dense problem on the contact boundary."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import block_diag

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.sparse_rows import transpose
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.condensation.condense import choose_condensation
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.condensation.device_choice import Device
from contact.condensation.factor_compliance import FactorCompliance, guessed_diagonal
from contact.errors import ContactError, Infeasible, InputError
from contact.obstacles.rigid import ObstacleMotion
from contact.rows.contact_rows import ContactRows


class CondensedBodies:
    """Operations body by body: loads reduced to the boundary, displacements recovered."""

    body: Any  # a Solid, or several as Bodies
    rows: ContactRows
    parts: tuple[CondensedBody, ...]
    _unit: float  # physical displacement of a unit motion a

    @property
    def always_refined(self) -> bool:
        """Whether some body requires a refinement step for each displacement."""
        return any(part.always_refined for part in self.parts)

    def unbalanced(self, load: Any, u: Any, mu: Array, t: Array) -> Any:
        """Residual forces on free dofs, or None if refinement gains nothing. Loads and
        displacements of all dofs are on the device of the body, see `Solid.placed`."""
        rest = load - self.body.contact_forces(self.rows, mu, t)
        each = [
            part.unbalanced(r, v)
            for part, r, v in zip(self.parts, self._split(rest), self._split(u), strict=True)
        ]
        if all(left is None for left in each):
            return None
        return together(
            [
                np.zeros(part.body.ndofs) if left is None else left
                for part, left in zip(self.parts, each, strict=True)
            ]
        )

    def placed(self, v: Array) -> Any:
        """Move a vector of all dofs to the device of a single body; to the host for several."""
        return self.parts[0].placed(v) if len(self.parts) == 1 else v

    def fetched(self, v: Any) -> Array:
        """A vector of all dofs on the host."""
        return v if isinstance(v, np.ndarray) else np.asarray(self.parts[0].arrays.get(v))

    def _split(self, v: Any) -> list[Any]:
        """Values on all dofs, body by body."""
        return [v[own] for own in self.body.slices]

    def _of_boundary(self, z_b: Array) -> list[Array]:
        """Values of the contact boundary's unknowns, body by body."""
        return np.split(z_b, np.cumsum([part.B.shape[1] for part in self.parts])[:-1])

    def flexed(self, r: Array) -> Array:
        """Displacement of the boundary's unknowns under forces r on them."""
        pairs = zip(self.parts, self._of_boundary(r), strict=True)
        return np.concatenate([part.flexed(own) for part, own in pairs])

    def resultants(self, load: Array) -> Array:
        """Work of a load on the rigid motions, from the load before condensation."""
        pairs = zip(self.parts, self._split(load), strict=True)
        return self._unit * np.concatenate([part.resultants(own) for part, own in pairs])

    @property
    def stiffness(self) -> Array:
        """Schur complement S_b of the contact boundary's unknowns, shape (nb, nb)."""
        return np.asarray(block_diag(*[part.stiffness for part in self.parts]))

    def reduce(self, load: Array) -> Array:
        """Load on all dofs, condensed onto the contact boundary's unknowns, shape (nb,)."""
        pairs = zip(self.parts, self._split(load), strict=True)
        return np.concatenate([part.reduce(own) for part, own in pairs])

    def carried(self, forces: Array) -> Array:
        """Forces on all dofs, condensed with zero supports onto the boundary's unknowns, (nb,)."""
        pairs = zip(self.parts, self._split(forces), strict=True)
        return np.concatenate([part.carried(own) for part, own in pairs])

    def restrict(self, rows: sparse.csr_array) -> Array:
        """Rows of all dofs in the contact boundary's unknowns, shape (nrows, nb)."""
        pairs = zip(self.parts, self.body.slices, strict=True)
        return np.hstack([part.restrict(rows[:, own]) for part, own in pairs])

    def restricted_columns(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """Transposed force vectors on all dofs, (ndofs, n), restricted to the boundary's unknowns,
        (nb, n)."""
        parts = [
            part.boundary_columns.T @ matrix[own]
            for part, own in zip(self.parts, self.body.slices, strict=True)
        ]
        return sparse.csr_array(sparse.vstack(parts, format="csr"))

    def expand(self, load: Array, z_b: Array) -> Array:
        """Displacement of all dofs from the contact boundary's unknowns."""
        trios = zip(self.parts, self._split(load), self._of_boundary(z_b), strict=True)
        return together([part.expand(own, z) for part, own, z in trios])

    def moved(self, forces: Array, z_b: Array) -> Array:
        """Displacement of all dofs under forces, with zero supports."""
        trios = zip(self.parts, self._split(forces), self._of_boundary(z_b), strict=True)
        return together([part.moved(own, z) for part, own, z in trios])

    def rigid_motion(self, a: Array) -> tuple[str, Array]:
        """Name, and displacement of all dofs, of the bodies' part of a motion a; the name is that
        of the largest motion if several bodies move."""
        found = []
        for part, own in zip(self.parts, self._of_motion(a), strict=True):
            if own.size and own.any():
                found.append(part.motion_of(part.modes @ (self._unit * own)))
            else:
                found.append(("", np.zeros(part.body.ndofs)))
        reaches = [
            b.largest_displacement(u) for b, (_, u) in zip(self.body.bodies, found, strict=True)
        ]
        k = int(np.argmax(reaches))
        return self.body.describe(k, found[k][0]), np.concatenate([u for _, u in found])

    def _of_motion(self, a: Array) -> list[Array]:
        """The rigid motions a of each body."""
        ends = np.cumsum([part.N.shape[1] for part in self.parts])
        return np.split(a[: ends[-1]], ends[:-1])


def together(each: list[Any]) -> Any:
    """Values on all dofs from those of each body; for one body possibly on a device."""
    return each[0] if len(each) == 1 else np.concatenate(each)


Array = NDArray[np.float64]


class CondensedContact(CondensedBodies):
    """The bodies and their contact rows, reduced to a dense problem on the contact boundary.

    It depends on the stiffness, the supports and the rows only, not on loads, gaps and friction, so
    one condensation serves a whole load history. `ContactProblem.condense` creates and caches it.

    Parameters
    ----------
    body : ElasticBody, LayeredBlock, CutBody or Bodies
    rows : ContactRows
    solver : {"auto", "pardiso", "superlu"}
        Sparse factorisation; see `contact.condensation.schur`.
    device : {"cpu", "cuda"} or tuple of str
        Where S_b and W are computed and the boundary problem is solved; ("cuda:0", "cuda:1") for
        devices that share the factors.
    keep : csr_array, shape (1, ndofs), optional
        Nonzero at dofs that are kept for other rows, see `touched_by`.
    deterministic : bool
        Whether equal calls give equal bits on a device.

    Attributes
    ----------
    points : PointRows
        Which rows of B belong to which contact point.
    B : csr_array, shape (n, nb)
        Live contact rows in the contact boundary's unknowns.
    N : ndarray, shape (nb, k)
        Rigid motions of the boundary that no support resists.
    slender, thin : bool
        Whether cells, or the body, are so thin that digits are lost.

    Raises
    ------
    InputError
        The contact boundary is fixed entirely.
    Unbounded
        A piece of the body is neither fixed nor connected to the contact boundary.
    ContactError
        The dense compliance does not fit into the memory of the device.

    Notes
    -----
    With the contact boundary's unknowns z_b (those in contact rows) and their Schur complement
    S_b, the compliance of the rows B is ``W = B S_b^-1 B^T``. A body supported by contact alone has
    rigid motions N with S_b N = 0: then S_b + rho N N^T replaces S_b, and the amplitudes a of the
    motion N a are unknowns, with the load balance ``N^T (r - B^T l) = 0``.

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

    _arrays: Any
    _W: Any
    _dense = True
    _keeps_stiff = True

    def __init__(
        self,
        body: Any,
        rows: ContactRows,
        solver: str = "auto",
        device: Device = "cpu",
        keep: sparse.csr_array | None = None,
        deterministic: bool = False,
    ) -> None:
        of_bodies = self._take(body, rows, keep)
        count = of_bodies[0].count
        way, self._dense = choose_condensation(body.bodies, count, solver, device, deterministic)
        if "thesis" in rows.functional.split(",") and not self._dense:
            raise InputError(
                "functional 'thesis': it needs the dense compliance, which does not fit; choose "
                "another functional"
            )
        self.parts = tuple(
            way(one, own, solver, device) for one, own in zip(body.bodies, of_bodies, strict=True)
        )
        self._finish(body)

    def touched_by(self, body: Any, rows: ContactRows) -> CondensedContact:
        """The same factorisations for other rows on dofs that were kept, of this body, perhaps
        under other loads."""
        other = copy(self)
        other.parts = tuple(
            part.under(one).touched_by(own)
            for part, one, own in zip(
                self.parts, body.bodies, other._take(body, rows, None), strict=True
            )
        )
        other._finish(body)
        return other

    def _take(self, body: Any, rows: ContactRows, keep: sparse.csr_array | None) -> list[BodyRows]:
        """Store the rows; return the columns of each body in the live rows."""
        self.rows = rows
        normal, tangential = self._choose(
            rows, body.unconstrained(rows.G), body.unconstrained(rows.T)
        )
        return [
            BodyRows(normal[:, own], tangential[:, own], None if keep is None else keep[:, own])
            for own in body.slices
        ]

    def _finish(self, body: Any) -> None:
        self._prescribe(body)
        self.B = sparse.csr_array(sparse.hstack([part.B for part in self.parts], format="csr"))
        self.slender = any(part.slender for part in self.parts)
        self.thin = any(part.thin for part in self.parts)
        with one_blas_thread(self.size):
            self._condense()

    def _choose(
        self, rows: ContactRows, live_n: NDArray[np.bool_], live_t: NDArray[np.bool_]
    ) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Number the live rows; returns the normal and the tangential ones among them."""
        if not live_n.any() and not live_t.any():
            raise InputError(
                "boundary: every displacement of the contact boundary is prescribed; "
                "fix less of it or choose another contact boundary"
            )
        normal = np.where(live_n, np.cumsum(live_n) - 1, -1)
        # A prescribed slip component affects the direction of friction, which acts on the obstacle:
        # keep its row, with zero compliance.
        alive = live_t.reshape(live_n.size, -1)
        half: NDArray[np.bool_] = ~alive & np.any(alive, axis=1, keepdims=True)
        self._half_held, self._stiff = half, ~alive & self._keeps_stiff
        seen = self._stiff.ravel() | live_t
        number = live_n.sum() + np.cumsum(seen) - 1
        self.points = PointRows(normal, np.where(seen, number, -1).reshape(alive.shape))
        # Avoid a product with a diagonal matrix of all dofs.
        of_entry = np.repeat(live_t.astype(float), np.diff(rows.T.indptr))
        tangents = sparse.csr_array(
            (of_entry * rows.T.data, rows.T.indices, rows.T.indptr), shape=rows.T.shape
        )
        return sparse.csr_array(rows.G[live_n]), sparse.csr_array(tangents[seen])

    def _prescribe(self, body: Any) -> None:
        u0, rows = together([part.prescribed() for part in self.parts]), self.rows
        self.body: Any = body
        self._fixed_normal = rows.G @ u0
        self._fixed_tangent = (rows.T @ u0).reshape(rows.gap.size, body.dim - 1)

    def under(self, body: Any) -> Self:
        """The same factorisation for a body that `ElasticBody.under` made of this one."""
        other = copy(self)
        other.parts = tuple(
            part.under(one) for part, one in zip(self.parts, body.bodies, strict=True)
        )
        other._prescribe(body)
        return other

    def _condense(self) -> None:
        """Compute the compliance of the rows, the sum of those of the bodies."""
        self._systems: list[Any] = []
        self._arrays = self.parts[0].arrays
        if self._dense:
            self._add_up()
        else:
            guess = guessed_diagonal(self.parts)
            self._scale = self.points.lengths(guess)
            self._W = FactorCompliance(self.parts, self._scale)
        # This factor gives the load balance the units of scaled forces.
        self._unit = float(np.mean(self._scale))
        self.N = block_diag(*[part.N for part in self.parts]) * self._unit
        self._C = (self.B @ self.N) / self._scale[:, None]

    def _add_up(self) -> None:
        """Compute the dense compliance, scaled by the compliance of each point."""
        arrays = self._arrays
        self._refuse_large(arrays.room())
        W = self.parts[0].compliance()
        for part in self.parts[1:]:
            W += arrays.put(part.arrays.get(part.compliance()))
        diagonal = arrays.get(W.diagonal())
        # The rows of ``thesis`` are linearly dependent, of rank 2N + 2: a small compliance selects
        # the multipliers of least norm.
        if "thesis" in self.rows.functional.split(","):
            i = arrays.xp.arange(diagonal.size)
            W[i, i] += 1e-10 * diagonal.max()
        self._scale = scale = self.points.lengths(diagonal)
        W /= arrays.put(scale)
        W /= arrays.put(scale)[:, None]
        self._W = arrays.matrix(W)

    def _refuse_large(self, room: int | None) -> None:
        """Raise a `ContactError` if the compliance and the Schur complement exceed the memory."""
        n, unknowns = self.B.shape[0], max(part.order for part in self.parts)
        needed = 8 * n * (n + unknowns)
        if room is not None and needed > room:
            fits = int(n * np.sqrt(room / needed))
            raise ContactError(
                f"device='cuda': the dense compliance of {n:,} contact rows needs "
                f"{needed / 1e9:.3g} GB, and {room / 1e9:.3g} GB of the device's memory are free; "
                f"about {fits:,} rows would fit: coarsen the contact boundary, or leave out "
                "device='cuda'"
            )

    @property
    def size(self) -> int:
        """Order of the largest dense matrix."""
        return max(part.order for part in self.parts)

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
        load: Array | None,
        gap: Array,
        slip_from: Array | None = None,
        motion: ObstacleMotion | None = None,
    ) -> BoundaryProblem:
        """The dense problem for one load vector and one gap.

        Parameters
        ----------
        load : ndarray, shape (ndofs,), or None
            None: of no load, without any substitution.
        gap : ndarray, shape (m,)
        slip_from : ndarray, shape (m, dim - 1), optional
            Tangential displacement that counts as zero, see `ContactSystem`.
        motion : ObstacleMotion, optional
            Prescribed motions shift the displacements, free ones are unknowns of a.

        Raises
        ------
        Infeasible
            A point whose normal displacement is prescribed lies behind the obstacle, or supports
            displace a bonded point.
        InputError
            A bonded point without a gap; supports that hold all points a driven obstacle presses.
        """
        fixed_n, fixed_t = self.prescribed(gap, slip_from, motion)
        v0, s = self.points.stacked(fixed_n, fixed_t), np.zeros(self.N.shape[1])
        if load is not None:
            v0, s = v0 + self.B @ self.flexed(self.reduce(load)), self.resultants(load)
        scale, tangent = self.point_scale, self.rubbing(fixed_t, motion)
        R, per_unit = self.driven(motion, self._scale)
        force = np.zeros(0) if motion is None else motion.force[motion.free]
        return BoundaryProblem(
            W=self._W,
            v0=v0 / self._scale,
            C=np.hstack((self._C, R)) if R.size else self._C,
            s=np.concatenate((s, per_unit * force)),
            gap=gap / scale,
            normal=self.points.normal,
            tangent=tangent,
            prescribed_slip=fixed_t / scale[:, None],
            bonded=self.rows.ties if self.rows.bonded.size else None,
            swept=self.swept(tangent, fixed_t, motion),
            systems=self._systems,
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
            pressed = np.isfinite(gap) & np.any(motion.normal[:, motion.free], axis=1)
            if pressed.any() and np.all(self.points.normal[pressed] < 0):
                raise InputError(
                    "Rigid: supports hold, along its normal, every contact point on which the "
                    "force can press the obstacle; let them end where the contact begins, hold "
                    "fewer components there, or give the obstacle a displacement instead of a force"
                )
        if slip_from is not None:
            fixed_t = fixed_t - slip_from
            largest = max(largest, float(np.abs(slip_from).max(initial=0.0)))
        # Smaller prescribed slips, relative to the displacements, are rounding.
        fixed_t = np.where(self._stiff & (np.abs(fixed_t) <= 1e-12 * largest), 0.0, fixed_t)
        prescribed, ties = self.points.normal < 0, self.rows.ties
        # Rounding of the coordinates.
        round_off = 1e-12 * self.body.extent
        through = prescribed & (fixed_n - gap > round_off)
        if not np.all(np.isfinite(gap[ties])):
            raise InputError(
                "rows.bonded: a bonded point needs a finite gap, zero where it is tied"
            )
        through |= ties & prescribed & (gap - fixed_n > round_off)
        moved = np.abs(np.where((self.points.tangent < 0) | self._stiff, fixed_t, 0.0)).max(axis=1)
        slips = ties & (moved > max(round_off, 1e-12 * largest))
        if np.any(slips):
            i = int(np.flatnonzero(slips)[0])
            raise Infeasible(
                f"supports: they displace the bonded contact point {i} at "
                f"{self.rows.x_nominal[:, i]} along the boundary by {moved[i]:.6g}"
            )
        if np.any(through):
            i = int(np.flatnonzero(through)[0])
            where = "away from" if ties[i] else "beyond"
            raise Infeasible(
                f"obstacle: contact point {i} at {self.rows.x_nominal[:, i]} is fixed at normal "
                f"displacement {fixed_n[i]:.6g}, {where} its gap {gap[i]:.6g}; "
                "let the support end where the contact begins, or hold fewer components there"
            )
        return fixed_n, fixed_t

    def rubbing(self, fixed_t: Array, motion: ObstacleMotion | None) -> NDArray[np.int64]:
        """Rows of tangents whose forces are unknowns, -1 for the others, (m, dim - 1), of slips
        `fixed_t`. Where the whole slip is prescribed, friction follows from the normal force and
        acts on supports only, see `ContactSystem.with_held_points`."""
        known = self._stiff.copy()
        if motion is not None and np.any(motion.free):
            known &= ~motion.drags
        known &= known.all(axis=1, keepdims=True) | (fixed_t == 0.0)
        return np.where(known, -1, self.points.tangent)

    def swept(
        self, tangent: NDArray[np.int64], fixed_t: Array, motion: ObstacleMotion | None
    ) -> NDArray[np.bool_] | None:
        """`BoundaryProblem.swept` for the rows of `rubbing`; None if there are no such points."""
        given = self._stiff & (tangent >= 0) & (fixed_t != 0.0) & ~self.rows.ties[:, None]
        if motion is not None and np.any(motion.free):
            given &= ~motion.drags
        return given.any(axis=1) if given.any() else None

    def driven(self, motion: ObstacleMotion | None, scale: Array) -> tuple[Array, Array]:
        """Columns of C for the free motions of obstacles, and the ratio of physical to scaled
        motion."""
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
        reduced = self.reduce(load) - transpose(self.B) @ stacked
        of_body = forces.a[: self.N.shape[1]]
        z_b = self.flexed(reduced) + self.N @ of_body
        scale = self.point_scale
        return self.expand(load, z_b), forces.mu / scale, forces.t / scale[:, None]

    def yielded(self, forces: Array) -> tuple[Array, Array]:
        """Scaled displacement of the live rows, (n,), and work on free motions, under forces on
        all dofs with zero supports."""
        moved = self.B @ self.flexed(self.carried(forces))
        return moved / self._scale, self.resultants(forces)

    def transposed(self, forces: Array, of_rows: Array, a: Array) -> Array:
        """Displacement of all dofs under forces on them and scaled forces on the live rows, (n,),
        plus the free motions a, with zero supports."""
        reduced = self.carried(forces) + self.B.T @ (of_rows / self._scale)
        return self.moved(forces, self.flexed(reduced) + self.N @ a[: self.N.shape[1]])

    def per_unit(self, motion: ObstacleMotion | None) -> Array:
        """Ratio of physical to scaled motion of the free motions of obstacles."""
        return self.driven(motion, self._scale)[1]

    @property
    def on_host(self) -> bool:
        """Whether the compliance is that of the host."""
        return self._arrays.xp is np

    def obstacle_motion(self, motion: ObstacleMotion | None, forces: Forces) -> Array | None:
        """Motions of the obstacles in physical units, prescribed and computed, shape (k,)."""
        if motion is None:
            return None
        found = motion.prescribed.copy()
        found[motion.free] = self.per_unit(motion) * forces.a[self.N.shape[1] :]
        return found

    @property
    def path(self) -> str:
        """Condensation method, "sparse", "slabs" or "fourier", one for each of several bodies."""
        return ", ".join(part.path for part in self.parts)

    def blas_threads(self) -> AbstractContextManager[None]:
        """BLAS threads while a problem is solved, recovered and certified. Matrices are small: a
        second thread gains nothing and would compete with PARDISO's for cores."""
        serial = any(part.serial for part in self.parts)
        return one_blas_thread(self.size) if serial else nullcontext()

    def moves_obstacle(self, a: Array) -> bool:
        """Whether a motion a moves an obstacle, not the body."""
        k = self.N.shape[1]
        return bool(np.abs(a[k:]).max(initial=0.0) > np.abs(a[:k]).max(initial=0.0))


Index = NDArray[np.int64]


@dataclass(frozen=True)
class PointRows:
    """Numbers of the live rows, those not entirely prescribed by supports."""

    normal: Index  # row of each point's normal, -1 where prescribed, shape (m,)
    tangent: Index  # rows of the tangents, -1 if wholly prescribed, shape (m, dim - 1)

    def stacked(self, of_normal: Array, of_tangent: Array) -> Array:
        """Stack values of points, shapes (m,) and (m, dim - 1), on the live rows, shape (n,)."""
        live_n, live_t = self.normal >= 0, self.tangent >= 0
        values = np.zeros(int(live_n.sum() + live_t.sum()))
        values[self.normal[live_n]] = of_normal[live_n]
        values[self.tangent[live_t]] = of_tangent[live_t]
        return values

    def lengths(self, compliance: Array) -> Array:
        """Root of the mean compliance of each point's rows, repeated on its rows, shape (n,).
        One value per point preserves the shape of the friction ball; rows without compliance are
        ignored, and a point with no others has the value one."""
        rows = np.column_stack((self.normal, self.tangent))
        own = np.where(rows >= 0, compliance[rows], 0.0)
        count = np.maximum((own > 0).sum(axis=1), 1)
        total = np.where(own > 0, own, 0.0).sum(axis=1)
        lengths = np.ones(compliance.size)
        of_point = np.where(total > 0, np.sqrt(total / count), 1.0)
        lengths[rows[rows >= 0]] = np.broadcast_to(of_point[:, None], rows.shape)[rows >= 0]
        return lengths

    def of_points(self, of_rows: Array) -> Array:
        """Common value of the rows of each point, shape (m,); one for a point without live rows."""
        first = np.maximum(self.normal, self.tangent.max(axis=1))
        return np.where(first >= 0, of_rows[np.maximum(first, 0)], 1.0)
