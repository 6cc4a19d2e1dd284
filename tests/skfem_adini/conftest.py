"""Meshes shared by the tests of this folder."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from skfem import MeshHex, MeshQuad

from skfem_adini import ElementHexAdini, ElementQuadAdini


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


@pytest.fixture(params=PARALLELOGRAMS)
def parallelograms(request):
    return PARALLELOGRAMS[request.param]()


@pytest.fixture
def convex_quads():
    return _convex()


@pytest.fixture(params=[*PARALLELOGRAMS, "convex"])
def any_quads(request):
    return (PARALLELOGRAMS | {"convex": _convex})[request.param]()


def _bricks():
    x, y, z = np.array([0, 0.2, 0.5, 1.4]), np.array([0, 0.3, 1.0]), np.array([0, 0.7, 0.8])
    return MeshHex.init_tensor(x, y, z)


def _turned_bricks():
    """Rotate about (1, 2, 3) by 0.7."""
    k = np.array([1.0, 2, 3]) / np.sqrt(14)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    R = np.eye(3) + np.sin(0.7) * K + (1 - np.cos(0.7)) * K @ K
    return MeshHex(R @ _bricks().p, _bricks().t)


def _sheared_bricks():
    x, y, z = _bricks().p
    return MeshHex(np.array([x + 0.7 * y - 0.2 * z, y - 0.1 * x, z + 0.3 * x]), _bricks().t)


def _mixed_bricks():
    """Swap two reference axes, or turn them cyclically, in some of the cells."""
    mesh = MeshHex().refined(1)
    t = mesh.t.copy()
    t[:, ::3] = t[[0, 2, 1, 3, 4, 6, 5, 7], ::3]
    t[:, 1::3] = t[[0, 2, 3, 1, 6, 4, 5, 7], 1::3]
    return MeshHex(mesh.p, t)


def _warped_bricks():
    mesh = MeshHex().refined(1)
    p = mesh.p + 0.1 * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape)
    return MeshHex(p, mesh.t)


PARALLELEPIPEDS = {
    "refined": lambda: MeshHex().refined(1),
    "graded": _bricks,
    "mixed-axes": _mixed_bricks,
    "turned": _turned_bricks,
    "sheared": _sheared_bricks,
}


@pytest.fixture(params=PARALLELEPIPEDS)
def parallelepipeds(request):
    return PARALLELEPIPEDS[request.param]()


@pytest.fixture
def warped_hexes():
    return _warped_bricks()


@pytest.fixture(params=[*PARALLELEPIPEDS, "warped"])
def any_hexes(request):
    return (PARALLELEPIPEDS | {"warped": _warped_bricks})[request.param]()


_CELLS = {f"quads-{name}": make for name, make in (PARALLELOGRAMS | {"convex": _convex}).items()}
_CELLS |= {f"hexes-{name}": make for name, make in PARALLELEPIPEDS.items()}
_CELLS["hexes-warped"] = _warped_bricks


@pytest.fixture(params=_CELLS)
def any_cells(request):
    return _CELLS[request.param]()


@pytest.fixture
def adini():
    """Return a function that gives Adini's element for the cells of a mesh."""
    elements = {2: ElementQuadAdini, 3: ElementHexAdini}
    return lambda mesh, **keys: elements[mesh.dim()](**keys)


@pytest.fixture
def interpolate():
    """Return a function that gives the dofs of u from u and the derivatives that are dofs."""

    def dofs(basis, *functions):
        x = basis.zeros()
        for row, f in zip(basis.nodal_dofs, functions, strict=True):
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


@pytest.fixture(scope="session")
def cut_problems():
    """Return the module of domains with known eigenvalues."""
    return _module("cut_problems")


@pytest.fixture(scope="session")
def boundary_integrals():
    """Return the module of eigenvalues by boundary integrals."""
    return _module("boundary_integrals")


def _module(name):
    path = Path(__file__).with_name(f"{name}.py")
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
