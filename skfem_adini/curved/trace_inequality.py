"""Constants of the trace inequality at a boundary, from one small eigenproblem for each cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from skfem.assembly.form.form import FormExtraParams

from skfem_adini.curved.adini_extension import AdiniExtension

Array = NDArray[np.float64]
Indices = NDArray[np.integer]
# Components of a density at the points of a basis, (cells, points) each: it is the sum of squares.
Parts = Callable[[Any, Any], list[Array]]

_SHIFT = 1e-12  # on the unit diagonal of the energies: above rounding, below their least eigenvalue
_MOST_LAYERS = 4  # layers of good cells added to a patch whose good cells are not connected
_PROBLEMS_AT_A_TIME = 1000  # eigenproblems solved together: about 20 kB each


def trace_constants(
    boundary: Any,
    groups: Callable[[Indices], Iterator[Any]],
    fields: Callable[[Any], dict[str, Any]],
    flux: Parts,
    energy: Parts,
    extension: AdiniExtension | None,
) -> tuple[Indices, Array]:
    r"""Return cells K and :math:`\lambda_K` of a trace inequality of fluxes t and energy a(u, u).

    :math:`\lambda_K` is the largest eigenvalue of :math:`\int_{\Gamma_K} |t|^2` against
    :math:`\sum_T a_T / m_T` over the cells T of the patch of K, where T is in :math:`m_T`
    patches: so :math:`\sum_K \int_{\Gamma_K} |t|^2 / \lambda_K \le a(u, u)` for any cut, grading
    and material. A good cell is its own patch; to another one belong the good cells at its
    vertices and the roots of those outside. Without an extension every cell is good."""
    dofs = boundary.dofs.element_dofs
    owners = np.unique(boundary.tind)
    patches: tuple[Indices, Indices] = (np.arange(owners.size), owners)
    if extension is None:
        P = sp.eye_array(boundary.N, format="csr")
    else:
        P = sp.csr_array(extension.P)
        patches = _patches(owners, extension, P, dofs)
    count = np.bincount(patches[1])
    cells = np.flatnonzero(count)
    energies = np.empty((cells.size, len(dofs), len(dofs)))
    for basis in groups(cells):
        F = _factors(basis, fields(basis), energy)
        energies[np.searchsorted(cells, basis.tind)] = F @ F.swapaxes(1, 2)
    energies /= count[cells, None, None]
    F = _factors(boundary, fields(boundary), flux)
    stacked = _joined(F, np.searchsorted(owners, boundary.tind))
    fluxes = np.asarray(np.linalg.qr(stacked, mode="r"))

    Q, first = _parameters(patches, P, dofs)
    A = Q.T @ (_blocks(energies[np.searchsorted(cells, patches[1])]) @ Q)
    own = np.flatnonzero(patches[1] == owners[patches[0]])
    B = _blocks(fluxes) @ Q[(own[:, None] * len(dofs) + np.arange(len(dofs))).ravel()]
    return owners, _largest_eigenvalues(sp.coo_array(A), sp.coo_array(B), first)


def _factors(basis: Any, fields: dict[str, Any], parts: Parts) -> Array:
    """Return F (cells, functions, numbers) with F F^T the integrals of the products of parts."""
    parameters: Any = {**basis.default_parameters(), **fields}
    w: Any = FormExtraParams(parameters)
    root = np.sqrt(basis.dx)
    rows = [np.hstack([root * part for part in parts(function[0], w)]) for function in basis.basis]
    return np.stack(rows, axis=1)


def _joined(F: Array, owner: Indices) -> Array:
    """Return, for each owner, the rows of all its pieces, (owners, numbers, functions)."""
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], owner[order])
    slot = np.arange(owner.size) - start
    found = np.zeros((owner.max() + 1, slot.max() + 1, F.shape[2], F.shape[1]))
    found[owner[order], slot] = F[order].swapaxes(1, 2)
    return found.reshape(len(found), -1, F.shape[1])


def _patches(
    owners: Indices, extension: AdiniExtension, P: Any, dofs: Indices
) -> tuple[Indices, Indices]:
    """Return pairs of a place in `owners` and a cell of its patch, ascending."""
    mesh, good = extension.domain.mesh, extension.good
    vertices, cells = mesh.nvertices, mesh.t.shape[1]
    holders = _ones(
        np.append(mesh.t[:, good].ravel(), extension.outside),
        np.append(np.tile(good, 4), extension.roots),
        (vertices, cells),
    )
    places, bad = np.arange(owners.size), np.flatnonzero(~np.isin(owners, good))
    corners = _ones(np.tile(bad, 4), mesh.t[:, owners[bad]].ravel(), (owners.size, vertices))
    members = corners @ holders + _ones(places, owners, (owners.size, cells))
    rows = np.tile(np.arange(cells), len(dofs))
    depends = sp.csr_array(_ones(rows, dofs.ravel(), (cells, P.shape[0])) @ abs(P))
    for _ in range(_MOST_LAYERS):
        apart = _apart(members, depends, good)
        if not apart.size:
            break
        near = _ones(apart, apart, (owners.size, owners.size)) @ (members @ depends)
        members = members + near @ (_ones(good, good, (cells, cells)) @ depends).T
    pairs = sp.csr_array(members).nonzero()
    order = np.lexsort(pairs[::-1])
    return pairs[0][order], pairs[1][order]


def _apart(members: Any, depends: sp.csr_array, good: Indices) -> Indices:
    """Return the patches whose parameters are not held together by good cells.
    Two of these hold each other, rigid motions included, if they have one parameter in common."""
    place, cell = sp.csr_array(members).nonzero()
    rows = sp.coo_array(depends[cell])
    pair, column = rows.coords
    owner = place[pair]
    keys, node = np.unique(owner * depends.shape[1] + column, return_inverse=True)
    holds = np.isin(cell, good)[pair]
    size = cell.size + keys.size
    graph = _ones(pair[holds], cell.size + node[holds], (size, size))
    label = connected_components(graph, directed=False)[1][cell.size :]
    of_key = keys // depends.shape[1]
    mixed = (np.diff(of_key) == 0) & (np.diff(label) != 0)
    return np.unique(of_key[1:][mixed])


def _ones(rows: Indices, columns: Indices, shape: tuple[int, int]) -> sp.csr_array:
    return sp.csr_array((np.ones(rows.size), (rows, columns)), shape=shape)


def _blocks(local: Array) -> sp.bsr_array:
    """Return a block diagonal matrix."""
    place = np.arange(len(local) + 1)
    shape = len(local) * local.shape[1], len(local) * local.shape[2]
    return sp.bsr_array((local, place[:-1], place), shape=shape)


def _parameters(
    patches: tuple[Indices, Indices], P: sp.csr_array, dofs: Indices
) -> tuple[sp.csr_array, Indices]:
    """Return the dofs of all pairs by the parameters of each patch, and where these begin."""
    place, cell = patches
    rows = sp.coo_array(P[dofs[:, cell].T.ravel()])
    row, column = rows.coords
    keys, node = np.unique(
        place[row // len(dofs)] * np.int64(P.shape[1]) + column, return_inverse=True
    )
    Q = sp.csr_array((rows.data, (row, node)), shape=(rows.shape[0], keys.size))
    first = np.searchsorted(keys, np.arange(place[-1] + 2) * np.int64(P.shape[1]))
    return Q, first


def _largest_eigenvalues(A: sp.coo_array, B: sp.coo_array, first: Indices) -> Array:
    """Return the largest eigenvalue of B^T B against A for each block of their columns."""
    found = np.zeros(first.size - 1)
    if not A.shape[0]:
        return found
    height = B.shape[0] // found.size
    diagonal = A.diagonal()
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    block = np.repeat(np.arange(found.size), np.diff(first))
    sizes = np.diff(first)
    for size in np.unique(sizes[sizes > 0]).tolist():
        same = np.flatnonzero(sizes == size)
        for start in range(0, same.size, _PROBLEMS_AT_A_TIME):
            chosen = same[start : start + _PROBLEMS_AT_A_TIME]
            slot = np.full(found.size, -1)
            slot[chosen] = np.arange(chosen.size)
            a, b = np.zeros((chosen.size, size, size)), np.zeros((chosen.size, height, size))
            for matrix, dense, rows in ((A, a, None), (B, b, height)):
                row, column = matrix.coords
                at = slot[block[column]]
                kept = at >= 0
                values = matrix.data[kept] * scale[column[kept]]
                begin = first[block[column[kept]]]
                if rows is None:
                    values, local = values * scale[row[kept]], row[kept] - begin
                else:
                    local = row[kept] % rows
                dense[at[kept], local, column[kept] - begin] = values
            a[:, range(size), range(size)] += _SHIFT
            gram = b @ np.linalg.solve(a, b.swapaxes(1, 2))
            found[chosen] = np.linalg.eigvalsh((gram + gram.swapaxes(1, 2)) / 2)[:, -1]
    return found
