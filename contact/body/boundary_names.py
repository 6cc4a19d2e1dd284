"""Facets of named boundaries, and numbers of named displacement components."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import Mesh

from contact.errors import InputError, array_of

_AXES = "xyz"


def select_facets(mesh: Mesh, boundary: str | Sequence[str] | ArrayLike) -> NDArray[np.int64]:
    """Facet numbers of a named boundary, of several, or of an array of facet numbers."""
    names = [boundary] if isinstance(boundary, str) else boundary
    if isinstance(names, (list, tuple)) and all(isinstance(name, str) for name in names):
        known = mesh.boundaries or {}
        for name in names:
            if name not in known:
                raise InputError(
                    f"boundary {name!r} is unknown; the mesh names {sorted(known) or 'none'} "
                    "(mesh.with_boundaries or mesh.with_defaults adds names)"
                )
        found = [np.asarray(known[name], dtype=np.int64) for name in names]
        facets = np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.int64)
    else:
        numbers = array_of("boundary", boundary)
        if numbers.size and numbers.dtype.kind not in "iu":
            raise InputError(
                f"boundary={boundary!r}: expected a name, names, or whole facet numbers"
            )
        facets = np.unique(numbers.astype(np.int64))
        if facets.size and not (facets[0] >= 0 and facets[-1] < mesh.nfacets):
            raise InputError(f"boundary: facet numbers must lie in 0..{mesh.nfacets - 1}")
    if facets.size == 0:
        raise InputError(f"boundary {boundary!r} has no facets")
    if np.any(mesh.f2t[1, facets] != -1):
        raise InputError(f"boundary {boundary!r} holds facets inside the body")
    return facets


def select_components(dim: int, components: str | int | Sequence[int] | None) -> list[int]:
    """Component numbers of "x", "xy", 1, (0, 2) or None (all)."""
    if components is None:
        return list(range(dim))
    if isinstance(components, str):
        numbers = [_AXES.find(letter) for letter in components]
    else:
        given = np.atleast_1d(array_of("components", components))
        numbers = [int(c) for c in given] if given.dtype.kind in "iu" else []
    if not numbers or any(c < 0 or c >= dim for c in numbers):
        raise InputError(
            f"components={components!r}: expected letters of {_AXES[:dim]!r} or numbers below {dim}"
        )
    return sorted(set(numbers))
