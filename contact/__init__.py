"""Frictional contact of elastic bodies with rigid obstacles, on scikit-fem."""

from importlib.metadata import version

from contact.body import ElasticBody
from contact.condense import CondensedContact
from contact.cross_check import CrossCheck, cross_check
from contact.cut_body import CutBody
from contact.errors import (
    ContactError,
    ContactWarning,
    Infeasible,
    InputError,
    MissingDependency,
    NotConverged,
    Unbounded,
)
from contact.layered_block import LayeredBlock
from contact.load_history import LoadHistory, LoadStep
from contact.load_stepper import LoadStepper
from contact.newton import Iteration
from contact.obstacles import ClosestPoint, Cylinder, Parabola, Plane, Sphere
from contact.problem import ContactProblem
from contact.result import ContactResult, Status
from contact.rigid import Rigid
from contact.signed_distance import SignedDistance
from contact.uniqueness import Uniqueness, uniqueness

__all__ = [
    "ClosestPoint",
    "CondensedContact",
    "ContactError",
    "ContactProblem",
    "ContactResult",
    "ContactWarning",
    "CrossCheck",
    "CutBody",
    "Cylinder",
    "ElasticBody",
    "Infeasible",
    "InputError",
    "Iteration",
    "LayeredBlock",
    "LoadHistory",
    "LoadStep",
    "LoadStepper",
    "MissingDependency",
    "NotConverged",
    "Parabola",
    "Plane",
    "Rigid",
    "SignedDistance",
    "Sphere",
    "Status",
    "Unbounded",
    "Uniqueness",
    "cross_check",
    "uniqueness",
]

__version__ = version("skfem-adini")


def __dir__() -> list[str]:
    """The public names, without the modules behind them."""
    return [*__all__, "__version__"]
