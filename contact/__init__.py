"""Frictional contact of elastic bodies, with each other and with rigid obstacles."""

from contact.body.anisotropic import Anisotropic, Orthotropic
from contact.body.cut_body import CutBody
from contact.body.distributed_body import DistributedBody
from contact.body.elastic_body import ElasticBody
from contact.body.layers.layered_block import LayeredBlock
from contact.body.solid import Surface
from contact.checks.cross_check import CrossCheck, cross_check
from contact.checks.recheck import recheck
from contact.checks.uniqueness import Uniqueness, uniqueness
from contact.condensation.condensed_contact import CondensedContact
from contact.derivatives.gradient import BodyGradient, ContactGradient
from contact.derivatives.history_gradient import HistoryGradient
from contact.errors import (
    ContactError,
    ContactWarning,
    Infeasible,
    InputError,
    JumpWarning,
    LargeMotionWarning,
    MissingDependency,
    NoEquilibrium,
    NotConverged,
    Unbounded,
)
from contact.histories.dynamic_history import DynamicHistory, DynamicStep
from contact.histories.dynamic_stepper import DynamicStepper
from contact.histories.load_history import LoadHistory, LoadStep
from contact.histories.load_stepper import LoadStepper
from contact.laws.adhesion import Adhesion
from contact.laws.iteration import Iteration
from contact.laws.pressure_overclosure import PressureOverclosure
from contact.laws.status import Status
from contact.laws.wear import Wear
from contact.nonlinear.deformed_body import DeformedBody
from contact.nonlinear.nonlinear_body import NonlinearBody
from contact.nonlinear.nonlinear_result import NonlinearHistory, NonlinearResult
from contact.nonlinear.nonlinear_stepper import NonlinearStepper
from contact.nonlinear.point_laws import (
    FinitePlasticity,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Plasticity,
    SaintVenant,
    Viscous,
)
from contact.obstacles.rigid import Rigid
from contact.obstacles.rough import Rough, self_affine
from contact.obstacles.shapes import ClosestPoint, Cone, Cylinder, Moved, Parabola, Plane, Sphere
from contact.obstacles.signed_distance import SignedDistance
from contact.obstacles.surface_mesh import SurfaceMesh
from contact.problem.contact_problem import ContactProblem
from contact.result.body_result import BodyResult
from contact.result.contact_result import ContactResult, save_pvtu
from contact.rows.pairs import Pair, Tie
from contact.spectral import condensed_waves as _condensed_waves  # noqa: F401 -- registers its bodies
from contact.spectral import mirrored_factor as _mirrored_factor  # noqa: F401 -- likewise
from contact.spectral.contact_edge import ContactEdge
from contact.spectral.grid_contact import GridContact
from contact.spectral.grid_result import GridResult
from contact.spectral.half_space import HalfSpace
from contact.spectral.periodic_layers import PeriodicLayers
from contact.spectral.slices import Slice
from contact.thermal.thermal_contact import ThermalContact
from contact.thermal.thermal_result import ThermalResult

__all__ = [
    "Adhesion",
    "Anisotropic",
    "BodyGradient",
    "BodyResult",
    "ClosestPoint",
    "CondensedContact",
    "Cone",
    "ContactEdge",
    "ContactError",
    "ContactGradient",
    "ContactProblem",
    "ContactResult",
    "ContactWarning",
    "CrossCheck",
    "CutBody",
    "Cylinder",
    "DeformedBody",
    "DistributedBody",
    "DynamicHistory",
    "DynamicStep",
    "DynamicStepper",
    "ElasticBody",
    "FinitePlasticity",
    "GridContact",
    "GridResult",
    "HalfSpace",
    "HistoryGradient",
    "Infeasible",
    "InputError",
    "Iteration",
    "JumpWarning",
    "LargeMotionWarning",
    "LayeredBlock",
    "LoadHistory",
    "LoadStep",
    "LoadStepper",
    "MissingDependency",
    "MooneyRivlin",
    "Moved",
    "NeoHooke",
    "NoEquilibrium",
    "NonlinearBody",
    "NonlinearHistory",
    "NonlinearResult",
    "NonlinearStepper",
    "NotConverged",
    "Ogden",
    "Orthotropic",
    "Pair",
    "Parabola",
    "PeriodicLayers",
    "Plane",
    "Plasticity",
    "PressureOverclosure",
    "Rigid",
    "Rough",
    "SaintVenant",
    "SignedDistance",
    "Slice",
    "Sphere",
    "Status",
    "Surface",
    "SurfaceMesh",
    "ThermalContact",
    "ThermalResult",
    "Tie",
    "Unbounded",
    "Uniqueness",
    "Viscous",
    "Wear",
    "cross_check",
    "recheck",
    "save_pvtu",
    "self_affine",
    "uniqueness",
]

__version__ = "1.0.0rc1"


def __dir__() -> list[str]:
    """The public names, without the modules behind them."""
    return [*__all__, "__version__"]
