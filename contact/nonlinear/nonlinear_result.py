"""A finished step in large strain: displacement, state, contact, certificate, pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.laws.iteration import Iteration
from contact.laws.status import Status
from contact.nonlinear.cell_forces import State
from contact.nonlinear.nonlinear_body import NonlinearBody
from contact.nonlinear.touching import Touch
from skfem_adini import to_pyvista
from skfem_adini.ground.errors import optional

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


@dataclass(frozen=True, repr=False)
class NonlinearResult:
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
        Newton's iterations.
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
            f"points in contact, det F {self.certificate['det_F_min']:.3g} to "
            f"{self.certificate['det_F_max']:.3g}, {len(self.history)} iterations)"
        )

    @property
    def end(self) -> Start:
        """What the next step starts from."""
        touch, internal = self.touch, self.internal
        return Start(self.time, self.u, self.mu, self.t, self.states, touch, internal)

    @property
    def x(self) -> Array:
        """Current places of the contact points, shape (dim, m)."""
        return self.touch.x

    @property
    def area(self) -> Array:
        """Current area of each contact point, between bodies the undeformed one, shape (m,)."""
        return self.touch.area

    @property
    def gap(self) -> Array:
        """Gap of each contact point, shape (m,)."""
        return self.touch.gap

    @property
    def pressure(self) -> Array:
        """Contact pressure, shape (m,)."""
        return self.mu / self.touch.area

    @property
    def shear(self) -> Array:
        """Friction tractions along the tangents, shape (m, dim - 1)."""
        return np.asarray(self.t / self.touch.area[:, None])

    @property
    def status(self) -> NDArray[np.int64]:
        """`Status` of each contact point, shape (m,)."""
        size = np.linalg.norm(self.t, axis=1)
        bound = self.touch.friction * self.mu
        slips = size >= bound * (1 - 1e-9)
        found = np.where(slips, int(Status.SLIP), int(Status.STICK))
        found = np.where(self.mu > 0, found, int(Status.OPEN))
        return np.where(self.touch.bonded, int(Status.BONDED), found)

    @property
    def resultant(self) -> Array:
        """Force of contact on the first body, shape (dim,)."""
        body = self.problem.body
        return -_total(body.bodies[0], self._contact[body.slices[0]])

    @property
    def _contact(self) -> Array:
        """Contact forces on all dofs, with the opposite sign."""
        return np.asarray(self.touch.G.T @ self.mu + self.touch.T.T @ self.t.ravel())

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
        forces = (self.internal - self.load + self._contact)[own]
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

    def to_pyvista(self, body: Any = None, subdivide: int | None = None) -> Any:
        """A body on its deformed shape as pyvista.UnstructuredGrid, with u and det F.

        Parameters
        ----------
        body : body, str or int, optional
            Which one, if the problem has several.
        subdivide : int, optional
            Linear sub-cells along an edge instead of exact cells of high order.

        Returns
        -------
        pyvista.UnstructuredGrid

        Raises
        ------
        MissingDependency
            Without pyvista.
        """
        one, u = self.of_body(body)
        cell = {}
        if isinstance(one, NonlinearBody):
            J = np.linalg.det(np.moveaxis(one.deformation_gradient(u), (0, 1), (-2, -1)))
            cell["det_F"] = J.mean(axis=1)
            states = self.states[self.problem.body.number_of(one)]
            cell |= {n: v.mean(axis=-1) for n, v in states.items() if v.ndim == 2}
        grid = to_pyvista(one.basis, {"displacement": u}, subdivide=subdivide, cell_data=cell)
        grid.points = np.asarray(grid.points) + np.asarray(grid.point_data["displacement"])
        return grid

    def plot(self, ax: Any = None) -> Any:
        """Deformed bodies in the plane, coloured by displacement, with the contact points.

        Parameters
        ----------
        ax : matplotlib axes, optional

        Returns
        -------
        matplotlib axes

        Raises
        ------
        InputError
            Bodies in space; use `to_pyvista`.
        """
        from contact.output.pictures import axes_of, scale_colours

        if self.problem.body.dim != 2:
            raise InputError("plot: bodies in space are drawn by to_pyvista()")
        ax = axes_of(ax)
        parts = [_draw(ax, *self.of_body(one)) for one in self.problem.body.bodies]
        scale_colours(ax, parts, "displacement")
        ax.scatter(*self.x[:, self.mu > 0], c="#d1495b", s=9, zorder=3)
        ax.set_aspect("equal")
        ax.autoscale_view()
        return ax


def _draw(ax: Any, body: Any, u: Array) -> Any:
    """Cells of a body, filled by the size of the displacement, and its edges as the element bends
    them; the filled cells."""
    from matplotlib.collections import LineCollection

    from contact.output.pictures import deformed_edges, triangulated

    drawn: Any = SimpleNamespace(body=body, u=u)
    x, moved, triangles = triangulated(drawn, 4, False)
    place, size = x + moved, np.linalg.norm(moved, axis=1)
    filled = ax.tripcolor(*place.T, triangles, size, shading="gouraud", cmap="viridis")
    for outline, width in ((False, 0.3), (True, 1.2)):
        edges = deformed_edges(drawn, 1.0, outline)
        ax.add_collection(LineCollection(edges, colors="#202020", linewidths=width))
    return filled


def _total(body: Any, forces: Array) -> Array:
    """Sum of each component of forces at the dofs that are displacements."""
    each = np.where(body.are_values, forces, 0.0).reshape(-1, body.dim)
    return np.asarray(each.sum(axis=0))


@dataclass(frozen=True)
class NonlinearHistory:
    """The finished steps of a `NonlinearStepper`.

    Attributes
    ----------
    times : ndarray, shape (n,)
    results : tuple of NonlinearResult

    Examples
    --------
    >>> len(NonlinearHistory(np.zeros(0), ()))
    0
    """

    times: Array
    results: tuple[NonlinearResult, ...]

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[NonlinearResult]:
        return iter(self.results)

    def __getitem__(self, place: int) -> NonlinearResult:
        """The result of one step, counted from zero."""
        return self.results[place]

    def __repr__(self) -> str:
        last = f"; the last: {self.results[-1]!r}" if self.results else ""
        return f"NonlinearHistory({len(self)} steps{last})"

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

    def to_vtk(self, path: str | Path, subdivide: int | None = None) -> list[Path]:
        """Write the deformed bodies of all steps, and ``history.pvd`` with their times.

        Parameters
        ----------
        path : str or Path
            A folder, made if needed.
        subdivide : int, optional
            As for `NonlinearResult.to_pyvista`.

        Returns
        -------
        list of Path
            The files of the steps.

        Raises
        ------
        MissingDependency
            Without pyvista.
        """
        pyvista = optional("pyvista", "VTK export needs pyvista: pip install 'pyvista>=0.47'")
        folder, written, lines = Path(path), list[Path](), list[str]()
        folder.mkdir(parents=True, exist_ok=True)
        for number, result in enumerate(self.results):
            blocks = pyvista.MultiBlock()
            for k, one in enumerate(result.problem.body.bodies):
                blocks.append(result.to_pyvista(one, subdivide), one.name or f"body {k}")
            written.append(folder / f"step_{number:05d}.vtm")
            blocks.save(written[-1])
            lines.append(f'<DataSet timestep="{result.time!r}" file="{written[-1].name}"/>')
        text = (
            '<VTKFile type="Collection" version="0.1"><Collection>\n{}\n</Collection></VTKFile>\n'
        )
        (folder / "history.pvd").write_text(text.format("\n".join(lines)))
        return written

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
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for result in results:
        for one in result.problem.body.bodies:
            _, u = result.of_body(one)
            corners = one.basis.nodal_dofs[: one.dim]
            x = one.mesh.p[:, : corners.shape[1]] + u[corners]
            low, high = np.minimum(low, x.min(axis=1)), np.maximum(high, x.max(axis=1))
    room = 0.05 * (high - low).max()
    return low - room, high + room
