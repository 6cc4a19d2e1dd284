"""The vector element of a body, from what the caller gave."""

from __future__ import annotations

from typing import Any

import skfem
from skfem import Mesh
from skfem.element import Element, ElementVector

from contact.errors import InputError
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

_OURS = (ElementQuadAdini, ElementHexAdini, ElementQuadBFS)
# Elements with u and its gradient at the vertices; scikit-fem has a class ElementQuadBFS as well.
GRADIENT_DOFS = (*_OURS, skfem.ElementQuadBFS)


def vector_element(element: Any, mesh: Mesh) -> ElementVector:
    """Return an `ElementVector` of a scalar element, or the vector element itself.

    Our scalar elements are made anew without Hessian: `ElementVector` would copy it into every
    function, twice the time and the memory, and strains need none.

    Raises
    ------
    InputError
        No element, or one that does not live on the cells of the mesh.
    """
    if not isinstance(element, Element):
        raise InputError(
            f"element: expected one of scikit-fem's, such as ElementQuad2(), got {element!r}"
        )
    if type(element) in _OURS:
        element = type(element)(derivatives=1)
    if not isinstance(element, ElementVector):
        element = ElementVector(element)
    if element.refdom is not mesh.elem.refdom:
        raise InputError(
            f"element: {type(element.elem).__name__} does not live on {type(mesh).__name__}"
        )
    return element
