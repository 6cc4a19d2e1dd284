"""Rows for normal and tangential displacement at contact points, from the facets' shares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import FacetBasis

from contact.body.supports import few_times, norms
from contact.rows.frames import directed, turned_tangents
from contact.rows.outline import Outline
from contact.rows.shares import Shares

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TraceRows:
    """The trace of a body on its contact facets, at the points of their functional."""

    outline: Outline
    shares: Shares
    x: Array  # points of the functional, shape (dim, nfacets, npoints)
    normals: Array  # of the facets, along which contact acts, shape as x
    smooth: Array  # smooth normals, for the tangents, shape as x
    parts: Array  # from functions to values, (nfacets, nvalues, npoints, nfunctions)
    dofs: NDArray[np.int64]  # scalar dofs of the functions, shape (nfacets, nfunctions)

    @classmethod
    def of(
        cls,
        outline: Outline,
        basis: FacetBasis,
        shares: Shares,
        direction: Callable[[Array], Array] | None,
    ) -> TraceRows:
        """Evaluate the trace with a scalar basis at the points of the functional.
        `direction` x -> n gives unit vectors in place of the normals."""
        x, points = np.asarray(basis.global_coordinates()), np.asarray(basis.X)
        values = np.stack([np.asarray(field[0]) for field in basis.basis], axis=-1)
        dofs = np.asarray(basis.element_dofs.T, dtype=np.int64)
        if shares.mean:
            carried = outline.body.scalar_dofs.nodal_dofs[:, outline.corners]
            mine = (dofs[:, None, :] == carried[..., None]).any(axis=0)
            measure = np.asarray(basis.dx) * outline.body.depth(x)
            parts = (values * measure[..., None])[:, None] * mine[:, :, None]
        else:
            # All other functions vanish on the facet, up to rounding of the coordinates.
            on_facet = (dofs[:, None, :] == outline.scalar_dofs[..., None]).any(axis=1)
            parts = shares.C[..., None] * (values * on_facet[:, None])[:, None]
        normals = np.asarray(basis.normals) if direction is None else direction(x)
        smooth = outline.smooth(normals, points) if direction is None else normals
        return cls(outline, shares, x, normals, smooth, parts, dofs)

    @cached_property
    def scalar(self) -> sparse.csr_array:
        """Rows of a scalar trace, shape (m, scalar dofs)."""
        return self._rows(self.parts.sum(axis=2)[None], 1)

    @cached_property
    def supported(self) -> sparse.csr_array:
        """Rows of a scalar trace that decide whether supports fix a contact point, as its vertex.
        At a plane of symmetry the mean over one side's facets may move across the plane; that over
        both sides does not."""
        hub = self.shares.hub
        k, place = np.unique(self.shares.number[hub >= 0], return_index=True)
        value = self.outline.body.scalar_dofs.nodal_dofs[0, hub[hub >= 0][place]]
        vertex = sparse.csr_array((np.ones(k.size), (k, value)), shape=self.scalar.shape)
        rest = np.ones(self.scalar.shape[0])
        rest[k] = 0.0
        return sparse.csr_array(vertex + sparse.diags_array(rest) @ self.scalar)

    def normal(self, normals: Array, sharp: NDArray[np.bool_]) -> sparse.csr_array:
        """Rows of the normal displacement, (m, ndofs); in `sharp` corners along `normals` (dim, m).
        Elsewhere along the normals of the facets."""
        rows = self._rows(np.einsum("fspb,cfp->cfsb", self.parts, self.normals), self.dim)
        return _chosen(sharp, directed(self.scalar, normals), rows)

    def tangential(
        self, normals: Array, tangents: Array, sharp: NDArray[np.bool_]
    ) -> sparse.csr_array:
        """Rows of the displacement along one tangent (dim, m) per contact point, (m, ndofs).
        The tangents follow the smooth normals along the facets, except in corners and where
        supports fix a point in the direction of its tangent."""
        number = self.shares.number
        mean, along = (
            np.broadcast_to(v[:, number][..., None], (self.dim, *self.parts.shape[:3]))
            for v in (normals, tangents)
        )
        here = np.broadcast_to(self.smooth[:, :, None], mean.shape)
        turned = turned_tangents(along[:, None], mean, here)[:, 0]
        rows = self._rows(np.einsum("fspb,cfsp->cfsb", self.parts, turned), self.dim)
        rows = _chosen(sharp, directed(self.scalar, tangents), rows)
        # Rows that vanish, up to rounding, in the free unknowns: supports fix this direction.
        straight, P = directed(self.supported, tangents), self.outline.body.constraint[0]
        return _chosen(norms(few_times(straight, P)) <= 1e-9 * norms(straight), straight, rows)

    @property
    def dim(self) -> int:
        """Number of components."""
        return self.outline.body.dim

    def _rows(self, values: Array, components: int) -> sparse.csr_array:
        """Sum the parts (components, nfacets, nvalues, nfunctions) of all facets."""
        body, (_, facets, slots, functions) = self.outline.body, values.shape
        shape = components, facets, slots, functions
        number = np.broadcast_to(self.shares.number[None, :, :, None], shape)
        component = np.arange(components)[:, None, None, None]
        column = np.broadcast_to(components * self.dofs[None, :, None] + component, shape)
        size = self.shares.weights.size, components * body.scalar_dofs.N
        place = number.ravel(), column.ravel()
        result = sparse.csr_array(sparse.coo_array((values.ravel(), place), shape=size))
        result.data *= np.repeat(1.0 / self.shares.weights, np.diff(result.indptr))
        # Drop rounding: a direction along an axis has no other component.
        length = body.lengths[0][body.dim * (result.indices // components)]
        result.data[np.abs(result.data) < 1e-11 * length] = 0.0
        result.eliminate_zeros()
        return result


def _chosen(
    where: NDArray[np.bool_], rows: sparse.csr_array, other: sparse.csr_array
) -> sparse.csr_array:
    """Rows of the first matrix where chosen, else of the second."""
    both = sparse.csr_array(sparse.vstack([rows, other], format="csr"))
    result = sparse.csr_array(both[np.arange(where.size) + np.where(where, 0, where.size)])
    result.eliminate_zeros()
    return result
