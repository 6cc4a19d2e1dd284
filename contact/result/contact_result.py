"""The solution of a contact problem, which can prove itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.body.elasticity import stress
from contact.errors import InputError, numbers
from contact.output.vtk import body_grid, boundary_grid
from contact.plot import plot_tractions
from contact.result.certify import as_lines
from contact.result.contact_forces import ContactForces
from contact.result.recovery import cell_stress, nodal_stress
from contact.result.stored_result import read, write
from contact.result.summary import as_html, as_text, counts, facts, vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class ContactResult(ContactForces):
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
        Of `Rigid` obstacles: translations, then rotation, one obstacle after the other.
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
        return as_text(facts(self), type(self).__name__)

    def _repr_html_(self) -> str:
        return as_html(facts(self), type(self).__name__)

    @cached_property
    def reactions(self) -> Array:
        """Forces of the supports on all dofs, shape (ndofs,)."""
        system = self.system
        return np.asarray(system.body.internal(self.u) + self.contact_forces - system.load)

    def balance(self) -> dict[str, Array]:
        """Applied load, support reactions, contact force, and the residual of their sum.

        Returns
        -------
        dict
            ``load``, ``support``, ``contact``: resultants, shape (dim,); ``residual``: their sum
            divided by the largest of them, or by the internal forces of the body if all resultants
            are rounding errors of these. Only reactions at prescribed displacements count.
        """
        body = self.system.body
        parts = {
            "load": body.total(self.system.load),
            "support": body.total(body.at_supports(self.reactions)),
            "contact": self.resultant,
        }
        largest = max(float(np.abs(part).max()) for part in parts.values())
        _, cancelling = body.equilibrium(self.u, self.contact_forces, self.system.load)
        if largest <= 1e-12 * cancelling:  # nothing but the rounding of forces inside
            largest = cancelling or 1.0
        parts["residual"] = sum(parts.values(), start=np.zeros(body.dim)) / largest
        return parts

    @property
    def kkt(self) -> dict[str, float]:
        """Relative residuals, recomputed from the problem; see `ContactSystem.kkt`."""
        return self.system.kkt(self.u, self.mu, self.t, self.motion)

    def certificate(self) -> str:
        """One line for each residual of `kkt`.

        Returns
        -------
        str
        """
        return as_lines(self.kkt)

    def stress(self, points: ArrayLike | None = None) -> Array:
        """Cauchy stress in the quadrature points of the basis, or at given points.

        Parameters
        ----------
        points : array, shape (dim, npoints), optional

        Returns
        -------
        ndarray, shape (dim, dim, ncells, nquadrature) or (dim, dim, npoints)

        Raises
        ------
        InputError
            Points of another shape, not finite, or outside the body.
        """
        body = self.system.body
        mean = body.mean_dilatation(self.u)
        if points is None:
            gradient = np.asarray(body.basis.interpolate(self.u).grad)
            volume = None if mean is None else mean[:, None]
            return stress(gradient, _per_cell(body.lam), _per_cell(body.mu), volume)
        where = self._points(points)
        lame_lambda, lame_mu, _ = body.material(where)
        volume = None if mean is None else mean[body.cells_of(where)]
        return stress(body.gradient(self.u, where), lame_lambda, lame_mu, volume)

    def nodal_stress(self) -> Array:
        """Cauchy stress at the vertices of the mesh, shape (3, 3, nvertices).

        Returns
        -------
        ndarray
            In the unit of E; from the dofs of Adini's and the BFS element, see
            `skfem_adini.nodal_stress`, else means over the cells around a vertex.
        """
        return nodal_stress(self.system.body, self.u)

    def cell_stress(self) -> Array:
        """Mean Cauchy stress of each cell, shape (3, 3, ncells).

        Returns
        -------
        ndarray
            In the unit of E, shape (3, 3, ncells); in 2-D the last row and column hold only
            sigma_zz.
        """
        return cell_stress(self.system.body, self.stress())

    def von_mises(self, points: ArrayLike | None = None) -> Array:
        """Von Mises stress, in the places of `stress`; plane strain keeps its sigma_zz.

        Parameters
        ----------
        points : array, shape (dim, npoints), optional

        Returns
        -------
        ndarray, shape (ncells, nquadrature) or (npoints,)
            In the unit of E.

        Raises
        ------
        InputError
            Points of another shape, not finite, or outside the body.
        """
        body = self.system.body
        sigma = self.stress(points)
        trace = np.trace(sigma)
        if body.plane == "strain":
            nu = _per_cell(body.nu) if points is None else body.material(self._points(points))[2]
            out_of_plane = nu * trace
        else:
            out_of_plane = np.zeros_like(trace)
        trace = trace + out_of_plane
        square = np.sum(sigma**2, axis=(0, 1)) + out_of_plane**2
        return np.asarray(np.sqrt(1.5 * np.maximum(square - trace**2 / 3, 0.0)))

    def sample(self, points: ArrayLike) -> Array:
        """Displacement at points of the body by the element's own interpolation.

        Parameters
        ----------
        points : array, shape (dim, npoints)

        Returns
        -------
        ndarray, shape (dim, npoints)

        Raises
        ------
        InputError
            Points of another shape, not finite, or outside the body.
        """
        return self.system.body.displacement(self.u, self._points(points))

    def _points(self, points: ArrayLike) -> Array:
        where, dim = numbers("points", points), self.system.body.dim
        if where.ndim != 2 or where.shape[0] != dim or not np.all(np.isfinite(where)):
            raise InputError(f"points: expected finite numbers of shape ({dim}, n)")
        return where

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
        """Body as a pyvista grid: displacement, cell-wise von Mises stress.

        Parameters
        ----------
        subdivide : int, optional
            Linear cells along each edge of a cell instead of exact ones, as for
            `skfem_adini.to_pyvista`.

        Returns
        -------
        pyvista.UnstructuredGrid

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        return body_grid(self, subdivide)

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
        return plot_tractions(self, ax)


def _per_cell(value: Array) -> Array:
    return value[:, None] if value.ndim else value
