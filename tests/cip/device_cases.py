"""Solvers whose kernels the tests of the device's source compile."""

import numpy as np

from cip import Grid, Solver, Velocity

CASES = [
    ("linear", None, 1), ("piecewise_linear", None, 1), ("cubic", None, 1), ("cubic", "eno", 1),
    ("cubic", "clamp", 1), ("cubic", "rational", 1), ("quintic", None, 1), ("csl2", None, 1),
    ("csl2", "bounds", 1), ("csl2", "rational", 1), ("csl4", "bounds", 1), ("adini", None, 2),
    ("adini", "eno", 2), ("bicubic", None, 2), ("bicubic", "clamp", 2), ("bicubic", "eno", 2),
    ("cubic", None, 3), ("quintic", None, 2), ("csl2", None, 3), ("csl4", "bounds", 2),
]  # fmt: skip


def solver_of(profile, limiter=None, dim=1, dtype=np.float64, **more):
    shape = (24, 20, 16)[:dim]
    if limiter is None and profile in ("cubic", "adini", "bicubic") and dim < 3:
        shape = ((301,), (9, 150))[dim - 1]  # in the CPU's loops no whole number of blocks
    grid = Grid([(0, 1), (0, 1.5), (0, 2)][:dim], shape, periodic=True)
    if more.pop("uneven", False):
        lines = [np.append(line, end) for line, (_, end) in zip(grid.coordinates, grid.bounds)]  # noqa: B905
        lines = [line + 0.02 * np.sin(2 * np.pi * line / line[-1]) for line in lines]
        grid = Grid.from_coordinates(*lines, periodic=True)
    field = ["0.4 + 0.2*sin(2*pi*x1)", "0.3*cos(2*pi*x1) + 0.1*sin(pi*x3)", "0.2*sin(2*pi*x1)"]
    field[1] = field[1] if dim == 3 else "0.3*cos(2*pi*x1)"
    form = more.pop("form", "advection" if profile.startswith("csl") else "transport")
    return Solver(
        grid, Velocity.from_expression(*field[:dim]), form, profile, limiter, dtype=dtype,
        bounds=(-0.8, 1.2), **more,
    )  # fmt: skip


def field(*x):
    """A smooth periodic field that reaches both bounds."""
    return 0.2 + np.sin(2 * np.pi * x[0]) * np.cos(4 * np.pi * x[-1])
