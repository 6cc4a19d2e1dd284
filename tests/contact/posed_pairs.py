"""A pair of bodies in any pose, whose contact points stick, slip and open."""

import numpy as np
from families import STRAIGHT
from scipy.spatial.transform import Rotation

from contact import ContactProblem, ElasticBody, Pair

STIFF, SOFT = 3.0, 1.0


class Pose:
    """x to ``size (Q x) + shift``, stresses times `stress`."""

    def __init__(self, Q, shift=0.0, size=1.0, stress=1.0):
        self.Q, self.size, self.stress = np.asarray(Q, float), size, stress
        self.shift = np.broadcast_to(shift, self.Q.shape[:1]).astype(float)

    def __call__(self, x):
        return self.size * np.tensordot(self.Q, x, 1) + self.shift.reshape(-1, *(1,) * (x.ndim - 1))

    def home(self, x):
        moved = x - self.shift.reshape(-1, *(1,) * (x.ndim - 1))
        return np.tensordot(self.Q.T, moved, 1) / self.size


def rotation(dim, seed):
    if dim == 3:
        return Rotation.random(random_state=seed).as_matrix()
    angle = np.random.default_rng(seed).uniform(-np.pi, np.pi)
    return Rotation.from_euler("z", angle).as_matrix()[:2, :2]


def traction(result):
    """Traction of contact and ties on the body with the multipliers, shape (dim, m)."""
    rows = result.system.rows
    p, t = result.pressure + result.tie_pressure, result.shear + result.tie_shear
    return np.einsum("mj,djm->dm", t, rows.tangents) - p * rows.normals


def body(element, ticks, E, pose):
    mesh = STRAIGHT[element].init_tensor(*ticks)
    names = {
        name: mesh.facets_satisfying(lambda x, k=k, v=v: np.abs(x[k] - v) < 1e-9, True)
        for name, k, v in (
            ("bottom", -1, ticks[-1][0]),
            ("top", -1, ticks[-1][-1]),
            ("right", 0, ticks[0][-1]),
        )
    }
    if np.linalg.det(pose.Q) < 0:
        mesh, names = reflected(mesh, names)
    mesh = type(mesh)(pose(mesh.p), mesh.t, sort_t=False).with_boundaries(names)
    return ElasticBody.from_mesh(mesh, element(), E=E * pose.stress, nu=0.3)


def mirrored(mesh):
    """Cells with the first two axes of the reference cell exchanged."""
    corners = mesh.elem.refdom.p
    swapped = corners[[1, 0, *range(2, mesh.dim())]]
    return mesh.t[[int(np.flatnonzero((c == corners.T).all(axis=1))[0]) for c in swapped.T]]


def reflected(mesh, names):
    turned = type(mesh)(mesh.p, mirrored(mesh), sort_t=False)
    keys = {tuple(sorted(f)): k for k, f in enumerate(turned.facets.T)}
    found = {
        name: np.array([keys[tuple(sorted(mesh.facets[:, f]))] for f in facets])
        for name, facets in names.items()
    }
    return turned, found


def blocks(element, pose):
    """The upper block, which covers the lower one in part, and the lower one."""
    dim = pose.Q.shape[0]
    across = [np.array([0.1, 0.35, 0.7, 1.05])] * (dim - 2)
    below = [np.linspace(0.0, 1.0, 4)] * (dim - 2)
    n = 7 if dim == 2 else 3
    upper = body(element, (np.linspace(0.2, 1.3, n + 1), *across, [0.0, 0.4, 0.8]), STIFF, pose)
    return upper, body(element, (np.linspace(0, 1, n + 3), *below, [-0.8, -0.3, 0]), SOFT, pose)


def posed(element, pose, friction=0.8, swap=False, law="coulomb", **more):
    """The problem and its bodies; with swap they are named in the other order."""
    dim, (upper, lower) = pose.Q.shape[0], blocks(element, pose)

    def pushed(x):
        y = pose.home(x)
        u = [0.002 + 0 * y[0], *[-0.001 + 0 * y[0]] * (dim - 2), -0.04 + 0.035 * y[0]]
        return pose.size * np.tensordot(pose.Q, np.array(u), 1)

    for c in range(dim):
        upper.fix("top", c, lambda x, c=c: pushed(x)[c])
        lower.fix("bottom", c)
    side = np.array([-0.004, 0.003, 0.002])[-dim:]
    upper.load("right", pose.stress * (pose.Q @ side))
    lower.body_force(pose.stress / pose.size * (pose.Q @ side))
    if law == "tresca":
        friction = 0.01 * pose.stress
    if swap:
        pair = Pair(lower, "top", upper, "bottom", friction=friction, multipliers="second")
    else:
        pair = Pair(upper, "bottom", lower, "top", friction=friction)
    return (
        ContactProblem([lower, upper] if swap else [upper, lower], [pair], law=law, **more),
        upper,
        lower,
    )
