"""Reactions between fields: closed forms, order in time, invariants, and bad input."""

import numpy as np
import pytest
from convergence import order
from schemes import made

from cip import Grid, InputError, NotConverged

SCHEMES = [
    ("cubic", 1, 1e-8), ("quintic", 1, 1e-8), ("csl2", 1, 1e-5), ("csl4", 1, 1e-7),
    ("bicubic", 2, 1e-8), ("adini", 2, 1e-8), ("csl4", 2, 1e-4), ("cubic", 3, 1e-8),
]  # fmt: skip
CHANGE = {"a": "-a*b", "b": "a*b"}


def box(dim, n=16):
    return Grid([(0, 1)] * dim, (n,) * dim, periodic=True)


@pytest.mark.parametrize(("profile", "dim", "tolerance"), SCHEMES)
def test_all_moments_follow_a_logistic_law(profile, dim, tolerance):
    """a' = -a b with a + b = s constant: a = s a0 E / (a0 E + s - a0), E = exp(-s t)."""
    solver = made(box(dim), ("0",) * dim, profile, reactions=CHANGE)
    wave = "*".join(f"(2 + sin(2*pi*x{q + 1}))" for q in range(dim))
    start = solver.state({"a": wave, "b": "1 + 0*x1"})
    end = solver.run(start, 0.5, dt=0.25).final
    E = f"exp(-0.5*({wave} + 1))"
    law = f"({wave} + 1)*({wave})*{E}/(({wave})*{E} + 1)"
    expected = solver.state({"a": law, "b": f"{wave} + 1 - {law}"})
    for f in range(2):
        for found, one in zip(end.data[f], expected.data[f], strict=True):
            assert np.abs(found - one).max() <= tolerance * np.abs(one).max()
    np.testing.assert_allclose(end.data.sum(axis=0), start.data.sum(axis=0), atol=1e-11)


@pytest.mark.parametrize("profile", ["bicubic", "csl4"])
def test_the_order_in_time_is_two(profile):
    """Advected: a = 2 + sin(2 pi (x - t/2)) falls by a rate that depends on the place."""
    grid, steps, errors = box(2, 48), [4, 8, 16], []
    rate = "1 + 0.5*cos(2*pi*x1)"
    solver = made(grid, ("0.5", "0"), profile, reactions={"a": f"-({rate})*a", "b": f"({rate})*a"})
    for count in steps:
        start = solver.state({"a": "2 + sin(2*pi*x1)*cos(2*pi*x2)", "b": 0.0})
        end = solver.run(start, 1.0, dt=1 / count).final
        x, y = grid.mesh()
        # The integral of the rate along the path that began at x - 1/2.
        lost = 1 + 0.5 * (np.sin(2 * np.pi * x) - np.sin(2 * np.pi * (x - 0.5))) / np.pi
        exact = (2 + np.sin(2 * np.pi * (x - 0.5)) * np.cos(2 * np.pi * y)) * np.exp(-lost)
        errors.append(np.abs(end["a"] - exact).max())
        total = sum(end.field(name).mass for name in "ab")
        assert total == pytest.approx(sum(start.field(name).mass for name in "ab"), rel=1e-12)
    assert 1.85 < order(steps, errors) < 2.2


def test_it_acts_with_sources_decay_and_diffusion():
    """In a field without gradients it is an ordinary differential equation."""
    solver = made(
        box(1), ("0.3",), "cubic", reactions={"a": "-2*a*c + t", "b": "2*a*c"}, decay={"b": 0.5},
        source={"b": 0.2}, diffusion={"a": 0.1},
    )  # fmt: skip
    start = solver.state({"a": 1.0, "b": 0.0, "c": 0.7})
    end = solver.run(start, 1.0, dt=0.01).final
    from scipy.integrate import solve_ivp

    def law(t, y):
        return [-1.4 * y[0] + t, 1.4 * y[0] + 0.2 - 0.5 * y[1]]

    exact = solve_ivp(law, (0, 1), [1.0, 0.0], rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose([end["a"][3], end["b"][3]], exact, rtol=1e-5)
    np.testing.assert_array_equal(end["c"], start["c"])


def test_a_run_back_undoes_them():
    solver = made(box(1), ("0.5",), "quintic", reactions=CHANGE)
    start = solver.state({"a": "2 + sin(2*pi*x1)", "b": 1.0})
    end = solver.run(start, 0.2, dt=0.05).final
    back = solver.run(end, 0.0, dt=-0.05).final
    np.testing.assert_allclose(back["a"], start["a"], atol=1e-4)


def test_refused():
    ring = box(1)
    for rates in (3, "a", {}, ["-a"]):
        with pytest.raises(InputError, match="reactions"):
            made(ring, ("1",), "cubic", reactions=rates)
    for rates, words in (
        ({"a": "-k*a"}, "'k' in"), ({"c": "-a"}, "'c' is no field"), ({"a": "open(a)"}, "no known"),
    ):  # fmt: skip
        solver = made(ring, ("1",), "cubic", reactions=rates)
        with pytest.raises(InputError, match=words):
            solver.step(solver.state({"a": 1.0, "b": 1.0}), 0.1)
    solver = made(ring, ("1",), "cubic", reactions=CHANGE)
    with pytest.raises(InputError, match="no field"):
        solver.step(solver.state(1.0), 0.1)
    with pytest.raises(InputError, match="'x'"):
        solver.state({"x": 1.0, "a": 1.0})
    blow = made(ring, ("1",), "cubic", reactions={"a": "a**2"})
    with pytest.raises(NotConverged, match="take a smaller dt"):
        blow.step(blow.state({"a": 5.0}), 1.0)
    root = made(ring, ("1",), "cubic", reactions={"a": "sqrt(a)"})
    with pytest.raises(NotConverged, match="not finite"):
        root.step(root.state({"a": -1.0}), 0.1)
