"""Contact rows as unknowns of the body, which avoids dense matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import min_weight_full_bipartite_matching
from scipy.sparse.linalg import splu

from contact.body.spread_unknowns import NodeBlocks
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.condensation.condensed_contact import CondensedContact
from contact.condensation.distributed import CondensedDistributed
from contact.condensation.solved_body import ROW_COMPLIANCE
from contact.errors import InputError
from contact.obstacles.rigid import ObstacleMotion
from contact.rows.contact_rows import ContactRows
from skfem_adini.distributed import AlteredSystem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PrimalProblem(BoundaryProblem):
    """A `BoundaryProblem` with scaled rows v as unknowns of a distributed body."""

    system: Any = None  # stiffness on unknowns that include the live rows
    load: Any = None  # own forces on its unknowns
    v: Any = None  # current rows, instead of v0 - W l + C a; v0: prescribed

    def displacements(self, mu: Array, t: Array, a: Array) -> tuple[Array, Array]:
        """Normal and tangential displacement of every point in the current state."""
        u_n = np.where(self.normal >= 0, self.v[self.normal], 0.0)
        u_t = np.where(self.tangent >= 0, self.v[self.tangent], self.prescribed_slip)
        return u_n, u_t


@dataclass(frozen=True)
class PrimalForces(Forces):
    """Forces with the process's own unknowns x in equilibrium with them."""

    x: Any = None


class PrimalBody(CondensedDistributed):
    """The scaled stiffness of a `DistributedBody`, without elimination."""

    thin = False

    def _schur(self, S: sparse.csr_array, solver: str) -> Any:
        self.S = S

    def _hold(self, N: Array, modes: Array) -> None:
        self.N, self.modes = N, modes


class PrimalContact(CondensedContact):
    """`CondensedContact` for a body that is not condensed: the rows ``B z = v`` are unknowns.
    Newton's methods prescribe those in contact and solve for the others by multigrid, see
    `contact.laws.primal_newton`. Points with one moved and one free tangent are refused."""

    _keeps_stiff = False

    def __init__(self, body: Any, rows: ContactRows, method: str) -> None:
        self._method = method
        of_body = self._take(body, rows, None)
        self.parts = (PrimalBody(body, of_body[0]),)
        self._finish(body)

    @property
    def size(self) -> int:
        """Order of the largest dense matrix."""
        return 1

    def _condense(self) -> None:
        part: Any = self.parts[0]
        body, z, B = part.body, part.body.unknowns, sparse.csr_array(self.B)
        self._arrays = part.arrays
        diagonal = z.collected(part._at, _diagonal(part.S, z))
        compliance = ROW_COMPLIANCE * (B.multiply(B) @ (1.0 / diagonal))
        self._scale = scale = self.points.lengths(compliance)
        B = sparse.csr_array(sparse.diags_array(1.0 / scale) @ B)
        pivots, change, back = rows_as_unknowns(B)
        self._blocks = blocks = NodeBlocks.of(body)
        at = z.collected(part._at, blocks.numbers).astype(np.int64)
        modes = part.rigid_in_unknowns()
        of_chosen = back @ z.collected(part._at, modes)
        modes = blocks.put(modes)
        mine = blocks.own(at[pivots])
        modes[at[pivots][mine] - blocks.first] = of_chosen[pivots][mine]
        self._system = AlteredSystem(
            *blocks.rows(part.S, z),
            blocks.first,
            blocks.total,
            at[pivots],
            *blocks.change(change, at),
            near_null=modes,
            comm=body.comm,
            method=self._method,
            block_size=blocks.size,
        )
        del part.S
        self._unit = float(np.mean(scale))
        self.N = part.N * self._unit
        self._C = (self.B @ self.N) / scale[:, None]

    def boundary_problem(
        self,
        load: Any,
        gap: Array,
        slip_from: Array | None = None,
        motion: ObstacleMotion | None = None,
    ) -> PrimalProblem:
        """The problem for one load vector and one gap; see `CondensedContact.boundary_problem`."""
        if motion is not None and np.any(motion.free):
            raise InputError(
                "obstacle: forces on obstacles are not offered without condensation; take "
                "DistributedBody(..., backend='mumps')"
            )
        fixed_n, fixed_t = self.prescribed(gap, slip_from, motion)
        if np.abs(fixed_t[self._half_held]).max(initial=0.0) > 0.0:
            raise InputError(
                "supports: one tangential component of a contact point is moved and the other "
                "free, which is not offered without condensation; take "
                "DistributedBody(..., backend='mumps')"
            )
        part: Any = self.parts[0]
        v0 = self.points.stacked(fixed_n, fixed_t) / self._scale
        scale = self.point_scale
        own = self._blocks.put(part._to_own(part._from_rest(load)))
        return PrimalProblem(
            W=np.zeros((0, 0)),
            v0=v0,
            C=self._C,
            s=self.resultants(load),
            gap=gap / scale,
            normal=self.points.normal,
            tangent=self.points.tangent,
            prescribed_slip=fixed_t / scale[:, None],
            bonded=self.rows.ties if self.rows.bonded.size else None,
            system=self._system,
            load=self._system.carried(own),
            v=v0,
        )

    def recover(self, load: Array, problem: Any, forces: Any) -> tuple[Array, Array, Array]:
        """Displacement of all dofs and physical forces: (u, mu, t)."""
        part: Any = self.parts[0]
        z = self._system.to_z(forces.x)[self._blocks.place]
        u = part._of_own(part._unit * z)
        scale = self.point_scale
        u0 = part.prescribed()
        return u + u0, forces.mu / scale, forces.t / scale[:, None]


def _diagonal(S: sparse.csr_array, z: Any) -> Array:
    column = np.searchsorted(z.numbers, z.first + np.arange(S.shape[0]))
    picked = sparse.csr_array((np.ones(column.size), (np.arange(column.size), column)), S.shape)
    return np.asarray(S.multiply(picked).sum(axis=1), dtype=np.float64).ravel()


def rows_as_unknowns(
    B: sparse.csr_array,
) -> tuple[NDArray[np.int64], sparse.csr_array, sparse.csr_array]:
    """Replace one unknown of each row of B (n, nb) by the row's value: ``x[pivots] = B z``.
    Returns pivots (n,), the change T of ``z = T x`` and its inverse, both (nb, nb). Raises
    InputError if rows are linearly dependent or T is not sparse."""
    n, nb = B.shape
    B.eliminate_zeros()
    largest = abs(B).max(axis=1).toarray().ravel()
    # Maximise the product of the pivot entries; weights must be positive.
    weight = sparse.csr_array(
        (1.0 - np.log(np.abs(B.data) / np.repeat(largest, np.diff(B.indptr))), B.indices, B.indptr),
        B.shape,
    )
    try:
        row, column = min_weight_full_bipartite_matching(weight)
    except ValueError:
        row = column = np.zeros(0, dtype=np.int64)
    if row.size < n:
        raise InputError(
            "functional: its contact rows are linearly dependent and cannot be unknowns; take "
            "another functional, or DistributedBody(..., backend='mumps')"
        )
    pivots = np.empty(n, dtype=np.int64)
    pivots[row] = column
    kept = np.ones(nb)
    kept[pivots] = 0.0
    place = sparse.csr_array((np.ones(n), (pivots, np.arange(n))), shape=(nb, n))
    back = sparse.csr_array(sparse.diags_array(kept) + place @ B)
    factor = splu(sparse.csc_array(back), permc_spec="COLAMD")
    # The inverse is sparse if each row shares unknowns with few others.
    blocks = []
    for start in range(0, nb, 256):
        some = np.arange(start, min(start + 256, nb))
        unit = np.zeros((nb, some.size))
        unit[some, some - start] = 1.0
        solved = factor.solve(unit)
        solved[np.abs(solved) < 1e-14 * np.abs(solved).max(axis=0)] = 0.0
        blocks.append(sparse.csc_array(solved))
        if blocks[-1].nnz > 60.0 * some.size:  # entries in each row: no longer sparse
            raise InputError(
                "functional: each of its contact rows depends on all others, so that they cannot "
                "be unknowns; take another functional, or DistributedBody(..., backend='mumps')"
            )
    return pivots, sparse.csr_array(sparse.hstack(blocks, format="csr")), back
