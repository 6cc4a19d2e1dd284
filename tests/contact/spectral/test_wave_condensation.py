"""Condensation wave by wave: the one of all levels with pivots, on a device too."""

import sys
import types

import numpy as np
import pytest
import scipy.fft
import scipy.linalg
from skfem import ElementHex1, ElementQuad1

from contact import ContactProblem, LayeredBlock
from contact.arrays import dense_arrays
from contact.body.layers import block_vectors
from contact.spectral import wave_kernel
from contact.spectral.layer_arguments import node_kinds
from contact.spectral.slab_symbols import Slab, Stack, cell
from contact.spectral.wave_cells import Column, cell_table, parities
from contact.spectral.wave_condensation import condensed
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from tests.cip.host_device import Array, HostCupy, _wrapped

ELEMENTS = [ElementQuad1(), ElementQuadAdini(), ElementQuadBFS(), ElementHex1(), ElementHexAdini()]
LAYERS = {
    "coated": [(0.1, 2, 100.0, 0.2), (0.5, 3, 1.0, 0.4)],
    "stiff": [(1e-3, 1, 1e6, 0.3), (1.0, 8, 1.0, 0.3)],  # in cells 100 times as flat
    "deep": [(1.0, 4096, 1.0, 0.45)],
}
cases = [
    pytest.mark.parametrize("layers", LAYERS.values(), ids=LAYERS),
    pytest.mark.parametrize("element", ELEMENTS, ids=lambda element: type(element).__name__),
]


def of_all(test):
    for case in cases:
        test = case(test)
    return test


def column(element, layers):
    """The cells, the kinds and lengths of a node's unknowns, and the column to be condensed."""
    sizes = (0.17, 0.125)[: element.dim - 1]
    cells = [cell((*sizes, h / m), element, E=E, nu=nu) for h, m, E, nu in layers]
    kinds = node_kinds(cells[0])
    size = np.array([*sizes, min(h / m for h, m, *_ in layers)])
    lengths = [1.0 if k == -1 else np.prod(size[:2]) if k < 0 else size[k] for k in kinds]
    lengths, parity = np.array(lengths), parities(kinds, element.dim)
    tables = np.array([cell_table(body, lengths, parity) for body in cells])
    none = np.zeros(0, dtype=int)
    return cells, lengths, parity, Column(tables, [m for _, m, *_ in layers], none, element.dim)


def steps(dim):
    """Waves at the limit of the grid among them."""
    return [2 * np.pi * np.fft.fftfreq(6), 2 * np.pi * np.fft.rfftfreq(8)][: dim - 1]


def full(upper, n):
    """Symmetric matrices, shape (waves, n, n), of their upper triangles."""
    matrices = np.zeros((upper.shape[1], n, n))
    for e, (i, j) in enumerate(zip(*np.triu_indices(n), strict=True)):
        matrices[:, i, j] = matrices[:, j, i] = upper[e]
    return matrices


def cell_slab(body, lengths, phases):
    """One layer of equal cells: the sum over pairs of corners, K_ab exp(i k (o_b - o_a))."""
    mesh, r, dofs = body.mesh, lengths.size, body.basis.nodal_dofs
    K, upper = body.stiffness.toarray(), mesh.p[-1] > 0.5 * mesh.p[-1].max()
    angles = np.tensordot((mesh.p[:-1] > 0).T, np.array(phases), axes=1)
    blocks = np.zeros((2, 2, phases[0].size, r, r), dtype=complex)
    for a, b in np.ndindex(mesh.nvertices, mesh.nvertices):
        block = K[np.ix_(dofs[:, a], dofs[:, b])] / np.outer(lengths, lengths)
        turned = np.exp(1j * (angles[b] - angles[a]))
        blocks[int(upper[a]), int(upper[b])] += turned[:, None, None] * block
    return Slab(blocks[0, 0], blocks[0, 1], blocks[1, 1])


@of_all
def test_condensation_is_that_of_all_levels(element, layers):
    """With pivots in each solve, and to the digits that rounding of the cells leaves.

    Rounding of a layer is as good as springs to the ground, eps times its own stiffness, in each.
    """
    dim = element.dim
    cells, lengths, parity, own = column(element, layers)
    stiffness, compliance = condensed(own, steps(dim))
    phases = [part.ravel() for part in np.meshgrid(*steps(dim), indexing="ij")]
    slabs = [cell_slab(body, lengths, phases) for body in cells]
    whole = Stack.of(list(zip(slabs, own.counts, strict=True))).whole
    exact = np.linalg.inv(whole.P)[:, :dim, :dim]
    turn = 1j ** parity[:dim]
    found = turn[:, None] * full(compliance, dim) * np.conj(turn)
    ground = sum(m * abs(slab.P).max() for slab, m in zip(slabs, own.counts, strict=True))
    lost = np.finfo(float).eps * ground * abs(exact).max()
    assert abs(found - exact).max() < 4 * lost * abs(exact).max()
    product = full(stiffness, dim) @ full(compliance, dim)
    assert abs(product - np.eye(dim)).max() < 1e-11


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("unknowns", "dim", "inner"),
    [(2, 2, []), (3, 3, []), (3, 3, [3, 4]), (6, 2, [8, 9, 10, 11, 2, 3, 4, 5])],
)
def test_the_kernel_compiles(compile_cuda, unknowns, dim, inner):
    text = wave_kernel.source(unknowns, dim, inner)
    assert compile_cuda(text, "sm_90", ("--std=c++17",))
    with pytest.raises(RuntimeError, match="LATERAL"):
        compile_cuda(text.replace("#define LATERAL", "#define NONE"), "sm_90", ("--std=c++17",))


@pytest.mark.gpu
@of_all
def test_a_device_condenses_as_the_host(element, layers):
    """To the digits that rounding of the cells leaves: springs to the ground, as above.

    The device contracts products and sums, in another order. Entries of the cells changed by eps at
    random move the stiffness by up to 1.4 r such springs on the host, with r unknowns a node.
    """
    cupy = pytest.importorskip("cupy")
    *_, own = column(element, layers)
    ours = condensed(own, steps(element.dim))
    theirs = condensed(own, [cupy.asarray(step) for step in steps(element.dim)])
    ground = sum(m * abs(table).max() for m, table in zip(own.counts, own.tables, strict=True))
    lost = 4 * (len(own.tables[0]) // 2) * np.finfo(float).eps * ground
    stiffness, compliance = (
        abs(one - other.get()).max() for one, other in zip(ours, theirs, strict=True)
    )
    assert stiffness < lost
    assert compliance < lost * abs(ours[1]).max() ** 2


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


@pytest.mark.parametrize(("sides", "top"), [("x", None), ("y", "x"), ("x", "x")])
def test_a_whole_solve_on_the_device(device, monkeypatch, sides, top):
    """Loads and displacements of all unknowns stay there until the result is made."""

    def pose():
        parts = [(0.1, 2, 50.0, 0.2), (0.5, 5, 1.0, 0.4)]
        block = LayeredBlock(1.3, parts, sides, top, columns=30, path="fourier")
        block.body_force((0.0, -0.1)).load("top", (0.0, -0.2))
        if (sides, top) == ("x", "x"):
            block.fix("top", "y", -0.03)
        return ContactProblem(block, "bottom", lambda x: 0.01 + 0.2 * (x[0] - 0.6) ** 2, 0.3)

    host = pose().solve()
    there = DeviceArrays(device)
    monkeypatch.setattr(block_vectors, "arrays_on", lambda name: there)
    problem = pose()
    placed = problem.condense("cuda")
    assert isinstance(placed.placed(problem.body.f), Array)
    result = problem.solve()
    assert isinstance(result.u, np.ndarray)
    size = abs(host.mu).max()
    assert abs(result.mu - host.mu).max() < 1e-11 * size
    assert abs(result.t - host.t).max() < 1e-11 * size
    assert abs(result.u - host.u).max() < 1e-10 * abs(host.u).max()
    assert max(result.kkt.values()) < 1e-11
