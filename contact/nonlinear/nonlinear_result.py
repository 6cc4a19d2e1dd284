"""A finished step in large strain: displacement, state, contact, certificate, pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.histories.step_history import StepHistory
from contact.laws.iteration import Iteration
from contact.laws.status import Status
from contact.nonlinear.cell_forces import State
from contact.nonlinear.deformed_body import DeformedBody
from contact.nonlinear.touching import Touch
from contact.output.drawn import drawn_bodies
from contact.output.pictures import (
    axes_of,
    cell_outlines,
    deformed_edges,
    scale_colours,
    triangulated,
)
from contact.output.vtk import block_sets
from contact.result.contact_fields import ContactFields, facts
from contact.result.contact_system import ContactSystem

Array = NDArray[np.float64]
__all__ = ["NonlinearHistory", "NonlinearResult"]


@dataclass(frozen=True)
class Start:
    """What a step starts from; at rest the time is 0 and there are no contact points yet."""

    time: float
    u: Array
    mu: Array
    t: Array
    states: tuple[State, ...]
    touch: Touch | None
    internal: Array  # internal forces, shape (ndofs,)


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearResult(ContactFields):
    """A certified step of a `NonlinearStepper`.

    Attributes
    ----------
    problem : ContactProblem
    time : float
    u : ndarray, shape (ndofs,)
        Displacement of all dofs, body after body.
    mu, t : ndarray, shape (m,) and (m, dim - 1)
        Contact forces of the points, normal and tangential.
    states : tuple of dict
        State of each body at the end of the step; empty without.
    touch : Touch
        Rows, gaps, slips and frames of the contact points, see `contact.nonlinear.touching`.
    internal, load : ndarray, shape (ndofs,)
        Internal and applied forces on all dofs.
    scale : ndarray, shape (m,)
        Physical over scaled displacement of the contact points, for the residuals.
    certificate : dict
        Relative residuals recomputed from the forms: "balance", "contact", "support"; "det_F_min"
        and "det_F_max" at quadrature points and corners; "work", the defect of the work balance of
        the step over the largest work, by the trapezoidal rule, NaN if no energy is known.
    history : tuple of Iteration
        Of all parts of a step that was halved; phases are "newton", "chord" with the tangent of an
        earlier iteration, and "damped" where no equilibrium was near, so that a body snapped.
    before : Start
        What the step, or its last part, started from.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, NeoHooke, NonlinearBody, NonlinearStepper, Plane
    >>> body = NonlinearBody.from_mesh(MeshQuad().refined(1).with_defaults(), stress=NeoHooke(1, 9))
    >>> problem = ContactProblem(body.fix("top", "xy"), "bottom", Plane((0, 0), (0, 1)))
    >>> result = NonlinearStepper(problem).move("top", "y", -0.2).run([0.5, 1.0]).results[-1]
    >>> bool(result.pressure.min() > 0), result.certificate["balance"] < 1e-9
    (True, True)
    """

    problem: Any
    time: float
    u: Array
    mu: Array
    t: Array
    states: tuple[State, ...]
    touch: Touch
    internal: Array
    load: Array
    scale: Array
    certificate: dict[str, float]
    history: tuple[Iteration, ...]
    before: Start

    def __repr__(self) -> str:
        return (
            f"NonlinearResult(time={self.time:g}, {int((self.mu > 0).sum())} of {self.mu.size} "
            f"points in contact, {self._volumes}, {len(self.history)} iterations)"
        )

    @property
    def _volumes(self) -> str:
        low, high = self.certificate["det_F_min"], self.certificate["det_F_max"]
        return f"det F {low:.3g} to {high:.3g}"

    @property
    def _facts(self) -> dict[str, str]:
        return {"time": f"{self.time:g}", **facts(self), "deformation": self._volumes}

    @cached_property
    def system(self) -> ContactSystem:
        """Bodies, rows at their current places, loads and friction."""
        touch, together = self.touch, self.problem.body
        for k in np.unique(touch.owner[touch.bonded]):  # whose rows are undeformed
            own, (one, u) = touch.bonded & (touch.owner == k), self.of_body(int(k))
            x = touch.x.copy()
            x[:, own] += one.displacement(u, x[:, own])
            touch = replace(touch, x=x, x_nominal=x)
        law = "coulomb" if np.any(touch.friction > 0) else None
        return ContactSystem(together, touch, self.load, law, touch.friction)

    @property
    def method(self) -> str:
        """Of solving: "newton"."""
        return "newton"

    @property
    def kkt(self) -> dict[str, float]:
        """The relative residuals of the certificate, by name."""
        return {name: self.certificate[name] for name in ("balance", "contact", "support")}

    @property
    def end(self) -> Start:
        """What the next step starts from."""
        touch, internal = self.touch, self.internal
        return Start(self.time, self.u, self.mu, self.t, self.states, touch, internal)

    def __getitem__(self, body: Any) -> DeformedBody:
        """The part of the result that belongs to one body.

        Parameters
        ----------
        body : body, int or str
            A body of the problem, its number, or its name.

        Raises
        ------
        InputError
            No such body.
        """
        k, last = self.problem.body.number_of(body), self.before
        one, u = self.of_body(body)
        return DeformedBody(one, u, self.states[k], last.states[k], self.time - last.time)

    def moved_mesh(self, k: int) -> Any:
        """Mesh of body k with its vertices at their current places.

        Parameters
        ----------
        k : int

        Returns
        -------
        Mesh
        """
        return self[k].mesh

    @property
    def area(self) -> Array:
        """Current area of each contact point, between bodies the undeformed one, shape (m,)."""
        return self.touch.area

    @property
    def gap(self) -> Array:
        """Gap of each contact point, shape (m,)."""
        return self.touch.gap

    @property
    def slip(self) -> Array:
        """Tangential displacement relative to the obstacle in this step, shape (m, dim - 1)."""
        return self.touch.slip

    @property
    def status(self) -> NDArray[np.int8]:
        """`Status` of each contact point, shape (m,)."""
        size = np.linalg.norm(self.t, axis=1)
        bound = self.touch.friction * self.mu
        slips = size >= bound * (1 - 1e-9)
        found = np.where(slips, int(Status.SLIP), int(Status.STICK))
        found = np.where(self.mu > 0, found, int(Status.OPEN))
        return np.where(self.touch.bonded, int(Status.BONDED), found).astype(np.int8)

    def reaction(self, boundary: Any, body: Any = None) -> Array:
        """Force of the supports on a boundary, shape (dim,).

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        body : body, str or int, optional
            Which one, if the problem has several.

        Returns
        -------
        ndarray

        Raises
        ------
        InputError
            No such boundary or body.
        """
        together = self.problem.body
        if body is None and len(together.bodies) > 1:
            raise InputError("body: there are several; say which")
        k = 0 if body is None else together.number_of(body)
        one, own = together.bodies[k], together.slices[k]
        forces = (self.internal - self.load + self.contact_forces + self.tie_forces)[own]
        dofs = one.basis.get_dofs(one.facets(boundary)).all()
        return _total(one, np.where(np.isin(np.arange(forces.size), dofs), forces, 0.0))

    def of_body(self, body: Any = None) -> tuple[Any, Array]:
        """A body and its part of u.

        Parameters
        ----------
        body : body, str or int, optional

        Returns
        -------
        body : ElasticBody
        u : ndarray

        Raises
        ------
        InputError
            No such body.
        """
        together = self.problem.body
        k = 0 if body is None else together.number_of(body)
        return together.bodies[k], self.u[together.slices[k]]

    def to_pyvista(self, subdivide: int | None = None) -> Any:
        """The body on its deformed shape: displacement, stress, det F, states; or all bodies.

        Parameters
        ----------
        subdivide : int, optional
            Linear sub-cells along an edge instead of exact cells of high order.

        Returns
        -------
        pyvista.UnstructuredGrid or pyvista.MultiBlock
            Of several bodies and their contact surfaces the blocks of `ContactResult.to_pyvista`;
            ``result[body].to_pyvista()`` is one of them.

        Raises
        ------
        MissingDependency
            Without pyvista.
        """
        if len(self.problem.body.bodies) > 1:
            return next(block_sets([self], subdivide))
        return self[0].to_pyvista(subdivide)

    def plot(self, ax: Any = None, colour: str = "displacement") -> Any:
        """Deformed bodies in the plane in colours, with the points in contact.

        Parameters
        ----------
        ax : matplotlib axes, optional
        colour : str
            "displacement", its size; or the mean of each cell of "von_mises", "det_F" or a scalar
            state by its name, such as "alpha".

        Returns
        -------
        matplotlib axes

        Raises
        ------
        InputError
            Bodies in space, for which there is `to_pyvista`, or no such quantity.
        """
        if self.problem.body.dim != 2:
            raise InputError("plot: bodies in space are drawn by to_pyvista()")
        ax = axes_of(ax)
        parts = [_draw(ax, one, colour) for one in drawn_bodies(self)]
        filled = [part for part in parts if part is not None]
        if not filled:
            known = sorted({name for one in drawn_bodies(self) for name in one.scalars})
            raise InputError(f"colour={colour!r}: expected displacement, or one of {known}")
        labels = {"von_mises": "von Mises stress", "det_F": "volume over its undeformed one"}
        scale_colours(ax, filled, labels.get(colour, colour))
        ax.scatter(*self.x[:, self.mu > 0], c="#d1495b", s=9, zorder=3)
        ax.set_aspect("equal")
        ax.autoscale_view()
        return ax


def _draw(ax: Any, one: DeformedBody, colour: str) -> Any:
    """A deformed body: its colours, which are returned or None, and its edges as they bend."""
    from matplotlib.collections import LineCollection, PolyCollection

    filled = None
    if colour == "displacement":
        x, moved, triangles = triangulated(one, 4, False)
        place, size = x + moved, np.linalg.norm(moved, axis=1)
        filled = ax.tripcolor(*place.T, triangles, size, shading="gouraud", cmap="viridis")
    elif (values := one.scalars.get(colour)) is not None:
        filled = PolyCollection(cell_outlines(one), array=values, cmap="viridis")
        ax.add_collection(filled)
    for outline, width in ((False, 0.3), (True, 1.2)):
        edges = deformed_edges(one, 1.0, outline)
        ax.add_collection(LineCollection(edges, colors="#202020", linewidths=width))
    return filled


def _total(body: Any, forces: Array) -> Array:
    """Sum of each component of forces at the dofs that are displacements."""
    each = np.where(body.are_values, forces, 0.0).reshape(-1, body.dim)
    return np.asarray(each.sum(axis=0))


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearHistory(StepHistory[NonlinearResult]):
    """The finished steps of a `NonlinearStepper`: a sequence of results, and their times.

    Attributes
    ----------
    times : ndarray, shape (n,)
    results : tuple of NonlinearResult

    Examples
    --------
    >>> len(NonlinearHistory(np.zeros(0), ()))
    0
    """

    def curve(self, boundary: Any, body: Any = None) -> Array:
        """Force of the supports on a boundary in each step, shape (n, dim).

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        body : body, str or int, optional

        Returns
        -------
        ndarray
        """
        return np.array([one.reaction(boundary, body) for one in self.results])

    def animate(self, path: str | Path, fps: int = 10) -> Path:
        """Write an animation of bodies in the plane.

        Parameters
        ----------
        path : str or Path
            A .gif file.
        fps : int
            Steps per second.

        Returns
        -------
        Path

        Raises
        ------
        InputError
            No steps, or bodies in space.
        """
        import matplotlib.pyplot as plt
        from matplotlib.animation import FuncAnimation, PillowWriter

        if not self.results:
            raise InputError("animate: the history has no steps yet; run it first")
        low, high = _frame(self.results)
        figure = plt.figure(figsize=(6, 4), layout="constrained")

        def draw(k: int) -> Sequence[Any]:
            figure.clear()  # the bar of colours too
            ax = self.results[k].plot(figure.subplots())
            ax.set_xlim(low[0], high[0])
            ax.set_ylim(low[1], high[1])
            ax.set_title(f"t = {self.times[k]:.3g}")
            return ()

        film = FuncAnimation(figure, draw, frames=len(self.results))
        film.save(path, writer=PillowWriter(fps=fps))
        plt.close(figure)
        return Path(path)


def _frame(results: Sequence[NonlinearResult]) -> tuple[Array, Array]:
    """Lower and upper limits of all deformed bodies, with some room."""
    meshes = [one.mesh for result in results for one in drawn_bodies(result)]
    low = np.min([mesh.p.min(axis=1) for mesh in meshes], axis=0)
    high = np.max([mesh.p.max(axis=1) for mesh in meshes], axis=0)
    room = 0.05 * (high - low).max()
    return low - room, high + room
