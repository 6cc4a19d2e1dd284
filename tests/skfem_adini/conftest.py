"""Meshes and elements shared by the tests of this folder."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skfem import MeshHex, MeshQuad

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS


def _mapped(A, mesh):
    return type(mesh)(np.array(A) @ mesh.p, mesh.t)


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


def _mixed_bricks():
    """Swap two reference axes, or turn them cyclically, in some of the cells."""
    mesh = MeshHex().refined(1)
    t = mesh.t.copy()
    t[:, ::3] = t[[0, 2, 1, 3, 4, 6, 5, 7], ::3]
    t[:, 1::3] = t[[0, 2, 3, 1, 6, 4, 5, 7], 1::3]
    return MeshHex(mesh.p, t)


COS, SIN, HALF = np.cos(0.3), np.sin(0.3), np.sqrt(0.5)
TURN = Rotation.from_rotvec(0.7 * np.array([1.0, 2, 3]) / np.sqrt(14)).as_matrix()
PARALLELOGRAMS = {
    "anticlockwise": lambda: MeshQuad().refined(2),
    "clockwise-graded": _graded,
    "mixed-orientation": _mixed_orientation,
    "rotated": lambda: _mapped([[COS, -SIN], [SIN, COS]], _graded()),
    "sheared": lambda: _mapped([[1, 0.7], [-0.1, 1]], _graded()),
    "diamond": lambda: _mapped([[HALF, -HALF], [HALF, HALF]], MeshQuad().refined(2)),
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
    "turned": lambda: _mapped(TURN, _bricks()),
    "sheared": lambda: _mapped([[1, 0.7, -0.2], [-0.1, 1, 0], [0.3, 0, 1]], _bricks()),
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


def _of(meshes):
    @pytest.fixture(params=meshes)
    def mesh(request):
        return meshes[request.param]()

    return mesh


parallelograms, parallelepipeds = _of(PARALLELOGRAMS), _of(PARALLELEPIPEDS)
any_quads, any_hexes = _of(QUADS), _of(HEXES)
warped_hexes = _of({"warped": HEXES["warped"]})
parallel_cells = _of(PARALLELOGRAMS | {f"{name} bricks": f for name, f in PARALLELEPIPEDS.items()})
any_cells = _of(QUADS | {f"{name} bricks": make for name, make in HEXES.items()})
