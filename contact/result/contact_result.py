"""The solution of a contact problem, which can prove itself."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.distributed_body import DistributedBody
from contact.errors import InputError
from contact.output.outlines import draw_outlines, have_outlines
from contact.output.sides import pair_name
from contact.output.vtk import block_sets, boundary_grid
from contact.plot import plot_tractions
from contact.result.body_result import BodyFields, BodyResult
from contact.result.certify import as_lines
from contact.result.contact_forces import ContactForces
from contact.result.stored_result import read, write

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class ContactResult(BodyFields, ContactForces):
    """Displacement, contact forces, and what follows from them.

    Lengths have the unit of the mesh; stresses, pressures and tractions that of E; forces are
    tractions times areas, in 2-D per unit depth.

    Attributes
    ----------
    system : ContactSystem
        The problem that was solved.
    u : ndarray, shape (ndofs,)
        Displacement of all dofs of ``system.body.basis``.
    mu : ndarray, shape (m,)
        Normal contact forces (multipliers), positive in compression.
    t : ndarray, shape (m, dim - 1)
        Tangential multipliers; the friction force on the body is -t.
    method : str
    history : tuple of Iteration
        One entry an iteration of the solver.
    motion : ndarray, shape (k,), or None
        Of `Rigid` obstacles: translations, then rotation, one obstacle after the other. None, or
        empty, where there is none; the way of shapes that moved is in ``slip``.
    tol, slack : float
        What the certificate was held to, see `certify`; tol None stands for that of the method.

    Examples
    --------
    The load of .1 on the top side stands on the foundation:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    >>> result = problem.solve()
    >>> bool(abs(result.resultant[1] - 0.1) < 1e-10), bool(max(result.kkt.values()) < 1e-10)
    (True, True)
    """

    def __repr__(self) -> str:
        return f"ContactResult({counts(self)}; resultant {vector(self.resultant)})"

    def summary(self) -> str:
        """What was solved, what came out and how well it is proved, in ten lines.

        Returns
        -------
        str
        """
        return as_text(self._facts, type(self).__name__)

    def _repr_html_(self) -> str:
        return as_html(self._facts, type(self).__name__)

    def keep_facts_of_many(self) -> None:
        """Keep the residuals and the summary if a body is on many processes.

        All of them compute these together, once; then one may print them without the others.
        """
        if any(isinstance(body, DistributedBody) for body in self.solid.bodies):
            self.__dict__["_kept"] = (self.kkt, facts(self))

    @property
    def _facts(self) -> dict[str, str]:
        kept = self.__dict__.get("_kept")
        return facts(self) if kept is None else kept[1]

    @property
    def solid(self) -> Any:
        """The body, or all bodies together."""
        return self.system.body

    @property
    def body(self) -> Any:
        """The body, as it was when the problem was solved.

        Raises
        ------
        InputError
            There are several.
        """
        if len(self.solid.bodies) > 1:
            raise InputError(
                f"result: it has {len(self.solid.bodies)} bodies; choose one, as in "
                "result[body].stress()"
            )
        return self.solid.bodies[0]

    @property
    def applied(self) -> Array:
        """Load on every dof, shape (ndofs,)."""
        return self.system.load

    def __getitem__(self, body: Any) -> BodyResult:
        """The part of the result that belongs to one body.

        Parameters
        ----------
        body : Solid, int or str
            A body of the problem, its number, or its name.

        Raises
        ------
        InputError
            No such body.
        """
        k = self.solid.number_of(body)
        own = self.solid.slices[k]
        return BodyResult(
            self.solid.bodies[k],
            self.u[own],
            self.applied[own],
            self.contact_forces[own],
            self.tie_forces[own],
        )

    @property
    def kkt(self) -> dict[str, float]:
        """Relative residuals, recomputed from the problem; see `ContactSystem.kkt`."""
        kept = self.__dict__.get("_kept")
        if kept is not None:
            return dict(kept[0])
        return self.system.kkt(self.u, self.mu, self.t, self.motion)

    def certificate(self) -> str:
        """One line for each residual of `kkt`.

        Returns
        -------
        str
        """
        return as_lines(self.kkt)

    def save(self, path: str | Path) -> Path:
        """Write the result, problem included, to one compressed file; see `load`.

        Parameters
        ----------
        path : str or Path
            Ends in .npz, which is added to a name that has no suffix, or only a number as suffix.

        Returns
        -------
        Path
            The file, complete and on the disk.

        Raises
        ------
        InputError
            Another suffix; a state that fails its certificate or holds NaN; a body or an element
            that cannot be stored.
        """
        return write(self, path)

    @classmethod
    def load(cls, path: str | Path) -> ContactResult:
        """Read a file written by `save`: nothing is lost, and the certificate is computed anew.

        The stiffness is assembled from the mesh, the element, E and nu in the file, so that the
        residuals show whether these, loads, laws and solution still belong together. A checksum
        covers what does not enter the residuals (names, weights, gaps of open points). Functions
        are not stored: the file has the values that supports, obstacles and friction took.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        ContactResult

        Raises
        ------
        InputError
            The file does not exist, is damaged, changed, encrypted or of another format, or its
            solution does not solve its problem. Files of format 2, which have no checksum, are
            certified as well.
        """
        return cls(**vars(read(path)))

    def to_pyvista(self, subdivide: int | None = None) -> Any:
        """The body as a pyvista grid: displacement and stress; of several bodies all that is known.

        Parameters
        ----------
        subdivide : int, optional
            Linear cells along each edge of a cell instead of exact ones, as for
            `skfem_adini.to_pyvista`.

        Returns
        -------
        pyvista.UnstructuredGrid or pyvista.MultiBlock
            Of several bodies: a block for each, by its name or as "body 0", ...; for each pair its
            contact surface, "contact 0", ..., or "tie 0", ..., as `boundary_to_pyvista` has it; and
            the opposite face if it is elastic, "contact 0 opposite", with the tractions on it.

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        if len(self.solid.bodies) > 1:
            return next(block_sets([self], subdivide))
        return super().to_pyvista(subdivide)

    def boundary_to_pyvista(self) -> Any:
        """Contact points as a pyvista point cloud or polyline with every contact field.

        Returns
        -------
        pyvista.PolyData

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        return boundary_grid(self)

    def plot(self, ax: Any = None) -> Any:
        """Pressure and shear along the boundary, stick and slip; in 3-D pressure on the faces.

        Without axes, below them the outlines of several deformed bodies near their contact, in 2-D;
        not of a `LayeredBlock` or a `CutBody`.

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
            Not axes, or flat ones in 3-D.
        """
        if ax is None and have_outlines(self):
            import matplotlib.pyplot as plt

            _, (ax, below) = plt.subplots(2, 1, figsize=(6, 7), layout="constrained")
            draw_outlines(self, below)
        return plot_tractions(self, ax)


def counts(result: Any) -> str:
    """How many contact points are open, stick and slip, and are bonded or held, if any are."""
    return _counted(result.status)


def _counted(status: Any) -> str:
    free, stick, slip, bonded, held = np.bincount(status, minlength=5)
    more = f", {bonded} bonded" if bonded else ""
    more += f", {held} undetermined" if held else ""
    return f"{status.size} points: {free} open, {stick} stick, {slip} slip{more}"


def facts(result: Any) -> dict[str, str]:
    """The most important facts of a result, by name.

    Parameters
    ----------
    result : ContactResult
    """
    system, kkt = result.system, result.kkt
    highest = int(np.argmax(result.pressure)) if np.any(result.pressure) else None
    worst = max(kkt, key=lambda name: kkt[name])
    law = system.law
    if law is not None:
        low, high = np.min(system.friction), np.max(system.friction)
        strength = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        law = f"{law}, " + ("friction " if law == "coulomb" else "bound as a force ") + strength
    return {
        **_bodies(system.body),
        "law": law or "without friction",
        "functional": system.rows.functional,
        "solved by": f"{result.method}, iterations: {len(result.history)}",
        "contact": counts(result),
        **_forces(result),
        "pressure": "none"
        if highest is None
        else f"at most {result.pressure[highest]:.6g}, at {vector(result.x[:, highest])}",
        "displacement": f"at most {system.body.reach(result.u):.6g}",
        "certificate": f"no residual above {kkt[worst]:.1e} ({worst})",
    }


def _bodies(body: Any) -> dict[str, str]:
    """The body, or each of several by its name or number."""
    if len(body.bodies) == 1:
        return {"body": repr(body)}
    return {one.name or f"body {k}": repr(one) for k, one in enumerate(body.bodies)}


def _forces(result: Any) -> dict[str, str]:
    """The resultant; of several bodies that of each contact and tie, and how its points are."""
    body, owner = result.system.body, result.system.rows.owner
    if len(body.bodies) == 1:
        return {"resultant": vector(result.resultant)}
    found = {}
    # Points of one pair are all bonded or all free.
    for k, force in enumerate(result.resultants + result.tie_resultants):
        own = result.part == k
        whose = body.called(int(owner[own][0]))
        found[pair_name(result, k)] = f"{_counted(result.status[own])}; {vector(force)} on {whose}"
    return found


def as_text(rows: dict[str, str], title: str) -> str:
    """Lines of names and values."""
    width = max(map(len, rows))
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in rows.items())])


def as_html(rows: dict[str, str], title: str) -> str:
    """The table that notebooks show."""
    body = "".join(
        f"<tr><th style='text-align: left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    return f"<table><caption>{escape(title)}</caption>{body}</table>"


def vector(values: Any) -> str:
    """Six digits of each component; components that are rounding errors are shown as 0."""
    rounding = 1e-12 * np.abs(values).max()
    return "(" + ", ".join("0" if abs(v) <= rounding else f"{v:.6g}" for v in values) + ")"
