"""The vector element of a body, from a scalar or vector element."""

from __future__ import annotations

from typing import Any

import skfem
from skfem import Mesh
from skfem.element import Element, ElementVector

from contact.errors import InputError
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from skfem_adini.kept_functions import without_functions

_OURS = (ElementQuadAdini, ElementHexAdini, ElementQuadBFS)
GRADIENT_DOFS = (*_OURS, skfem.ElementQuadBFS)  # elements with u and its gradient at the vertices
# Default element for each class of mesh.
DEFAULT_ELEMENT = {
    "MeshTri1": skfem.ElementTriP2,
    "MeshTri2": skfem.ElementTriP2,
    "MeshQuad1": skfem.ElementQuad2,
    "MeshQuad2": skfem.ElementQuad2,
    "MeshTet1": skfem.ElementTetP1,
    "MeshTet2": skfem.ElementTetP2,
    "MeshHex1": skfem.ElementHex1,
    "MeshHex2": skfem.ElementHex2,
}


def vector_element(element: Any, mesh: Mesh) -> ElementVector:
    """An `ElementVector` of a scalar element, of the mesh's default one, or a given vector element.
    Elements of `skfem_adini` are replaced by ones without Hessian, which halves time and memory;
    elements that store functions of a mesh are copied without them."""
    if element is None:
        if type(mesh).__name__ not in DEFAULT_ELEMENT:
            raise InputError(f"element: no default for {type(mesh).__name__}; pass one")
        element = DEFAULT_ELEMENT[type(mesh).__name__]()
    if not isinstance(element, Element):
        raise InputError(
            f"element: expected one of scikit-fem's, such as ElementQuad2(), got {element!r}"
        )
    if type(element) in _OURS:
        element = type(element)(derivatives=1)
    if not isinstance(element, ElementVector):
        element = ElementVector(element)
    if element.refdom is not mesh.elem.refdom:
        fits = DEFAULT_ELEMENT.get(type(mesh).__name__)
        raise InputError(
            f"element: {type(element.elem).__name__} does not live on {type(mesh).__name__}"
            + (f"; take for instance {fits.__name__}" if fits else "")
        )
    return without_functions(element)
