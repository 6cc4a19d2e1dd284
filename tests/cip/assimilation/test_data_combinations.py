"""More reports than unknowns, as many, or fewer: always the analysis of dense matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import aslinearoperator

from cip import Covariance, Grid, Sensors, Solver, Velocity, four_d_var
from cip.assimilation.four_d_var import combined_analysis


def check_against_dense(reports, unknowns, seed, spread):
    """A problem of given singular values, whose mean and variances follow in closed form."""
    rng = np.random.default_rng(seed)
    rank = int(rng.integers(1, min(reports, unknowns) + 1)) if seed % 3 else min(reports, unknowns)
    sizes = 10.0 ** rng.uniform(-spread, spread, size=rank)
    left, _ = np.linalg.qr(rng.standard_normal((reports, rank)))
    right, _ = np.linalg.qr(rng.standard_normal((unknowns, rank)))
    A = aslinearoperator((left * sizes) @ right.T)
    b = rng.standard_normal(reports)
    mean = right @ (sizes / (1.0 + sizes**2) * (left.T @ b))
    known = (right**2) @ (1.0 / (1.0 + sizes**2))
    variances = known + np.maximum(1.0 - np.sum(right**2, axis=1), 0.0)
    all_of_them = combined_analysis(A, b, 1e-13, 500, reports, lambda *_: None)
    assert all_of_them.complete
    assert all_of_them.residual <= 1e-13
    # Rounding of the operator's own products, relative to the largest singular value.
    scale = np.abs(mean).max() * max(1.0, sizes.max())
    np.testing.assert_allclose(all_of_them.solution, mean, rtol=0, atol=1e-11 * scale)
    found = all_of_them.variances(np.ones(unknowns), all_of_them.directions)
    np.testing.assert_allclose(found, variances, rtol=1e-8, atol=1e-11)
    if rank == unknowns:  # nothing is left of the prior: small deviations are as accurate as large
        np.testing.assert_allclose(found, variances, rtol=1e-8)
    few = combined_analysis(A, b, 1e-10, 500, 0, lambda *_: None)
    assert few.residual <= 1e-10
    above = few.variances(np.ones(unknowns), few.directions) - variances
    assert above.min() > -1e-10
    if few.complete:
        assert above.max() < 1e-10


@settings(max_examples=60)
@given(st.integers(1, 60), st.integers(1, 60), st.integers(0, 2**31), st.sampled_from([0.0, 1.0]))
def test_any_shape(reports, unknowns, seed, spread):
    check_against_dense(reports, unknowns, seed, spread)


@pytest.mark.slow
@pytest.mark.parametrize("unknowns", range(1, 61))
def test_all_shapes(unknowns):
    for reports in range(1, 61):
        check_against_dense(
            reports, unknowns, 61 * reports + unknowns, [0.0, 1.0, 3.0][reports % 3]
        )


@pytest.mark.parametrize("deviation", [0.3, 1e-6])
@pytest.mark.parametrize(
    ("patterns", "points", "times"), [(1, 20, 1), (1, 1, 1), (2, 3, 1), (4, 5, 1), (4, 6, 3)]
)
def test_a_window_with_few_unknowns(patterns, points, times, deviation):
    """At whole numbers of periods a wave is where it was, so the reports are of the patterns."""
    grid = Grid((0, 1), 16, periodic=True)
    solver = Solver(grid, 1.0)
    shapes = [solver.state(f"cos({2 * k}*pi*x1) + 0.3*sin({2 * k}*pi*x1)") for k in range(patterns)]
    rng = np.random.default_rng(points)
    places, clock = rng.random(points), np.arange(times, dtype=float)
    values = rng.standard_normal((times, points))
    sensors = Sensors(places, clock, values, deviation)
    B = Covariance.patterns(shapes)
    found = four_d_var(solver, solver.state(0.0), B, sensors, dt=1.0, vectors=values.size, tol=1e-9)
    rows = sensors.rows(grid, "cubic")
    once = np.stack([rows @ one.data.ravel() for one in shapes], axis=1)
    A, b = np.tile(once, (times, 1)) / deviation, values.ravel() / deviation
    # Householder's QR of [A; 1] does not square the condition of A.
    _, R = np.linalg.qr(np.concatenate([A, np.eye(patterns)]))
    amplitudes, *_ = np.linalg.lstsq(
        np.concatenate([A, np.eye(patterns)]), np.append(b, np.zeros(patterns)), rcond=None
    )
    nodal = np.stack([one["u"] for one in shapes], axis=1)
    np.testing.assert_allclose(
        found.start["u"], nodal @ amplitudes, rtol=0, atol=1e-7 * np.abs(amplitudes).max()
    )
    spread = np.sqrt(np.sum((nodal @ np.linalg.inv(R)) ** 2, axis=1))
    np.testing.assert_allclose(found.deviations, spread, rtol=1e-7)
    assert found.complete


def test_one_unknown_parameter_and_many_reports():
    """One speed and one amplitude beside forty reports: more than one outer iteration."""
    grid = Grid((0, 1), 32, periodic=True)
    solver = Solver(grid, Velocity.from_expression("a", parameters={"a": 0.9}), profile="quintic")
    plan = Sensors(np.linspace(0, 0.95, 20), [0.2, 0.4], deviations=0.01)
    x, t = plan.points, plan.times[:, None]
    sensors = plan.with_values(1.3 * np.sin(2 * np.pi * (x - t)))
    B = Covariance.patterns([solver.state("sin(2*pi*x1)")])
    found = four_d_var(
        solver, solver.state("sin(2*pi*x1)"), B, sensors, dt=0.1, parameters={"a": 1.0}
    )
    assert found.complete
    assert found.parameters["a"] == pytest.approx(1.0, abs=1e-4)
    # Fisher's information of the speed: the sum of (t u_x)^2 over the reports, over their variance.
    slopes = 1.3 * 2 * np.pi * t * np.cos(2 * np.pi * (x - t))
    expected = 0.01 / np.sqrt(np.sum(slopes**2))
    assert found.parameter_deviations["a"] == pytest.approx(expected, rel=1e-2)
