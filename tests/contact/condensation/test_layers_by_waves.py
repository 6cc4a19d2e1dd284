"""Layered blocks condensed by transforms: the sparse path, body by body, and what is refused."""

import pickle
from copy import deepcopy

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1

from contact import (
    ContactProblem,
    InputError,
    LayeredBlock,
    LoadStepper,
    Rigid,
    Unbounded,
    cross_check,
)
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

COATED = [(0.1, 2, 50.0, 0.2), (0.5, 5, 1.0, 0.4)]
ONE = [(0.5, 3, 2.0, 0.3)]


def hill(x):
    return 0.01 + 0.2 * sum((p - 0.6) ** 2 for p in x[:-1])


def compare(block, obstacle=hill, friction=0.3, **more):
    """Multipliers to 1e-11 and displacement to 1e-10, with the condensation by transforms."""
    problem = ContactProblem(block, "bottom", obstacle, friction, **more)
    ours = problem.solve()
    assert problem.condense().path == "fourier"
    other = ContactProblem(block.elastic(), "bottom", obstacle, friction, **more)
    sparse = other.solve()
    assert other.condense().path == "sparse"
    size = np.abs(sparse.mu).max()
    assert size > 0
    assert np.abs(ours.mu - sparse.mu).max() <= 1e-11 * size
    assert np.abs(ours.t - sparse.t).max() <= 1e-11 * size
    assert np.abs(ours.u - sparse.u).max() <= 1e-10 * np.abs(sparse.u).max()
    assert max(ours.kkt.values()) <= 1e-11
    return ours


def pressed(block, top):
    """Moved down where the top is said to be, else loaded, also in the middle of its layers."""
    down = "y" if block.dim == 2 else "z"
    if top == "moved":
        block.fix("top", down, -0.03)
    else:
        block.load("top", (0.0,) * (block.dim - 1) + (-0.2,))
        block.body_force((0.01,) * (block.dim - 1) + (-0.1,))
    return block


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", [None, ElementQuad1(), ElementQuadBFS()])
@pytest.mark.parametrize(
    ("sides", "fixed", "top"),
    [
        ("periodic", "x", "moved"),
        ("periodic", None, "loaded"),
        ("x", "x", "moved"),
        ("x", None, "loaded"),
        ("y", "x", "loaded"),
        (("y", "y"), None, "loaded"),
    ],
)
def test_in_the_plane(sides, fixed, top, element):
    block = LayeredBlock(1.3, COATED, sides, fixed, cells=9, element=element, path="fourier")
    compare(pressed(block, top))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("top", ["moved", "loaded"])
@pytest.mark.parametrize(
    "sides", ["periodic", ("x", "y"), ("periodic", "y"), ("x", "periodic"), ("x", "xz")]
)
def test_in_space(sides, top):
    if top == "moved" and "xz" in sides:
        top = "loaded"
    block = LayeredBlock((1.0, 1.2), COATED, sides, "xy", cells=(4, 5), path="fourier")
    compare(pressed(block, top), lambda x: 0.7 * hill(x))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("sides", [("periodic", "y"), ("x", "yx"), ("yz", "periodic")])
def test_adini_bricks(sides):
    block = LayeredBlock(
        (1.0, 1.2), ONE, sides, "x", cells=(3, 4), element=ElementHexAdini(), path="fourier"
    ) if sides != ("x", "yx") else LayeredBlock(
        (1.0, 1.2), ONE, ("x", "y"), None, cells=(4, 3), element=ElementHexAdini(), path="fourier"
    )  # fmt: skip
    compare(pressed(block, "loaded"), lambda x: 0.3 * hill(x), functional="centroid")


@pytest.mark.parametrize("element", [ElementHex1(), ElementHexAdini()])
@pytest.mark.parametrize("cells", [(1, 1), (1, 3), (3, 1)])
def test_one_cell_between_mirrored_sides(element, cells):
    more = {"cells": cells, "element": element, "path": "fourier"}
    block = LayeredBlock((0.5, 1.0), COATED, ("x", "y"), "x", **more)
    compare(block.load("top", (0.0, 0.0, -0.1)), lambda x: 0.003 * x[0] ** 2 + 0.002 * x[1])


@pytest.mark.parametrize("functional", ["gauss", "nodal"])
def test_other_functionals_and_laws(functional):
    block = LayeredBlock(1.3, COATED, "periodic", "x", columns=10)
    compare(pressed(block, "moved"), functional=functional)
    compare(block, friction=0.02, law="tresca", functional=functional)
    compare(block, friction=0.0, functional=functional)


def test_plane_stress_many_layers_and_a_stiff_coating():
    layers = [(0.03, 1, 1e2, 0.3), (0.7, 37, 1.0, 0.2), (0.3, 12, 5.0, 0.45)]
    block = LayeredBlock((1.0, 1.03), layers, "x", "x", columns=12, plane="stress", path="fourier")
    compare(pressed(block, "moved"), lambda x: 0.005 + 0.02 * (x[0] - 0.3) ** 2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("functional", [None, "nodal"])
@pytest.mark.parametrize(
    ("sides", "fixed", "top"),
    [
        ("x", "x", "moved"),
        ("x", None, "loaded"),
        ("y", "x", "loaded"),
        (("y", "y"), None, "loaded"),
    ],
)
def test_without_a_mesh(sides, fixed, top, functional):
    """Adini's cells between mirrored sides: neither a mesh nor a matrix of the body."""
    layers = [(0.1, 2, 5.0, 0.2), (0.5, 13, 1.0, 0.4)]
    block = LayeredBlock(1.3, layers, sides, fixed, columns=14, path="fourier")
    assert isinstance(block, LayeredBlock)
    pressed(block, top)
    result = compare(block, functional=functional)
    assert np.abs(result.u.reshape(16, 15, 6)[:, [0, -1], 3 if "x" in sides else 2]).max() < 1e-13
    body = block.elastic()
    meshed = pressed(LayeredBlock(1.3, layers, sides, fixed, cells=14, path="fourier"), top)
    P, Q = body.constraint[0], meshed.constraint[0]
    assert P.shape[1] == Q.shape[1] == block.constraint[0].shape[1]


@pytest.mark.parametrize(("unit", "modulus"), [(1.0, 2e11), (1e-9, 1e12), (1e6, 1e-12)])
@pytest.mark.parametrize("kind", [{"columns": 5}, {"cells": 5}, {"cells": (3, 4)}])
def test_units_of_length_and_stiffness(kind, unit, modulus):
    """With an obstacle that also moves along the sides."""
    layers = [(0.55 * unit, 4, 1.8 * modulus, 0.0), (0.2 * unit, 2, 1.5 * modulus, 0.3)]
    dim = 3 if kind == {"cells": (3, 4)} else 2
    sides, lengths = ("x", unit) if dim == 2 else (("x", "y"), (unit, unit))
    block = LayeredBlock(lengths, layers, sides, "xyz"[: dim - 1], path="fourier", **kind)
    block.fix("top", "xyz"[dim - 1], -0.01 * unit)

    def bowl(x):
        return 3e-3 * unit * sum((p / unit - 0.3) ** 2 for p in x[:-1])

    motion = (1e-3 * unit, *[0.0] * (dim - 1))
    compare(block, Rigid(bowl, displacement=motion), functional="nodal" if dim == 3 else None)


@pytest.mark.parametrize(
    "more", [{"columns": 4}, {"columns": 4, "path": "fourier"}, {"cells": 4}, {"cells": (3, 3)}]
)
@pytest.mark.parametrize("height", [1e-2, 1e-4])
def test_layers_much_thinner_than_cells_are_wide(height, more):
    """First and last layer; sides of the block are found however flat its cells are."""
    flat, thick = (height, 4, 3.0, 0.3), (0.5, 3, 1.0, 0.2)
    dim = 3 if more == {"cells": (3, 3)} else 2
    sides, lengths = ("x", 1.0) if dim == 2 else (("x", "y"), (1.0, 1.0))
    for layers in ([flat, thick], [thick, flat]):
        block = LayeredBlock(lengths, layers, sides, "x", **more)
        block.fix("top", "xyz"[dim - 1], -0.03)
        ours, sparse = (
            ContactProblem(body, "bottom", hill, 0.3).solve() for body in (block, block.elastic())
        )
        assert sparse.mu.max() > 0
        assert np.abs(ours.mu - sparse.mu).max() < 1e-9 * sparse.mu.max()
        assert np.abs(ours.u - sparse.u).max() < 1e-9 * np.abs(sparse.u).max()


def test_sides_that_move_and_supports_besides_without_a_mesh():
    block = LayeredBlock(1.3, COATED, "x", "x", columns=9, path="fourier")
    block.fix("top", "y", -0.03)
    compare(block)
    other = LayeredBlock(1.3, COATED, "x", "x", columns=9, path="fourier").fix("left", "y")
    with pytest.raises(InputError, match="path: supports besides"):
        ContactProblem(other, "bottom", hill, 0.3).condense()
    deep = deepcopy(LayeredBlock(1.3, COATED, "y", None, columns=9, path="fourier"))
    assert ContactProblem(deep, "bottom", hill, 0.3).condense().path == "fourier"


@pytest.mark.parametrize("kind", [{"columns": 4}, {"cells": 4}])
def test_pressures_that_held_derivatives_leave_open_are_refused(kind):
    """Full contact has two numbers more than unknowns: the derivatives held in the corners."""
    block = LayeredBlock(1.0, [(0.5, 2, 1.0, 0.3)], "x", path="fourier", **kind)
    block.load("top", (0.0, -0.01))
    with pytest.raises(InputError, match="pressures are not determined"):
        ContactProblem(block, "bottom", 0.0).solve()


def random_block(seed):
    rng = np.random.default_rng(seed)
    dim = int(rng.integers(2, 4))
    layers = [
        (rng.uniform(0.1, 0.6), int(rng.integers(1, 6)), 10 ** rng.uniform(0, 1),
         rng.uniform(0.0, 0.45))
        for _ in range(rng.integers(1, 4))
    ]  # fmt: skip
    kinds = [["periodic", "x", "y"]] if dim == 2 else [["periodic", "x", "yz"],
                                                       ["periodic", "y", "xz"]]  # fmt: skip
    sides = tuple(rng.choice(kind) for kind in kinds)
    cells = [int(n) for n in rng.integers(2, 7, dim - 1)]
    elements = [ElementQuad1(), ElementQuadAdini()] if dim == 2 else [ElementHex1()]
    across, down = "xyz"[: dim - 1], "xyz"[dim - 1]
    block = LayeredBlock(
        tuple(rng.uniform(0.5, 2.0, 2)) if dim == 3 else rng.uniform(0.5, 2.0), layers,
        str(sides[0]) if dim == 2 else tuple(map(str, sides)), across,
        cells=cells if dim == 3 else cells[0], element=rng.choice(elements), path="fourier",
    )  # fmt: skip
    held = any(down in side for side in sides)
    if held:  # the sides hold the top there, too
        block.load("top", (0.0,) * (dim - 1) + (-rng.uniform(0.2, 0.4),))
    else:
        block.fix("top", down, -rng.uniform(0.01, 0.03))
    block.body_force(rng.uniform(-0.05, 0.0, dim))
    height, turns = rng.uniform(0.002, 0.009), rng.uniform(1.0, 3.0, 2)

    def ground(x):
        waves = sum(1 - np.cos(t * (p - 0.4)) for t, p in zip(turns, x[:-1], strict=False))
        return (0.1 * height if held else height) * waves

    return block, ground, float(rng.uniform(0.1, 0.9))


def _agree(seed):
    block, ground, friction = random_block(seed)
    compare(block, ground, friction)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(12))
def test_random_blocks(seed):
    _agree(seed)


@pytest.mark.slow
@pytest.mark.parametrize("start", range(100, 400, 20))
def test_three_hundred_random_blocks(start):
    for seed in range(start, start + 20):
        _agree(seed)


def test_any_load_is_reduced_and_expanded_as_by_a_dense_elimination():
    rng = np.random.default_rng(5)
    for sides, path in ((("periodic", "y"), None), (("x", "xz"), None), ("periodic", None)):
        block = LayeredBlock((1.0, 1.5), COATED, sides, "y", cells=(3, 4), path=path)
        condensed = ContactProblem(block, "bottom", 0.0, 0.3).condense().parts[0]
        P, at = condensed._P.toarray(), condensed._boundary
        used = np.flatnonzero(np.abs(P).max(axis=0) > 0)
        rest = np.setdiff1d(used, at)
        S = P.T @ block.stiffness.toarray() @ P
        inner, across = S[np.ix_(rest, rest)], S[np.ix_(rest, at)]
        solved = np.linalg.solve(inner, across)
        schur = S[np.ix_(at, at)] - across.T @ solved
        assert np.abs(condensed._factor.schur - schur).max() < 1e-12 * np.abs(S).max()
        load = P.T @ (P @ rng.standard_normal(P.shape[1]))
        z_b = rng.standard_normal(at.size)
        down = load[at] - solved.T @ load[rest]
        assert np.abs(condensed._factor.reduce(load) - down).max() < 1e-11 * np.abs(down).max()
        z = np.zeros(load.size)
        z[at], z[rest] = z_b, np.linalg.solve(inner, load[rest]) - solved @ z_b
        found = condensed._factor.expand(load, z_b)
        assert np.abs(found - z).max() < 1e-11 * np.abs(z).max()


def test_histories_driven_obstacles_and_a_cross_check():
    """One condensation serves every step; an independent solver confirms the last one."""
    ends = []
    for kind in (lambda b: b, lambda b: b.elastic()):
        block = kind(LayeredBlock((1.0, 1.0), ONE, "periodic", "xy", cells=(4, 4)))
        rigid = Rigid(hill, displacement=(0.0, 0.0, None), force=(None, None, 0.05))
        stepper = LoadStepper(ContactProblem(block.fix("top", "z"), "bottom", rigid, 0.4))
        stepper.move("top", "x", 0.02, lambda t: t)
        history = stepper.run([0.5, 1.0])
        ends.append(history.results[-1])
    assert np.abs(ends[0].t).max() > 0
    assert np.abs(ends[0].mu - ends[1].mu).max() < 1e-11 * ends[1].mu.max()
    assert np.abs(ends[0].t - ends[1].t).max() < 1e-11 * ends[1].mu.max()
    problem = ContactProblem(pressed(LayeredBlock(1.0, ONE, "periodic", "x"), "moved"), "bottom",
                             hill, 0.3)  # fmt: skip
    check = cross_check(problem, problem.solve())
    assert check.verdict == "agrees"


def test_copies_and_pickles_keep_the_path():
    block = pressed(LayeredBlock(1.0, ONE, "periodic", "x"), "moved")
    first = ContactProblem(block, "bottom", hill, 0.3).solve()
    for other in (deepcopy(block), pickle.loads(pickle.dumps(block))):
        problem = ContactProblem(other, "bottom", hill, 0.3)
        assert problem.condense().path == "fourier"
        assert np.array_equal(problem.solve().mu, first.mu)


def test_what_transforms_do_not_diagonalise_is_condensed_otherwise():
    """Clamped and free sides, natural conditions of Adini's cells, further supports and ties."""
    for block in (
        LayeredBlock((1.0, 1.0), ONE, ("xyz", "periodic"), cells=(3, 3)),
        LayeredBlock((1.0, 1.0), ONE, None, "xyz", cells=(3, 3)),
        LayeredBlock((1.0, 1.0), ONE, ("x", None), "xyz", cells=(3, 3)),
        LayeredBlock(1.0, ONE, "x", "xy", element=ElementQuadAdini()),
        LayeredBlock(1.0, ONE, ("x", None), "xy", element=ElementQuad1()),
        LayeredBlock(1.0, ONE, "periodic", "xy").fix("left", "x"),
        LayeredBlock(1.0, ONE, "periodic").tie("top", "y"),
    ):
        other = deepcopy(block)
        assert ContactProblem(block, "bottom", 0.0, 0.3).condense().path == "sparse"
        other.__dict__["path"] = "fourier"
        with pytest.raises(InputError, match="path: "):
            ContactProblem(other, "bottom", 0.0, 0.3).condense()
    block = LayeredBlock(1.0, ONE, "periodic")
    assert ContactProblem(block.fix("bottom", "xy"), "top", 0.0, 0.3).condense().path == "sparse"
    plain = LayeredBlock(1.0, ONE, "x", "xy")
    assert ContactProblem(plain, "bottom", 0.0, 0.3).condense().path == "slabs"
    changed = LayeredBlock(1.0, ONE, "periodic", "xy")
    changed.E = 3.0
    assert ContactProblem(changed, "bottom", 0.0, 0.3).condense().path == "sparse"
    asked = ContactProblem(LayeredBlock(1.0, ONE, "periodic"), "bottom", 0.0, 0.3, solver="superlu")
    assert asked.condense().path == "sparse"


def test_sides_without_derivatives_need_no_mirroring():
    """Between rollers bilinear cells are the same body with and without `path`."""
    blocks = [
        pressed(LayeredBlock(1.0, ONE, "x", "x", element=ElementQuad1(), path=path), "moved")
        for path in (None, "fourier")
    ]
    one, other = (ContactProblem(block, "bottom", hill, 0.3) for block in blocks)
    assert one.condense().path == "fourier"
    assert np.array_equal(one.solve().mu, other.solve().mu)


def test_a_translation_that_nothing_holds_is_named():
    block = LayeredBlock((1.0, 1.0), ONE, ("x", "periodic"), cells=(3, 3), path="fourier")
    with pytest.raises(Unbounded, match="a translation along y"):
        ContactProblem(block.load("top", (0.0, 0.1, -1.0)), "bottom", 0.0).solve()
    block = LayeredBlock(1.0, ONE, "periodic").load("top", (0.0, 1.0))
    with pytest.raises(Unbounded, match="a translation along y"):
        ContactProblem(block, "bottom", 0.0, 0.3).solve()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"columns": 3, "cells": 4}, "columns=3: cells=4 says the same"),
        ({"sides": "xy", "path": "fourier"}, "sides='xy': transforms diagonalise"),
        ({"path": "fourier"}, "sides=None: transforms diagonalise"),
        ({"sides": ("x", "y"), "path": "fourier"}, "sides="),
        ({"sides": "x", "path": "slabs"}, "path='slabs': expected None or 'fourier'"),
        ({"sides": ("periodic", "x")}, r"sides=.*both sides"),
        ({"sides": "periodic", "layers": [(0.0, 2, 1.0, 0.3)]}, r"layers\[0\]: the height must"),
        ({"sides": "periodic", "layers": [(1.0, 2, 1.0, 0.5)]}, "nu"),
        ({"sides": "periodic", "cells": 0}, "cells=0"),
        ({"sides": "periodic", "cells": 1}, "cells=1: expected two or more along periodic sides"),
        ({"sides": "periodic", "cells": (2, 2, 2)}, "cells="),
        ({"sides": "periodic", "cells": 2.5}, "cells="),
        ({"cells": (3, 3)}, "lengths=1.0: expected two positive numbers"),
        ({"lengths": (1.0, -1.0), "cells": (3, 3)}, "lengths="),
        ({"lengths": (1.0, 1.0), "cells": (3, 3), "sides": "x"}, "sides='x'"),
        ({"lengths": (1.0, 1.0), "cells": (3, 3), "sides": ("x", "q")}, "components='q'"),
        ({"lengths": (1.0, 1.0), "cells": (3, 3), "element": ElementQuad1()}, "element"),
        ({"sides": "periodic", "plane": "axisymmetric"}, "plane='axisymmetric'"),
    ],
)
def test_bad_input_is_named(given, message):
    with pytest.raises(InputError, match=message):
        LayeredBlock(**{"lengths": 1.0, "layers": ONE} | given)


def test_it_says_what_it_is():
    block = LayeredBlock((1.0, 1.0), COATED, "periodic", cells=(3, 3))
    assert repr(block) == "LayeredBlock(3-D, 3 x 3 x 7 cells, 384 unknowns of ElementHex1)"
