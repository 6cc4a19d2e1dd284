"""Contact rows: normal and tangential displacement of a boundary as sparse functionals."""

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
    """The contact boundary, discretised: m points, each with a normal and dim - 1 tangents.

    Attributes
    ----------
    G : csr_array, shape (m, ndofs)
        ``G u`` is the normal displacement u_n along the outward normal of the body.
    T : csr_array, shape (m * (dim - 1), ndofs)
        Tangential displacement; the rows of one point are consecutive.
    gap : ndarray, shape (m,)
        The gap d under the same functional; ``inf`` where there is no obstacle.
    weights : ndarray, shape (m,)
        Length or area of each point: a multiplier (a force) over its weight is a pressure.
    x : ndarray, shape (dim, m)
        Mean place of the functional's dual function: where the pressure is reported.
    x_nominal : ndarray, shape (dim, m)
        Nominal place of the functional on the boundary, for instance a vertex.
    normals : ndarray, shape (dim, m)
        Outward unit normals of the body.
    tangents : ndarray, shape (dim, dim - 1, m)
        Unit tangents.
    functional : str
        Name of the functional; of several boundaries the different names, joined by commas.
    part : ndarray of int, shape (m,)
        Number of the contact boundary of each point; empty where there is one only.
    bonded : ndarray of bool, shape (m,)
        Points tied to the obstacle at the gap d, ``u_n = d`` and ``u_t = 0``, with forces of either
        sign in every component and without friction; empty where no point is.
    owner : ndarray of int, shape (m,)
        Number of the body on whose boundary each point lies; empty where there is one body only.
    axes : ndarray, shape (m, dim, dim)
        Means of the normal and of the tangents under each functional: the directions in which unit
        forces act. Where bodies touch each other, else empty.
    """

    G: sparse.csr_array
    T: sparse.csr_array
    gap: Array
    weights: Array
    x: Array
    x_nominal: Array
    normals: Array
    tangents: Array
    functional: str
    part: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    bonded: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    owner: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    axes: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))

    @property
    def ties(self) -> NDArray[np.bool_]:
        """The mask `bonded`, all False where it is empty, shape (m,)."""
        return self.bonded if self.bonded.size else np.zeros(self.gap.size, dtype=bool)

    @cached_property
    def spacing(self) -> Array:
        """Distance of each point to the next one of its boundary, ``inf`` where it is alone."""
        found = np.full(self.gap.size, np.inf)
        part = self.part if self.part.size else np.zeros(self.gap.size, dtype=np.int64)
        for k in np.unique(part):
            own = np.flatnonzero(part == k)
            places = self.x_nominal[:, own].T
            if own.size > 1:
                found[own] = np.asarray(scipy.spatial.KDTree(places).query(places, 2)[0])[:, 1]
        return found


def refuse_other_points(rows: ContactRows, of_last: ContactRows) -> None:
    """Raise an `InputError` unless the last step has the same contact points and tangents."""
    if of_last.T is rows.T:
        return
    # Places and tangents are the same if they differ by rounding, 1e-9, only.
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
