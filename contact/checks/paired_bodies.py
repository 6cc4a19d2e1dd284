"""Internal forces, reactions and resultants of bodies on the host, in pairs of numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.paired_rows import blocks_times, rows_times
from contact.arrays.pairs import Pairs, dot
from contact.arrays.ranges import in_ranges
from contact.body.axisymmetry import AxisymmetricLaw, strains
from contact.body.basis_solid import BasisSolid
from contact.body.cell_strains import gradients
from contact.body.constitutive import TensorLaw
from contact.body.layers.layered_block import LayeredBlock
from contact.body.layers.layers import PER_NODE
from contact.errors import InputError

Array = NDArray[np.float64]


class PairedBody(ABC):
    """Forces of a body as `Pairs` of shape (ndofs,), in twice the working precision."""

    host: Any  # the body on the host, for scales in float64

    @abstractmethod
    def internal(self, u: Array) -> Pairs:
        """Internal forces of a displacement."""

    @abstractmethod
    def unbalanced(self, forces: Pairs) -> float:
        """Largest force at a free unknown; those of derivatives are divided by their length."""

    @abstractmethod
    def at_supports(self, forces: Pairs) -> Pairs:
        """The part of forces that acts where a displacement is prescribed."""

    @abstractmethod
    def total(self, forces: Pairs) -> Pairs:
        """Resultant of forces, shape (dim,); of a ring along its axis only."""

    @abstractmethod
    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement; of derivatives times their length."""


def paired_body(body: Any) -> PairedBody:
    """The `PairedBody` of a body; raises InputError for an unsupported kind."""
    if isinstance(body, BasisSolid):
        return PairedBasisBody(body)
    if isinstance(body, LayeredBlock):
        return PairedBlock(body)
    raise InputError(
        f"result: its body is a {type(body).__name__}, of which no process has all forces; solve "
        "with an ElasticBody on one process to check a result in other arithmetic"
    )


class PairedBasisBody(PairedBody):
    """A body with a Basis: its sparse matrices, or the strains of its cells if slender."""

    def __init__(self, body: BasisSolid) -> None:
        self.host = body.on_host()
        self._P, self._u0 = body.constraint
        self._transposed = sparse.csr_array(self._P.T)

    def internal(self, u: Array) -> Pairs:
        """``S u`` without mean translations, or the forces of `strained_forces`."""
        body = self.host
        if body.slender:
            return strained_forces(body, u)
        return rows_times(body.stiffness, Pairs.of(u) - body.vectors.mean_translation(u))

    def unbalanced(self, forces: Pairs) -> float:
        """Largest force at a free unknown; those of derivatives are divided by their length."""
        at_free = rows_times(self._transposed, forces).rounded
        return largest(at_free / self.host.lengths[1])

    def at_supports(self, forces: Pairs) -> Pairs:
        """The part of forces that acts where a displacement is prescribed."""
        return forces - rows_times(self.host.picked, rows_times(self._transposed, forces))

    def total(self, forces: Pairs) -> Pairs:
        """Resultant of forces, shape (dim,); of a ring along its axis only."""
        body = self.host
        moved = body.are_values & (np.arange(body.ndofs) % body.dim == 1 if body.is_ring else True)
        return Pairs.where(moved, forces, 0.0).reshape(-1, body.dim).sum()

    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement; of derivatives times their length."""
        off = Pairs.of(u) - self._u0
        off = off - rows_times(self._P, rows_times(self.host.picked.T, off))
        return largest(self.host.lengths[0] * off.rounded)


class PairedBlock(PairedBody):
    """A block without a matrix: the element matrix of each layer, cell by cell."""

    def __init__(self, block: LayeredBlock) -> None:
        self.host = block.on_host()
        self._held, self._values = block.prescribed
        self._length = np.tile([1.0, 1.0] + [block.cell_size] * 4, block.ndofs // PER_NODE)

    def internal(self, u: Array) -> Pairs:
        """Internal forces, from displacements relative to the first node of each cell."""
        block = self.host
        nodes = u.reshape(block.node_rows, -1, PER_NODE)
        forces = Pairs.zeros(nodes.shape)
        # Process 2^12 cells at a time.
        for K, corners in block.stiffness.strips(max(1, 2**12 // block.columns)):
            cells = np.concatenate([nodes[c] for c in corners], axis=2)
            first = np.tile(nodes[corners[0]] * (np.arange(PER_NODE) < 2), 4)
            moved = (Pairs.of(cells) - first).reshape(-1, K.shape[0])
            each = np.broadcast_to(K, (len(moved.high), *K.shape))
            local = blocks_times(each, moved).reshape(*cells.shape)
            for k, c in enumerate(corners):
                forces[c] = forces[c] + local[:, :, PER_NODE * k : PER_NODE * (k + 1)]
        return forces.reshape(-1)

    def unbalanced(self, forces: Pairs) -> float:
        """Largest force at a free dof; those of derivatives are divided by the cell size."""
        left = forces.rounded / self._length
        left[self._held] = 0.0
        return largest(left)

    def at_supports(self, forces: Pairs) -> Pairs:
        """The part of forces that acts where a displacement is prescribed."""
        held = np.zeros(forces.high.size, dtype=bool)
        held[self._held] = True
        return Pairs.where(held, forces, 0.0)

    def total(self, forces: Pairs) -> Pairs:
        """Resultant of forces, shape (2,)."""
        return forces.reshape(-1, PER_NODE)[:, :2].sum()

    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement; of derivatives times the cell size."""
        return largest(self._length[self._held] * (Pairs.of(u)[self._held] - self._values).rounded)


def largest(x: Array) -> float:
    """The largest modulus, zero of nothing."""
    return float(np.abs(x).max(initial=0.0))


def strained_forces(body: Any, u: Array) -> Pairs:
    r"""Internal forces :math:`\int \sigma(u) : \nabla v` of slender cells, shape (ndofs,).
    As `contact.body.cell_strains`, but no sum is rounded to float64; the force on a cell's first
    node makes the resultant zero."""
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

    in_ranges(work, len(dofs), 2**9)  # cells per batch
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
    """Values (ncells, npoints, n) with the functions first, (n, ncells, npoints)."""
    return rows.transpose(2, 0, 1)


def _of_cells(x: Any) -> Pairs:
    """Numbers of each cell, shape (ncells, n), for sums over n: shape (n, ncells, 1)."""
    return Pairs(*(part.T[:, :, None] for part in _parts(Pairs.of(x))))


def _parts(x: Pairs) -> tuple[Array, Array]:
    return x.high, x.low
