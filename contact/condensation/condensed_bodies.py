"""Bodies that are condensed one by one, taken together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import block_diag

from contact.condensation.condensed_body import CondensedBody
from contact.rows.contact_rows import ContactRows

Array = NDArray[np.float64]


class CondensedBodies:
    """Operations body by body: loads reduced to the boundary, displacements recovered."""

    body: Any  # a Solid, or several together as Bodies
    rows: ContactRows
    parts: tuple[CondensedBody, ...]
    _unit: float  # physical displacement of a unit motion a

    @property
    def always_refined(self) -> bool:
        """Whether each displacement gets a step of refinement, that of some body at least."""
        return any(part.always_refined for part in self.parts)

    def unbalanced(self, load: Any, u: Any, mu: Array, t: Array) -> Any:
        """Forces on free dofs that nothing balances, or None where refinement gains nothing.

        Loads and displacements of all dofs are given and returned where the body computes, see
        `Solid.placed`.
        """
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
        """A vector of all dofs where a single body computes; on the host for several."""
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
        """Work of a load on the rigid motions, from the load itself, not from its elimination."""
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
        """Condensed forces on all dofs, supports at rest, in the boundary's unknowns, (nb,)."""
        pairs = zip(self.parts, self._split(forces), strict=True)
        return np.concatenate([part.carried(own) for part, own in pairs])

    def restrict(self, rows: sparse.csr_array) -> Array:
        """Rows of all dofs in the contact boundary's unknowns, shape (nrows, nb)."""
        pairs = zip(self.parts, self.body.slices, strict=True)
        return np.hstack([part.restrict(rows[:, own]) for part, own in pairs])

    def restricted_columns(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """Transpose of forces on all dofs, in those that work on the boundary's unknowns.

        Parameters
        ----------
        matrix : csr_array, shape (ndofs, n)

        Returns
        -------
        csr_array, shape (nb, n)
        """
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
        """Displacement of all dofs under forces on them and supports at rest."""
        trios = zip(self.parts, self._split(forces), self._of_boundary(z_b), strict=True)
        return together([part.moved(own, z) for part, own, z in trios])

    def rigid_motion(self, a: Array) -> tuple[str, Array]:
        """Name and all dofs of the bodies' part of a motion a of the boundary problem.

        If several bodies move, the name is that of the largest motion.
        """
        found = []
        for part, own in zip(self.parts, self._of_motion(a), strict=True):
            if own.size and own.any():
                found.append(part.motion_of(part.modes @ (self._unit * own)))
            else:
                found.append(("", np.zeros(part.body.ndofs)))
        reaches = [b.reach(u) for b, (_, u) in zip(self.body.bodies, found, strict=True)]
        k = int(np.argmax(reaches))
        return self.body.said_of(k, found[k][0]), np.concatenate([u for _, u in found])

    def _of_motion(self, a: Array) -> list[Array]:
        """The rigid motions a of each body."""
        ends = np.cumsum([part.N.shape[1] for part in self.parts])
        return np.split(a[: ends[-1]], ends[:-1])


def together(each: list[Any]) -> Any:
    """Values on all dofs from those of each body; of one body they may lie on a device."""
    return each[0] if len(each) == 1 else np.concatenate(each)
