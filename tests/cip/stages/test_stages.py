"""Planes and space: both examples of King (2012), section 3.3, exact flows, walls, sweeps."""

from itertools import product

import numpy as np
import pytest
from example_scripts import load
from scipy import ndimage

from cip import Grid, Solver, Velocity


def bell(x, y):
    return np.exp(-10 * (x**2 + y**2))


def blade(x, y, t):
    return bell(x * np.cosh(t) - y * np.sinh(t), y * np.cosh(t) - x * np.sinh(t))


@pytest.mark.parametrize(
    ("profile", "limit"), [("bicubic", 6e-4), ("adini", 2.3e-3), ("cubic", 1.1e-3)]
)
def test_example_1(profile, limit):
    """h = dt = .04 to t = 1.2; the dissertation's slice has .0035."""
    grid = Grid([(-2, 2)] * 2, (100, 100))
    solver = Solver(grid, Velocity.from_expression("x2", "x1"), profile=profile, boundary=0.0)
    final = solver.run(solver.state(bell), 1.2, dt=0.04).final["u"]
    error = final - blade(*grid.mesh(), 1.2)
    assert 0.04 * np.sqrt(np.sum(error**2)) <= limit


@pytest.mark.parametrize(
    ("profile", "limit"), [("adini", 0.008), pytest.param("bicubic", 0.005, marks=pytest.mark.slow)]
)
def test_example_2(profile, limit):
    """Four revolutions in steps of 2 pi / 200; the edge of the disk is a tanh of width .16."""

    def disk(x, y):
        def edge(s):
            return (1 + np.tanh(s / 0.16)) / 2

        radius = np.sqrt(x**2 + y**2 + 1e-30)
        slot = edge(0.25 - np.sqrt(x**2 + 1e-30)) * edge(0.8 + y)
        return edge(1.4 - radius) * (1 - slot)

    grid = Grid([(-2, 2)] * 2, (100, 100))
    solver = Solver(grid, Velocity.from_expression("x2", "-x1"), profile=profile, boundary=0.0)
    start = solver.state(disk)
    final = solver.run(start, 8 * np.pi, dt=2 * np.pi / 200).final["u"]
    assert grid.coordinates[0][29] == pytest.approx(-0.84)
    error = (final - start["u"])[29]
    assert np.sqrt(0.04 * np.sum(error**2)) <= limit


@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_cubics_are_reproduced_with_their_derivatives(profile):
    """One step of a linear flow maps cubics to cubics: exact for a profile that holds them."""
    rng = np.random.default_rng(4)
    powers = [(i, j) for i in range(4) for j in range(4 - i)]
    weights = rng.uniform(-1, 1, len(powers))

    def cubic(x, y):
        return sum(w * x**i * y**j for w, (i, j) in zip(weights, powers, strict=True))

    grid = Grid([(-1, 1), (-1, 1.5)], (8, 10))
    velocity = Velocity.from_expression("0.3*x1 + 0.2*x2", "0.4*x2 - 0.1*x1")
    solver = Solver(grid, velocity, profile=profile, boundary={})
    dt = 0.25
    A = np.array([[0.3, 0.2], [-0.1, 0.4]])
    values, vectors = np.linalg.eig(-A * dt)
    back = (vectors @ np.diag(np.exp(values)) @ np.linalg.inv(vectors)).real
    after = solver.step(solver.state(cubic), dt)
    x, y = grid.mesh()

    def moved(x, y):
        return cubic(back[0, 0] * x + back[0, 1] * y, back[1, 0] * x + back[1, 1] * y)

    expected = solver.state(moved)
    for name in expected.names:
        np.testing.assert_allclose(after[name], expected[name], atol=2e-9)
    assert x.shape == y.shape == after["u"].shape


@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_constants_and_uniform_flow(profile):
    grid = Grid([(0, 1), (0, 2)], (12, 10), periodic=True)
    solver = Solver(grid, Velocity.from_expression("sin(2*pi*x2)", "cos(2*pi*x1)"), profile=profile)
    final = solver.run(solver.state(3.7), 1.0, dt=0.13).final
    np.testing.assert_allclose(final["u"], 3.7, rtol=1e-14)
    np.testing.assert_allclose(final.data[1:], 0, atol=1e-12)
    whole = Solver(grid, Velocity.from_expression("3/12", "4/10"), profile=profile)
    start = whole.state(lambda x, y: np.sin(2 * np.pi * x) * np.cos(np.pi * y))
    moved = whole.step(start, 1.0)["u"]  # three and two cells
    np.testing.assert_allclose(moved, np.roll(start["u"], (3, 2), (0, 1)), atol=1e-13)


def test_determinant_of_the_flow_map():
    """E and E_x against central differences of the displacements, an O(h^4) oracle."""
    n, h = 48, 1 / 48
    grid = Grid([(0, 1)] * 2, (n, n), periodic=True)
    velocity = Velocity.from_expression("0.3 + 0.2*sin(2*pi*x1)*cos(2*pi*x2)", "0.1*sin(2*pi*x1)")
    solver = Solver(grid, velocity, "advection", "adini")
    feet = solver.feet(solver._stages[0], 0.0, 0.4).data.reshape(9, n, n)

    def slope(f, axis):
        near, far = (np.roll(f, -q, axis) - np.roll(f, q, axis) for q in (1, 2))
        return 2 / 3 * near - far / 12

    # Displacements count cells, so their differences are derivatives.
    Xx, Xy = 1 + slope(feet[0], 0), slope(feet[0], 1)
    Yx, Yy = slope(feet[1], 0), 1 + slope(feet[1], 1)
    np.testing.assert_allclose(feet[6], Xx * Yy - Xy * Yx, atol=5e-3)
    np.testing.assert_allclose(feet[7], slope(feet[6], 0) / h, atol=0.05)
    np.testing.assert_allclose(feet[8], slope(feet[6], 1) / h, atol=0.05)
    assert np.ptp(feet[6]) > 0.3


@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_uniform_flow_needs_data_only_where_it_comes_in(profile):
    """Cubics are carried exactly, in all eight directions: walls may be followed, corners met."""
    for a, b in product((-1, 0, 1), repeat=2):
        if a == b == 0:
            continue

        def field(x, y, t, a=a, b=b):
            x, y = x - 0.7 * a * t, y - 0.6 * b * t
            return x**2 * y - y**3 + 2 * x * y - 1

        into = {"x-": a > 0, "x+": a < 0, "y-": b > 0, "y+": b < 0}
        data = {wall: field for wall, comes_in in into.items() if comes_in}
        grid = Grid([(0, 1), (0, 2)], (8, 8))
        solver = Solver(grid, [0.7 * a, 0.6 * b], profile=profile, boundary=data)
        state = solver.state(lambda x, y, field=field: field(x, y, 0.0))
        for dt in (0.05, 0.4):
            state = solver.step(state, dt)
        expected = solver.state(lambda x, y, field=field, t=state.t: field(x, y, t))
        np.testing.assert_allclose(state.data, expected.data, atol=1e-12)


@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_turning_flow_leaves_through_its_corner(profile):
    """x' = 1 + x, y' = -y: in at x-, along y- where y = 0, in at y+; exact to the profile."""

    def field(x, y, t):
        return np.log(1 + x) - t + (y * np.exp(t)) ** 2

    errors = []
    for n in (8, 16, 32):
        grid = Grid((0, 1), (n, n))
        solver = Solver(
            grid, Velocity.from_expression("1 + x1", "-x2"), profile=profile,
            boundary={"x-": field, "y+": field},
        )  # fmt: skip
        run = solver.run(solver.state(lambda x, y: field(x, y, 0.0)), 0.5, dt=1 / n)
        errors.append(np.abs(run.final["u"] - field(*grid.mesh(), 0.5)).max())
    assert errors[-1] < 1e-5
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > 2.5)


# Sweeps in space, and the deformation flow of LeVeque (1996).


DEFORMATION = (
    "2*sin(pi*x1)**2*sin(2*pi*x2)*sin(2*pi*x3)*cos(pi*t/3)",
    "-sin(2*pi*x1)*sin(pi*x2)**2*sin(2*pi*x3)*cos(pi*t/3)",
    "-sin(2*pi*x1)*sin(2*pi*x2)*sin(pi*x3)**2*cos(pi*t/3)",
)


def test_mass_and_positivity():
    grid = Grid((0, 1), (12, 10, 11), periodic=True)
    solver = Solver(
        grid,
        Velocity.from_expression("0.5+0.3*sin(2*pi*x2)", "0.4*cos(2*pi*x3)", "sin(2*pi*x1)/3"),
        "advection", "csl2", "bounds", "strang",
    )  # fmt: skip
    start = solver.state(lambda x, y, z: np.exp(-30 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)) + 0 * z)
    run = solver.run(start, 1.0, dt=0.21, snapshots=3)
    np.testing.assert_allclose(run.diagnostics.mass, start.mass, rtol=1e-13)
    for state in run.states:
        assert min(state[name].min() for name in state.names) >= -1e-13


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", ["linear", pytest.param("cubic", marks=pytest.mark.slow)])
def test_constants(profile):
    flow, grid = Velocity.from_expression(*DEFORMATION), Grid((0, 1), (8, 8, 8), periodic=True)
    solver = Solver(grid, flow, profile=profile)
    final = solver.run(solver.state(2.5), 0.4, dt=0.13).final
    np.testing.assert_allclose(final["u"], 2.5, rtol=1e-14)


@pytest.mark.slow
def test_deformation_flow_beside_splines():
    """N = 64, back at its start after 60 steps: means win in every norm, values in L1 and L2."""
    example = load("cip_deformation")
    run = example.simulate(64, 60, "csl4")
    start, end = run[0], run.final
    np.testing.assert_allclose(run.diagnostics.mass, start.mass, rtol=1e-13)
    begin, u = example.splines(64, 60)
    other = example.norms(example.means(u), example.means(begin))
    found = example.norms(end["mean"], start["mean"])
    assert found[0] <= 0.4 * other[0]
    assert found[1] <= 0.55 * other[1]
    assert found[2] <= 0.85 * other[2]
    other = example.norms(u, begin)
    found = example.norms(end["u"], start["u"])
    assert found[0] <= 0.55 * other[0]
    assert found[1] <= 0.72 * other[1]
    assert found[2] <= 1.3 * other[2]


def test_peer_of_the_deformation_flow():
    """The splines' means against quadrature of SciPy's interpolant, their velocity against ours."""
    example = load("cip_deformation")
    u = np.random.default_rng(8).random((6, 7, 5))
    x, w = np.polynomial.legendre.leggauss(4)
    places = np.meshgrid(*(np.add.outer(np.arange(n), (1 + x) / 2).ravel() for n in u.shape),
                         indexing="ij")  # fmt: skip
    fine = ndimage.map_coordinates(u, places, order=3, mode="grid-wrap")
    fine = fine.reshape(6, 4, 7, 4, 5, 4)
    expected = np.einsum("iajbkc,a,b,c->ijk", fine, w / 2, w / 2, w / 2)
    np.testing.assert_allclose(example.means(u), expected, atol=1e-13)
    points = np.random.default_rng(9).random((3, 10))
    formulas = Velocity.from_expression(*DEFORMATION).on(Grid((0, 1), (4, 4, 4)))
    ours = [f.derivative((0, 0, 0, 0), (1.0,) * 4)(*points, 0.7) for f in formulas]
    np.testing.assert_allclose(example.speed(points, 0.7), ours, atol=1e-14)
