"""What the local matrix of a cell depends on, judged from the element and the mapping."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.element import Element, ElementComposite, ElementDG, ElementGlobal, ElementVector
from skfem.mapping import MappingAffine, MappingIsoparametric

from skfem_adini.elements.element_hex_adini import ElementHexAdini
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.element_quad_bfs import ElementQuadBFS

_OURS = (ElementQuadAdini, ElementHexAdini, ElementQuadBFS)


def leaves(element: Any) -> list[Any]:
    """Return the elements that an element is composed of, itself if it is not composed."""
    if type(element) in (ElementVector, ElementDG):
        return leaves(element.elem)
    if type(element) is ElementComposite:
        return [leaf for part in element.elems for leaf in leaves(part)]
    return [element]


def why_not_element(element: Any) -> str | None:
    """Say why an element's functions may depend on more than shape and orientation, else None.
    Elements of scikit-fem use only the mapping's derivative and ``orient``, but for global
    functionals; the ``gbasis`` of another package may use anything."""
    for leaf in leaves(element):
        author = type(leaf).gbasis.__module__
        known = type(leaf) in _OURS or author.startswith("skfem.element.")
        if not known or isinstance(leaf, ElementGlobal) or "gbasis" in vars(leaf):
            return f"functions of {type(leaf).__name__} may depend on the place of a cell"
    return None


def why_not_mapping(mapping: Any, mesh: Any) -> str | None:
    """Say why a mapping may depend on more than differences of a cell's nodes, else None."""
    standard = type(mapping) in (MappingAffine, MappingIsoparametric)
    if not standard or getattr(mapping, "tind", None) is not None:
        return f"the mapping is a {type(mapping).__name__} that is not the usual one"
    if mapping.mesh is not mesh and mapping.mesh.t.shape[1] != mesh.t.shape[1]:
        return "the mapping has other cells than the mesh"
    return None


def oriented(element: Any) -> list[Any]:
    """Return the leaves whose functions depend on the orientation of facets or edges."""
    return [leaf for leaf in leaves(element) if type(leaf).orient is not Element.orient]


def orientations(elements: Iterable[Any], mapping: Any) -> NDArray[np.uint64]:
    """Return the signs of the facets or edges of each cell as bits, shape (cells, words)."""
    signs = [
        np.asarray(leaf.orient(mapping, i)) > 0
        for element in elements
        for leaf in oriented(element)
        for i in range(int(leaf._bfun_counts().sum()))
    ]
    words = np.zeros((mapping.mesh.t.shape[1], -(-len(signs) // 64)), dtype=np.uint64)
    for i, sign in enumerate(signs):
        words[:, i // 64] |= sign.astype(np.uint64) << np.uint64(i % 64)
    return words
