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
from contact.laws.status import Status
from contact.output.vtk import body_grid, boundary_grid
from contact.plot import plot_tractions
from contact.result.certify import as_lines
from contact.result.contact_state import ContactState
from contact.result.recovery import cell_stress, nodal_stress
from contact.result.stored_result import read, write
from contact.result.summary import as_html, as_text, counts, facts, vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class ContactResult(ContactState):
    """Displacement, contact forces, and what follows from them.

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
    """

    def __repr__(self) -> str:
        return f"ContactResult({counts(self)}; resultant {vector(self.resultant)})"

    def summary(self) -> str:
        """What was solved, what came out and how well it is proved, in ten lines."""
        return as_text(facts(self), type(self).__name__)

    def _repr_html_(self) -> str:
        return as_html(facts(self), type(self).__name__)

    @property
    def x(self) -> Array:
        """Places of the contact points: the functional's means, shape (dim, m)."""
        return self.system.rows.x

    @property
    def x_nominal(self) -> Array:
        """Nominal places of the contact points, shape (dim, m)."""
        return self.system.rows.x_nominal

    @property
    def pressure(self) -> Array:
        """Contact pressure at `x`, force per area, positive in compression, shape (m,)."""
        return self.mu / self.system.rows.weights

    @property
    def shear(self) -> Array:
        """Shear traction that acts on the body at `x`, along the tangents, (m, dim - 1).

        Zero where the whole tangential displacement is prescribed.
        """
        return -self.t / self.system.rows.weights[:, None]

    @cached_property
    def normal_displacement(self) -> Array:
        """u_n of the contact points along the outward normal, shape (m,)."""
        return np.asarray(self.system.rows.G @ self.u)

    @cached_property
    def slip(self) -> Array:
        """Tangential displacement relative to the obstacle, u_t - w_t, shape (m, dim - 1)."""
        return self.system.relative(self.u, self.motion)[1]

    @cached_property
    def slip_increment(self) -> Array:
        """Slip since the last step of a load history, which friction opposes, (m, dim - 1)."""
        return self.system.slip_increment(self.slip)

    @property
    def gap(self) -> Array:
        """What is left of the gap, d - (u_n - w_n), shape (m,)."""
        return self.system.rows.gap - self.system.relative(self.u, self.motion)[0]

    @property
    def part(self) -> NDArray[np.int64]:
        """Number of the contact boundary of each contact point, shape (m,)."""
        part = self.system.rows.part
        return part if part.size else np.zeros(self.mu.size, dtype=np.int64)

    @cached_property
    def status(self) -> NDArray[np.int8]:
        """`Status` of each contact point, shape (m,)."""
        size = max(float(self.mu.max(initial=0.0)), float(np.abs(self.t).max(initial=0.0)))
        g = self.system.bound(self.mu)
        loaded = self.mu > 1e-12 * size
        if self.system.law == "tresca":
            loaded = loaded | (g > 0)
        force = np.linalg.norm(self.t, axis=1)
        # What rounding leaves of a displacement is no slip.
        moves = np.linalg.norm(self.slip_increment, axis=1) > 1e-10 * self.system.body.reach(self.u)
        slides = loaded & moves & (force >= g * (1 - 1e-9))
        return np.where(slides, Status.SLIP, np.where(loaded, Status.STICK, Status.OPEN)).astype(
            np.int8
        )

    @property
    def zone(self) -> Array:
        """Span of the nominal places of loaded points, shape (dim, 2): least and largest.

        NaN where nothing is in contact.
        """
        loaded = self.mu > 1e-12 * float(self.mu.max(initial=0.0))
        if not loaded.any():
            return np.full((self.x.shape[0], 2), np.nan)
        where = self.x_nominal[:, loaded]
        return np.column_stack((where.min(axis=1), where.max(axis=1)))

    @cached_property
    def resultant(self) -> Array:
        """Force of the obstacle on the body, pressure and friction together, shape (dim,)."""
        return self.system.body.total(-self.contact_forces)

    @property
    def resultants(self) -> Array:
        """The resultant of each contact boundary, shape (nboundaries, dim)."""
        return np.array(
            [
                self.system.body.total(-self._forces(self.part == k))
                for k in range(self.part.max() + 1)
            ]
        )

    def _forces(self, chosen: NDArray[np.bool_]) -> Array:
        rows, t = self.system.rows, np.where(chosen[:, None], self.t, 0.0)
        return np.asarray(rows.G.T @ np.where(chosen, self.mu, 0.0) + rows.T.T @ t.ravel())

    @property
    def contact_force(self) -> float:
        """Sum of the normal forces."""
        return float(self.mu.sum())

    @cached_property
    def contact_forces(self) -> Array:
        """``G^T mu + T^T t`` on all dofs: the contact forces with the opposite sign."""
        rows = self.system.rows
        return np.asarray(rows.G.T @ self.mu + rows.T.T @ self.t.ravel())

    @cached_property
    def reactions(self) -> Array:
        """Forces of the supports on all dofs, shape (ndofs,)."""
        system = self.system
        return np.asarray(system.body.internal(self.u) + self.contact_forces - system.load)

    def balance(self) -> dict[str, Array]:
        """Applied load, support reactions, contact force, and what is left of their sum.

        Returns
        -------
        dict
            ``load``, ``support``, ``contact``: resultants, shape (dim,); ``residual``: their sum
            over the largest of them, or over the forces inside the body where all of them are
            rounding of those; reactions count only where a displacement is prescribed.
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
        """One line for each residual of `kkt`."""
        return as_lines(self.kkt)

    def stress(self, points: ArrayLike | None = None) -> Array:
        """Cauchy stress in the quadrature points of the basis, or at given points.

        Parameters
        ----------
        points : array, shape (dim, npoints), optional

        Returns
        -------
        ndarray, shape (dim, dim, ncells, nquadrature) or (dim, dim, npoints)
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
        """Cauchy stress at the vertices of the mesh, shape (3, 3, nvertices)."""
        return nodal_stress(self.system.body, self.u)

    def cell_stress(self) -> Array:
        """Mean Cauchy stress of each cell, shape (3, 3, ncells)."""
        return cell_stress(self.system.body, self.stress())

    @property
    def centre_of_pressure(self) -> Array:
        """Where the resultant of the pressure acts, on each contact boundary, (nboundaries, dim).

        NaN where nothing is in contact. The forces act at the nominal places: the moment about
        any point is that which the body feels.
        """
        parts = [self.part == k for k in range(self.part.max() + 1)]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.array([self.x_nominal[:, p] @ self.mu[p] / self.mu[p].sum() for p in parts])

    def von_mises(self, points: ArrayLike | None = None) -> Array:
        """Von Mises stress, in the places of `stress`; plane strain keeps its sigma_zz."""
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
            Ends in .npz, which is added to a name without a suffix or with a number for one.

        Returns
        -------
        Path
            The file, complete and on the disk.

        Raises
        ------
        InputError
            Another suffix; a state that fails its certificate or holds NaN; a body or an element
            that no file holds.
        """
        return write(self, path)

    @classmethod
    def load(cls, path: str | Path) -> ContactResult:
        """Read a file written by `save`: nothing is lost, and the certificate is computed anew.

        The stiffness is assembled from the mesh, the element, E and nu in the file, so that
        residuals see whether these, loads, laws and solution still belong together. What residuals
        cannot see (names, weights, gaps of open points) a checksum covers. Functions are not in
        the file: supports, obstacles and friction are there as the numbers they gave.

        Raises
        ------
        InputError
            No such file; damaged, changed, encrypted or foreign; the solution in it does not solve
            the problem in it. Files of format 2, before checksums, are certified all the same.
        """
        return cls(**vars(read(path)))

    def to_pyvista(self, subdivide: int | None = None) -> Any:
        """Body as a pyvista grid: displacement, cell-wise von Mises stress."""
        return body_grid(self, subdivide)

    def boundary_to_pyvista(self) -> Any:
        """Contact points as a pyvista point cloud or polyline with every contact field."""
        return boundary_grid(self)

    def plot(self, ax: Any = None) -> Any:
        """Pressure and shear along the boundary, stick and slip; in 3-D pressure on the faces."""
        return plot_tractions(self, ax)


def _per_cell(value: Array) -> Array:
    return value[:, None] if value.ndim else value
