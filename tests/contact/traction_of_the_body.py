"""The traction on a boundary as the stresses of the body beside it have it."""

from types import SimpleNamespace

import numpy as np
from scipy.interpolate import RBFInterpolator
from skfem import ElementHex2, ElementQuad2, ElementTetP2, ElementTriP2

from contact.facet_basis import facet_basis


def forces(result):
    """What the body asks of its boundaries, as forces on all dofs."""
    body = result.system.body
    basis, lam, mu = body.basis, body.E * body.nu, body.E / (2 * (1 + body.nu))
    lam = lam / (1 - body.nu**2 if body.plane == "stress" else (1 + body.nu) * (1 - 2 * body.nu))
    gradient = np.asarray(basis.interpolate(result.u).grad)
    sigma = mu * (gradient + gradient.swapaxes(0, 1))
    for c in range(body.dim):
        sigma[c, c] += lam * np.trace(gradient)
    asked = np.zeros(basis.N)
    for i, dofs in enumerate(basis.element_dofs):
        work = np.sum(sigma * np.asarray(basis.basis[i][0].grad), axis=(0, 1)) * basis.dx
        np.add.at(asked, dofs, work.sum(axis=1))
    return asked - body.f


def hats(body, facets):
    """Vertices of a boundary, and the dofs of functions that are their hats on it."""
    mesh, dofs = body.mesh, body.scalar_dofs
    vertex = np.unique(mesh.facets[:, facets])
    L = np.zeros((dofs.N, mesh.nvertices))
    L[dofs.nodal_dofs[0], np.arange(mesh.nvertices)] = 1.0
    carriers = []  # what has one dof more each, the mean of its vertices
    if isinstance(body.element, ElementTriP2 | ElementQuad2 | ElementHex2):
        carriers.append((dofs.facet_dofs, mesh.facets))
    if isinstance(body.element, ElementTetP2 | ElementHex2):
        carriers.append((dofs.edge_dofs, mesh.edges))
    for more, ends in carriers:
        for end in ends:
            L[more[0], end] = 1.0 / len(ends)
    return vertex, L[:, vertex]


def solved(A, asked, taken):
    """Pressure and shear at a vertex, none in directions that supports take."""
    kept = np.ones(asked.size, dtype=bool)
    for c in np.flatnonzero(taken):
        kept[1 + np.argmax(np.abs(A[c, 1:]) * kept[1:])] = False
    found = np.zeros(asked.size)
    found[kept] = np.linalg.lstsq(A[np.ix_(~taken, kept)], asked[~taken], rcond=None)[0]
    return found


def traction(result, boundary):
    """Means of the traction beside each vertex of a boundary, weighted by its hat.

    Places x, pressure, shear as vectors (dim, m), and `free`, where no support takes a part.
    """
    body = result.system.body
    facets, dim = body.facets(boundary), body.dim
    vertex, L = hats(body, facets)
    basis = facet_basis(body.mesh, body.element, facets, dofs=body.scalar_dofs, intorder=8)
    value = np.zeros((vertex.size, *basis.dx.shape))
    for field, dofs in zip(basis.basis, basis.element_dofs, strict=True):
        value += L[dofs].T[:, :, None] * np.asarray(field[0])
    n = np.asarray(basis.normals)
    if dim == 2:
        frame = np.array([-n, [-n[1], n[0]]])
    else:
        away = np.eye(3)[np.argmin(np.abs(n.mean(axis=(1, 2))))][:, None, None]
        first = away - np.sum(away * n, axis=0) * n
        first /= np.linalg.norm(first, axis=0)
        frame = np.array([-n, first, np.cross(n, first, axis=0)])
    weighted = value * basis.dx
    size = weighted.sum(axis=(1, 2))
    asked = np.array([L.T @ forces(result)[c::dim] for c in range(dim)])
    parts = np.einsum("vfq,jcfq->vcj", weighted, frame)
    held = np.diff(body.constraint[0].indptr) == 0
    taken = np.array([np.abs(L[held[c::dim]]).sum(axis=0) for c in range(dim)]).T > 0
    part = np.array([solved(*of) for of in zip(parts, asked.T, taken, strict=True)])
    return SimpleNamespace(
        x=np.einsum("vfq,cfq->cv", weighted, np.asarray(basis.global_coordinates())) / size,
        pressure=part[:, 0],
        shear=np.einsum("vcj,vj->cv", parts[:, :, 1:], part[:, 1:]) / size,
        free=~taken.any(axis=1),
        total=asked.sum(axis=1),
    )


def mismatch(result, boundary, normals=None):
    """Means over the boundary of what a result's traction is off the body's, over the mean one.

    Along the normal and along the boundary; `normals` (dim, 1), where they are not the points' own.
    """
    there, rows = traction(result, boundary), result.system.rows
    normals = rows.normals if normals is None else normals
    ours = np.einsum("mj,cjm->cm", result.shear, rows.tangents) - result.pressure * rows.normals
    mean = np.sum(rows.weights * np.linalg.norm(ours, axis=0))
    if mean == 0:
        return 0.0, 0.0
    size = np.ptp(result.system.body.mesh.p, axis=1).max()
    fields = np.vstack((there.pressure, there.shear)).T
    read = RBFInterpolator(there.x.T / size, fields, kernel="linear", degree=0)
    pressure, *shear = read(result.x.T / size).T
    normal = -np.sum(ours * normals, axis=0)
    along = np.linalg.norm(ours + normal * normals - shear, axis=0)
    nearest = np.argmin(((there.x[:, :, None] - result.x[:, None]) ** 2).sum(axis=0), axis=0)
    along = along * there.free[nearest]
    return tuple(float(np.sum(rows.weights * e) / mean) for e in (np.abs(normal - pressure), along))
