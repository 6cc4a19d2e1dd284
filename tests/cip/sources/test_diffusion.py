"""Diffusion of all moments: closed forms, order in time, mass, bounds and derivatives."""

import numpy as np
import pytest
from convergence import order
from schemes import made

from cip import Grid, InputError, NotSupported, Solver

SCHEMES = [
    ("cubic", 1, 2e-4), ("quintic", 1, 3e-7), ("csl2", 1, 2e-4), ("csl4", 1, 3e-7),
    ("adini", 2, 2e-3), ("bicubic", 2, 1e-3), ("csl4", 2, 5e-6), ("csl2", 3, 8e-3),
]  # fmt: skip
KAPPA = 0.004


@pytest.mark.parametrize(("profile", "dim", "tolerance"), SCHEMES)
def test_waves_decay_on_their_way(profile, dim, tolerance):
    """With a constant velocity transport and diffusion commute: no error in time."""
    grid = Grid([(0, 1)] * dim, (32,) * dim, periodic=True)
    solver = made(grid, ("0.7", "-0.4", "0.3")[:dim], profile, diffusion=KAPPA)
    lengths = (1, 2, 1)[:dim]
    rate = KAPPA * sum((2 * np.pi * n) ** 2 for n in lengths)

    def wave(t):
        parts = [
            f"sin(2*pi*{n}*(x{q + 1} - {c * t!r}))"
            for q, (n, c) in enumerate(zip(lengths, (0.7, -0.4, 0.3), strict=False))
        ]
        return solver.state(f"{np.exp(-rate * t)!r}*" + "*".join(parts))

    end, expected = solver.run(wave(0.0), 0.5, dt=0.1).final, wave(0.5)
    for found, one in zip(end.data, expected.data, strict=True):
        assert np.abs(found - one).max() <= tolerance * np.abs(one).max()
    assert abs(end.mass) < 1e-15


@pytest.mark.parametrize("profile", ["cubic", "quintic", "csl2", "csl4"])
@pytest.mark.parametrize("length", [0.01, 100.0])
def test_nothing_diffuses_through_walls(profile, length):
    solver = made(Grid((0, 2), 24), ("0",), profile, diffusion=0.3)

    def wave(t):
        return solver.state(f"1 + {np.exp(-0.3 * (1.5 * np.pi) ** 2 * t)!r}*cos(1.5*pi*x1)")

    end = solver.step(wave(0.0), length)
    np.testing.assert_allclose(end.data, wave(length).data, rtol=0, atol=1e-11)
    assert end.mass == pytest.approx(2.0, abs=1e-14)


@pytest.mark.parametrize("profile", ["bicubic", "csl4"])
def test_the_order_in_time_is_two(profile):
    """In a shear flow u = sin(2 pi x) cos(2 pi y) cos t solves the equation with a source."""
    grid = Grid([(0, 1)] * 2, (64, 64), periodic=True)
    X, Y = "2*pi*x1", "2*pi*x2"
    source = (
        f"-sin({X})*cos({Y})*sin(t) + 2*pi*0.5*sin({Y})*cos({X})*cos({Y})*cos(t)"
        f" + 0.02*8*pi**2*sin({X})*cos({Y})*cos(t)"
    )
    solver = made(grid, (f"0.5*sin({Y})", "0"), profile, diffusion=0.02, source=source)
    steps, errors = [4, 8, 16], []
    for count in steps:
        end = solver.run(solver.state(f"sin({X})*cos({Y})"), 1.0, dt=1 / count).final
        expected = solver.state(f"sin({X})*cos({Y})*{np.cos(1.0)!r}")
        errors.append(np.abs(end["u"] - expected["u"]).max())
    assert 1.85 < order(steps, errors) < 2.2


@pytest.mark.parametrize("number", [1e-3, 0.3, 40.0])
def test_with_a_limiter_no_value_leaves_the_range(number):
    grid = Grid([(0, 1)] * 2, (20, 16), periodic=(True, False))
    kappa = number / 20**2
    options = {"limiter": "bounds", "bounds": (0.0, 1.0), "boundary": 0.0}
    solver = made(grid, ("1", "0"), "csl2", diffusion=kappa, **options)
    start = solver.state(lambda x, y: 1.0 * ((abs(x - 0.5) < 0.2) & (abs(y - 0.4) < 0.2)))
    run = solver.run(start, 1.0, dt=0.1)
    for moment in run.final.data:
        assert -1e-14 < moment.min() <= moment.max() < 1 + 1e-14
    assert run.final.mass == pytest.approx(start.mass, rel=1e-13)


@pytest.mark.parametrize(
    ("grid", "profile"),
    [
        (Grid([(0, 1)] * 2, (9, 8), periodic=(True, False)), "bicubic"),
        (Grid([(0, 1)] * 2, (8, 7), periodic=(False, True)), "csl4"),
        (Grid((0, 1), 9), "quintic"),
        (Grid((0, 1), 9), "csl4"),
    ],
)
def test_tangent_and_adjoint(grid, profile):
    flow = ("0.3*sin(2*pi*x1)*cos(t)", "0.2*sin(2*pi*x2)")[: grid.dim]
    solver = made(grid, flow, profile, diffusion=0.02, boundary=0.0, decay="0.3 + 0.2*x1")
    rng = np.random.default_rng(0)
    start = solver.state("0.5 + 0.1*cos(pi*x1)")
    run = solver.run(start, 0.2, dt=0.1)
    tangent, adjoint = solver.tangent(run), solver.adjoint(run)
    v, w = rng.standard_normal((2, start.data.size))
    ahead = tangent @ v
    assert w @ ahead == pytest.approx(v @ (adjoint @ w), rel=1e-11)
    np.testing.assert_allclose(tangent @ start.data.ravel(), run.final.data.ravel(), atol=1e-12)


def test_refused():
    line = Grid((0, 1), 8, periodic=True)
    bent = Grid.from_coordinates(np.linspace(0, 1, 9) ** 2)
    with pytest.raises(NotSupported, match="not uniform in x"):
        Solver(bent, 0.0, diffusion=0.1)
    solver = Solver(line, 1.0, diffusion=0.1)
    with pytest.raises(InputError, match="cannot be undone"):
        solver.step(solver.state(0.0, t=1.0), -0.1)
