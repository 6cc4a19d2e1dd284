"""One body of a result of large strain: stresses, deformation, state, grid and pictures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.nonlinear.cell_forces import FormForces, State, det
from contact.nonlinear.nonlinear_body import NonlinearBody
from contact.output.vtk import body_grid
from contact.result.body_result import BodyResult, vertex_means
from skfem_adini import von_mises

Array = NDArray[np.float64]
__all__ = ["DeformedBody"]


@dataclass(frozen=True, eq=False, repr=False)
class DeformedBody:
    """The part of a `NonlinearResult` that belongs to one body: ``result[body]``.

    Attributes
    ----------
    body : NonlinearBody or ElasticBody
    u : ndarray, shape (ndofs,)
        Displacement of all dofs of ``body.basis``.
    state, before : dict
        State of the material at the quadrature points, at the end and at the start of the step.
    dt : float
        Time that the step took.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, NeoHooke, NonlinearBody, NonlinearStepper, Plane
    >>> body = NonlinearBody.from_mesh(MeshQuad().refined(1).with_defaults(), stress=NeoHooke(1, 9))
    >>> problem = ContactProblem(body.fix("top", "xy"), "bottom", Plane((0, 0), (0, 1)))
    >>> result = NonlinearStepper(problem).move("top", "y", -0.2).run([0.5, 1.0])[-1]
    >>> bool(result[0].cell_stress()[1, 1].max() < 0)
    True
    """

    body: Any
    u: Array
    state: State
    before: State
    dt: float

    def __repr__(self) -> str:
        size = self.body.largest_displacement(self.u)
        return f"DeformedBody({self.body!r}; displacement at most {size:.6g})"

    def stress(self) -> Array:
        """Cauchy stress at the quadrature points, shape (3, 3, ncells, npoints).

        Returns
        -------
        ndarray
            Of an `ElasticBody` the means of the cells.

        Raises
        ------
        InputError
            A body given by forms, which do not say their stress.
        """
        body = self.body
        if not isinstance(body, NonlinearBody):
            none = np.zeros(self.u.size)
            mean = BodyResult(body, self.u, none, none, none).cell_stress()
            return np.broadcast_to(mean[..., None], (*mean.shape, body.measure.shape[1]))
        return body.cauchy_stress(self.u, self.before, self.dt)

    @property
    def knows_stress(self) -> bool:
        """Whether the stress is known: not of bodies given by forms."""
        return not isinstance(getattr(self.body, "cells", None), FormForces)

    def von_mises(self) -> Array:
        """Von Mises stress at the quadrature points, shape (ncells, npoints).

        Returns
        -------
        ndarray
        """
        return np.asarray(von_mises(self.stress()))

    def cell_stress(self) -> Array:
        """Mean Cauchy stress of each cell, shape (3, 3, ncells).

        Returns
        -------
        ndarray
        """
        return self.cell_means(self.stress())

    def nodal_stress(self) -> Array:
        """Means of the cells' stresses at the vertices, shape (3, 3, nvertices).

        Returns
        -------
        ndarray
        """
        mesh, mean = self.body.mesh, self.cell_stress()
        at = np.repeat(mean[..., None], mesh.t.shape[0], axis=-1)
        return vertex_means(mesh, at, self.body.measure.sum(axis=1))

    def cell_means(self, values: Array) -> Array:
        """Means over the cells of values at the quadrature points, shape (..., ncells).

        Parameters
        ----------
        values : ndarray, shape (..., ncells, npoints)

        Returns
        -------
        ndarray
        """
        dx = self.body.measure
        return np.asarray((values * dx).sum(axis=-1) / dx.sum(axis=1))

    def volume_ratio(self) -> Array:
        """det F at the quadrature points, shape (ncells, npoints); 1 for an `ElasticBody`.

        Returns
        -------
        ndarray
        """
        if not isinstance(self.body, NonlinearBody):
            return np.ones(self.body.measure.shape)
        return np.asarray(det(self.body.deformation_gradient(self.u)))

    @property
    def scalars(self) -> dict[str, Array]:
        """Means over each cell of det F, von Mises stress if known, and scalar states."""
        points = {"det_F": self.volume_ratio()}
        points |= {"von_mises": self.von_mises()} if self.knows_stress else {}
        points |= {n: v for n, v in self.state.items() if v.ndim == 2}
        return {name: self.cell_means(values) for name, values in points.items()}

    def to_pyvista(self, subdivide: int | None = None) -> Any:
        """The body on its deformed shape, with displacement, stress, det F and scalar states.

        Parameters
        ----------
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
        return body_grid(self, subdivide)

    def on_grid(self, grid: Any) -> Any:
        """A grid of the undeformed body moved to the deformed shape, with the cells' scalars.

        Parameters
        ----------
        grid : pyvista.UnstructuredGrid

        Returns
        -------
        pyvista.UnstructuredGrid
        """
        share = grid.n_cells // self.body.mesh.nelements
        for name, values in self.scalars.items():
            grid.cell_data[name] = np.repeat(values, share)
        grid.points = np.asarray(grid.points) + np.asarray(grid.point_data["displacement"])
        return grid

    @property
    def mesh(self) -> Any:
        """The mesh with its vertices, and nodes of curved edges, at their current places."""
        mesh, body = self.body.mesh, self.body
        corners = body.basis.nodal_dofs[: body.dim]
        n = corners.shape[1]
        moved = mesh.doflocs.copy()
        moved[:, :n] += self.u[corners]
        if moved.shape[1] > n:
            moved[:, n:] += body.displacement(self.u, mesh.doflocs[:, n:])
        return replace(mesh, doflocs=moved)
