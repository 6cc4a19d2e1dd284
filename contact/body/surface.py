"""A part of a body's boundary as the obstacle of another body, or of another part of this one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from contact.body.solid import Solid


@dataclass(frozen=True, eq=False)
class Surface:
    """Facets of an elastic body that another body may touch; see `ElasticBody.surface`.

    Attributes
    ----------
    body : Solid
    facets : ndarray of int, shape (n,)
        Numbers of the facets in its mesh.
    clearance : float, callable, ndarray or None
        The gap, if it is not that between the two meshes, as for `Pair`.
    """

    body: Solid
    facets: NDArray[np.int64]
    clearance: Any = None

    def __repr__(self) -> str:
        return f"Surface({self.facets.size} facets of {self.body!r})"
