"""Closed surfaces of facets for the tests of obstacles made of them."""

import functools

import numpy as np
from scipy.spatial import ConvexHull


def ring(count, radius=1.0, centre=(0.0, 0.0), turn=0.0):
    """Points and segments of a polygon in a circle, counter-clockwise."""
    a = turn + 2 * np.pi * np.arange(count) / count
    points = np.array([np.cos(a), np.sin(a)]) * radius + np.reshape(centre, (2, 1))
    return points, np.stack((np.arange(count), np.roll(np.arange(count), -1)))


def ball(refined, radius=1.0, centre=(0.0, 0.0, 0.0)):
    """Points and triangles in a sphere, from an octahedron, each edge halved `refined` times."""
    p, facets = _sphere(refined)
    return radius * p.T + np.reshape(centre, (3, 1)), facets


@functools.cache
def _sphere(refined):
    p = np.vstack((np.eye(3), -np.eye(3)))
    for _ in range(refined):
        faces = p[ConvexHull(p).simplices]
        middle = np.unique(
            np.round(0.5 * (faces + np.roll(faces, 1, axis=1)), 12).reshape(-1, 3), axis=0
        )
        p = np.vstack((p, middle / np.linalg.norm(middle, axis=1)[:, None]))
    return p, turned_out(p)


def turned_out(p):
    """Triangles of the convex hull of points (npoints, 3) around the origin, seen from outside."""
    facets = ConvexHull(p).simplices
    inwards = np.linalg.det(p[facets]) < 0
    facets[inwards] = facets[inwards][:, ::-1]
    return facets.T


def brick(low, high):
    """Points and facets of a rectangle or a box."""
    dim = len(low)
    if dim == 2:
        (a, b), (c, d) = low, high
        return np.array([[a, c, c, a], [b, b, d, d]], float), np.array([[0, 1, 2, 3], [1, 2, 3, 0]])
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1).reshape(-1, 3)
    middle = 0.5 * (np.asarray(low, float) + high)
    return corners.T.astype(float), turned_out(corners - middle)


def bumpy(rng, dim):
    """A star-shaped outline or body with dents, no two facets alike."""
    if dim == 2:
        points, facets = ring(40)
        return points * rng.uniform(0.6, 1.4, 40), facets
    points, facets = ball(2)
    return points * rng.uniform(0.6, 1.4, points.shape[1]), facets


def rotation(rng, dim):
    q, r = np.linalg.qr(rng.standard_normal((dim, dim)))
    q = q * np.sign(np.diag(r))
    q[:, 0] *= np.sign(np.linalg.det(q))
    return q
