"""The public names of `skfem_adini`, which load scikit-fem."""

from skfem_adini.assembly.affine_cells import AffineCells
from skfem_adini.assembly.assemble import assemble
from skfem_adini.assembly.congruent_cells import CongruentCells
from skfem_adini.conditions.essential_constraints import essential_constraints, essential_dofs
from skfem_adini.conditions.hanging_constraints import hanging_constraints
from skfem_adini.conditions.project_trace import project_trace
from skfem_adini.curved.adini_extension import AdiniExtension
from skfem_adini.curved.boundary_basis import BoundaryBasis
from skfem_adini.curved.cut_domain import CutDomain
from skfem_adini.curved.element_quad_adini_cut import ElementQuadAdiniCut, UnisolvenceWarning
from skfem_adini.curved.element_quad_adini_weighted import ElementQuadAdiniWeighted
from skfem_adini.curved.ghost_penalty import ghost_penalty
from skfem_adini.curved.nitsche import nitsche
from skfem_adini.curved.quadrature.cut_quadrature import CutQuadrature, cut_quadrature
from skfem_adini.curved.quadrature.level_set import FieldLevelSet, LevelSet
from skfem_adini.curved.quadrature.polygon import Polygon
from skfem_adini.curved.refined_at_boundary import refined_at_boundary
from skfem_adini.elements.element_hex_adini import ElementHexAdini
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.element_quad_bfs import ElementQuadBFS
from skfem_adini.errors import (
    AdiniError,
    IndefiniteWarning,
    InputError,
    MissingDependency,
    NotConverged,
    ReducedOrderWarning,
    UnresolvedWarning,
)
from skfem_adini.ground.jit import state_of
from skfem_adini.output.nodal_fields import nodal_gradient, nodal_stress, von_mises
from skfem_adini.output.vtk_fields import save, to_pyvista
from skfem_adini.solvers.factorize import factorize
from skfem_adini.solvers.lowest_eigenpairs import lowest_eigenpairs
from skfem_adini.solvers.multigrid import NearNullSpace
from skfem_adini.solvers.near_null_space import near_null_space
from skfem_adini.solvers.refine_eigenpair import RefinedEigenpair, refine_eigenpair
from skfem_adini.uniform.solver import UniformSolver

__all__ = [
    "AdiniError",
    "AdiniExtension",
    "AffineCells",
    "BoundaryBasis",
    "CongruentCells",
    "CutDomain",
    "CutQuadrature",
    "ElementHexAdini",
    "ElementQuadAdini",
    "ElementQuadAdiniCut",
    "ElementQuadAdiniWeighted",
    "ElementQuadBFS",
    "FieldLevelSet",
    "IndefiniteWarning",
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

# Now: the files may change before the first kernel is compiled.
state_of("skfem_adini")
