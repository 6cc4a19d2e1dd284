"""The examples of programs, spectra and regulators show what they say, and draw it."""

import numpy as np
import pytest
from example_scripts import load


def test_penalties_tend_to_multipliers(tmp_path):
    betas, errors, exact = load("qp_penalty").main(tmp_path)
    # Ten times the penalty, a tenth of the error: in x and in both multipliers.
    np.testing.assert_allclose(errors[3:] / errors[2:-1], 0.1, rtol=0.02)
    assert betas[-1] * errors[-1].max() < 1.0
    assert (exact.z > 0).sum() > 10
    assert (tmp_path / "qp_penalty.png").stat().st_size > 10_000


def test_sqp_finds_the_published_solution(tmp_path):
    sqp = load("qp_sqp")
    x, last, lengths = sqp.main(["--output", str(tmp_path)])
    assert (tmp_path / "qp_sqp.png").stat().st_size > 10_000
    # First-order conditions of the nonlinear program itself, by central differences.
    h, unit = 1e-6, np.eye(4)

    def lagrangian(x):
        e, c = sqp.equality(x)[0], sqp.inequality(x)[0]
        return sqp.objective(x)[0] + last.y[0] * e - last.z[0] * c

    slope = [(lagrangian(x + h * d) - lagrangian(x - h * d)) / (2 * h) for d in unit]
    np.testing.assert_allclose(slope + last.z_box, 0.0, atol=1e-7)
    assert last.z[0] > 0
    # Superlinear: the last step before the end squares the one before, nearly.
    assert lengths[-2] < 1e-2 * lengths[-3]


@pytest.mark.filterwarnings("ignore:The default value of raise_error")
def test_predictive_control_keeps_its_bounds_and_agrees_with_osqp(tmp_path):
    shown = load("qp_mpc").main(tmp_path)
    assert shown["gaps"].max() < 1e-3
    warm, cold = shown["counts"].mean(axis=0)
    assert warm < 0.5 * cold
    # Both kinds of bounds are met: full force at first, then full speed.
    assert shown["forces"].min() == -1.0
    assert shown["path"][:, 1].min() == pytest.approx(-0.6, abs=1e-9)
    assert (tmp_path / "qp_mpc.png").stat().st_size > 10_000


def test_spectrum(tmp_path):
    shown = load("eigs_spectrum").main(["--order", "150", "--output", str(tmp_path)])
    assert shown["residual"] < 1e-9
    assert shown["distance to LAPACK's"] < 1e-9
    # A larger space needs fewer products.
    assert shown["products, ncv = 60"] < shown["products, ncv = 25"]
    assert (tmp_path / "eigs_spectrum.png").stat().st_size > 10_000
