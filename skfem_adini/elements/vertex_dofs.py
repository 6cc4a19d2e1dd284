"""The dofs at the vertices, by name, component and vertex."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.assembly.basis.abstract_basis import AbstractBasis
from skfem.element import ElementQuadBFS as ScikitFemBFS
from skfem.element import ElementVector

from skfem_adini.elements.element_hex_adini import ElementHexAdini
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.element_quad_bfs import ElementQuadBFS
from skfem_adini.errors import InputError

Indices = NDArray[np.integer]


def vertex_dofs(basis: Any, weighted: bool = False) -> Indices:
    """Return the dofs as (names, components, vertices): u, u_x, u_y (, u_z) and, for BFS, u_xy.
    BFS may be this package's or scikit-fem's, with the same dofs. Dofs of a weighted element,
    which belong to u over the weight, are returned only if `weighted`."""
    elem = scalar_element(basis)
    if not isinstance(elem, ElementQuadAdini | ElementHexAdini | ElementQuadBFS | ScikitFemBFS):
        raise InputError(
            f"basis: expected ElementQuadAdini, ElementHexAdini or ElementQuadBFS, or an "
            f"ElementVector of one, got {full_name(elem)}"
        )
    if isinstance(elem, ElementQuadAdini) and elem.dofs_of != "u" and not weighted:
        raise InputError(
            f"basis: the dofs of {type(elem).__name__} are those of {elem.dofs_of}, not of u; "
            "expected ElementQuadAdini"
        )
    nodal = basis.dofs.nodal_dofs
    return np.asarray(nodal).reshape(elem.nodal_dofs, len(nodal) // elem.nodal_dofs, -1)


def scalar_element(basis: Any) -> Any:
    """Return the element of a scikit-fem basis; for a vector field, that of a component."""
    if not isinstance(basis, AbstractBasis):
        raise InputError(f"basis: expected a scikit-fem Basis, got {type(basis).__name__}")
    return basis.elem.elem if isinstance(basis.elem, ElementVector) else basis.elem


def full_name(elem: Any) -> str:
    """Return the name of an element's class with its package; scikit-fem has a BFS class, too."""
    return f"{type(elem).__module__.partition('.')[0]}.{type(elem).__name__}"
