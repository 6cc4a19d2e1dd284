"""The boundary's stiffness and compliance by images; the factor where arrays do not mix."""

import sys
import types

import numpy as np
import pytest
import scipy.fft
import scipy.linalg
from skfem import ElementHex1

from contact import ContactProblem, LayeredBlock
from contact.arrays import dense_arrays
from contact.body.layers import block_vectors
from contact.body.layers.lateral_sides import odd_unknowns, read_sides
from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.layer_arguments import node_kinds
from contact.spectral.slab_symbols import cell, real_slab
from contact.spectral.wave_cells import cell_table, functions, parities
from contact.spectral.wave_condensation import phases_of
from contact.spectral.wave_factor import WaveFactor
from skfem_adini import ElementQuadAdini
from tests.cip.host_device import Array, HostCupy, _wrapped

LAYERS = [(0.1, 2, 50.0, 0.2), (0.5, 5, 1.0, 0.4)]
SIDES = ["periodic", "x", "y", ("x", "y"), ("periodic", "y"), ("yz", "periodic"), ("x", "xz")]


class _Module:
    """A module whose functions see into arrays."""

    def __init__(self, module):
        self._module = module

    def __getattr__(self, name):
        found = getattr(self._module, name)
        return _wrapped(found) if callable(found) else _Module(found)


class Device(HostCupy):
    """`HostCupy` with the modules that transforms and small systems need."""

    linalg, fft, lib, pi = (*map(_Module, (np.linalg, np.fft, np.lib)), np.pi)

    def array(self, values):
        """A copy."""
        return self.asarray(values).copy()

    def unravel_index(self, index, shape):
        """Several arrays at once."""
        return tuple(map(Array, np.unravel_index(index.get(), shape)))


@pytest.fixture
def device(monkeypatch):
    module, transforms = Device(), _Module(scipy.fft)
    monkeypatch.setattr(Array, "__module__", "cupy")
    monkeypatch.setitem(sys.modules, "cupy", module)
    for name in ("cupyx", "cupyx.scipy"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "cupyx.scipy.fft", transforms)
    sys.modules["cupyx"].scipy = sys.modules["cupyx.scipy"]
    sys.modules["cupyx.scipy"].fft = transforms
    return module


def factor(sides, xp=np, kept=None, top=()):
    """Layers of Adini's rectangles, or of trilinear bricks."""
    dim = 3 if isinstance(sides, tuple) else 2
    cells, sizes = (6,) if dim == 2 else (4, 5), (0.2, 0.15)[: dim - 1]
    element = ElementQuadAdini() if dim == 2 else ElementHex1()
    bodies = [cell((*sizes, h / m), element, E=E, nu=nu) for h, m, E, nu in LAYERS]
    kinds = node_kinds(bodies[0])
    lengths = np.array([1.0 if k == -1 else 0.1 * (k + 4) for k in kinds])
    lateral = LateralWaves(cells, odd_unknowns(read_sides(sides, dim), kinds), xp)
    parity = parities(kinds, dim)
    turns = (lateral.turns + parity - (lateral.turns + parity)[0]) % 4
    waves = phases_of(lateral.steps, slice(0, int(np.prod(lateral.shape))))
    slabs = [
        (real_slab(cell_table(one, lengths, parity), functions(waves)), m)
        for one, (_, m, *_) in zip(bodies, LAYERS, strict=True)
    ]
    kept = np.arange(dim if kept is None else kept)
    return WaveFactor(slabs, lateral, turns, np.array(top, dtype=int), kept, xp, lengths)


@pytest.mark.parametrize("sides", SIDES)
def test_stiffness_and_compliance_are_those_of_unit_loads(sides):
    """Column by column: a force on one node of the lowest plane, through all planes."""
    ours = factor(sides)
    nb, size = ours.boundary.size, ours.rows * int(np.prod(ours._lateral.points)) * ours._r
    assert ours.hold(np.arange(0))
    product = ours.schur @ ours.compliance
    assert abs(product - np.eye(nb)).max() < 1e-12 * np.linalg.cond(ours.schur)
    rng = np.random.default_rng(0)
    r = rng.standard_normal(nb)
    z = ours.flexed(r)
    np.testing.assert_allclose(z, ours.compliance @ r, rtol=0, atol=1e-12 * abs(z).max())
    load = np.zeros(size)
    load[ours.boundary] = r
    np.testing.assert_allclose(ours.reduce(load), r, rtol=0, atol=1e-13 * abs(r).max())
    np.testing.assert_allclose(ours.expand(load, z)[ours.boundary], z, atol=1e-13 * abs(z).max())


def test_means_that_nothing_holds_are_held_by_springs():
    """Forces in balance cause what they cause between any supports, but for a motion."""
    ours = factor("x", top=range(6))
    assert not ours.hold(np.arange(0)) or np.linalg.cond(ours.schur) > 1e12
    assert ours.hold(np.array([1]))
    motion = (ours.boundary % 6 == 1).astype(float)
    r = np.random.default_rng(1).standard_normal(motion.size)
    r -= motion * (r @ motion) / (motion @ motion)
    z = ours.flexed(r)
    assert abs(ours.schur @ z - r).max() < 1e-11 * abs(r).max()


@pytest.mark.parametrize("sides", ["x", "periodic", ("x", "y"), ("periodic", "y")])
def test_a_device_needs_no_array_of_the_host(device, sides):
    """Every array of the factor is the device's, and what comes back is what the host finds."""
    host, other = factor(sides), factor(sides, device)
    load = (
        np.random.default_rng(2)
        .standard_normal(host.rows * int(np.prod(host._lateral.points)) * host._r)
        .reshape(-1, host._r)
    )
    free = np.stack([~host._lateral.held(k).ravel() for k in range(host._r)], axis=-1)
    load = (load.reshape(host.rows, *free.shape) * free).ravel()
    assert host.hold(np.arange(0))
    assert other.hold(np.arange(0))
    for name in ("schur", "compliance"):
        ours, theirs = getattr(host, name), getattr(other, name)
        assert isinstance(theirs, Array)
        np.testing.assert_allclose(theirs.get(), ours, rtol=0, atol=1e-14 * abs(ours).max())
    r, placed = host.reduce(load), device.asarray(load)
    np.testing.assert_allclose(other.reduce(placed), r, rtol=0, atol=1e-13 * abs(r).max())
    z = host.flexed(r)
    np.testing.assert_allclose(other.flexed(r), z, rtol=0, atol=1e-12 * abs(z).max())
    u, found = host.expand(load, z), other.expand(placed, z)
    assert isinstance(found, Array)
    assert isinstance(other.expand(load, z), np.ndarray)
    np.testing.assert_allclose(found.get(), u, rtol=0, atol=1e-12 * abs(u).max())


class DeviceArrays(dense_arrays.DeviceArrays):
    """Those of CuPy, with a device that the host plays."""

    def __init__(self, module):
        self.xp, self._solve = module, _wrapped(scipy.linalg.solve_triangular)

    def room(self):
        return None

    def get(self, x):
        return x.get() if isinstance(x, Array) else x

    def put(self, x):
        return self.xp.asarray(x, dtype=float).copy()

    def congruent(self, B, A):
        return self.put(dense_arrays.HostArrays().congruent(B, A.get()))


@pytest.mark.parametrize(("sides", "top"), [("x", None), ("y", "x"), ("x", "x")])
def test_a_whole_solve_on_the_device(device, monkeypatch, sides, top):
    """Loads and displacements of all unknowns stay there until the result is made."""

    def pose():
        block = LayeredBlock(1.3, LAYERS, sides, top, columns=30, path="fourier")
        block.body_force((0.0, -0.1)).load("top", (0.0, -0.2))
        if top == "x" and sides == "x":
            block.fix("top", "y", -0.03)
        return ContactProblem(block, "bottom", lambda x: 0.01 + 0.2 * (x[0] - 0.6) ** 2, 0.3)

    host = pose().solve()
    there = DeviceArrays(device)
    monkeypatch.setattr(block_vectors, "arrays_on", lambda name: there)
    problem = pose()
    condensed = problem.condense("cuda")
    assert isinstance(condensed.placed(problem.body.f), Array)
    result = problem.solve()
    assert isinstance(result.u, np.ndarray)
    size = abs(host.mu).max()
    assert abs(result.mu - host.mu).max() < 1e-11 * size
    assert abs(result.t - host.t).max() < 1e-11 * size
    assert abs(result.u - host.u).max() < 1e-10 * abs(host.u).max()
    assert max(result.kkt.values()) < 1e-11
