"""Meshes and elements shared by the tests of this folder."""

import numpy as np
import pytest
from skfem import MeshHex, MeshQuad

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS


def _deformed(mesh, f):
    return type(mesh)(np.array(f(*mesh.p)), mesh.t)


def _graded():
    return MeshQuad.init_tensor(np.array([0, 0.2, 0.5, 1.4]), np.array([0, 0.3, 1.0, 1.1]))


def _mixed_orientation(turned=False):
    mesh = MeshQuad().refined(2)
    t = mesh.t.copy()
    t[:, ::2] = t[::-1, ::2]
    if turned:
        t[:, ::3] = np.roll(t[:, ::3], 1, axis=0)
    return MeshQuad(mesh.p, t)


def _moved(mesh, by):
    return type(mesh)(mesh.p + by * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape), mesh.t)


def _bricks():
    x, y, z = np.array([0, 0.2, 0.5, 1.4]), np.array([0, 0.3, 1.0]), np.array([0, 0.7, 0.8])
    return MeshHex.init_tensor(x, y, z)


def _turned_bricks():
    """Rotate about (1, 2, 3) by 0.7."""
    k = np.array([1.0, 2, 3]) / np.sqrt(14)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    R = np.eye(3) + np.sin(0.7) * K + (1 - np.cos(0.7)) * K @ K
    return MeshHex(R @ _bricks().p, _bricks().t)


def _mixed_bricks():
    """Swap two reference axes, or turn them cyclically, in some of the cells."""
    mesh = MeshHex().refined(1)
    t = mesh.t.copy()
    t[:, ::3] = t[[0, 2, 1, 3, 4, 6, 5, 7], ::3]
    t[:, 1::3] = t[[0, 2, 3, 1, 6, 4, 5, 7], 1::3]
    return MeshHex(mesh.p, t)


COS, SIN, HALF = np.cos(0.3), np.sin(0.3), np.sqrt(0.5)
PARALLELOGRAMS = {
    "anticlockwise": lambda: MeshQuad().refined(2),
    "clockwise-graded": _graded,
    "mixed-orientation": _mixed_orientation,
    "rotated": lambda: _deformed(_graded(), lambda x, y: (COS * x - SIN * y, SIN * x + COS * y)),
    "sheared": lambda: _deformed(_graded(), lambda x, y: (x + 0.7 * y, y - 0.1 * x)),
    "diamond": lambda: _deformed(
        MeshQuad().refined(2), lambda x, y: (HALF * (x - y), HALF * (x + y))
    ),
}
RECTANGLES = {
    "refined": lambda: MeshQuad().refined(2),
    "graded": _graded,
    "mixed": lambda: _mixed_orientation(turned=True),
}
PARALLELEPIPEDS = {
    "refined": lambda: MeshHex().refined(1),
    "graded": _bricks,
    "mixed-axes": _mixed_bricks,
    "turned": _turned_bricks,
    "sheared": lambda: _deformed(
        _bricks(), lambda x, y, z: (x + 0.7 * y - 0.2 * z, y - 0.1 * x, z + 0.3 * x)
    ),
}
QUADS = PARALLELOGRAMS | {"convex": lambda: _moved(MeshQuad().refined(2), 0.05)}
HEXES = PARALLELEPIPEDS | {"warped": lambda: _moved(MeshHex().refined(1), 0.1)}
SPACES = {
    f"{kind.__name__}-{name}": (make, kind)
    for meshes, kind in (
        (QUADS, ElementQuadAdini),
        (HEXES, ElementHexAdini),
        (RECTANGLES, ElementQuadBFS),
    )
    for name, make in meshes.items()
}


@pytest.fixture(params=SPACES)
def space(request):
    """A mesh, and the kind of element that takes its cells."""
    make, kind = SPACES[request.param]
    return make(), kind


@pytest.fixture(params=PARALLELOGRAMS)
def parallelograms(request):
    return PARALLELOGRAMS[request.param]()


@pytest.fixture(params=QUADS)
def any_quads(request):
    return QUADS[request.param]()


@pytest.fixture(params=PARALLELEPIPEDS)
def parallelepipeds(request):
    return PARALLELEPIPEDS[request.param]()


@pytest.fixture
def warped_hexes():
    return HEXES["warped"]()


@pytest.fixture(params=HEXES)
def any_hexes(request):
    return HEXES[request.param]()


@pytest.fixture
def convergence_order():
    """Return a function that fits the order of errors on meshes with n cells a side."""

    def fit(cells, errors):
        assert len(cells) >= 3
        return -np.polyfit(np.log(cells), np.log(errors), 1)[0]

    return fit
