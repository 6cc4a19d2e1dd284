"""Meshes shared by the tests of this folder."""

import numpy as np
import pytest
from skfem import MeshQuad


def _deformed(mesh, f):
    return MeshQuad(np.array(f(*mesh.p)), mesh.t)


def _graded():
    return MeshQuad.init_tensor(np.array([0, 0.2, 0.5, 1.4]), np.array([0, 0.3, 1.0, 1.1]))


def _rotated():
    c, s = np.cos(0.3), np.sin(0.3)
    return _deformed(_graded(), lambda x, y: (c * x - s * y, s * x + c * y))


def _sheared():
    return _deformed(_graded(), lambda x, y: (x + 0.7 * y, y - 0.1 * x))


def _diamond():
    c = np.sqrt(0.5)
    return _deformed(MeshQuad().refined(2), lambda x, y: (c * (x - y), c * (x + y)))


def _convex():
    mesh = MeshQuad().refined(2)
    p = mesh.p + 0.05 * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape)
    return MeshQuad(p, mesh.t)


def _mixed_orientation():
    mesh = MeshQuad().refined(2)
    t = mesh.t.copy()
    t[:, ::2] = t[::-1, ::2]
    return MeshQuad(mesh.p, t)


PARALLELOGRAMS = {
    "anticlockwise": lambda: MeshQuad().refined(2),
    "clockwise-graded": _graded,
    "mixed-orientation": _mixed_orientation,
    "rotated": _rotated,
    "sheared": _sheared,
    "diamond": _diamond,
}


@pytest.fixture(params=PARALLELOGRAMS, ids=str)
def parallelograms(request):
    return PARALLELOGRAMS[request.param]()


@pytest.fixture
def convex_quads():
    return _convex()


@pytest.fixture(params=[*PARALLELOGRAMS, "convex"], ids=str)
def any_quads(request):
    return (PARALLELOGRAMS | {"convex": _convex})[request.param]()


@pytest.fixture
def interpolate():
    """Return a function that gives the Adini dofs of u with gradient (u_x, u_y)."""

    def dofs(basis, u, u_x, u_y):
        x = basis.zeros()
        for row, f in zip(basis.nodal_dofs, (u, u_x, u_y), strict=True):
            x[row] = f(*basis.mesh.p)
        return x

    return dofs


@pytest.fixture
def convergence_order():
    """Return a function that fits the order of errors on meshes with n cells a side."""

    def fit(cells, errors):
        assert len(cells) >= 3
        return -np.polyfit(np.log(cells), np.log(errors), 1)[0]

    return fit
