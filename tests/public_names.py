"""The names that a user imports, and which of them come from nowhere but here."""

import importlib
import inspect
from typing import Any

import contact
import contact.plot
import skfem_adini
import skfem_adini.plot
from contact import InputError  # noqa: F401

PACKAGES = ("skfem_adini", "contact", "cip", "gpu")

ERRORS = {
    name
    for package in PACKAGES
    for name, thing in vars(importlib.import_module(package)).items()
    if isinstance(thing, type) and issubclass(thing, Exception)
}


def all_of_them() -> dict[str, Any]:
    """What the packages name in `__all__`, and the functions of the two modules of pictures."""
    names = {
        f"{package}.{name}": getattr(importlib.import_module(package), name)
        for package in PACKAGES
        for name in importlib.import_module(package).__all__
    }
    for module in (skfem_adini.plot, contact.plot):
        for name, thing in vars(module).items():
            if inspect.isfunction(thing) and thing.__module__ == module.__name__ and name[0] != "_":
                names[f"{module.__name__}.{name}"] = thing
    return names


# The methods that users call: all public ones of these classes, or those that are listed.
METHODS: dict[str, tuple[str, ...]] = {
    "skfem_adini.AdiniExtension": (),
    "skfem_adini.CutDomain": (),
    "skfem_adini.UniformSolver": (),
    "contact.ElasticBody": ("from_mesh", "fix", "load", "body_force"),
    "contact.CutBody": ("fix", "load", "body_force", "arc"),
    "contact.ContactProblem": ("condense", "solve"),
    "contact.ContactResult": (),
    "contact.LoadStepper": (),
    "contact.DynamicStepper": (),
    "contact.DynamicHistory": (),
    "contact.ThermalContact": (),
    "contact.ThermalResult": (),
    "contact.SurfaceMesh": (),
    "contact.Rough": (),
    "contact.GridContact": (),
    "contact.GridResult": (),
    "contact.HalfSpace": (),
    "contact.PeriodicLayers": (),
    "contact.DistributedBody": ("fix", "load", "body_force", "gather"),
    "contact.LayeredBlock": ("fix", "load", "body_force"),
    "contact.LoadHistory": (),
    "contact.DeformedBody": (),
    "contact.NonlinearHistory": (),
    "contact.NonlinearResult": (),
    "contact.NonlinearStepper": (),
    "cip.Grid": (),
    "cip.Source": ("from_expression", "from_snapshots", "with_parameters"),
    "cip.Velocity": ("from_expression", "from_snapshots", "from_xarray", "with_parameters"),
    "cip.State": (),
    "cip.Solver": ("tangent", "adjoint"),
    "cip.Trajectory": (),
    "cip.Sensors": (),
    "cip.IdentifiedVelocity": (),
    "gpu.LQRResult": (),
    "gpu.DLQRResult": (),
    "gpu.LowRankValue": (),
}

# Without a source in the literature: why, and which names.
_REASONS = {
    "holds what was given, or what a function with a source returned": """
        skfem_adini.BoundaryBasis skfem_adini.CutDomain skfem_adini.CutQuadrature
        skfem_adini.FieldLevelSet skfem_adini.LevelSet skfem_adini.NearNullSpace skfem_adini.Polygon
        skfem_adini.RefinedEigenpair contact.ContactResult contact.CrossCheck contact.Iteration
        contact.BodyResult contact.GridResult contact.Surface contact.LoadHistory contact.LoadStep
        contact.NonlinearHistory contact.NonlinearResult contact.DeformedBody
        contact.DynamicHistory contact.DynamicStep
        contact.Status contact.Slice contact.ThermalResult
        contact.Uniqueness cip.Budget cip.Diagnostics cip.Sensors
        cip.Placement
        cip.Grid cip.Identifiability cip.IdentifiedVelocity cip.Source cip.State cip.Trajectory
        cip.Sphere cip.Velocity
        gpu.KKT gpu.LQRResult gpu.DLQRResult gpu.QPFactor
        gpu.QPBatch gpu.QPResult gpu.Status gpu.Step""",
    "geometry of school": """
        contact.ClosestPoint contact.Cylinder contact.Moved contact.Plane contact.Rigid
        contact.Sphere""",
    "follows from the dofs of the elements, whose docstrings have the source": """
        skfem_adini.essential_constraints skfem_adini.essential_dofs skfem_adini.hanging_constraints
        skfem_adini.nodal_gradient skfem_adini.nodal_stress skfem_adini.project_trace""",
    "a way of computing: classes of cells, refinement, bodies, one factor for many": """
        skfem_adini.CongruentCells
        skfem_adini.assemble skfem_adini.refined_at_boundary contact.CutBody contact.ElasticBody
        contact.DistributedBody
        contact.LayeredBlock gpu.batch_solve_qp""",
    "compares or searches; the bound F* is derived where it is computed": """
        contact.cross_check contact.uniqueness""",
    "files, pictures and other packages": """
        skfem_adini.save skfem_adini.to_pyvista skfem_adini.plot.plot_shape_function
        skfem_adini.plot.plot_matrix skfem_adini.plot.plot_cut_domain
        skfem_adini.plot.plot_cut_field contact.plot.plot_tractions contact.plot.plot_pressure
        contact.plot.face_pressure contact.plot.plot_field contact.plot.plot_cells
        contact.plot.draw_edges contact.save_pvtu gpu.register_qpsolvers""",
}
OURS = {name: reason for reason, names in _REASONS.items() for name in names.split()}
