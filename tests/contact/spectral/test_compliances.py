"""Compliances on a grid: closed forms, the sparse path wave by wave, and each other."""

from itertools import product

import numpy as np
import pytest
import scipy.linalg
import skfem
from example_scripts import load
from skfem import ElementHex1, ElementQuad2

from contact import GridContact, HalfSpace, InputError, LayeredBlock, PeriodicLayers, Rigid
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

E, NU = 2.5, 0.3
ONE = [(0.5, 3, 1.0, 0.3)]
COATED = [(0.1, 2, 100.0, 0.2), (0.5, 3, 1.0, 0.4)]
ADINI, BFS, BRICK = ElementQuadAdini(), ElementQuadBFS(), ElementHexAdini()


def order_of(sizes, errors):
    return np.polyfit(np.log(sizes), np.log(errors), 1)[0]


def drop(values, places):
    """Difference of two places, over neighbours: waves at the limit of the grid cancel."""
    smooth = 0.25 * (np.roll(values, 1) + 2 * values + np.roll(values, -1))
    return smooth[places[0]] - smooth[places[1]]


@pytest.mark.parametrize(("nu", "sign"), [(0.0, 1.0), (0.3, -1.0), (0.45, 1.0)])
def test_point_loads(nu, sign):
    """Boussinesq and Cerruti, as differences of two places, far from the images of the load.

    K. L. Johnson, Contact Mechanics, (3.18) and (3.75). The images change the differences by
    about one per cent.
    """
    n = 512
    shear = E / (2 * (1 + nu))
    space = HalfSpace((1.0, 1.0), (n, n), E, nu, normal=(0, 0, sign))
    x = (np.arange(n) - n // 2) / n
    inverse = drop(1 / np.where(x != 0, x, np.inf), places := (n // 2 + 8, n // 2 + 24))
    forces = np.zeros((3, n, n))
    forces[2, n // 2, n // 2] = -sign  # presses
    u = space.apply(forces)
    normal, lateral = -sign * u[2, :, n // 2], u[0, :, n // 2]
    assert drop(normal, places) == pytest.approx((1 - nu) / (2 * np.pi * shear) * inverse, rel=0.02)
    towards = -(1 - 2 * nu) / (4 * np.pi * shear) * inverse
    assert drop(lateral, places) == pytest.approx(towards, rel=0.02)
    forces = np.zeros((3, n, n))
    forces[0, n // 2, n // 2] = 1.0
    u = space.apply(forces)
    for values, factor in ((u[0, :, n // 2], 1.0), (u[0, n // 2, :], 1 - nu)):
        wanted = factor / (2 * np.pi * shear) * inverse
        assert drop(values, places) == pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize(
    ("lengths", "shape"),
    [((2.0,), (16,)), ((2.0,), (15,)), ((2.0, 3.0), (6, 8)), ((1.0, 1.0), (5, 7))],
)
def test_a_half_space_is_symmetric_and_positive(lengths, shape):
    """Also where waves at the limit of the grid are their own conjugates."""
    space, dim = HalfSpace(lengths, shape, E, NU), len(shape) + 1
    n = dim * int(np.prod(shape))
    W = np.array([space.apply(e.reshape(dim, *shape)).ravel() for e in np.eye(n)])
    S = np.array([space.precondition(e.reshape(dim, *shape)).ravel() for e in np.eye(n)])
    assert pytest.approx(W.T, abs=1e-14 * np.abs(W).max()) == W
    assert pytest.approx(S.T, abs=1e-13 * np.abs(S).max()) == S
    values = np.linalg.eigvalsh(W)
    assert np.sum(np.abs(values) < 1e-12 * values.max()) == dim  # the mean
    assert values.min() > -1e-12 * values.max()
    assert np.linalg.eigvalsh(S).min() > 0
    means = np.eye(n) - np.kron(np.eye(dim), np.full((n // dim,) * 2, dim / n))
    assert pytest.approx(means, abs=1e-12) == W @ S


@pytest.mark.parametrize(
    "space",
    [
        HalfSpace(1.0, 15, E, NU),
        HalfSpace((1.0, 1.0), (6, 8), E, NU),
        *(
            PeriodicLayers(lengths, COATED, cells, **more)
            for lengths, cells in ((2.0, 6), ((2.0, 3.0), (6, 5)))
            for more in ({}, {"top": "x"}, {"base": (2.0, 0.2)})
        ),
    ],
    ids=repr,
)
def test_normal_products_alone(space):
    """They are parts of the whole ones; the preconditioner inverts them but for a free mean."""
    forces = np.zeros((len(space.shape) + 1, *space.shape))
    forces[-1] = np.random.default_rng(1).standard_normal(space.shape)
    u = space.apply_normal(forces[-1])
    np.testing.assert_allclose(u, space.apply(forces)[-1], atol=1e-13 * np.abs(u).max())
    held = isinstance(space, PeriodicLayers) and space.base is None and not space.constant.any()
    wanted = forces[-1] - (0.0 if held else forces[-1].mean())
    np.testing.assert_allclose(space.precondition_normal(u), wanted, atol=1e-11)


IN_PLANE = {"lengths": 1.3, "layers": COATED, "cells": 8}
IN_SPACE = {"lengths": (1.0, 1.5), "layers": COATED, "cells": (4, 5)}
MOVED, UP = {"motion": (0.1, -0.2)}, {"motion": (0.1, 0.0, -0.2)}
CASES = [
    IN_PLANE | MOVED,
    IN_PLANE | {"layers": [(0.5, 5, 2e5, 0.3)], "cells": 7, "plane": "stress"},
    IN_PLANE | {"top": "y", "motion": (0.3, 0.1)},
    {"lengths": 1e-3, "layers": [(1e-3, 1, 1.0, 0.3)], "cells": 3},
    IN_SPACE | UP,
    IN_SPACE | {"layers": ONE, "cells": (4, 6), "top": "z"},
    IN_SPACE | {"layers": ONE, "cells": (5, 4), "top": "xz"},
    IN_PLANE | MOVED | {"element": ADINI},
    {"lengths": 1.3e-3, "layers": [(0.5e-3, 5, 2e11, 0.3)], "cells": 7, "element": ADINI}
    | {"plane": "stress"},
    IN_PLANE | {"top": "y", "motion": (0.3, 0.1), "element": ADINI},
    IN_PLANE | {"top": "x", "motion": (0.3, 0.1), "element": BFS},
    IN_SPACE | UP | {"element": BRICK},
    IN_SPACE | {"layers": ONE, "cells": (4, 4), "top": "z", "element": BRICK},
    *(
        IN_PLANE | {"cells": 7, "sides": sides, "element": element, "top": top}
        for sides in ("x", "y")
        for element in (None, ADINI, BFS)
        for top in (None, "x", "y")
    ),
    *(
        IN_SPACE | {"cells": (4, 3), "sides": sides, "top": top}
        for sides in product(("periodic", "x", "yz"), ("periodic", "y", "xz"))
        for top in (None, "z", "x")
        if sides != ("periodic", "periodic")
    ),
    *(
        IN_SPACE | {"layers": ONE, "cells": (3, 2), "sides": sides, "element": BRICK}
        for sides in (("x", "periodic"), ("periodic", "xz"), ("x", "y"), ("yz", "xz"), ("yz", "y"))
    ),
]


def mean_of(values, weights):
    across = tuple(range(1, values.ndim))
    return np.sum(values * weights, axis=across, keepdims=True) / weights.sum()


@pytest.mark.sampled(7)
@pytest.mark.parametrize("given", CASES)
def test_every_level_is_that_of_the_sparse_body(given):
    """Displacements on the planes of nodes, and fields inside, also a period further on."""
    block = PeriodicLayers(**given)
    body, dim = block.elastic(), block.dim
    loose = block.constant.reshape(-1, *[1] * (dim - 1))
    rng = np.random.default_rng(0)
    forces = rng.standard_normal((dim, *block.shape)) * block.weights
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
    if block.constant.any() or given.get("element") is BFS or block.lengths[0] < 1.0:
        return  # derivatives of the dense solution have fewer digits
    x = rng.uniform(0.0, 1.0, (dim, 60)) * np.array([*block.lengths, levels[-1]])[:, None]
    exact, sigma = body.displacement(u, x), body.stress_at(u, x)
    periods = np.array([*np.where(block.mirrored, 0.0, block.lengths), 0.0])
    turned = x + rng.integers(-2, 3, (dim, 60)) * periods[:, None]
    assert abs(block.sample(forces, turned) - exact).max() < 1e-10 * size
    assert abs(block.stress(forces, turned) - sigma).max() < 1e-10 * abs(sigma).max()


@pytest.mark.parametrize("lengths", [1.0, (1.0, 1.0)])
@pytest.mark.parametrize("base", [None, (2.0, 0.3)])
def test_layers_tend_to_the_half_space(lengths, base):
    """Johnson, Contact Mechanics 1985, (13.2): a wave of pressure p moves by (1 - nu) p / (G k).

    Deep ones, and layers of the half space on it: the wave is the continuum's in the half space
    and the mesh's in the layers.
    """
    errors, sizes, young = [], np.array([16, 32, 64]) * (2 if base else 1), base[0] if base else 1.0
    for n in sizes:
        cells = n if np.ndim(lengths) == 0 else (n, 4)
        layer = (0.25, n // 4, young, 0.3) if base else (2.0, 2 * n, young, 0.3)
        block = PeriodicLayers(lengths, [layer], cells, base=base)
        wave = np.cos(2 * np.pi * np.arange(n) / n)
        forces = np.zeros((block.dim, *block.shape))
        forces[-1] = wave if block.dim == 2 else wave[:, None]
        forces[-1] *= np.prod(block.spacing)
        errors.append(abs(block.apply(forces)[-1].flat[0] / ((1 - 0.3**2) / np.pi / young) - 1))
    assert errors[-1] < (1e-5 if base else 1e-3)
    low, high = (-9.0, -1.5) if base else (-2.3, -1.7)
    assert low < order_of(sizes, errors) < high


@pytest.mark.parametrize(
    "layers", [[(1e-3, 1, 1e6, 0.3), (1.0, 8, 1.0, 0.3)], [(1.0, 4096, 1.0, 0.45)]]
)
def test_stiff_and_thin_layers_keep_their_digits(layers):
    """A contrast of 1e6 and 4096 layers of cells; symmetric and positive as a compliance is."""
    block = PeriodicLayers((1.0, 1.0), layers, (6, 8))
    f, g = np.random.default_rng(1).standard_normal((2, 3, 6, 8))
    one, other = np.sum(g * block.apply(f)), np.sum(f * block.apply(g))
    assert abs(one - other) < 1e-11 * np.sum(abs(g * block.apply(f)))
    assert np.sum(f * block.apply(f)) > 0
    assert abs(block.precondition(block.apply(f)) - f).max() < 1e-8


@pytest.mark.parametrize("sides", ["periodic", "x"])
def test_a_half_space_carries_the_mean_pressure(sides):
    """It is uniform in the layers, and they are compressed by it, whatever they lie on."""
    block = PeriodicLayers(2.0, COATED, 6, base=(2.0, 0.3), sides=sides)
    forces = np.zeros((2, *block.shape))
    forces[1] = 0.01 * block.spacing[0] * block.weights
    x = np.array([[0.3, 1.9, 1.2], [0.05, 0.1, 0.4]])
    assert np.allclose(block.stress(forces, x)[1, 1], -0.01, rtol=1e-12)
    stiff = np.array([100 * 0.8 / (1.2 * 0.6), 0.6 / (1.4 * 0.2)])  # oedometric
    shortened = -0.01 * np.array([0.05 / stiff[0], 0.1 / stiff[0], 0.1 / stiff[0] + 0.3 / stiff[1]])
    assert np.allclose(block.sample(forces, x)[1], shortened, rtol=1e-11)
    assert abs(block.displacement(forces, 0) - block.apply(forces)).max() < 1e-15


def test_an_element_that_keeps_shape_functions_serves_layers_of_several_heights():
    forces = np.random.default_rng(0).standard_normal((2, 4)) / 50
    theirs, ours = (
        PeriodicLayers(2.0, COATED, 4, element=one).apply(forces)
        for one in (skfem.ElementQuadBFS(), BFS)
    )
    np.testing.assert_allclose(theirs, ours, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("cells", [(1, 1), (1, 3), (3, 1)])
def test_one_cell_between_rollers_is_a_column(cells):
    """It is shortened without moving aside: the modulus is that of confined compression."""
    layers = [(0.25, 2, 2.0, 0.2), (0.75, 3, 1.0, 0.3)]
    more = {"sides": ("x", "y"), "top": "z", "motion": (0, 0, -0.1)}
    block = PeriodicLayers((1.0, 2.0), layers, cells, **more)
    give = sum(h * (1 + nu) * (1 - 2 * nu) / (E * (1 - nu)) for h, _, E, nu in layers)
    assert GridContact(block, Rigid(0.0)).solve().pressure == pytest.approx(0.1 / give, rel=1e-12)
    shown = f"PeriodicLayers(3-D, {cells[0]} x {cells[1]} x 5 cells, {block.unknowns} unknowns"
    assert repr(block).startswith(shown)


THICK, STIFF, K = 0.125, 100.0, 2 * np.pi  # a coating of nu = .2, its ground E = 1, nu = .3


def exact_coating():
    """Displacements of the lower side per stress (xz, zz) there, and the coating's transfer."""
    state_matrix = load("validation_periodic").state_matrix
    coating = scipy.linalg.expm(THICK * state_matrix(K, STIFF, 0.2))
    whole = scipy.linalg.expm(1.5 * state_matrix(K, 1.0, 0.3)) @ coating
    return -np.linalg.solve(whole[:2, :2], whole[:2, 2:]), coating


def kinked(n, element=ADINI, interfaces="kinked"):
    """Layers whose derivatives across an interface are their own."""
    layers = [(THICK, n // 8, STIFF, 0.2), (1.5, 3 * n // 2, 1.0, 0.3)]
    lengths, cells = ((1.0, 0.25), (n, 2)) if element is BRICK else (1.0, n)
    return PeriodicLayers(lengths, layers, cells, element=element, interfaces=interfaces)


def wave_of(body, component):
    """Displacement of a wave of unit tractions along one component."""
    forces = np.zeros((body.dim, *body.shape))
    n = body.shape[0]
    wave = np.cos(K * np.arange(n) / n) * np.prod(body.spacing)
    forces[component] = wave if body.dim == 2 else wave[:, None]
    u = body.apply(forces).reshape(body.dim, n, -1)[..., 0]
    return forces, np.fft.rfft(u, axis=1)[[0, -1], 1] / (n / 2)


@pytest.mark.parametrize("element", [ADINI, BFS, BRICK], ids=lambda e: type(e).__name__)
def test_coating_beside_its_closed_form(element):
    """Third order, 3e-5 at 64 points a wave; first order where derivatives are shared."""
    wanted = -exact_coating()[0]  # the traction on a lower side is minus the stress
    for interfaces, low, high, last in (("kinked", 2.8, 4.2, 3e-5), ("smooth", 0.8, 1.2, 1.0)):
        sizes = (16, 32, 64)
        bodies = [kinked(n, element, interfaces) for n in sizes]
        errors = [
            [
                np.linalg.norm(wave_of(body, c)[1] - wanted[:, c]) / np.linalg.norm(wanted[:, c])
                for c in (0, -1)
            ]
            for body in bodies
        ]
        assert np.max(errors[-1]) < last
        rate = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
        assert np.all((rate > low) & (rate < high))


def test_stress_jumps_as_it_should():
    """Beside the interface, where sigma_xx of the two layers differs by a factor."""
    flexible, coating = exact_coating()
    state = coating @ np.r_[-flexible[:, 1], 0.0, -1.0]  # of the wave at the interface
    errors = []
    for n in (32, 64):
        body = kinked(n)
        forces, _ = wave_of(body, 1)
        off = []
        for side, (young, ratio) in ((-1e-9, (STIFF, 0.2)), (1e-9, (1.0, 0.3))):
            mu = young / (2 * (1 + ratio))
            lame = 2 * mu * ratio / (1 - 2 * ratio)
            axial = lame + 2 * mu
            xx = 1j * K * (axial - lame**2 / axial) * state[0] + lame / axial * state[3]
            x = np.array([0.5 / n, 10.5 / n])
            sigma = body.stress(forces, np.array([x, np.full(2, THICK + side)]))
            for wanted, (i, j) in ((xx, (0, 0)), (state[2], (0, 1)), (state[3], (1, 1))):
                value = (wanted * np.exp(1j * K * x)).real
                off.append(abs(sigma[i, j] - value).max() / max(abs(state)[2:].max(), abs(wanted)))
        errors.append(max(off))
    assert errors[1] < 2e-2
    assert errors[1] < 0.4 * errors[0]


SPACE = {"lengths": (1.0, 1.0), "cells": (4, 4)}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"lengths": (1.0, 1.0, 1.0)}, "lengths="),
        ({"layers": []}, "layers="),
        ({"layers": None}, "layers=None: expected a list"),
        ({"layers": [(0.0, 1, 1.0, 0.3)]}, r"layers\[0\]: the height must be positive"),
        ({"layers": [*ONE, (1.0, 2, 1.0, -1.0)]}, r"layers\[1\]: nu=-1: Poisson"),
        ({"layers": [(1.0, 2, -1.0, 0.3)]}, r"layers\[0\]: E=-1: Young"),
        ({"plane": "axisymmetric"}, "plane='axisymmetric': layers have no radii"),
        (SPACE | {"plane": "stress"}, "a body in three dimensions"),
        ({"cells": (4, (1, 2))}, "cells="),
        ({"cells": 1}, "cells="),
        ({"top": "z"}, "components="),
        ({"motion": (0.0, 1.0, 2.0)}, "motion="),
        ({"plane": "air"}, "plane"),
        ({"element": ElementQuad2()}, "element ElementQuad2: has unknowns that belong to no"),
        ({"element": ElementHex1()}, "element: ElementHex1 does not live on"),
        ({"element": "Q1"}, "element: expected one of scikit-fem"),
        ({"element": ADINI, "base": (1.0, 0.3)}, "base: the half space is joined"),
        ({"base": (1.0, 0.5)}, "nu"),
        ({"base": (1.0, 0.3), "plane": "stress"}, "base: a top"),
        ({"interfaces": np.array(["smooth", "kinked"])}, "interfaces=ndarray"),
        ({"sides": "xy"}, "sides='xy': transforms diagonalise sides across x that are"),
        ({"sides": ("x", "y")}, "expected 'periodic' or 1 entries"),
        ({"sides": "x", "motion": (0.1, 0.0)}, r"motion=.*the sides hold x at zero"),
        *((SPACE | {"sides": s}, "sides=") for s in ("x", ("x", "x"), ("periodic", "yz"))),
        (SPACE | {"sides": ("x", "periodic"), "cells": (1, 1)}, "whole numbers from 1, 2"),
    ],
)
def test_bad_layers_are_named(given, message):
    arguments = {"lengths": 1.0, "layers": ONE, "cells": 4} | given
    with pytest.raises(InputError, match=message):
        PeriodicLayers(**arguments)
    if set(given) <= {"layers", "lengths", "plane", "cells"} and message.startswith("layers"):
        with pytest.raises(InputError, match=message):
            LayeredBlock(**({"sides": "periodic"} | arguments))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"lengths": (1.0, -1.0)}, "lengths"),
        ({"shape": (8, 0.5)}, "shape"),
        ({"E": 0.0}, "E="),
        ({"E": 1e308}, "E=1e[+]308: .* units"),
        ({"lengths": (1e-200, 1e-200)}, "E=1.0: .* units"),
        ({"nu": 0.5}, "nu"),
        ({"normal": (0, 1, 1)}, "normal"),
    ],
)
def test_bad_half_spaces_are_named(settings, words):
    given = {"lengths": (1.0, 1.0), "shape": (8, 8), "E": 1.0, "nu": 0.3}
    with pytest.raises(InputError, match=f"^{words}"):
        HalfSpace(**(given | settings))


LINE = PeriodicLayers(1.0, ONE, 4)
ROLLERS = PeriodicLayers(1.0, ONE, 4, sides="x")
ZERO = np.zeros((2, 4))


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        *((lambda r=row: LINE.displacement(ZERO, r), "row=") for row in (-1, 4, 0.5, True, None)),
        *(
            (lambda p=p: LINE.sample(ZERO, p), "points")
            for p in ([[0.1], [0.7]], [[0.1], [-0.01]], [0.1, 0.2], [[0.1], [np.nan]])
        ),
        (lambda: ROLLERS.sample(np.zeros((2, 5)), [[1.1], [0.1]]), "beyond a side"),
        *(
            (lambda f=f: LINE.stress(f, [[0.5], [0.3]]), "forces: expected finite numbers of shape")
            for f in (np.zeros((2, 5)), np.full((2, 4), np.nan), np.zeros(4), [[1.0], [1.0, 2.0]])
        ),
        *(
            (lambda f=f: HalfSpace(1.0, 8, E, NU).apply(f), "forces: expected an array of real num")
            for f in (np.zeros(8), np.zeros((2, 9)), np.zeros((2, 8)) * 1j, "x", None)
        ),
        (kinked(8).elastic, "interfaces: a mesh shares all derivatives"),
        (PeriodicLayers(1.0, ONE, 4, base=(1.0, 0.3)).elastic, "base: a half space has no mesh"),
    ],
)
def test_what_compliances_do_not_have_is_refused(ask, message):
    with pytest.raises(InputError, match=message):
        ask()
