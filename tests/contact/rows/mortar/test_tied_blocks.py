"""Multipliers of ties: a linear displacement passes through, with ends that are free or held."""

import numpy as np
import pytest
from families import PLANE_AND_BFS
from scipy import sparse
from scipy.sparse.linalg import spsolve
from two_blocks import facing, sides

from contact.rows.mortar.mortar_rows import mortar_rows

GRADIENT = np.array([[0.3, -0.2], [0.5, 0.1]])


def linear(x):
    return np.einsum("ij,j...->i...", GRADIENT, x)


def stress(body):
    """Of the linear displacement."""
    strain = 0.5 * (GRADIENT + GRADIENT.T)
    lam, mu = float(np.max(body.lam)), float(np.max(body.mu))
    return lam * np.trace(strain) * np.eye(2) + 2 * mu * strain


@pytest.mark.sampled(3)
@pytest.mark.parametrize("ends", ["held", "free", "one"])
@pytest.mark.parametrize("multipliers", ["upper", "lower"])
@pytest.mark.parametrize(("n", "m"), [(7, 10), (3, 14), (14, 3)])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_linear_displacement(element, n, m, multipliers, ends):
    upper, lower = facing(element, n, m)
    normals = {"left": (-1.0, 0.0), "right": (1.0, 0.0)}
    held = {"held": ["left", "right"], "free": [], "one": ["left"]}[ends]
    for body, far in ((upper, "top"), (lower, "bottom")):
        for c in range(2):
            body.fix([far, *held], "xy"[c], lambda x, c=c: linear(x)[c])
        for side in set(normals) - set(held):
            body.load(side, stress(body) @ normals[side])
    pair = sides(upper, lower, multipliers)
    found = mortar_rows(*pair, "standard", tied=True)
    bodies = pair[0], pair[2]
    S = sparse.block_diag([b.stiffness for b in bodies], format="csr")
    P = sparse.block_diag([b.constraint[0] for b in bodies], format="csr")
    u0 = np.concatenate([b.constraint[1] for b in bodies])
    f = np.concatenate([b.f for b in bodies])
    B = sparse.vstack(
        [
            sparse.hstack([found.rows.G, found.other_G]),
            sparse.hstack([found.rows.T, found.other_T]),
        ],
        format="csr",
    )
    free = B @ P
    # As many conditions as there are independent ones: nothing is dropped at the ends.
    lengths = np.concatenate([b.lengths[1] for b in bodies])
    singular = np.linalg.svd(free.toarray() / lengths, compute_uv=False)
    assert singular[-1] > 1e-3 * singular[0]
    K = sparse.block_array([[P.T @ S @ P, free.T], [free, None]], format="csc")
    solution = spsolve(K, np.concatenate((P.T @ (f - S @ u0), -B @ u0)))
    u = np.split(u0 + P @ solution[: P.shape[1]], [bodies[0].f.size])
    rng = np.random.default_rng(3)
    for body, displacement in zip(bodies, u, strict=True):
        low, high = body.mesh.p.min(axis=1), body.mesh.p.max(axis=1)
        points = rng.uniform(0.01, 0.99, (2, 50)) * (high - low)[:, None] + low[:, None]
        assert np.abs(body.displacement(displacement, points) - linear(points)).max() < 1e-11
    # The multipliers are the traction, at every point.
    w, m_points = found.rows.weights, found.rows.weights.size
    n_x, t_x = found.rows.normals, found.rows.tangents[:, 0]
    traction = -stress(upper) @ n_x
    mu = solution[P.shape[1] :]
    assert np.abs(mu[:m_points] / w - np.sum(n_x * traction, axis=0)).max() < 1e-8
    assert np.abs(mu[m_points:] / w - np.sum(t_x * traction, axis=0)).max() < 1e-8
