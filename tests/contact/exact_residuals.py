"""Residuals of a state of one plane body in rational arithmetic, which is exact."""

from fractions import Fraction

import numpy as np
from scipy import sparse


def fractions(values):
    return np.array([Fraction(float(v)) for v in np.ravel(values)], dtype=object)


def times(matrix, x):
    """The product of a sparse matrix and Fractions."""
    A = sparse.csr_array(matrix)
    return np.array(
        [
            sum(
                (
                    Fraction(float(A.data[k])) * x[A.indices[k]]
                    for k in range(A.indptr[i], A.indptr[i + 1])
                ),
                start=Fraction(0),
            )
            for i in range(A.shape[0])
        ],
        dtype=object,
    )


def exact_residuals(result):
    """Of a body with a matrix under Coulomb's law, all points of which have a gap.

    Scales, of which a few digits are enough, are those of the package.
    """
    system, body = result.system, result.system.body
    rows, (P, u0) = system.rows, body.constraint
    u, mu, t = map(fractions, (result.u, result.mu, result.t))
    load, gap, coefficient = map(fractions, (system.load, rows.gap, system.friction))
    contact = times(rows.G.T, mu) + times(rows.T.T, t)
    moved = u - fractions(body.vectors.mean_translation(result.u))
    left = times(body.stiffness, moved) + contact - load
    at_free = times(P.T, left)
    forces = np.asarray(rows.G.T @ result.mu + rows.T.T @ result.t.ravel())
    cancelling = body.equilibrium(result.u, forces, system.load)[1]
    length = max(body.largest_displacement(result.u), body.local_displacement(forces))
    size = max(np.abs(result.mu).max(), np.abs(result.t).max())
    noise = 10 * np.finfo(float).eps * cancelling
    assert noise < size
    reactions = left - times(body.picked, at_free)

    def total(v):
        return [sum(v[c :: body.dim][body.are_values[c :: body.dim]]) for c in range(body.dim)]

    sums = zip(*map(total, (abs(load), abs(contact), abs(reactions))), strict=True)
    off = u - fractions(u0)
    held = off - times(P, times(body.picked.T, off))
    through = times(rows.G, u) - gap
    g = coefficient * np.maximum(mu, 0)
    q = t + Fraction(size / length) * times(rows.T, u)
    returned = t - np.clip(q, -g, g)
    live = body.unconstrained(rows.T)
    closed = np.minimum(np.maximum(abs(mu) - Fraction(noise), 0) / Fraction(size),
                        abs(through) / Fraction(length))  # fmt: skip
    found = {
        "equilibrium": max(abs(at_free / fractions(body.lengths[1]))) / Fraction(cancelling),
        "balance": max(map(abs, total(load + reactions - contact))) / max(map(sum, sums)),
        "support": max(abs(fractions(body.lengths[0]) * held)) / Fraction(length),
        "penetration": max(0, *through) / Fraction(length),
        "sign": max(0, *(-mu - Fraction(noise))) / Fraction(size),
        "complementarity": max(closed),
        "cone": max(0, *(abs(t) - g - Fraction(noise))) / Fraction(size),
        "slip": max(0, *(abs(returned[live]) - Fraction(noise))) / Fraction(size),
    }
    return {name: float(value) for name, value in found.items()}


def exact_strained_forces(body, u):
    """Internal forces of a plane isotropic body from the strains of its cells, Fractions."""
    basis, dim = body.basis, body.dim
    u, lame_lambda, lame_mu = fractions(u), Fraction(float(body.lam)), Fraction(float(body.mu))
    forces = fractions(np.zeros(u.size))
    for c, dofs in enumerate(basis.element_dofs.T):
        slopes = [basis.basis[i][0].grad[i % dim] for i in range(dofs.size)]
        shape = (dim, *basis.dx.shape)
        each = [np.broadcast_to(np.asarray(slope), shape)[:, c] for slope in slopes]
        for q, weight in enumerate(fractions(basis.dx[c])):
            G = np.full((dim, dim), Fraction(0), dtype=object)
            for i, slope in enumerate(each):
                # From the cell's first node: a translation strains nothing, whatever the rounding.
                moved = u[dofs[i]] - u[dofs[i % dim]]
                G[i % dim] += moved * fractions(slope[:, q])
            sigma = lame_mu * (G + G.T) + lame_lambda * np.trace(G) * np.eye(dim, dtype=int)
            for i, slope in enumerate(each):
                force = weight * sum(sigma[i % dim] * fractions(slope[:, q]))
                forces[dofs[i]] += force
                forces[dofs[i % dim]] -= force
    return forces


def exact_block_forces(block, u):
    """Internal forces of a block without a mesh from its element matrices, Fractions."""
    u, n, row = fractions(u).reshape(-1, 6), block.columns, 0
    forces = np.full(u.shape, Fraction(0), dtype=object)
    for layer in block.cell_rows:
        K = fractions(layer.stiffness).reshape(24, 24)
        for _ in range(layer.height):
            for i in range(n):
                low = row * (n + 1) + i
                nodes = [low, low + 1, low + n + 2, low + n + 1]
                local = u[nodes].copy()
                local[:, :2] -= local[0, :2]  # a translation causes no force
                forces[nodes] += (K @ local.ravel()).reshape(4, 6)
            row += 1
    return forces.ravel()
