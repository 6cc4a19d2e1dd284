"""Start of a cold solve in two dimensions: the same problem with fewer contact points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.dense_arrays import arrays_of
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.laws.friction import Coulomb, Friction, Tresca

GROUP = 4  # neighbouring contact points that become one point of the coarse problem
FEW = 100  # with fewer contact points a coarse problem saves no time
ON_HOST = 400  # rows up to which steps on a device take as long as its calls, longer than the host


@dataclass(frozen=True)
class CoarseProblem:
    """A problem whose neighbouring points, in groups, have equal scaled forces: l = P L, P^T W P.
    Its zones differ from those of the fine problem at a few points only.
    """

    problem: BoundaryProblem  # the coarse one
    friction: Friction | None
    fine: BoundaryProblem
    row: NDArray[np.int64]  # coarse row of each fine row; -1 where a normal cannot touch
    share: NDArray[np.float64]  # scaled force of a fine row over that of its coarse row

    @classmethod
    def of(cls, fine: BoundaryProblem, friction: Friction | None) -> CoarseProblem | None:
        """Group points, numbered along the boundary; None in 3-D, for fewer than `FEW` points, with
        bonded ones and on compliant surfaces.
        """
        m = fine.gap.size
        if fine.tangent.shape[1] != 1 or m < FEW or fine.ties.any() or fine.compliance:
            return None
        group = np.arange(m) // GROUP
        count = int(group[-1]) + 1
        bears = np.column_stack((fine.can_touch, fine.tangent[:, 0] >= 0))
        there = np.stack([np.bincount(group, bears[:, j], count) > 0 for j in (0, 1)], axis=1)
        number = np.where(there.T, np.cumsum(there.T).reshape(2, count) - 1, -1).T
        of_point = np.column_stack((fine.normal, fine.tangent[:, 0]))
        row = np.full(fine.v0.size, -1)
        row[of_point[bears]] = number[group][bears]

        used = np.argsort(row, kind="stable")[np.count_nonzero(row < 0) :]
        first = np.flatnonzero(np.diff(row[used], prepend=-1))
        arrays = arrays_of(fine.W)
        ones = np.ones(used.size), (row[used], used)
        sums = sparse.csr_array(ones, shape=(first.size, row.size))
        W = arrays.congruent(sums, arrays.values(fine.W))
        compliance = np.where(there, arrays.get(W.diagonal())[number], 0.0).sum(axis=1)
        scale = np.sqrt(compliance / np.maximum(there.sum(axis=1), 1))  # one a coarse point
        scale = np.where(scale > 0, scale, 1.0)
        share = np.empty(first.size)
        share[number[there]] = 1.0 / np.broadcast_to(scale[:, None], there.shape)[there]
        W = W * arrays.put(share) * arrays.put(share)[:, None]
        gap = np.bincount(group, np.where(fine.can_touch, fine.gap, 0.0), count) / scale
        problem = BoundaryProblem(
            W=arrays.get(W) if first.size <= ON_HOST else arrays.matrix(W),
            v0=np.add.reduceat(fine.v0[used], first) * share,
            C=np.add.reduceat(fine.C[used], first, axis=0) * share[:, None],
            s=fine.s,
            gap=np.where(there[:, 0], gap, np.inf),
            normal=number[:, 0],
            tangent=number[:, 1:],
            prescribed_slip=(np.bincount(group, fine.prescribed_slip[:, 0], count) / scale)[
                :, None
            ],
        )
        if isinstance(friction, Coulomb):
            friction = Coulomb(_means(group, friction.coefficient))
        elif friction is not None:
            friction = Tresca(_means(group, friction.given) * scale)
        return cls(problem, friction, fine, row, share)

    def refined(self, forces: Forces) -> Forces:
        """Forces of the fine problem from those of the coarse one."""
        coarse = self.share * self.problem.forces(forces.mu, forces.t)
        stacked = np.where(self.row >= 0, coarse[self.row], 0.0)
        mu, t = self.fine.zeros()
        normal, tangent = self.fine.normal >= 0, self.fine.tangent >= 0
        mu[normal] = stacked[self.fine.normal[normal]]
        t[tangent] = stacked[self.fine.tangent[tangent]]
        return Forces(mu, t, forces.a)


def _means(group: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the values of each group."""
    return np.asarray(np.bincount(group, values) / np.bincount(group))
