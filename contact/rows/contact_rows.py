"""Contact rows: normal and tangential displacement at contact points, linear in the dofs."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class ContactRows:
    """The contact boundary, discretised: m points, each with a normal and dim - 1 tangents."""

    G: sparse.csr_array  # G u = u_n along the outward normal of the body, shape (m, ndofs)
    T: sparse.csr_array  # tangential, point by point, shape (m * (dim - 1), ndofs)
    gap: Array  # gap d by the same functional, inf without obstacle, shape (m,)
    weights: Array  # length or area: force over weight is a pressure, shape (m,)
    x: Array  # centroids of the dual functions, where pressure is reported, (dim, m)
    x_nominal: Array  # nominal places, such as vertices, shape (dim, m)
    normals: Array  # outward unit normals, shape (dim, m)
    tangents: Array  # unit tangents, shape (dim, dim - 1, m)
    functional: str  # name; several names joined by commas
    # number of the contact boundary of each point, (m,); empty if there is only one
    part: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    # points tied at u_n = d, u_t = 0, forces of any sign, (m,); empty if there are none
    bonded: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    # number of the body of each point, (m,); empty if there is only one
    owner: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    # directions of unit forces between two bodies: mean normal, tangents, (m, dim, dim); or empty
    axes: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))

    @property
    def ties(self) -> NDArray[np.bool_]:
        """The mask `bonded`, all False if it is empty, shape (m,)."""
        return self.bonded if self.bonded.size else np.zeros(self.gap.size, dtype=bool)

    @property
    def boundary(self) -> NDArray[np.int64]:
        """The numbers `part`, all zero if it is empty, shape (m,)."""
        return self.part if self.part.size else np.zeros(self.gap.size, dtype=np.int64)

    @cached_property
    def spacing(self) -> Array:
        """Distance of each point to the nearest one of its boundary, ``inf`` if it is the only
        one."""
        found = np.full(self.gap.size, np.inf)
        for k in np.unique(self.boundary):
            own = np.flatnonzero(self.boundary == k)
            places = self.x_nominal[:, own].T
            if own.size > 1:
                found[own] = np.asarray(scipy.spatial.KDTree(places).query(places, 2)[0])[:, 1]
        return found


def refuse_other_points(rows: ContactRows, of_last: ContactRows) -> None:
    """Raise an `InputError` unless the last step has the same contact points and tangents."""
    if of_last.T is rows.T:
        return
    # Points and tangents are equal if they differ by less than 1e-9.
    size = float(np.ptp(rows.x_nominal, axis=1).max())
    for name, ours, theirs, unit in (
        ("places", rows.x_nominal, of_last.x_nominal, size),
        ("tangents", rows.tangents, of_last.tangents, 1.0),
    ):
        if ours.shape != theirs.shape or np.abs(ours - theirs).max() > 1e-9 * unit:
            raise InputError(
                f"after: a result whose {of_last.gap.size} contact points have other {name} than "
                f"the {rows.gap.size} of this problem is no step of its history"
            )
