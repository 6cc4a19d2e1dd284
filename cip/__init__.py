"""Multi-moment semi-Lagrangian (CIP) schemes for transport and advection in 1-D, 2-D and 3-D.

`Solver` follows the characteristics of a `Velocity` backward on a `Grid` and evaluates the moments
of a `State` there by a profile; `run` gives a `Trajectory`. `SphereSolver` does it on a `Sphere`.
Every failure is a `CipError`.
"""

from cip.assimilation.analysis import Analysis
from cip.assimilation.covariance import Covariance
from cip.assimilation.four_d_var import four_d_var
from cip.assimilation.place_sensors import Placement, place_sensors
from cip.assimilation.sensors import Sensors
from cip.errors import (
    CipError,
    DivergenceWarning,
    InputError,
    LeftDomain,
    MissingDependency,
    NotConverged,
    NotFinite,
    NotSupported,
    PeriodicityWarning,
)
from cip.formulas.source import Source
from cip.formulas.spline_velocity import SplineVelocity
from cip.formulas.velocity import Velocity
from cip.grid import Grid, Sphere
from cip.inverse.identifiability import Identifiability, IdentifiabilityWarning
from cip.inverse.identified import IdentifiedVelocity, MisfitWarning
from cip.inverse.identify import identify_velocity
from cip.output.budget import Budget
from cip.output.flow_map import FlowMap, flow_map
from cip.output.level_set import area, contour, reinitialise
from cip.output.trajectory import Diagnostics, Trajectory
from cip.solver.solver import Solver
from cip.sphere.solver import SphereSolver
from cip.stages.state import State

__all__ = [
    "Analysis",
    "Budget",
    "CipError",
    "Covariance",
    "Diagnostics",
    "DivergenceWarning",
    "FlowMap",
    "Grid",
    "Identifiability",
    "IdentifiabilityWarning",
    "IdentifiedVelocity",
    "InputError",
    "LeftDomain",
    "MisfitWarning",
    "MissingDependency",
    "NotConverged",
    "NotFinite",
    "NotSupported",
    "PeriodicityWarning",
    "Placement",
    "Sensors",
    "Solver",
    "Source",
    "Sphere",
    "SphereSolver",
    "SplineVelocity",
    "State",
    "Trajectory",
    "Velocity",
    "area",
    "contour",
    "flow_map",
    "four_d_var",
    "identify_velocity",
    "place_sensors",
    "reinitialise",
]

__version__ = "1.0.0rc1"


def __dir__() -> list[str]:
    """The public names, without the submodules."""
    return [*__all__, "__version__"]
