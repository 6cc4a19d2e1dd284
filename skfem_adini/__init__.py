"""Adini finite elements for scikit-fem."""

from .element_quad_adini import ElementQuadAdini
from .errors import AdiniError, InputError, MissingDependency, ReducedOrderWarning
from .essential_constraints import essential_constraints
from .essential_dofs import essential_dofs
from .output import save, to_pyvista
from .project_trace import project_trace

__all__ = [
    "AdiniError",
    "ElementQuadAdini",
    "InputError",
    "MissingDependency",
    "ReducedOrderWarning",
    "essential_constraints",
    "essential_dofs",
    "project_trace",
    "save",
    "to_pyvista",
]
