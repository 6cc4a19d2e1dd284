"""Adini finite elements for scikit-fem."""

from importlib.metadata import version

from .adini_extension import AdiniExtension
from .assemble import assemble
from .cut_domain import BoundaryBasis, CutDomain
from .cut_polygon import Polygon
from .cut_quadrature import CutQuadrature, cut_quadrature
from .element_hex_adini import ElementHexAdini
from .element_quad_adini import ElementQuadAdini
from .element_quad_adini_cut import ElementQuadAdiniCut, UnisolvenceWarning
from .element_quad_adini_weighted import ElementQuadAdiniWeighted
from .element_quad_bfs import ElementQuadBFS
from .errors import (
    AdiniError,
    InputError,
    MissingDependency,
    NotConverged,
    ReducedOrderWarning,
    UnresolvedWarning,
)
from .essential_constraints import essential_constraints
from .essential_dofs import essential_dofs
from .ghost_penalty import ghost_penalty
from .hanging_constraints import hanging_constraints
from .level_set import FieldLevelSet, LevelSet
from .lowest_eigenpairs import lowest_eigenpairs
from .near_null_space import NearNullSpace, near_null_space
from .nitsche import nitsche
from .nodal_fields import nodal_gradient, nodal_stress, von_mises
from .output import save, to_pyvista
from .project_trace import project_trace
from .refine_eigenpair import RefinedEigenpair, refine_eigenpair
from .refined_at_boundary import refined_at_boundary
from .sparse_solve import factorize
from .uniform_solver import UniformSolver

__all__ = [
    "AdiniError",
    "AdiniExtension",
    "BoundaryBasis",
    "CutDomain",
    "CutQuadrature",
    "ElementHexAdini",
    "ElementQuadAdini",
    "ElementQuadAdiniCut",
    "ElementQuadAdiniWeighted",
    "ElementQuadBFS",
    "FieldLevelSet",
    "InputError",
    "LevelSet",
    "MissingDependency",
    "NearNullSpace",
    "NotConverged",
    "Polygon",
    "ReducedOrderWarning",
    "RefinedEigenpair",
    "UniformSolver",
    "UnisolvenceWarning",
    "UnresolvedWarning",
    "assemble",
    "cut_quadrature",
    "essential_constraints",
    "essential_dofs",
    "factorize",
    "ghost_penalty",
    "hanging_constraints",
    "lowest_eigenpairs",
    "near_null_space",
    "nitsche",
    "nodal_gradient",
    "nodal_stress",
    "project_trace",
    "refine_eigenpair",
    "refined_at_boundary",
    "save",
    "to_pyvista",
    "von_mises",
]

__version__ = version("skfem-adini")


def __dir__() -> list[str]:
    """The public names, without the modules behind them."""
    return [*__all__, "__version__"]
