"""The solution of a contact problem, with its certificate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.body.distributed_body import DistributedBody
from contact.derivatives.gradient import ContactGradient, gradient, warn_of
from contact.errors import ContactError, InputError
from contact.laws.status import Status
from contact.output.pictures import draw_outlines, have_outlines
from contact.output.vtk import block_sets, body_grid
from contact.plot import plot_tractions
from contact.portable import Origin
from contact.result.body_result import BodyFields, BodyResult
from contact.result.certify import as_lines
from contact.result.contact_fields import ContactFields, counts, facts, vector
from contact.result.contact_system import ContactState
from contact.result.stored_result import read, write
from skfem_adini.distributed import write_pieces

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class ContactResult(ContactFields, BodyFields, ContactState):
    """Displacement, contact forces, and derived quantities.

    Bonded points transmit forces of ties, which have attributes of their own.

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
        empty, if there are none; the path of moved shapes is included in ``slip``.
    tol, slack : float
        Tolerances of the certificate, see `certify`; tol None is the default of the method.
    jump : str
        With adhesion "pull-off" or "contact" if the step passed such an instability, else empty.
    origin : Origin or None
        For `vjp`: the problem as it was. None in a result from a file.

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

    origin: Origin | None = None

    def __repr__(self) -> str:
        return f"ContactResult({counts(self)}; resultant {vector(self.resultant)})"

    def keep_facts_of_many(self) -> None:
        """Compute and store residuals and summary if a body is distributed.

        All processes compute these together, once; afterwards one may print them alone.
        """
        if any(isinstance(body, DistributedBody) for body in self.solid.bodies):
            self.__dict__["_kept"] = (self.kkt, facts(self))

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

    @cached_property
    def normal_displacement(self) -> Array:
        """u_n of the contact points along the outward normal, shape (m,)."""
        return np.asarray(self.system.rows.G @ self.u)

    @cached_property
    def slip(self) -> Array:
        """Tangential displacement relative to the obstacle, u_t - w_t, shape (m, dim - 1)."""
        return self._relative[1]

    @cached_property
    def _relative(self) -> tuple[Array, Array]:
        """Normal and tangential displacement relative to the obstacle, (m,) and (m, dim - 1)."""
        return self.system.relative(self.u, self.motion)

    @cached_property
    def slip_increment(self) -> Array:
        """Slip since the last step of a load history, which friction opposes, (m, dim - 1)."""
        return self.system.slip_increment(self.slip)

    @property
    def gap(self) -> Array:
        """Gap in the deformed state, d - (u_n - w_n), shape (m,).

        On compliant surfaces under pressure it is minus the overclosure. What has been worn or
        indented in earlier steps is part of d; what this step adds is minus the gap in contact.
        """
        return self.system.rows.gap - self._relative[0]

    @property
    def indentation(self) -> Array:
        """Permanent indentation of the surface by its hardness, up to this step, shape (m,)."""
        return self._left[0]

    @property
    def worn(self) -> Array:
        """Depths worn off the body and off the other side, up to this step, shape (2, m)."""
        return self._left[1]

    @property
    def worn_volume(self) -> Array:
        """Volumes worn off the body and off the other side, shape (2,); in 2-D areas."""
        surface, area = self.system.surface, self.system.rows.weights
        if surface is None or surface.volume is None:
            return np.asarray(self.worn @ area)
        return np.asarray(surface.volume + (self.worn - surface.worn) @ area)

    @cached_property
    def _left(self) -> tuple[Array, Array]:
        surface = self.system.surface
        if surface is None:
            return np.zeros(self.mu.size), np.zeros((2, self.mu.size))
        indented, worn = self.system.left(self.u, self.mu, self.motion)
        return surface.indented + indented, surface.worn + worn

    @cached_property
    def status(self) -> NDArray[np.int8]:
        """`Status` of each contact point, shape (m,)."""
        size = max(float(self.mu.max(initial=0.0)), float(np.abs(self.t).max(initial=0.0)))
        g = self.system.bound(self.mu)
        loaded = self.mu > 1e-12 * size
        if self.system.surface is not None and self.system.surface.adhesion is not None:
            tension = self.system.surface.adhesion.tension * self.system.rows.weights
            loaded = loaded | (self.mu > -(1 - 1e-9) * tension) & (
                np.abs(self.gap) <= 1e-10 * self.system.body.largest_displacement(self.u)
            )
        if self.system.law == "tresca":
            loaded = loaded | (g > 0)
        force = np.linalg.norm(self.t, axis=1)
        # Rounding of a displacement is not slip.
        moves = np.linalg.norm(
            self.slip_increment, axis=1
        ) > 1e-10 * self.system.body.largest_displacement(self.u)
        held = loaded & (g > 0)
        held = held & self.system.held if held.any() else held
        moves = np.where(held, force > 0, moves)  # zero force implies zero slip
        slides = loaded & moves & (force >= g * (1 - 1e-9))
        status = np.where(slides, Status.SLIP, np.where(loaded, Status.STICK, Status.OPEN))
        status = np.where(held & ~slides, Status.UNDETERMINED, status)
        return np.where(self.system.rows.ties, Status.BONDED, status).astype(np.int8)

    @property
    def kkt(self) -> dict[str, float]:
        """Relative residuals of every law, recomputed from the problem, u, mu, t and motion only.

        ``equilibrium``: largest residual force at a free dof, divided by the largest sum of moduli
        of the forces there; ``balance``: the sum of all loads, reactions and contact forces,
        divided by the sum of their moduli; ``support``: violation of the prescribed displacements;
        ``penetration``, ``sign``, ``complementarity``: the contact law; ``cone``, ``slip``:
        ``|t| <= g``, and t = P_g(t + c u_t) with the slip increment u_t; these laws are not those
        of bonded points, which have ``tie``: ``|u_n - d|`` and ``|u_t|``. On compliant surfaces
        penetration and complementarity are the excess, or deficit, of the force at the point of the
        curve with the same ``mu + c (u_n - d)`` over mu. Lengths are relative to the largest
        displacement, or to the one that a contact force alone would cause if that is larger.
        Forces are reduced by the rounding error of internal forces, and relative to the largest
        contact force, or to that rounding error if it is larger. If obstacles are driven by forces,
        also ``obstacle``: their residual force divided by the sum of moduli.
        """
        kept = self.__dict__.get("_kept")
        if kept is not None:
            return dict(kept[0])
        return self.system.kkt(self.u, self.mu, self.t, self.motion)

    def vjp(
        self,
        *,
        u: ArrayLike | None = None,
        pressure: ArrayLike | None = None,
        shear: ArrayLike | None = None,
        slip: ArrayLike | None = None,
        contact_forces: ArrayLike | None = None,
        resultant: ArrayLike | None = None,
        motion: ArrayLike | None = None,
        problem: Any = None,
    ) -> ContactGradient:
        """Gradients of a function of the result by loads, moduli, friction, gap, vertices, ...

        The function J is given by its derivatives by the parts of the result. One transposed
        substitution with the factors of the problem is made, as long as that exists; else the body
        is factored again.

        Parameters
        ----------
        u : array, shape (ndofs,), optional
        pressure : array, shape (m,), optional
        shear, slip : array, shape (m, dim - 1), optional
        contact_forces : array, shape (ndofs,), optional
        resultant : array, shape (dim,), optional
        motion : array, shape (k,), optional
            Of `Rigid` obstacles.
        problem : ContactProblem, optional
            Default: the one that was solved. `ContactGradient.vertices` and `pose` need it.

        Returns
        -------
        ContactGradient

        Raises
        ------
        InputError
            Arrays of another shape; a result of adhesion, hardness or wear, of a copy or a file of
            finite sliding, a cotangent `slip` of it, or a result of a `DistributedBody` or solved
            on a device; a result of two bodies from a file without its problem.
        NotConverged
            The solution is at a limit of friction, or too ill-conditioned.

        Warns
        -----
        ContactWarning
            Points touch without force, or stick at the bound of friction.
        """
        found = gradient(
            self,
            self._posed_as(problem),
            {
                "u": u, "pressure": pressure, "shear": shear, "slip": slip, "motion": motion,
                "contact_forces": contact_forces, "resultant": resultant,
            },
        )  # fmt: skip
        warn_of(found.degenerate)
        return found

    def _posed_as(self, problem: Any) -> Any:
        """The problem given, or the one that was solved if it still exists."""
        if self.origin is not None and self.origin.slides and self.origin.slide is None:
            raise InputError(
                "vjp: the rows of finite sliding depend on the solution, and a copy or a file has "
                "no derivatives of them; take the result of the LoadStepper itself"
            )
        if problem is None and self.origin is None and self.system.rows.axes.size:
            raise InputError(
                "vjp: a result of several bodies from a file does not say whether they slid; give "
                "its problem, vjp(problem=...)"
            )
        return problem

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
        residuals verify that these, loads, laws and solution are consistent. A checksum covers
        other data (names, weights, gaps of open points). Functions are not stored: the file has the
        values of supports, obstacles and friction.

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
        """The body as a pyvista grid: displacement and stress; for several bodies all fields.

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

    def plot(self, ax: Any = None) -> Any:
        """Pressure and shear along the boundary, stick and slip; in 3-D pressure on the faces.

        If no axes are given, several bodies in 2-D also get a plot of their deformed outlines near
        the contact, except a `LayeredBlock` or a `CutBody`.

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


def save_pvtu(path: str | Path, result: ContactResult) -> Path:
    """Write a result of a `DistributedBody` to a `.vtu` file of each process and a `.pvtu` index.

    All processes must call it together; ParaView and pyvista read the index. The fields are those
    of ``ContactResult.to_pyvista``.

    Parameters
    ----------
    path : str or Path
        A name ending in ``.pvtu``, in a folder that all processes see.
    result : ContactResult

    Returns
    -------
    Path
        The index, which is written last: as long as it is missing the files are not complete.

    Raises
    ------
    InputError
        Another suffix, another body, or a process that could not write; the index is not written
        then.

    Examples
    --------
    >>> import tempfile
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, DistributedBody, save_pvtu
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = DistributedBody(mesh, contact="bottom", E=1.0, nu=0.3).fix("top", "xy", -0.01)
    >>> result = ContactProblem(body, "bottom", 0.0, friction=0.3).solve()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_pvtu(f"{folder}/block.pvtu", result).name
    'block.pvtu'
    """
    body = result.body
    if not isinstance(body, DistributedBody):
        raise InputError(
            f"result: its body is a {type(body).__name__}, not a DistributedBody; write "
            "result.to_pyvista() instead"
        )
    u, applied = body.to_local(result.u), body.to_local(result.applied)
    forces = (body.to_local(f) for f in (result.contact_forces, result.tie_forces))
    piece = BodyResult(body.local, u, applied, *forces)

    def grid() -> Any:
        own = body.space.own_cells
        return body_grid(piece).extract_cells(own, pass_point_ids=False, pass_cell_ids=False)

    try:
        return write_pieces(path, body.comm, grid)
    except ContactError as error:
        raise InputError(str(error)) from error
