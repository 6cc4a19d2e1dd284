"""Elements of scikit-fem that store the shape functions of the first mesh they were used on."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
from skfem.element import ElementGlobal, ElementVector
from skfem.mapping import Mapping


def without_functions(element: Any) -> Any:
    """The element, or a copy without its stored shape functions. An `ElementGlobal` inverts the
    matrix of its dofs once, on the first mesh, and evaluates the same functions on every other mesh
    without a warning."""
    scalar = element.elem if isinstance(element, ElementVector) else element
    if not isinstance(scalar, ElementGlobal):
        return element
    fresh = deepcopy(element)
    (fresh.elem if isinstance(fresh, ElementVector) else fresh).V = None
    return fresh


def functions_of_another_mesh(element: Any, mapping: Mapping) -> bool:
    """Whether an element has stored shape functions that are not those of the mapping's cells."""
    kept = getattr(element.elem if isinstance(element, ElementVector) else element, "V", None)
    fresh = without_functions(element)
    if kept is None or fresh is element:
        return False
    fresh = fresh.elem if isinstance(fresh, ElementVector) else fresh
    fresh.gbasis(mapping, np.zeros((mapping.mesh.dim(), 1)), 0)
    size = np.abs(fresh.V).max(axis=0)
    return kept.shape != fresh.V.shape or not np.all(np.abs(kept - fresh.V) <= 1e-8 * size)
