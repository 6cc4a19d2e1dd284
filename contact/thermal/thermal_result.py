"""Temperatures, heat fluxes and the contact under them, with a certificate of both."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Basis

from contact.errors import InputError
from contact.output.archive import (
    from_arrays,
    head,
    loosened,
    named_archive,
    to_arrays,
    unproved,
)
from contact.output.pictures import axes_of, draw_faces, scale_colours
from contact.result.certify import as_lines
from contact.result.contact_fields import as_text, counts
from contact.result.contact_result import ContactResult
from contact.result.stored_result import problem_arrays, rebuild, state_arrays
from contact.thermal.film import Film
from contact.thermal.heat_system import Before, HeatSystem
from skfem_adini import to_pyvista
from skfem_adini.ground.archives import read_arrays, reading, words, write_arrays

Array = NDArray[np.float64]
_FORMAT = 1


@dataclass(frozen=True, eq=False, repr=False)
class ThermalResult:
    """Temperature and contact of a steady state, or of one step in time.

    Temperatures have the unit of those given; heat is per time, in 2-D per unit depth.

    Attributes
    ----------
    contact : ContactResult
        Displacement, pressure, ... under the thermal strain of this temperature.
    T : ndarray, shape (n,)
        Temperature of all dofs of all bodies; see `temperature`.
    system : HeatSystem
        The equations of heat, without the conductance.
    conductance : ndarray, shape (m,)
        Of each contact point, heat per area, time and temperature.
    power : ndarray, shape (m,)
        Heat of friction of each contact point per time.
    time : float
        NaN for a steady state.
    history : tuple of float
        Largest change of conductances and of the heat of friction in each iteration, relative to
        the largest of them.
    gain : float
        Of a steady state: the largest real part of the factors (eigenvalues) by which small changes
        of the conductances come back through temperatures and pressures; NaN if not computed. With
        a factor above 1 the state is unstable, such as that between the two stable states of
        Barber's rod; disturbances that swing as they grow may escape it, not `ThermalContact.run`.
    tol : float
        Tolerance of the certificate.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, ThermalContact
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("top", "xy", -0.01)
    >>> problem = ContactProblem(body, "bottom", 0.0)
    >>> model = ThermalContact(problem, 2.0, 3.0, obstacle_temperature=0.0)
    >>> result = model.fix("top", 5.0).solve()
    >>> print(result.flux.round(9).min(), round(result.balance()["prescribed"], 9))
    6.0 6.0
    """

    contact: ContactResult
    T: Array
    system: HeatSystem
    conductance: Array
    power: Array
    time: float = np.nan
    history: tuple[float, ...] = ()
    gain: float = np.nan
    tol: float = 1e-10

    def __repr__(self) -> str:
        low, high = self._range
        return f"ThermalResult(temperature {low:.6g} to {high:.6g}; {counts(self.contact)})"

    @property
    def _range(self) -> tuple[float, float]:
        values = self.T[self.system.values > 0]
        return float(values.min()), float(values.max())

    @property
    def temperature(self) -> tuple[Array, ...]:
        """Temperature of each body by the dofs of its scalar element, shapes (ndofs / dim,)."""
        return tuple(np.split(self.T, self.system.ends[1:-1]))

    def at_vertices(self, body: Any = 0) -> Array:
        """Temperature at the vertices of the mesh of one body.

        Parameters
        ----------
        body : Solid, int or str
            A body of the problem, its number, or its name.

        Returns
        -------
        ndarray, shape (nvertices,)
        """
        k = self.contact.solid.number_of(body)
        return self.temperature[k][self.contact.solid.bodies[k].scalar_dofs.nodal_dofs[0]]

    def sample(self, points: Any, body: Any = 0) -> Array:
        """Temperature at points of one body, by the interpolation of its element.

        Parameters
        ----------
        points : array, shape (dim, npoints)
        body : Solid, int or str
            A body of the problem, its number, or its name.

        Returns
        -------
        ndarray, shape (npoints,)

        Raises
        ------
        InputError
            Points of another shape, or outside the body.
        """
        one, T = self.contact[body], self.temperature[self.contact.solid.number_of(body)]
        unit = np.eye(one.body.dim)[0]  # as a displacement along x, of the same element
        return np.asarray(one.body.displacement(np.kron(T, unit), one._points(points))[0])

    @property
    def jump(self) -> Array:
        """Mean jump of the temperature at each contact point, first minus other side, (m,)."""
        return self.system.film.jump(self.T) / self.system.film.weights

    @property
    def flux(self) -> Array:
        """Heat per area and time through each contact point to the other side, shape (m,)."""
        return self.conductance * self.jump

    @property
    def friction_flux(self) -> Array:
        """Heat of friction per area and time at each contact point, on both sides, shape (m,)."""
        return self.power / self.system.film.weights

    @property
    def heat(self) -> Array:
        """Heat per time through each contact boundary to the other side, (nboundaries,)."""
        through = self.flux * self.system.film.weights
        return np.asarray(np.bincount(self.contact.part, through), dtype=np.float64)

    def balance(self, body: Any = None) -> dict[str, float]:
        """Heat per time into a body, or all bodies together, by where it comes from.

        In a step in time the mean of the step, as the method counts it.

        Parameters
        ----------
        body : Solid, int or str, optional

        Returns
        -------
        dict
            "prescribed" through boundaries of given temperature; "sources" with inflow;
            "convection"; "contact" with obstacles and, for one body, other bodies; "friction";
            "stored", what warms the body; "error", what is missing in their sum, relative to the
            sum of their moduli.
        """
        k = None if body is None else self.contact.solid.number_of(body)
        return self.system.balance(self.T, self.conductance, self.power, k)

    @property
    def kkt(self) -> dict[str, float]:
        """Relative residuals of both fields, recomputed together.

        Those of `ContactResult.kkt` under the thermal strain of `T`; "heat", the largest heat
        missing at a dof over the largest sum of moduli, with conductances and heat of friction of
        this contact; "temperature", the deviation from prescribed temperatures.
        """
        low, high = self._range
        off = self.system.T0 + self.system.P @ (self.system.P.T @ self.T) - self.T
        size = max(high - low, float(np.abs(self.system.T0).max(initial=0.0))) or 1.0
        found = {"temperature": float(np.abs(off).max()) / size}
        if not self.system.initial:
            found["heat"] = self.system.residual(self.T, self.conductance, self.power)
        return self.contact.kkt | found

    def certificate(self) -> str:
        """One line for each residual of `kkt`.

        Returns
        -------
        str
        """
        return as_lines(self.kkt)

    def summary(self) -> str:
        """Temperatures, heat, contact and residuals, in some lines.

        Returns
        -------
        str
        """
        kkt, (low, high), balance = self.kkt, self._range, self.balance()
        worst = max(kkt, key=lambda name: kkt[name])
        rows = {
            "time": "steady" if np.isnan(self.time) else f"{self.time:.6g}",
            "temperature": f"{low:.6g} to {high:.6g}",
            "contact": counts(self.contact),
            "heat through contact": ", ".join(f"{q:.6g}" for q in self.heat),
            "heat in": ", ".join(f"{k} {v:.6g}" for k, v in balance.items() if k != "error"),
            "balance": f"{balance['error']:.1e} of the heat is missing",
            "iterations": f"{len(self.history)}, last change {self.history[-1]:.1e}"
            if self.history
            else "none, the temperature does not act on the contact",
            "stability": self._stability,
            "certificate": f"no residual above {kkt[worst]:.1e} ({worst})",
        }
        return as_text(rows, type(self).__name__)

    @property
    def _stability(self) -> str:
        if np.isnan(self.gain):
            return "not computed"
        word = "unstable" if self.gain > 1 else "no disturbance grows steadily"
        return f"{word} (gain {self.gain:.4g})"

    def _scalar_basis(self, k: int) -> Any:
        body = self.contact.solid.bodies[k]
        return Basis(body.mesh, body.element, body.basis.mapping, dofs=body.scalar_dofs)

    def to_pyvista(self, subdivide: int | None = None) -> Any:
        """What `ContactResult.to_pyvista` gives, with the field "temperature".

        Parameters
        ----------
        subdivide : int, optional
            As for `ContactResult.to_pyvista`.

        Returns
        -------
        pyvista.UnstructuredGrid or pyvista.MultiBlock

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        found = self.contact.to_pyvista(subdivide)
        several = len(self.temperature) > 1
        for k, T in enumerate(self.temperature):
            scalar = to_pyvista(self._scalar_basis(k), {"temperature": T}, subdivide=subdivide)
            grid = found[k] if several else found
            grid.point_data["temperature"] = scalar.point_data["temperature"]
        return found

    def boundary_to_pyvista(self) -> Any:
        """Contact points as `ContactResult.boundary_to_pyvista` has them, with fields of heat.

        Returns
        -------
        pyvista.PolyData
            Also with "heat_flux", "friction_flux", "conductance" and "temperature_jump".

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        found = self.contact.boundary_to_pyvista()
        for name in ("friction_flux", "conductance"):
            found.point_data[name] = getattr(self, name)
        found.point_data["heat_flux"], found.point_data["temperature_jump"] = self.flux, self.jump
        return found

    def plot(self, ax: Any = None) -> Any:
        """Temperature of all bodies in 2-D, or on their surfaces in 3-D.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            In 3-D with ``projection="3d"``; new ones by default.

        Returns
        -------
        matplotlib Axes

        Raises
        ------
        InputError
            Not axes.
        """
        drawn = _surfaces if self.contact.solid.dim == 3 else _plane
        return drawn(self, ax)

    def save(self, path: str | Path) -> Path:
        """Write the result, problem included, to one compressed file; see `load`.

        Parameters
        ----------
        path : str or Path
            Ends in .npz, which is added to a name that has no suffix.

        Returns
        -------
        Path

        Raises
        ------
        InputError
            Another suffix, or a result that cannot be stored.
        """
        file, contact, heat = named_archive(path), self.contact, self.system
        about = {"kind": "ThermalResult", "format": _FORMAT, "time": self.time, "gain": self.gain}
        about |= {"history": self.history, "tol": self.tol, "initial": heat.initial}
        parts = {name: getattr(self, name) for name in ("T", "conductance", "power")}
        arrays = to_arrays(problem_arrays(contact.system) | state_arrays(contact), "contact/")
        arrays |= to_arrays(parts) | to_arrays(vars(heat) | _NO_PARTS, "heat/")
        arrays |= to_arrays(vars(heat.film), "film/") | {"about": words(about)}
        if heat.before is not None:
            arrays |= to_arrays(heat.before._asdict(), "before/")
        return write_arrays(file, arrays)

    @classmethod
    def load(cls, path: str | Path) -> ThermalResult:
        """Read a file written by `save`, and certify it anew.

        The contact is rebuilt and certified as by `ContactResult.load`, the heat from the matrices
        in the file; conductances are numbers there, for functions are not stored.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        ThermalResult

        Raises
        ------
        InputError
            The file does not exist, is damaged, changed or of another kind, or its solution does
            not solve its problem.
        """
        file = named_archive(path)
        arrays, _ = read_arrays(file)
        with reading(file):
            reads = f"format {_FORMAT}"
            about = head(arrays, "ThermalResult", (_FORMAT,), "with", reads)
            of = {n.removeprefix("contact/"): a for n, a in arrays.items() if n[:8] == "contact/"}
            system = _heat_from(arrays, about["initial"])
            parts = from_arrays(arrays, ("T", "conductance", "power"))
        contact = ContactResult(**vars(rebuild(file, of, True)))
        more = {name: about[name] for name in ("time", "gain", "tol")}
        result = cls(contact, **parts, system=system, history=tuple(about["history"]), **more)
        if not max(result.kkt.values()) <= loosened(result.tol):
            raise InputError(f"{unproved(file)}:\n{result.certificate()}")
        return result


_NO_PARTS = {"film": None, "before": None, "initial": None}


def _heat_from(arrays: dict[str, Any], initial: bool) -> HeatSystem:
    def part(kind: Any, prefix: str) -> dict[str, Any]:
        names = [f.name for f in fields(kind)] if kind is not Before else list(Before._fields)
        return from_arrays(arrays, names, prefix)

    before = part(Before, "before/")
    if before:
        before |= {name: float(before[name]) for name in ("dt", "theta")}
    system = HeatSystem(**part(HeatSystem, "heat/"), film=Film(**part(Film, "film/")))
    return replace(system, before=Before(**before) if before else None, initial=initial)


def _plane(result: ThermalResult, ax: Any) -> Any:
    """Temperature on the meshes of bodies in the plane."""
    ax, parts = axes_of(ax), []
    for k, body in enumerate(result.contact.solid.bodies):
        mesh = body.mesh
        corners = mesh.t.T
        split = [corners[:, :3]] if len(mesh.t) == 3 else [corners[:, :3], corners[:, [0, 2, 3]]]
        x, y = mesh.p[:, : mesh.nvertices]
        T, style = result.at_vertices(k), {"shading": "gouraud", "cmap": "inferno"}
        parts.append(ax.tripcolor(x, y, np.vstack(split), T, **style))
    ax.set(xlabel="x", ylabel="y", aspect="equal")
    return scale_colours(ax, parts, "temperature")


def _surfaces(result: ThermalResult, ax: Any) -> Any:
    """Mean temperature of the boundary facets of bodies in space."""
    parts = []
    for k, body in enumerate(result.contact.solid.bodies):
        corners = body.mesh.facets[:, body.mesh.boundary_facets()]
        places = body.mesh.p[:, corners].transpose(2, 1, 0)
        parts.append((places, result.at_vertices(k)[corners].mean(axis=0)))
    return draw_faces(parts, ax, "temperature", cmap="inferno")
