"""The blocks of nodes on the CPU against the node functions, and the wrap of a foot."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cip import Grid, Solver, Velocity
from cip.engines import cpu_loops
from cip.profiles import line_kernels, line_profiles, plane_kernels
from cip.profiles.catalogue import Limits, Line, Update
from skfem_adini.ground.jit import loop_over

locate: Any = getattr(line_profiles.locate, "py_func", line_profiles.locate)


@given(
    n=st.integers(4, 10**6), i=st.floats(0, 1, exclude_max=True),
    cells=st.integers(-(10**9), 10**9), s=st.floats(0, 1, exclude_max=True),
)  # fmt: skip
@example(n=49, i=0.0, cells=-49, s=0.0)
@example(n=4, i=0.9, cells=1, s=0.0)
def test_feet_wrap_into_the_period(n, i, cells, s):
    """Whole periods, however many, do not change the cell."""
    node, d = int(i * n), cells + s
    k, r, place = locate(node, d, n, 1)
    assert k == (node + int(np.floor(d))) % n
    assert r == (k + 1) % n
    assert place == d - np.floor(d)


@given(n=st.integers(4, 100), d=st.floats(-300, 300))
@settings(max_examples=50)
def test_feet_stay_on_a_line_with_ends(n, d):
    k, r, place = locate(n // 2, d, n, 0)
    assert 0 <= k == r - 1 <= n - 2
    assert k + place == pytest.approx(min(max(n // 2 + d, 0), n - 1), abs=1e-9)


def grid_of(lengths, regular):
    """Grids longer than a block, no whole number of blocks."""
    rng = np.random.default_rng(3)
    if regular:
        return Grid([(0, 1)] * len(lengths), lengths, periodic=True)
    lines = [np.linspace(0, 1, n) for n in lengths]
    for line in lines:
        line[1:-1] += rng.uniform(-0.3, 0.3, line.size - 2) * line[1]
    return Grid.from_coordinates(*lines)


FAST = [("cubic", True, "transport"), ("adini", False, "transport")]
CASES = [
    pytest.param(*case, marks=[] if case in FAST else pytest.mark.slow)
    for case in product(("cubic", "adini", "bicubic"), (True, False), ("transport", "advection"))
]


@pytest.mark.parametrize(("profile", "regular", "form"), CASES)
def test_blocks_are_the_node_functions(profile, regular, form):
    """Uniform and periodic grids (`regular`), and such that are neither."""
    grid = grid_of((301,) if profile == "cubic" else (9, 150), regular)
    wall = None if regular else 0.0
    waves = ("0.6 + 0.5*cos(2*pi*x1)", "0.3 - sin(2*pi*x2)")
    field = waves if regular else ("1.1 - x1", "0.3 - x2")
    velocity = Velocity.from_expression(*field[: grid.dim])
    solver = Solver(grid, velocity, form, profile, boundary=wall)
    state = solver.state(0.0)
    state.data[...] = np.random.default_rng(5).uniform(-1, 1, state.data.shape)
    stage = solver._stages[0]
    feet = solver.feet(stage, 0.0, 0.21).data
    if profile == "cubic":
        feet[128:256] = feet[200]  # cells that follow each other, between blocks that have others
    if regular:
        feet[: grid.dim * grid.size] -= 2 * 301  # whole cells, several periods
    m = state.data.reshape(-1)
    new, expected = np.full_like(m, np.nan), np.full_like(m, np.nan)
    solver._kernels.launch(stage, m, new, feet)
    strides, ends = (grid.nodes[-1], 1)[-grid.dim :], map(int, grid.periodic)
    lines = [
        Line(h, 0, stride, n, end)
        for h, stride, n, end in zip(grid.widths, strides, grid.nodes, ends, strict=True)
    ]
    update = Update(grid.size, grid.dim, 0, int(form == "advection"))
    if profile == "cubic":
        run = loop_over(cpu_loops.run_line, node=line_kernels.node_cubic)
        run(0, grid.nodes[0], m, expected, feet, *lines, update, Limits())
    else:
        run = loop_over(cpu_loops.run_plane, node=getattr(plane_kernels, f"node_{profile}"))
        run(0, grid.nodes[0], m, expected, feet, *lines, update, Limits())
    assert np.isfinite(expected).all()
    # Multiply-adds may be fused in one and not in the other; second derivatives go with h^-2.
    scale = np.abs(expected).max()
    np.testing.assert_allclose(new, expected, rtol=0, atol=1e-13 * scale)
