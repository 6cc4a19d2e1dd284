"""Real condensation wave by wave is the complex one of all levels, to the rounding of the data."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1

from contact.spectral import wave_condensation, wave_kernel
from contact.spectral.real_symbol import RealSymbol
from contact.spectral.slab_symbols import Slab, Stack, cell
from contact.spectral.wave_cells import Column, cell_table, functions, parities
from contact.spectral.wave_condensation import condensed, eliminated, inverse
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from tests.contact.spectral.test_periodic_layers import COATED

ELEMENTS = [ElementQuad1(), ElementQuadAdini(), ElementQuadBFS(), ElementHex1(), ElementHexAdini()]
NAMES = [type(element).__name__ for element in ELEMENTS]
STIFF = [(1e-3, 1, 1e6, 0.3), (1.0, 8, 1.0, 0.3)]  # a contrast of 1e6 in cells 100 times as flat
DEEP = [(1.0, 4096, 1.0, 0.45)]


def bodies(element, layers, sizes):
    """A cell of each layer, with the kinds and lengths of a node's unknowns."""
    from contact.spectral.layer_arguments import node_kinds

    cells = [cell((*sizes, h / m), element, E=E, nu=nu) for h, m, E, nu in layers]
    kinds = node_kinds(cells[0])
    size = np.array([*sizes, min(h / m for h, m, *_ in layers)])
    lengths = [1.0 if k == -1 else np.prod(size[:2]) if k < 0 else size[k] for k in kinds]
    return cells, kinds, np.array(lengths)


def column(element, layers, sizes, free=()):
    cells, kinds, lengths = bodies(element, layers, sizes)
    dim = cells[0].mesh.dim()
    parity = parities(kinds, dim)
    tables = np.array([cell_table(body, lengths, parity) for body in cells])
    return Column(tables, [m for _, m, *_ in layers], np.array(free, dtype=int), dim)


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


@pytest.mark.parametrize("element", ELEMENTS, ids=NAMES)
def test_a_layer_is_the_complex_one_turned(element):
    """Each wave of a cell of three different sizes, whose sines and cosines are all there."""
    dim = element.dim
    cells, kinds, lengths = bodies(element, COATED[:1], (0.3, 0.2)[: dim - 1])
    phases = [part.ravel() for part in np.meshgrid(*steps(dim), indexing="ij")]
    parity = parities(kinds, dim)
    table = cell_table(cells[0], lengths, parity)
    real = np.moveaxis(np.tensordot(table, functions(phases), axes=1), 2, 0)
    slab, turn = cell_slab(cells[0], lengths, phases), 1j**parity
    r = lengths.size
    for block, rows, columns in (
        (slab.P, slice(r), slice(r)), (slab.Q, slice(r), slice(r, 2 * r)),
        (slab.R, slice(r, 2 * r), slice(r, 2 * r)),
    ):  # fmt: skip
        turned = np.conj(turn)[:, None] * block * turn
        assert abs(turned - real[:, rows, columns]).max() < 1e-13 * abs(real).max()


@pytest.mark.parametrize("layers", [COATED, STIFF, DEEP], ids=["coated", "stiff", "deep"])
@pytest.mark.parametrize("element", ELEMENTS, ids=NAMES)
def test_condensation_is_that_of_all_levels(element, layers):
    """With pivots in each solve, and to the digits that rounding of the cells leaves.

    Rounding of a layer is as good as springs to the ground, eps times its own stiffness, in each.
    """
    dim = element.dim
    sizes = (0.17, 0.125)[: dim - 1]
    cells, kinds, lengths = bodies(element, layers, sizes)
    stiffness, compliance = condensed(column(element, layers, sizes), steps(dim))
    phases = [part.ravel() for part in np.meshgrid(*steps(dim), indexing="ij")]
    slabs = [cell_slab(body, lengths, phases) for body in cells]
    whole = Stack.of(list(zip(slabs, [m for _, m, *_ in layers], strict=True))).whole
    exact = np.linalg.inv(whole.P)[:, :dim, :dim]
    turn = 1j ** parities(kinds, dim)[:dim]
    found = turn[:, None] * full(compliance, dim) * np.conj(turn)
    ground = sum(m * abs(slab.P).max() for slab, (_, m, *_) in zip(slabs, layers, strict=True))
    lost = np.finfo(float).eps * ground * abs(exact).max()
    assert abs(found - exact).max() < 4 * lost * abs(exact).max()
    product = full(stiffness, dim) @ full(compliance, dim)
    assert abs(product - np.eye(dim)).max() < 1e-11


@pytest.mark.parametrize("layers", [STIFF, DEEP], ids=["stiff", "deep"])
@pytest.mark.parametrize("element", ELEMENTS, ids=NAMES)
def test_pivots_would_win_no_digits(element, layers):
    """The same steps in the longest numbers of the machine, from the same cells."""
    if np.finfo(np.longdouble).eps > 1e-18:
        pytest.skip("no numbers longer than double")
    dim = element.dim
    body = column(element, layers, (0.17, 0.125)[: dim - 1])
    phases = [part.ravel() for part in np.meshgrid(*steps(dim), indexing="ij")]
    cells = [np.tensordot(table, functions(phases), axes=1) for table in body.tables]
    r = len(cells[0]) // 2

    def face(kind):
        whole = None
        for power, count in zip(cells, body.counts, strict=True):
            power = power.astype(kind)
            for bit in range(count.bit_length()):
                power = wave_condensation.joined(power, power) if bit else power
                if count >> bit & 1:
                    whole = power if whole is None else wave_condensation.joined(whole, power)
        return whole[:r, :r]

    error = abs(face(float) - face(np.longdouble))[np.triu_indices(r)].max()
    ground = sum(m * abs(power).max() for m, power in zip(body.counts, cells, strict=True))
    assert 0 < error < 2 * np.finfo(float).eps * ground


def test_blocks_of_waves_make_no_difference(monkeypatch):
    body = column(ElementHexAdini(), COATED, (0.3, 0.2))
    once = condensed(body, steps(3))
    monkeypatch.setattr(wave_condensation, "_NUMBERS", 9 * 12**2 * 7)
    np.testing.assert_array_equal(condensed(body, steps(3)), once)


@pytest.mark.parametrize("element", [ElementHex1(), ElementQuadAdini()], ids=["Q1", "Adini"])
def test_a_free_top_and_what_it_rests_on(element):
    """The upper side is free and springs of random stiffness hold its values."""
    dim = element.dim
    sizes, r = (0.3, 0.2)[: dim - 1], 3 if dim == 3 else 6
    body = column(element, COATED, sizes, range(r))
    count = int(np.prod([s.size for s in steps(dim)]))
    springs = np.random.default_rng(0).standard_normal((count, dim, 4))
    springs = springs @ springs.transpose(0, 2, 1)
    base = np.array([springs[:, i, j] for i, j in zip(*np.triu_indices(dim), strict=True)])
    stiffness, _ = condensed(body, steps(dim), base)
    both = Column(body.tables, body.counts, np.zeros(0, dtype=int), r)
    here = [part.ravel() for part in np.meshgrid(*steps(dim), indexing="ij")]
    whole = wave_condensation._slab(both.tables, both, here)
    whole = full(whole[np.triu_indices(2 * r)], 2 * r)
    whole[:, r : r + dim, r : r + dim] += springs
    kept, rest = np.arange(dim), np.arange(dim, 2 * r)
    inner = np.linalg.solve(whole[:, rest[:, None], rest], whole[:, rest][:, :, kept])
    exact = whole[:, :dim, :dim] - whole[:, :dim][:, :, rest] @ inner
    assert abs(full(stiffness, dim) - exact).max() < 1e-12 * abs(exact).max()


def test_schur_complements_and_inverses():
    A = np.random.default_rng(1).standard_normal((5, 9, 7))
    A = np.einsum("ikw,jkw->ijw", A, A)
    by_wave = np.moveaxis(A, 2, 0)
    found = np.moveaxis(inverse(A.copy()), 2, 0)
    np.testing.assert_allclose(np.triu(found), np.triu(np.linalg.inv(by_wave)), atol=1e-10)
    rest = np.linalg.inv(np.linalg.inv(by_wave)[:, 2:, 2:])
    found = np.moveaxis(eliminated(A.copy(), 2), 2, 0)
    np.testing.assert_allclose(np.triu(found), np.triu(rest), atol=1e-10)


@pytest.mark.parametrize("real", [False, True])
def test_products_of_symbols(real):
    rng = np.random.default_rng(2)
    turns = (0, 2, 2) if real else (1, 3, 0)
    N = full(rng.standard_normal((6, 4)), 3)
    d = np.array([1, 1j, -1, -1j])[list(turns)]
    S = np.moveaxis(d[:, None] * N * np.conj(d), 0, 2)
    symbol = RealSymbol.of(S, turns)
    waves = rng.standard_normal((3, 4)) + 0j
    if not real:
        waves += 1j * rng.standard_normal((3, 4))
    exact = np.einsum("ijw,jw->iw", S, waves)
    found = symbol.times(waves.real.copy() if real else waves.copy())
    np.testing.assert_allclose(found, exact, atol=1e-14)
    assert np.isrealobj(found) == real
    np.testing.assert_array_equal(symbol[2, 1], N[:, 1, 2])


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
@pytest.mark.parametrize("layers", [COATED, STIFF, DEEP], ids=["coated", "stiff", "deep"])
@pytest.mark.parametrize("element", ELEMENTS, ids=NAMES)
def test_a_device_condenses_as_the_host(element, layers):
    """To the digits that rounding of the cells leaves: springs to the ground, as above.

    The device contracts products and sums, in another order. Entries of the cells changed by eps at
    random move the stiffness by up to 1.4 r such springs on the host, with r unknowns a node.
    """
    cupy = pytest.importorskip("cupy")
    dim = element.dim
    body = column(element, layers, (0.17, 0.125)[: dim - 1])
    ours = condensed(body, steps(dim))
    theirs = condensed(body, [cupy.asarray(step) for step in steps(dim)])
    sizes = [abs(table).max() for table in body.tables]
    ground = sum(m * size for m, size in zip(body.counts, sizes, strict=True))
    lost = 4 * (len(body.tables[0]) // 2) * np.finfo(float).eps * ground
    stiffness, compliance = (
        abs(one - other.get()).max() for one, other in zip(ours, theirs, strict=True)
    )
    assert stiffness < lost
    assert compliance < lost * abs(ours[1]).max() ** 2
