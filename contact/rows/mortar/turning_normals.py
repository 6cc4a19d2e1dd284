r"""How the averaged normals of facets in space turn with the displacement.

The normal of a facet at one of its corners is that of :math:`c = t_1 \times t_2` with the tangents
:math:`t_i = \sum_k x_k \, \partial_i N_k` of its nodes, so that

.. math::
    \delta c = \sum_k \delta x_k \times (\partial_1 N_k \, t_2 - \partial_2 N_k \, t_1), \qquad
    \delta n = (1 - n n^T) \, \delta c / |c| .

Averaged normals and those between the corners are sums of such, scaled to unit length. Their
weights are kept: neighbouring facets turn alike.

References
----------
M. A. Puso and T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004), appendix.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.mortar.face_maps import FaceMaps, shapes
from contact.rows.outline import Outline, hats, reference_corners

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Csr = sparse.csr_array

# [i, j, k] e_k v_j is the component i of v x e.
_CROSS = np.zeros((3, 3, 3))
_CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_CROSS[[1, 2, 0], [0, 1, 2], [2, 0, 1]] = -1.0


def turning_normals(
    outline: Outline, maps: FaceMaps, of_nodes: Csr, facet: Index, X: Array
) -> list[Csr]:
    """Derivatives of the components of the normals at places of facets, three of (n, ndofs).

    Parameters
    ----------
    outline : Outline
    maps : FaceMaps
        Its facets where the body has moved to, see `contact.rows.mortar.displaced.displaced_maps`.
    of_nodes : csr_array, shape (nfacets * k, scalar dofs)
        Trace at their nodes.
    facet : ndarray of int, shape (n,)
    X : ndarray, shape (2, n)
    """
    at_corners, corners, count = _at_corners(outline, maps, of_nodes), maps.corners, facet.size
    hat = hats(X, corners)
    mean = np.einsum("dnk,kn->dn", maps.normals[:, facet], hat)
    size = np.linalg.norm(mean, axis=0)
    column = facet[:, None] * corners + np.arange(corners)
    row = np.repeat(np.arange(count), corners)
    between = Csr(
        sparse.coo_array(
            ((hat / size).T.ravel(), (row, column.ravel())),
            shape=(count, outline.facets.size * corners),
        )
    )
    return _across([Csr(between @ part) for part in at_corners], mean / size)


def _at_corners(outline: Outline, maps: FaceMaps, trace: Csr) -> list[Csr]:
    """Derivatives of the averaged normals at the corners of all facets, (nfacets * ncorners, .)."""
    count, corners, nodes = outline.facets.size, maps.corners, maps.nodes.shape[2]
    every = np.arange(count)
    own, change = np.empty((3, count, corners)), np.empty((3, 3, count, corners, nodes))
    for k, at in enumerate(reference_corners(3, corners).T):
        place = np.repeat(at[:, None], count, axis=1)
        one, two = maps.tangents(every, place).transpose(1, 0, 2)
        c = np.cross(one, two, axis=0)
        size = np.linalg.norm(c, axis=0)
        own[:, :, k] = c / size
        slope = shapes(place, nodes)[1]
        arm = np.einsum("nf,df->dfn", slope[:, 0], two) - np.einsum("nf,df->dfn", slope[:, 1], one)
        of_c = np.einsum("ijk,kfn->ijfn", _CROSS, arm) / size[:, None]
        along = np.einsum("jf,jifn->ifn", own[:, :, k], of_c)
        change[:, :, :, k] = of_c - own[:, :, k][:, None, :, None] * along[None]
    outward = np.sign(np.sum(own * maps.normals, axis=0))
    change, own = change * outward[..., None], own * outward
    row = np.repeat(np.arange(count * corners), nodes)
    column = np.tile((every[:, None] * nodes + np.arange(nodes))[:, None], (1, corners, 1)).ravel()
    shape = count * corners, count * nodes
    mean, free = outline.averaging(own, maps.nodes[:, :, :corners])
    parts = []
    for i in range(3):
        of_components = [
            _embedded(sparse.coo_array((change[i, j].ravel(), (row, column)), shape) @ trace, j)
            for j in range(3)
        ]
        total = of_components[0] + of_components[1] + of_components[2]
        parts.append(Csr(sparse.diags_array(free[i].ravel().astype(float)) @ (mean @ total)))
    return _across(parts, maps.normals.reshape(3, -1))


def _across(parts: list[Csr], n: Array) -> list[Csr]:
    """Components of the derivatives of vectors without those along unit vectors n (3, nrows)."""
    along = sum((sparse.diags_array(n[i]) @ parts[i] for i in range(3)), start=0.0 * parts[0])
    return [Csr(parts[i] - sparse.diags_array(n[i]) @ along) for i in range(3)]


def _embedded(of_scalar: sparse.csr_array, j: int) -> Csr:
    """Rows of a scalar trace in the dofs of component j."""
    coo = of_scalar.tocoo()
    shape = coo.shape[0], 3 * coo.shape[1]
    return Csr(sparse.coo_array((coo.data, (coo.row, 3 * coo.col + j)), shape=shape))
