"""Covariances: variances, correlations beside closed forms, gradients that belong to values."""

import numpy as np
import pytest

from cip import Covariance, Grid, State

UNEVEN = np.linspace(0, 1, 41) + 0.004 * np.sin(2 * np.pi * np.linspace(0, 1, 41))
GRIDS = {
    "ring": Grid((0, 2), 48, periodic=True),
    "line": Grid((0, 1), 30),
    "uneven": Grid.from_coordinates(UNEVEN),
    "plane": Grid([(0, 1), (0, 3)], (12, 15), periodic=(True, False)),
    "space": Grid([(0, 1)] * 3, (6, 5, 7), periodic=(True, False, True)),
}


def dense(B):
    S = B.root @ np.eye(B.root.shape[1])
    return S @ S.T


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("profile", ["cubic", "quintic", "csl2", "csl4"])
def test_variances_transposes_and_moments(name, profile):
    """Variances are exact; the moments of an error are those of the state with its values."""
    grid = GRIDS[name]
    wanted = 0.5 + np.random.default_rng(1).random(grid.nodes)
    B = Covariance.diffusion(grid, profile, wanted, 0.2)
    S = B.root @ np.eye(B.root.shape[1])
    found = np.sum(S[: grid.size] ** 2, axis=1)
    np.testing.assert_allclose(found, wanted.ravel() ** 2, rtol=1e-12)
    transposed = B.root.rmatmat(np.eye(B.root.shape[0]))
    np.testing.assert_allclose(transposed.T, S, rtol=0, atol=1e-12 * np.abs(S).max())
    error = Covariance.diffusion(grid, profile, 0.7, 0.4).draw(seed=2, t=1.5)
    again = State.from_function(np.array(error["u"]), grid, profile)
    scale = np.abs(again.data).reshape(len(again.data), -1).max(axis=1)
    gap = np.abs(again.data - error.data).reshape(len(again.data), -1).max(axis=1)
    assert np.all(gap < 1e-10 * scale)
    assert error.t == 1.5


@pytest.mark.sampled(3)
@pytest.mark.parametrize("order", [2, 3, 6])
def test_correlations_on_the_line_beside_the_closed_form(order):
    """That of (1 - kappa d^2)^-M on the infinite line: polynomials times exponentials."""
    grid = Grid((0, 40), 800, periodic=True)
    length = 1.0
    s = np.sqrt((2 * order - 3) / length**2) * np.minimum(
        grid.coordinates[0], 40 - grid.coordinates[0]
    )
    polynomial = {2: 1 + s, 3: 1 + s + s**2 / 3}
    if order == 6:  # Guttorp and Gneiting (2006): half-integer Matern 11/2
        polynomial[6] = 1 + s + 4 / 9 * s**2 + s**3 / 9 + s**4 / 63 + s**5 / 945
    exact = polynomial[order] * np.exp(-s)
    B = Covariance.diffusion(grid, "cubic", 1.0, length, order)
    unit = np.zeros(1600)
    unit[0] = 1.0
    found = (B.root @ B.root.rmatvec(unit))[:800]
    # Finite volumes of second order: h / length = 1/20.
    assert np.max(np.abs(found - exact)) < 0.02
    # Daley's length: the curvature at 0 of the correlation.
    if order == 6:
        h = grid.spacing[0]
        curvature = (2 * found[0] - found[1] - found[-1]) / h**2
        assert curvature == pytest.approx(1 / length**2, rel=0.02)


def test_correlations_have_the_same_length_in_every_direction():
    grid = Grid([(0, 20), (0, 20)], (200, 200), periodic=True)
    B = Covariance.diffusion(grid, "adini", 1.0, 1.0)
    unit = np.zeros(3 * grid.size)
    unit[0] = 1.0
    row = (B.root @ B.root.rmatvec(unit))[: grid.size].reshape(200, 200)
    assert row[7, 0] == pytest.approx(row[0, 7], rel=1e-10)
    assert row[5, 5] == pytest.approx(row[7, 1], rel=5e-3)  # at the distance sqrt(50) h
    h = 0.1
    laplacian = (row[1, 0] + row[-1, 0] + row[0, 1] + row[0, -1] - 4) / h**2
    assert -2 / laplacian == pytest.approx(1.0, rel=0.03)


def test_patterns():
    grid = GRIDS["plane"]
    states = [State.from_function(f, grid, "adini") for f in ("x1*0 + 1", "x2", "cos(x2)")]
    B = Covariance.patterns(states, [1.0, 2.0, 0.5])
    columns = np.stack([s.data.ravel() for s in states], axis=1)
    expected = columns @ np.diag([1.0, 4.0, 0.25]) @ columns.T
    np.testing.assert_allclose(dense(B), expected, rtol=1e-13, atol=1e-13)
    variance = np.diag(expected)[: grid.size]
    np.testing.assert_allclose(B.deviations.ravel() ** 2, variance, rtol=1e-13)
