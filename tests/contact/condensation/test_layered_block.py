"""Layers of equal cells, by slab doubling and by transforms, beside the sparse path."""

from copy import deepcopy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import ElementHex1, ElementQuad1

from contact import (
    ContactProblem,
    Infeasible,
    InputError,
    LayeredBlock,
    LoadStepper,
    Rigid,
    Unbounded,
)
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

COATED = [(0.1, 2, 50.0, 0.2), (0.5, 5, 1.0, 0.4)]
ONE = [(0.5, 3, 2.0, 0.3)]


def hill(x):
    return 0.01 + 0.2 * sum((p - 0.6) ** 2 for p in x[:-1])


def supported(n):
    block = LayeredBlock(1.0, [(1.0, n, 2.0, 0.3)], sides="y", top="x")
    return block.load("top", (0.0, -1.0)), 0.03, 0.9


def layers(n):
    parts = [(0.25, n // 4 - 1, 2.0, 0.3), (0.35, n // 4, 20.0, 0.2), (0.4, n // 2, 1.0, 0.45)]
    block = LayeredBlock((1.5, 1.0), parts, sides=(None, "x"), columns=n)
    block.load("top", lambda x: np.array([0.1 * x[0], -1 + 0 * x[0]])).load("left", (0.2, 0.0))
    return block.body_force((0.0, -0.3)), 0.01, 0.4


def floating(n):
    parts = [(0.5, n // 4, 2.0, 0.3), (0.3, n // 8 + 1, 20.0, 0.2)]
    block = LayeredBlock(2.0, parts, columns=n)
    return block.load("top", (0.1, -1.0)), lambda x: 0.01 * x[0] ** 2, 0.5


def moved(n):
    block = LayeredBlock(1.0, [(1.0, n, 2.0, 0.3)], sides="x", top="x")
    return block.fix("top", "y", -0.05), lambda x: 0.1 * (x[0] - 0.5) ** 2, 0.3


def plane_stress(n):
    block = LayeredBlock(1.0, [(1.0, n, 2.0, 0.3)], sides="x", plane="stress")
    return block.load("top", (0.0, -1.0)), lambda x: 0.05 * x[0] ** 2, 0.3


CASES = [supported, layers, floating, moved, plane_stress]


def same(ours, other, force, displacement):
    size = np.abs(other.mu).max()
    assert size > 0
    assert np.abs(ours.mu - other.mu).max() <= force * size
    assert np.abs(ours.t - other.t).max() <= force * size
    assert np.abs(ours.u - other.u).max() <= displacement * np.abs(other.u).max()


def internal(block, body, u):
    """Forces ``S u`` in the precision of u, without any from translations."""
    dofs, cells = body.basis.element_dofs, [block.columns * one.height for one in block.cell_rows]
    local, component = u[dofs], np.tile(np.arange(6), 4)
    for c in range(2):
        local[component == c] -= u[dofs[c]]
    parts = zip(block.cell_rows, np.split(local, np.cumsum(cells)[:-1], axis=1), strict=True)
    total = np.zeros_like(u)
    forces = np.hstack([one.stiffness.astype(u.dtype) @ own for one, own in parts])
    np.add.at(total, dofs, forces)
    return total


def refined(block, *arguments, **more):
    """By a sparse factorisation, with one step of refinement by residuals in extended precision.

    Entries of an assembled stiffness are rounded, so that a translation meets forces: with 128
    columns the solution differs from that of the body by 2.5e-12 of the largest force.
    """
    body = block.elastic()
    problem = ContactProblem(body, *arguments, **more)
    result = problem.solve()
    rows, free = result.system.rows, np.diff(body.constraint[0].indptr) > 0
    contact = rows.G.T @ result.mu + rows.T.T @ result.t.ravel()
    left = body.f - contact - internal(block, body, result.u.astype(np.longdouble))
    body.f = body.f + np.where(free, left, 0.0).astype(float)
    return problem.solve(start=result)


def by_slabs(block, obstacle, friction, **more):
    ours = ContactProblem(block, "bottom", obstacle, friction, **more).solve()
    sparse = refined(block, "bottom", obstacle, friction, **more)
    same(ours, sparse, 1e-12, 1e-11)
    assert max(ours.kkt.values()) <= 1e-12
    return ours, sparse


def by_waves(block, obstacle=hill, friction=0.3, **more):
    problem = ContactProblem(block, "bottom", obstacle, friction, **more)
    ours = problem.solve()
    assert problem.condense().path == "fourier"
    other = ContactProblem(block.elastic(), "bottom", obstacle, friction, **more)
    sparse = other.solve()
    assert other.condense().path == "sparse"
    same(ours, sparse, 1e-11, 1e-10)
    assert max(ours.kkt.values()) <= 1e-11
    return ours


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("case", "n", "friction", "more"),
    [
        *((case, 16, None, {}) for case in CASES),
        (layers, 64, None, {}),
        *(
            pytest.param(case, n, None, {}, marks=pytest.mark.slow)
            for case in CASES[:4]
            for n in (64, 128)
            if (case, n) != (layers, 64)
        ),
        (layers, 12, None, {"functional": "gauss"}),
        (layers, 12, None, {"functional": "nodal"}),
        (floating, 12, 0.2, {"law": "tresca"}),
        (supported, 12, 0.0, {"law": None}),
    ],
)
def test_slabs_agree_with_sparse_factorisation(case, n, friction, more):
    block, obstacle, usual = case(n)
    by_slabs(block, obstacle, usual if friction is None else friction, **more)


def test_fields_agree_everywhere():
    block, obstacle, friction = layers(16)
    ours, sparse = by_slabs(block, obstacle, friction)
    points = np.random.default_rng(3).random((2, 200)) * [[1.5], [1.0]]
    points[:, :4] = [[0.0, 1.5, 0.0, 1.5], [0.0, 0.0, 1.0, 1.0]]  # the corners
    for field in ("sample", "stress", "von_mises"):
        found, expected = (np.asarray(getattr(r, field)(points)) for r in (ours, sparse))
        assert np.abs(found - expected).max() <= 1e-10 * np.abs(expected).max()
    for ours_part, part in zip(ours.balance().values(), sparse.balance().values(), strict=True):
        assert np.allclose(ours_part, part, atol=1e-12)
    with pytest.raises(InputError, match=r"block.elastic\(\)"):
        _ = block.basis
    with pytest.raises(InputError, match="outside the block"):
        ours.sample([[0.5, 1.6], [0.5, 0.5]])
    # Translations meet no force at all: rounding is that of strains, not of displacements.
    shift = np.tile([1e6, -1e6 / 3, 0.0, 0.0, 0.0, 0.0], block.f.size // 6)
    assert not np.any(block.stiffness @ shift)


@settings(max_examples=max(settings().max_examples // 3, 10))
@given(
    columns=st.integers(1, 7),
    rows=st.lists(st.integers(1, 9), min_size=1, max_size=3),
    sides=st.sampled_from([None, "x", "y", "xy", ("x", None), (None, "xy"), ("y", "x")]),
    top=st.sampled_from([None, "x", "y", "xy"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_slabs_reduce_and_expand_as_a_dense_elimination_does(columns, rows, sides, top, seed):
    rng = np.random.default_rng(seed)
    parts = [(rng.uniform(0.2, 2.0), n, 10 ** rng.uniform(-2, 2), rng.uniform(0, 0.45))
             for n in rows]  # fmt: skip
    block = LayeredBlock(rng.uniform(0.5, 3.0), parts, sides=sides, top=top, columns=columns)
    if (columns, sides) == (1, "xy"):  # nothing of the bottom is free to move
        with pytest.raises(InputError):
            ContactProblem(block, "bottom", 0.0).condense()
        return
    part = ContactProblem(block, "bottom", 0.0).condense().parts[0]
    at, S = sorted(part._P[:, part._boundary].tocsc().indices), block.elastic().stiffness.toarray()
    rest = np.setdiff1d(np.arange(block.f.size), [*at, *block.prescribed[0]])
    inner, across = S[np.ix_(rest, rest)], S[np.ix_(rest, at)]
    solved, factor = np.linalg.solve(inner, across), part._factor
    # Layers of 1e4 times the stiffness, cells of any shape: the dense solve is no better.
    schur = S[np.ix_(at, at)] - across.T @ solved
    assert np.abs(factor.schur - schur).max() <= 1e-9 * np.abs(S).max()
    load, z_b, z = np.zeros(len(S)), rng.standard_normal(len(at)), np.zeros(len(S))
    load[[*at, *rest]] = rng.standard_normal(len(at) + len(rest))
    down = load[at] - solved.T @ load[rest]
    assert np.abs(factor.reduce(load) - down).max() <= 1e-8 * np.abs(down).max()
    z[at], z[rest] = z_b, np.linalg.solve(inner, load[rest]) - solved @ z_b
    assert np.abs(factor.expand(load, z_b) - z).max() <= 1e-8 * np.abs(z).max()


def pressed(block, top):
    """Moved down where the top is said to be, else loaded, also in the middle of its layers."""
    if top == "moved":
        return block.fix("top", "xyz"[block.dim - 1], -0.03)
    block.load("top", (0.0,) * (block.dim - 1) + (-0.2,))
    return block.body_force((0.01,) * (block.dim - 1) + (-0.1,))


SIDES = [
    ("periodic", "x", "moved"),
    ("periodic", None, "loaded"),
    ("x", "x", "moved"),
    ("x", None, "loaded"),
    ("y", "x", "loaded"),
    (("y", "y"), None, "loaded"),
]
PLANE = {"lengths": 1.3, "layers": COATED}
SPACE = {"lengths": (1.0, 1.2), "layers": COATED, "top": "xy"}
MANY = [(0.03, 1, 1e2, 0.3), (0.7, 37, 1.0, 0.2), (0.3, 12, 5.0, 0.45)]
WAVES = [  # block, how its top is driven, factor of the obstacle, what the problem is given
    *(
        (PLANE | {"sides": sides, "top": fixed, "cells": 9, "element": element}, top, 1.0, {})
        for sides, fixed, top in SIDES
        for element in (None, ElementQuad1(), ElementQuadBFS())
    ),
    *(
        (SPACE | {"sides": sides, "cells": (4, 5)}, top, 0.7, {})
        for sides in ("periodic", ("x", "y"), ("periodic", "y"), ("x", "periodic"), ("x", "xz"))
        for top in ("moved", "loaded")
        if (sides, top) != (("x", "xz"), "moved")
    ),
    *(
        (
            SPACE | {"layers": ONE, "sides": sides, "cells": (3, 4), "element": ElementHexAdini()},
            "loaded",
            0.3,
            {"functional": "centroid"},
        )
        for sides in (("periodic", "y"), ("x", "y"), ("yz", "periodic"))
    ),
    *(
        (PLANE | {"sides": "periodic", "top": "x", "columns": 10}, "moved", 1.0, law | functional)
        for law in ({}, {"friction": 0.02, "law": "tresca"}, {"friction": 0.0})
        for functional in ({"functional": "gauss"}, {"functional": "nodal"})
    ),
    (
        {"lengths": 1.0, "layers": MANY, "sides": "x", "top": "x", "columns": 12}
        | {"plane": "stress"},
        "moved",
        0.5,
        {},
    ),
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("given", "top", "scale", "more"), WAVES)
def test_waves_agree_with_sparse_factorisation(given, top, scale, more):
    block = pressed(LayeredBlock(**given, path="fourier"), top)
    by_waves(block, lambda x: scale * hill(x), **more)


@pytest.mark.parametrize("element", [ElementHex1(), ElementHexAdini()])
@pytest.mark.parametrize("cells", [(1, 1), (1, 3), (3, 1)])
def test_one_cell_between_mirrored_sides(element, cells):
    more = {"cells": cells, "element": element, "path": "fourier"}
    block = LayeredBlock((0.5, 1.0), COATED, ("x", "y"), "x", **more)
    by_waves(block.load("top", (0.0, 0.0, -0.1)), lambda x: 0.003 * x[0] ** 2 + 0.002 * x[1])


@pytest.mark.sampled(3)
@pytest.mark.parametrize("functional", [None, "nodal"])
@pytest.mark.parametrize(("sides", "fixed", "top"), SIDES[2:])
def test_without_a_mesh(sides, fixed, top, functional):
    """Adini's cells between mirrored sides: neither a mesh nor a matrix of the body."""
    parts = [(0.1, 2, 5.0, 0.2), (0.5, 13, 1.0, 0.4)]
    block = LayeredBlock(1.3, parts, sides, fixed, columns=14, path="fourier")
    result = by_waves(pressed(block, top), functional=functional)
    assert np.abs(result.u.reshape(16, 15, 6)[:, [0, -1], 3 if "x" in sides else 2]).max() < 1e-13
    meshed = pressed(LayeredBlock(1.3, parts, sides, fixed, cells=14, path="fourier"), top)
    free = [one.constraint[0].shape[1] for one in (block.elastic(), meshed, block)]
    assert len(set(free)) == 1


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("unit", "modulus"), [(1.0, 2e11), (1e-9, 1e12), (1e6, 1e-12)])
@pytest.mark.parametrize("kind", [{"columns": 5}, {"cells": 5}, {"cells": (3, 4)}])
def test_units_of_length_and_stiffness(kind, unit, modulus):
    """With an obstacle that also moves along the sides."""
    parts = [(0.55 * unit, 4, 1.8 * modulus, 0.0), (0.2 * unit, 2, 1.5 * modulus, 0.3)]
    dim = 3 if kind == {"cells": (3, 4)} else 2
    sides, lengths = ("x", unit) if dim == 2 else (("x", "y"), (unit, unit))
    block = LayeredBlock(lengths, parts, sides, "xyz"[: dim - 1], path="fourier", **kind)
    block.fix("top", "xyz"[dim - 1], -0.01 * unit)

    def bowl(x):
        return 3e-3 * unit * sum((p / unit - 0.3) ** 2 for p in x[:-1])

    motion = (1e-3 * unit, *[0.0] * (dim - 1))
    by_waves(block, Rigid(bowl, displacement=motion), functional="nodal" if dim == 3 else None)


@pytest.mark.parametrize(
    "more", [{"columns": 4}, {"columns": 4, "path": "fourier"}, {"cells": 4}, {"cells": (3, 3)}]
)
def test_layers_much_thinner_than_cells_are_wide(more):
    """First and last layer; sides of the block are found however flat its cells are."""
    flat, thick = (1e-4, 4, 3.0, 0.3), (0.5, 3, 1.0, 0.2)
    dim = 3 if more == {"cells": (3, 3)} else 2
    sides, lengths = ("x", 1.0) if dim == 2 else (("x", "y"), (1.0, 1.0))
    for parts in ([flat, thick], [thick, flat]):
        block = LayeredBlock(lengths, parts, sides, "x", **more)
        block.fix("top", "xyz"[dim - 1], -0.03)
        bodies = block, block.elastic()
        same(*(ContactProblem(b, "bottom", hill, 0.3).solve() for b in bodies), 1e-9, 1e-9)


def test_sides_that_move_and_supports_besides_without_a_mesh():
    block = LayeredBlock(1.3, COATED, "x", "x", columns=9, path="fourier")
    by_waves(block.fix("top", "y", -0.03))
    other = LayeredBlock(1.3, COATED, "x", "x", columns=9, path="fourier").fix("left", "y")
    with pytest.raises(InputError, match="path: supports besides"):
        ContactProblem(other, "bottom", hill, 0.3).condense()


@pytest.mark.parametrize("kind", [{"columns": 4}, {"cells": 4}])
def test_pressures_that_held_derivatives_leave_open_are_refused(kind):
    """Full contact has two numbers more than unknowns: the derivatives held in the corners."""
    block = LayeredBlock(1.0, [(0.5, 2, 1.0, 0.3)], "x", path="fourier", **kind)
    with pytest.raises(InputError, match="pressures are not determined"):
        ContactProblem(block.load("top", (0.0, -0.01)), "bottom", 0.0).solve()


def random_block(seed):
    rng = np.random.default_rng(seed)
    dim = int(rng.integers(2, 4))
    parts = [
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
        tuple(rng.uniform(0.5, 2.0, 2)) if dim == 3 else rng.uniform(0.5, 2.0), parts,
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


@pytest.mark.parametrize(
    "seeds",
    [
        *(pytest.param([seed], marks=pytest.mark.sampled(4)) for seed in range(12)),
        *(pytest.param(range(k, k + 20), marks=pytest.mark.slow) for k in range(100, 400, 20)),
    ],
    ids=str,
)
def test_random_blocks(seeds):
    for seed in seeds:
        by_waves(*random_block(seed))


@pytest.mark.filterwarnings("ignore:displacements reach")  # E of one under loads of two
@pytest.mark.parametrize("path", ["slabs", "fourier"])
def test_histories_and_driven_obstacles_as_with_a_basis(path):
    """One condensation serves every step."""
    ends = []
    for kind in (lambda b: b, lambda b: b.elastic()):
        block = LayeredBlock(1.0, [(1.0, 8, 1.0, 0.3)], top="x")
        rigid = Rigid(0.0, displacement=(0.02, None), force=(None, 0.7))
        if path == "fourier":
            block = LayeredBlock((1.0, 1.0), ONE, "periodic", "xy", cells=(4, 4))
            rigid = Rigid(hill, displacement=(0.0, 0.0, None), force=(None, None, 0.05))
        body = kind(block.fix("top", "xyz"[block.dim - 1]))
        problem = ContactProblem(body, "bottom", rigid, 0.4)
        condensed = problem.condense()
        stepper = LoadStepper(problem).move("top", "x", 0.05, np.sin)
        if path == "slabs":
            stepper.load("left", lambda x: np.array([0.01 * x[1], 0.0 * x[0]]))
        ends.append(stepper.run([0.5, 1.0, 1.5]).results[-1])
        assert problem.condense() is condensed
    same(*ends, *((1e-12, 1e-11) if path == "slabs" else (1e-11, 1e-10)))
    assert np.abs(ends[0].t).max() > 0


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
    plain = LayeredBlock(1.0, ONE, "x", "xy")
    rollers = LayeredBlock(1.0, ONE, "x", "x", element=ElementQuad1())  # the same body mirrored
    upside_down = LayeredBlock(1.0, ONE, "periodic").fix("bottom", "xy")
    changed = LayeredBlock(1.0, ONE, "periodic", "xy")
    changed.E = 3.0
    periodic = LayeredBlock(1.0, ONE, "periodic")
    for block, boundary, solver, path in (
        (plain, "bottom", "auto", "slabs"),
        (rollers, "bottom", "auto", "fourier"),
        (upside_down, "top", "auto", "sparse"),
        (changed, "bottom", "auto", "sparse"),
        (periodic, "bottom", "superlu", "sparse"),
    ):
        problem = ContactProblem(block, boundary, 0.0, 0.3, solver=solver)
        assert problem.condense().path == path


def test_what_nothing_holds_is_named():
    block = LayeredBlock(2.0, [(1.0, 6, 1.0, 0.3)], columns=8).load("top", (0.3, -1.0))
    for body in (block, block.elastic()):
        with pytest.raises(Unbounded, match="a translation along x") as error:
            ContactProblem(body, "bottom", 0.0).solve()
        assert error.value.mode.shape == block.f.shape
    turned = LayeredBlock(2.0, [(1.0, 6, 1.0, 0.3)], sides="x", columns=8)
    space = LayeredBlock((1.0, 1.0), ONE, ("x", "periodic"), cells=(3, 3), path="fourier")
    periodic = LayeredBlock(1.0, ONE, "periodic")
    for body, load, friction in (
        (turned, (0.0, 1.0), 0.0),
        (space, (0.0, 0.1, -1.0), 0.0),
        (periodic, (0.0, 1.0), 0.3),
    ):
        with pytest.raises(Unbounded, match="a translation along y"):
            ContactProblem(body.load("top", load), "bottom", 0.0, friction).solve()
    driven_in = LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)]).fix("left", "y", -0.1)
    with pytest.raises(Infeasible, match="contact point 0"):
        ContactProblem(driven_in, "bottom", 0.0).solve()


@pytest.mark.gpu
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("n", [16, 64])
def test_device_agrees_with_host(case, n):
    block, obstacle, friction = case(n)
    host = ContactProblem(block, "bottom", obstacle, friction).solve()
    block, obstacle, friction = case(n)
    problem = ContactProblem(block, "bottom", obstacle, friction)
    problem.condense(device="cuda")
    for method in ("newton", "tresca_loop"):
        same(problem.solve(method), host, 1e-12, 1e-11)


CUBE = {"lengths": (1.0, 1.0), "cells": (3, 3)}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"lengths": 1j}, "lengths"),
        ({"lengths": (1.0, 2.0)}, "lengths.*the layers are 0.5 high"),
        ({"layers": None}, "layers"),
        ({"layers": [(1.0, 4, 1.0)]}, r"layers\[0\]"),
        ({"layers": [*ONE, (-1.0, 4, 1.0, 0.3)]}, r"layers\[1\].*height"),
        ({"layers": [(1.0, 2.5, 1.0, 0.3)]}, "cells must be a whole number"),
        ({"layers": [(1.0, 4, 1.0, 0.5)]}, "nu="),
        ({"sides": ("x", "y", "x")}, "sides"),
        ({"top": 5}, "components"),
        ({"columns": "many"}, "columns"),
        ({"plane": "membrane"}, "plane"),
        ({"columns": 3, "cells": 4}, "columns=3: cells=4 says the same"),
        ({"path": "fourier"}, "sides=None: transforms diagonalise"),
        ({"sides": "x", "path": "slabs"}, "path='slabs': expected None or 'fourier'"),
        ({"sides": ("periodic", "x")}, r"sides=.*both sides"),
        ({"sides": "periodic", "cells": 1}, "cells=1: expected two or more along periodic sides"),
        ({"cells": (3, 3)}, "lengths=1.0: expected two positive numbers"),
        (CUBE | {"sides": "x"}, "sides='x'"),
        (CUBE | {"sides": ("x", "q")}, "components='q'"),
        (CUBE | {"element": ElementQuad1()}, "element"),
        ({"sides": "periodic", "plane": "axisymmetric"}, "plane='axisymmetric'"),
    ],
)
def test_bad_blocks_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        LayeredBlock(**{"lengths": 1.0, "layers": ONE} | given)


def test_bad_use_is_refused():
    block = LayeredBlock(1.0, ONE)
    facets = block.trace.mesh
    clash = LayeredBlock(1.0, ONE).fix("top", "y", 0.1).fix("left", "y", 0.2)
    stepper = LoadStepper(ContactProblem(block, "bottom", 0.0))
    for call, message in (
        (lambda: block.fix("bottom", "x"), "boundary='bottom'"),
        (lambda: block.fix("middle"), "boundary='middle'"),
        (lambda: block.fix("top", "y", np.nan), "value"),
        (lambda: block.load("top", (np.nan, 0.0)), "traction"),
        (lambda: block.load("top", (1.0, 0.0, 0.0)), "traction"),
        (lambda: block.body_force((1.0,)), "force"),
        (lambda: ContactProblem(block, "top", 0.0), "boundary"),
        # Numbers of facets inside the block, as its lowest row of cells counts them.
        (lambda: ContactProblem(block, facets.f2t[1] == -1, 0.0), "that name"),
        (lambda: ContactProblem(block, facets.boundary_facets(), 0.0), "that name"),
        (lambda: stepper.move("top", "x"), "not fixed"),
        (lambda: ContactProblem(clash, "bottom", 0.0).solve(), "differ where they meet"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_it_says_what_it_is():
    block = LayeredBlock((1.0, 1.0), COATED, "periodic", cells=(3, 3))
    assert repr(block) == "LayeredBlock(3-D, 3 x 3 x 7 cells, 384 unknowns of ElementHex1)"
