r"""Internal forces of slender cells in pairs of numbers, from the strains of each cell.

The cells compute :math:`\int \sigma(u) : \nabla v` as `contact.body.cell_strains` does, with the
same gradients of the basis functions, weights and constants. No sum is rounded to float64, and the
first node of a cell takes what the others leave of the resultant, which is zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.paired_rows import rows_times
from contact.arrays.pairs import Pairs, dot
from contact.arrays.ranges import in_ranges
from contact.body.axisymmetric_law import AxisymmetricLaw
from contact.body.axisymmetry import strains
from contact.body.cell_strains import gradients
from contact.body.constitutive import TensorLaw

Array = NDArray[np.float64]
_CELLS = 2**9  # whose gradients are there at the same time


def strained_forces(body: Any, u: Array) -> Pairs:
    """Forces of a displacement on all dofs, shape (ndofs,).

    Parameters
    ----------
    body : BasisSolid
    u : ndarray, shape (ndofs,)
    """
    basis, dim = body.basis, body.dim
    dofs, measure = basis.element_dofs.T, body.measure
    local = u[dofs].reshape(len(dofs), -1, dim)
    values = body.are_values[dofs].reshape(local.shape)
    first = np.where(values, local[:, :1], 0.0)
    g = gradients(basis)
    hoop = strains(basis)[:, :, 2, ::dim] if body.is_ring else None
    forces = Pairs.zeros(local.shape)

    def work(some: slice) -> None:
        G = _gradient(g[:, some], Pairs.of(local[some]) - first[some])
        if hoop is not None:
            G = _with_hoop(G, dot(_by_function(hoop[some]), _of_cells(local[some, :, 0])))
        mean = None
        if body.dilatation == "mean":
            weights = measure[some].T
            total = dot(weights, Pairs(*(part.T for part in _parts(_trace(G)))))
            mean = (total / Pairs.of(weights).sum()).reshape(-1, 1)
        sigma = _stress(body.law.at(np.arange(len(dofs))[some]), G, mean) * measure[some]
        found = _transposed(g[:, some], sigma)
        found[:, 0] = found[:, 0] - Pairs.where(values[some], found, 0.0).sum(axis=1)
        if hoop is not None:
            ring = dot(hoop[some].transpose(1, 0, 2), _of_cells(sigma[2, 2]))
            found[:, :, 0] = found[:, :, 0] + ring
        forces[some] = found

    in_ranges(work, len(dofs), _CELLS)
    places = dofs.ravel(), np.arange(dofs.size)
    scatter = sparse.csr_array((np.ones(dofs.size), places), shape=(u.size, dofs.size))
    return rows_times(scatter, forces.reshape(-1))


def _gradient(g: Array, v: Pairs) -> Pairs:
    """d u_b / d x_a as [b, a], shape (dim, dim, ncells, npoints)."""
    dim = len(g)
    G = Pairs.zeros((dim, dim, *g.shape[1:3]))
    for b in range(dim):
        for a in range(dim):
            G[b, a] = dot(_by_function(g[a]), _of_cells(v[:, :, b]))
    return G


def _transposed(g: Array, sigma: Pairs) -> Pairs:
    """Sums over points of sigma_ba times the gradients, shape (ncells, nfunctions, dim)."""
    dim, cells, _, n = g.shape
    forces = Pairs.zeros((cells, n, dim))
    at = np.moveaxis(g, 2, 1).reshape(-1, cells, n)
    for b in range(dim):
        along = (np.moveaxis(part[b, :dim], 2, 1) for part in _parts(sigma))
        forces[:, :, b] = dot(at, Pairs(*(part.reshape(-1, cells, 1) for part in along)))
    return forces


def _with_hoop(G: Pairs, hoop: Pairs) -> Pairs:
    """The gradient in the axes r, z, theta."""
    full = Pairs.zeros((3, 3, *hoop.high.shape))
    full[:2, :2], full[2, 2] = G, hoop
    return full


def _stress(law: Any, G: Pairs, mean: Pairs | None) -> Pairs:
    """``lambda tr(eps) I + 2 mu eps`` or C eps of gradients, of the same shape."""
    solid = law.solid if isinstance(law, AxisymmetricLaw) else law
    dim, shape = len(G.high), G.high.shape[2:]
    sigma = Pairs.zeros(G.high.shape)
    if isinstance(solid, TensorLaw):
        flat = G.reshape(dim * dim, *shape)
        for a in range(dim):
            for b in range(dim):
                sigma[a, b] = dot(solid.tensor[a, b].reshape(dim * dim, -1, 1), flat)
        return sigma
    lame_lambda, lame_mu = (np.reshape(v, (-1, 1)) for v in (solid.lam, solid.mu))
    pressure = (_trace(G) if mean is None else mean) * lame_lambda
    for a in range(dim):
        for b in range(dim):
            shear = (G[a, b] + G[b, a]) * lame_mu
            sigma[a, b] = shear + pressure if a == b else shear
    return sigma


def _trace(G: Pairs) -> Pairs:
    every = range(len(G.high))
    return Pairs(*(np.array([part[a, a] for a in every]) for part in _parts(G))).sum()


def _by_function(rows: Array) -> Array:
    """Of each cell, point and function, (ncells, npoints, n), as (n, ncells, npoints)."""
    return rows.transpose(2, 0, 1)


def _of_cells(x: Any) -> Pairs:
    """Numbers of each cell, shape (ncells, n), for sums over n: shape (n, ncells, 1)."""
    return Pairs(*(part.T[:, :, None] for part in _parts(Pairs.of(x))))


def _parts(x: Pairs) -> tuple[Array, Array]:
    return x.high, x.low
