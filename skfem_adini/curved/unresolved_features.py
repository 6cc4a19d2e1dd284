"""Gaps, holes and strips of a cut domain that are too narrow for the cells to resolve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from skfem_adini.curved.cut_domain import CutDomain
from skfem_adini.errors import UnresolvedWarning
from skfem_adini.ground.errors import warn

Array = NDArray[np.float64]
Indices = NDArray[np.integer]


def components(domain: CutDomain) -> Indices:
    """Return the component number of every vertex; active cells with a common vertex are joined."""
    t = domain.mesh.t[:, domain.active]
    count = domain.mesh.p.shape[1]
    place = np.repeat(t[0], 3), t[1:].T.ravel()
    graph = sparse.coo_array((np.ones(place[0].size), place), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def warn_of_unresolved_features(domain: CutDomain) -> None:
    r"""Warn where two pieces of the boundary face each other in the support of one shape function.
    Active cells at a vertex share its dofs: both sides of a gap of less than two cells are coupled.
    Pieces face each other if :math:`n_a \cdot n_b < -0.9` and each lies in front of the other."""
    rule, mesh = domain.quadrature, domain.mesh
    cells, first, count = np.unique(rule.boundary_cells, return_index=True, return_counts=True)
    if cells.size == 0:
        return
    most = int(min(count.max(), 12))  # boundary points compared in a cell, out of possibly hundreds
    # Points spread evenly over those of the cell, repeated if there are fewer than `most`.
    chosen = first[:, None] + (np.linspace(0, 1, most) * (count - 1)[:, None]).round().astype(int)
    size = np.ptp(mesh.p[:, mesh.t[:, cells]], axis=1)
    points, normals = rule.boundary_points[:, chosen], rule.normals[:, chosen]

    around = sparse.csr_array(
        (np.ones(4 * cells.size), (mesh.t[:, cells].T.ravel(), np.repeat(np.arange(cells.size), 4)))
    )
    vertices = np.flatnonzero(np.diff(around.indptr))
    most = int(np.diff(around.indptr).max())
    slots = np.minimum(np.arange(most), np.diff(around.indptr)[vertices, None] - 1)
    patches = around.indices[around.indptr[vertices, None] + slots]
    said = False
    for start in range(0, len(patches), 500):  # patches of (4 x 12)^2 pairs of points
        members = patches[start : start + 500]
        shape = 2, len(members), -1
        places = points[:, members].reshape(shape), normals[:, members].reshape(shape)
        distance = _facing(*places, inside=True)
        # In a domain thinner than a cell one polynomial represents both sides.
        thin = np.flatnonzero(distance < size[:, members].min(axis=(0, 2)))
        if thin.size and not said:
            said, here = True, thin[0]
            x, y = mesh.p[:, vertices[start + here]]
            _warn(
                f"the domain is {distance[here]:.2g} thin in the cells at ({x:.6g}, {y:.6g}), of "
                f"size {size[0, members[here, 0]]:.2g}"
            )
        distance = _facing(*places, inside=False)
        if np.isfinite(distance).any():
            nearest = int(distance.argmin())
            x, y = mesh.p[:, vertices[start + nearest]]
            _warn(
                f"a gap or hole of the domain, {distance[nearest]:.2g} wide, lies between cells "
                f"that meet at ({x:.6g}, {y:.6g}), of size {size[0, members[nearest, 0]]:.2g}: "
                "what is on both sides is coupled"
            )
            break


def _facing(points: Array, normals: Array, inside: bool) -> Array:
    """Return the least distance of two points of each group that face each other, else inf."""
    sign = -1.0 if inside else 1.0
    between = points[:, :, None, :] - points[:, :, :, None]
    length = np.hypot(*between)
    # Normals are opposite up to 26 degrees, and the connecting line within 45 of both.
    opposite = np.einsum("dgi,dgj->gij", normals, normals) < -0.9
    ahead = sign * np.einsum("dgij,dgi->gij", between, normals) > 0.7 * length
    found = opposite & ahead & ahead.swapaxes(1, 2)
    return np.asarray(np.where(found, length, np.inf).min(axis=(1, 2)))


def _warn(what: str) -> None:
    warn(
        f"domain: {what}; the solution there is not to be trusted before the mesh is refined "
        "(refined_at_boundary)",
        UnresolvedWarning,
    )
