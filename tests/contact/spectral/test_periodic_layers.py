"""Layers in Fourier space are the sparse path with tied sides, wave by wave, and tend to solids."""

from functools import partial
from itertools import product

import numpy as np
import pytest
import skfem
from skfem import ElementHex1, ElementQuad2

from contact import GridContact, InputError, LayeredBlock, Rigid
from contact.spectral.periodic_layers import PeriodicLayers
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

ONE = [(0.5, 3, 1.0, 0.3)]
COATED = [(0.1, 2, 100.0, 0.2), (0.5, 3, 1.0, 0.4)]
CASES = (
    {
        "plane": lambda: PeriodicLayers(1.3, COATED, 8, motion=(0.1, -0.2)),
        "plane stress, odd": lambda: PeriodicLayers(1.3, [(0.5, 5, 2e5, 0.3)], 7, plane="stress"),
        "plane, free to slide": lambda: PeriodicLayers(1.3, COATED, 8, top="y", motion=(0.3, 0.1)),
        "plane, one layer of cells": lambda: PeriodicLayers(1e-3, [(1e-3, 1, 1.0, 0.3)], 3),
        "space": lambda: PeriodicLayers((1.0, 1.5), COATED, (4, 5), motion=(0.1, 0.0, -0.2)),
        "space, free to slide": lambda: PeriodicLayers((1.0, 1.5), ONE, (4, 6), top="z"),
        "space, free along y": lambda: PeriodicLayers((1.0, 1.5), ONE, (5, 4), top="xz"),
        "Adini": lambda: PeriodicLayers(
            1.3, COATED, 8, motion=(0.1, -0.2), element=ElementQuadAdini()
        ),
        "Adini, odd, millimetres": lambda: PeriodicLayers(
            1.3e-3, [(0.5e-3, 5, 2e11, 0.3)], 7, plane="stress", element=ElementQuadAdini()
        ),
        "Adini, free to slide": lambda: PeriodicLayers(
            1.3, COATED, 8, top="y", motion=(0.3, 0.1), element=ElementQuadAdini()
        ),
        "BFS, free to rise": lambda: PeriodicLayers(
            1.3, COATED, 8, top="x", motion=(0.3, 0.1), element=ElementQuadBFS()
        ),
        "Adini's brick": lambda: PeriodicLayers(
            (1.0, 1.5), COATED, (4, 5), motion=(0.1, 0.0, -0.2), element=ElementHexAdini()
        ),
        "Adini's brick, free to slide": lambda: PeriodicLayers(
            (1.0, 1.5), ONE, (4, 4), top="z", element=ElementHexAdini()
        ),
    }
    | {
        f"sides {sides}, {type(element).__name__}, top {top}": partial(
            PeriodicLayers, 1.3, COATED, 7, sides=sides, element=element, top=top
        )
        for sides in ("x", "y")
        for element in (None, ElementQuadAdini(), ElementQuadBFS())
        for top in (None, "x", "y")
    }
    | {
        f"sides {sides}, top {top}": partial(
            PeriodicLayers, (1.0, 1.5), COATED, (4, 3), sides=sides, top=top
        )
        for sides in product(("periodic", "x", "yz"), ("periodic", "y", "xz"))
        for top in (None, "z", "x")
        if sides != ("periodic", "periodic")
    }
    | {
        f"sides {sides}, Adini's brick": partial(
            PeriodicLayers, (1.0, 1.5), ONE, (3, 2), sides=sides, element=ElementHexAdini()
        )
        for sides in (("x", "periodic"), ("periodic", "xz"), ("x", "y"), ("yz", "xz"), ("yz", "y"))
    }
)


def mean_of(values, weights):
    across = tuple(range(1, values.ndim))
    return np.sum(values * weights, axis=across, keepdims=True) / weights.sum()


@pytest.mark.sampled(7)
@pytest.mark.parametrize("make", CASES.values(), ids=CASES)
def test_every_level_is_that_of_the_sparse_body(make):
    block = make()
    body, dim = block.elastic(), block.dim
    loose = block.constant.reshape(-1, *[1] * (dim - 1))
    forces = np.random.default_rng(0).standard_normal((dim, *block.shape)) * block.weights
    shares = block.weights / block.weights.sum()
    forces -= loose * shares * forces.sum(axis=tuple(range(1, dim)), keepdims=True)
    forces[block.fixed] = 0.0
    places, levels = body.mesh.p, np.unique(body.mesh.p[-1].round(12))
    number = [np.rint(places[a] / block.spacing[a]).astype(int) for a in range(dim - 1)]
    once = np.all([k < n for k, n in zip(number, block.shape, strict=True)], axis=0)

    def nodes(row):
        found = np.flatnonzero(once & (abs(places[-1] - levels[row]) < 1e-9))
        return found, tuple(index[found] for index in number)

    load, (low, at) = np.zeros(body.basis.N), nodes(0)
    for c in range(dim):
        load[body.basis.nodal_dofs[c, low]] = forces[(c, *at)]
    P, u0 = body.constraint
    S = (P.T @ body.stiffness @ P).toarray()
    unit = np.sqrt(np.diag(S).max())
    z = np.linalg.lstsq(S / unit**2, P.T @ (load - body.stiffness @ u0) / unit**2, rcond=1e-12)[0]
    u = P @ z + u0
    size = abs(u).max()
    for row in range(levels.size):
        exact, (here, at) = np.zeros((dim, *block.shape)), nodes(row)
        for c in range(dim):
            exact[(c, *at)] = u[body.basis.nodal_dofs[c, here]]
        error = block.displacement(forces, row) - exact
        assert abs(error - loose * mean_of(error, block.weights)).max() < 1e-10 * size
    again = block.displacement(forces, 0) - block.initial - block.apply(forces)
    assert abs(again).max() < 1e-11 * size  # planes inside eliminate in another order
    assert abs(block.precondition(block.apply(forces)) - forces).max() < 1e-11


@pytest.mark.parametrize("lengths", [1.0, (1.0, 1.0)])
def test_a_deep_body_tends_to_the_half_space(lengths):
    """Johnson, Contact Mechanics 1985, (13.2): a wave of pressure p moves by (1 - nu) p / (G k)."""
    errors = []
    for n in (16, 32, 64):
        cells = n if np.ndim(lengths) == 0 else (n, 4)
        block = PeriodicLayers(lengths, [(2.0, 2 * n, 1.0, 0.3)], cells)
        wave = np.cos(2 * np.pi * np.arange(n) / n)
        wave = wave if block.dim == 2 else np.repeat(wave[:, None], 4, axis=1)
        forces = np.zeros((block.dim, *block.shape))
        forces[-1] = wave * np.prod(block.spacing)
        exact = (1 - 0.3**2) / np.pi
        errors.append(abs(block.apply(forces)[-1].flat[0] / exact - 1))
    assert errors[-1] < 1e-3
    order = np.polyfit(np.log([16, 32, 64]), np.log(errors), 1)[0]
    assert -2.3 < order < -1.7


def test_stiff_and_thin_layers_keep_their_digits():
    """A contrast of 1e6 and 4096 layers of cells; symmetric and positive as a compliance is."""
    for layers in ([(1e-3, 1, 1e6, 0.3), (1.0, 8, 1.0, 0.3)], [(1.0, 4096, 1.0, 0.45)]):
        block = PeriodicLayers((1.0, 1.0), layers, (6, 8))
        rng = np.random.default_rng(1)
        f, g = rng.standard_normal((2, 3, 6, 8))
        one, other = np.sum(g * block.apply(f)), np.sum(f * block.apply(g))
        assert abs(one - other) < 1e-11 * np.sum(abs(g * block.apply(f)))
        assert np.sum(f * block.apply(f)) > 0
        assert abs(block.precondition(block.apply(f)) - f).max() < 1e-8


@pytest.mark.parametrize("element", [None, ElementQuadAdini(), ElementQuadBFS()])
@pytest.mark.parametrize("layer", [(1.0, 4096, 1.0, 0.3), (100.0, 16, 1.0, 0.3)])
def test_the_order_of_condensation_does_not_matter(element, layer):
    """One layer, or two of the same cells: other slabs are joined, with other rounding."""
    height, rows, *material = layer
    part = rows // 3
    split = [(height * k / rows, k, *material) for k in (part, rows - part)]
    forces = np.random.default_rng(2).standard_normal((2, 64))
    one, other = (
        PeriodicLayers(1.0, layers, 64, element=element).apply(forces)
        for layers in ([layer], split)
    )
    assert abs(one - other).max() < 1e-10 * abs(one).max()


def test_a_uniform_pressure_compresses_each_layer_by_its_own_modulus():
    block = PeriodicLayers((2.0, 3.0), COATED, (4, 4))
    forces = np.zeros((3, 4, 4))
    forces[2] = 0.01 * np.prod(block.spacing)
    modulus = [E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) for _, _, E, nu in COATED]
    exact = 0.01 * sum(layer[0] / M for layer, M in zip(COATED, modulus, strict=True))
    assert np.abs(block.apply(forces)[2] / exact - 1).max() < 1e-12
    assert block.unknowns == 3 * 16 * 5
    assert repr(block) == "PeriodicLayers(3-D, 4 x 4 x 5 cells, 240 unknowns)"


@pytest.mark.parametrize("more", [{}, {"top": "x"}, {"base": (2.0, 0.2)}])
@pytest.mark.parametrize("lengths", [2.0, (2.0, 3.0)])
def test_normal_products_alone(lengths, more):
    """They are parts of the whole ones; the preconditioner inverts them but for a free mean."""
    cells = 6 if isinstance(lengths, float) else (6, 5)
    block = PeriodicLayers(lengths, COATED, cells, **more)
    forces = np.zeros((block.dim, *block.shape))
    forces[-1] = np.random.default_rng(1).standard_normal(block.shape)
    u = block.apply_normal(forces[-1])
    np.testing.assert_allclose(u, block.apply(forces)[-1], atol=1e-13 * np.abs(u).max())
    again = block.precondition_normal(u)
    wanted = forces[-1] - (forces[-1].mean() if more else 0.0)
    np.testing.assert_allclose(again, wanted, atol=1e-11)


def test_an_element_that_keeps_shape_functions_serves_layers_of_several_heights():
    forces = np.random.default_rng(0).standard_normal((2, 4)) / 50
    theirs, ours = (
        PeriodicLayers(2.0, COATED, 4, element=one).apply(forces)
        for one in (skfem.ElementQuadBFS(), ElementQuadBFS())
    )
    np.testing.assert_allclose(theirs, ours, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("sides", ["x", "y"])
def test_what_mirroring_holds_besides_is_natural_as_the_mesh_is_refined(sides):
    """Without the derivatives that a mirror image makes vanish the body is softer, ever less.

    The bilinear element has none: there the two are the same body.
    """

    def given(element, n):
        block = PeriodicLayers(1.0, [(0.5, n // 2, 1.0, 0.3)], n, sides=sides, element=element)
        mirrored, other = block.elastic(), block.elastic()
        other._couplings = ()
        other.__dict__.pop("constraint", None)
        nodes = mirrored.basis.nodal_dofs[1, mirrored.mesh.p[1] < 1e-9]
        works = []
        for body in (mirrored, other):
            load = np.zeros(body.basis.N)
            x = body.mesh.p[0, body.mesh.p[1] < 1e-9]
            load[nodes] = (1 + x) * np.where(np.abs(x - 0.5) < 0.5 - 1e-9, 1.0, 0.5) / n
            P = body.constraint[0]
            u = P @ np.linalg.solve((P.T @ body.stiffness @ P).toarray(), P.T @ load)
            works.append(load @ u)
        return works[1] / works[0] - 1

    assert abs(given(None, 8)) < 1e-12
    errors = [given(ElementQuadAdini(), n) for n in (4, 8, 16)]
    assert errors[0] > 1e-6
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.5 * errors[1]


def test_layers_between_sides_on_a_half_space_are_a_half_of_the_periodic_ones():
    """Both on the same half space: the mirrored forces of twice the width, half of it."""
    n, layers, base = 8, [(0.25, 2, 2.0, 0.3)], (1.0, 0.2)
    forces = np.random.default_rng(4).standard_normal((2, n + 1))
    forces[0, [0, n]] = 0.0
    half = PeriodicLayers(1.0, layers, n, sides="x", base=base).apply(forces)
    twice = np.concatenate((forces, ([[-1.0], [1.0]] * forces)[:, -2:0:-1]), axis=1)
    twice[:, [0, n]] *= 2.0
    whole = PeriodicLayers(2.0, layers, 2 * n, base=base).apply(twice)
    assert abs(half - whole[:, : n + 1]).max() < 1e-12 * abs(half).max()


@pytest.mark.parametrize(
    ("sides", "message"),
    [
        ("xy", "sides='xy': transforms diagonalise sides across x that are"),
        (None, "sides=None: transforms"),
        ("z", "sides='z'"),
        (3, "sides=3"),
        (("x", "y"), "expected 'periodic' or 1 entries"),
    ],
)
def test_sides_that_transforms_do_not_diagonalise_are_named(sides, message):
    with pytest.raises(InputError, match=message):
        PeriodicLayers(1.0, ONE, 4, sides=sides)


@pytest.mark.parametrize("sides", ["x", ("x",), ("x", "x"), ("periodic", "yz"), ("y", "y")])
def test_sides_in_space_are_named(sides):
    with pytest.raises(InputError, match="sides="):
        PeriodicLayers((1.0, 1.0), ONE, (4, 4), sides=sides)


def test_a_motion_against_the_sides_is_named():
    with pytest.raises(InputError, match=r"motion=.*the sides hold x at zero"):
        PeriodicLayers(1.0, ONE, 4, sides="x", motion=(0.1, 0.0))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"lengths": (1.0, 1.0, 1.0)}, "lengths="),
        ({"lengths": -1.0}, "lengths="),
        ({"lengths": np.nan}, "lengths"),
        ({"layers": []}, "layers="),
        ({"layers": [(0.0, 1, 1.0, 0.3)]}, r"layers\[0\]: the height must be positive"),
        ({"layers": [(1.0, 2, 1.0, 0.5)]}, r"layers\[0\]: nu=0.5: Poisson"),
        ({"layers": [*ONE, (1.0, 2, 1.0, -1.0)]}, r"layers\[1\]: nu=-1: Poisson"),
        ({"layers": [(1.0, 2, -1.0, 0.3)]}, r"layers\[0\]: E=-1: Young"),
        ({"cells": (4, 4)}, "cells="),
        ({"cells": (4, (1, 2))}, "cells="),
        ({"cells": 4.5}, "cells="),
        ({"cells": 1}, "cells="),
        ({"top": "z"}, "components="),
        ({"motion": (0.0, np.inf)}, "motion"),
        ({"motion": (0.0, 1.0, 2.0)}, "motion="),
        ({"plane": "air"}, "plane"),
        ({"element": ElementQuad2()}, "element ElementQuad2: has unknowns that belong to no"),
        ({"element": ElementHex1()}, "element: ElementHex1 does not live on"),
        ({"element": "Q1"}, "element: expected one of scikit-fem"),
        ({"element": ElementQuadAdini(), "base": (1.0, 0.3)}, "base: the half space is joined"),
    ],
)
def test_bad_input_is_named(given, message):
    with pytest.raises(InputError, match=message):
        PeriodicLayers(**{"lengths": 1.0, "layers": ONE, "cells": 4} | given)


@pytest.mark.parametrize("row", [-1, 4, 0.5, True, "0", None])
def test_levels_outside_are_refused(row):
    block = PeriodicLayers(1.0, ONE, 4)
    with pytest.raises(InputError, match="row="):
        block.displacement(np.zeros((2, 4)), row)


@pytest.mark.parametrize("lengths", [1.0, (1.0, 1.0)])
def test_layers_of_the_half_space_on_it_are_a_half_space(lengths):
    """The wave is the continuum's in the half space and the mesh's in the layers."""
    errors = []
    for n in (32, 64, 128):
        cells = n if np.ndim(lengths) == 0 else (n, 4)
        block = PeriodicLayers(lengths, [(0.25, n // 4, 2.0, 0.3)], cells, base=(2.0, 0.3))
        wave = np.cos(2 * np.pi * np.arange(n) / n)
        forces = np.zeros((block.dim, *block.shape))
        forces[-1] = wave if block.dim == 2 else wave[:, None]
        forces[-1] *= np.prod(block.spacing)
        errors.append(abs(block.apply(forces)[-1].flat[0] / (0.5 * (1 - 0.3**2) / np.pi) - 1))
        assert not block.constant.any()
    assert errors[-1] < 1e-5
    assert np.polyfit(np.log([32, 64, 128]), np.log(errors), 1)[0] < -1.5


def test_a_coating_on_a_half_space_is_one_on_a_deep_block():
    errors = []
    for n in (32, 64, 128):
        coating = (0.125, n // 8, 100.0, 0.2)
        forces = np.zeros((2, n))
        forces[1] = np.cos(2 * np.pi * np.arange(n) / n) / n
        one = PeriodicLayers(1.0, [coating], n, base=(1.0, 0.3)).apply(forces)[1, 0]
        deep = PeriodicLayers(1.0, [coating, (3.0, 3 * n, 1.0, 0.3)], n).apply(forces)[1, 0]
        errors.append(abs(one / deep - 1))
    assert errors[-1] < 1e-4
    assert np.polyfit(np.log([32, 64, 128]), np.log(errors), 1)[0] < -1.8


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"base": 1.0}, "base="),
        ({"base": (-1.0, 0.3)}, "E"),
        ({"base": (1.0, 0.5)}, "nu"),
        ({"base": (1.0, 0.3), "top": "x"}, "base: a top"),
        ({"base": (1.0, 0.3), "plane": "stress"}, "base: a top"),
    ],
)
def test_bad_half_spaces_are_named(given, message):
    with pytest.raises(InputError, match=message):
        PeriodicLayers(**{"lengths": 1.0, "layers": ONE, "cells": 4} | given)
    with pytest.raises(InputError, match="base: a half space has no mesh"):
        PeriodicLayers(1.0, ONE, 4, base=(1.0, 0.3)).elastic()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"plane": "axisymmetric"}, "plane='axisymmetric': layers have no radii"),
        ({"plane": "stress", "lengths": (1.0, 1.0), "cells": (4, 4)}, "a body in three dimensions"),
        ({"layers": None}, "layers=None: expected a list"),
    ],
)
def test_bad_layers_are_named(given, message):
    arguments = {"lengths": 1.0, "layers": ONE, "cells": 4} | given
    with pytest.raises(InputError, match=message):
        PeriodicLayers(**arguments)
    with pytest.raises(InputError, match=message):
        LayeredBlock(sides="periodic", **arguments)


@pytest.mark.parametrize("cells", [(1, 1), (1, 3), (3, 1)])
def test_one_cell_between_rollers_is_a_column(cells):
    """It is shortened without moving aside: the modulus is that of confined compression."""
    layers = [(0.25, 2, 2.0, 0.2), (0.75, 3, 1.0, 0.3)]
    more = {"sides": ("x", "y"), "top": "z", "motion": (0, 0, -0.1)}
    block = PeriodicLayers((1.0, 2.0), layers, cells, **more)
    give = sum(h * (1 + nu) * (1 - 2 * nu) / (E * (1 - nu)) for h, _, E, nu in layers)
    result = GridContact(block, Rigid(0.0)).solve()
    assert result.pressure == pytest.approx(0.1 / give, rel=1e-12)


def test_one_cell_between_periodic_sides_is_refused():
    with pytest.raises(InputError, match="whole numbers from 1, 2"):
        PeriodicLayers((1.0, 1.0), [(1.0, 1, 1.0, 0.3)], (1, 1), sides=("x", "periodic"))
