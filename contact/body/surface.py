"""A part of a body's boundary as the obstacle of another body, or of another part of this one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


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

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body.surface("top").facets.size
    4
    """

    body: Any
    facets: NDArray[np.int64]
    clearance: Any = None

    def __repr__(self) -> str:
        return f"Surface({self.facets.size} facets of {self.body!r})"
