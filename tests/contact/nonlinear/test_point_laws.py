"""Material laws against closed forms, their energies and invariance."""

import numpy as np
import pytest
from scipy.linalg import expm

from contact import (
    FinitePlasticity,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Plasticity,
    SaintVenant,
    Viscous,
)

TRELOAR = Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0), 10.0)
ELASTIC = [SaintVenant(2.0, 0.3), NeoHooke(1.0, 9.0), MooneyRivlin(0.3, 0.2, 10.0), TRELOAR]
METALS = [Plasticity(1000.0, 0.3, 1.0, 50.0), FinitePlasticity(1000.0, 0.3, 1.0, 50.0)]
NAMES = {"ids": lambda law: type(law).__name__}


def some(seed, size=0.3):
    return np.eye(3) + size * np.random.default_rng(seed).uniform(-1, 1, (3, 3))


def rotation(seed):
    A = np.random.default_rng(seed).standard_normal((3, 3))
    return expm(A - A.T)


def as_points(value):
    return np.asarray(value, dtype=float)


@pytest.mark.parametrize("law", ELASTIC, **NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_stress_is_the_derivative_of_the_energy(law, seed):
    F, way = some(seed), np.random.default_rng(seed + 10).standard_normal((3, 3))
    h = 1e-6
    slope = (law.energy(F + h * way) - law.energy(F - h * way)) / (2 * h)
    assert abs(slope - np.sum(law(F) * way)) <= 1e-8 * np.abs(law(F)).max()


@pytest.mark.parametrize("law", ELASTIC, **NAMES)
def test_stress_turns_with_the_body(law):
    F, Q = some(3), rotation(4)
    assert np.abs(law(Q @ F) - Q @ law(F)).max() <= 1e-13 * np.abs(law(F)).max()


@pytest.mark.parametrize("law", ELASTIC, **NAMES)
def test_small_strains_obey_hooke(law):
    e = 1e-6 * (some(5) + some(5).T - 2 * np.eye(3))
    if isinstance(law, SaintVenant):
        lam, mu = 2 * 0.3 / (1.3 * 0.4), 2 / 2.6
    elif isinstance(law, NeoHooke):
        lam, mu = law.lam, law.mu
    else:
        mu = 2 * (law.c1 + law.c2) if law is not TRELOAR else np.dot(law.mu, law.alpha) / 2
        lam = law.K - 2 * mu / 3
    hooke = lam * np.trace(e) * np.eye(3) + 2 * mu * e
    assert np.abs(law(np.eye(3) + e) - hooke).max() <= 1e-5 * np.abs(hooke).max()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    "stretches", [(1.0, 1.0, 1.0), (1.2, 1.2, 0.7), (1.3, 1.3 + 1e-9, 1.1)], ids=str
)
def test_ogden_of_two_and_four_is_mooney_rivlin(stretches, seed):
    """Its tangent too, where stretches are equal or nearly so."""
    ogden, mooney = Ogden((0.6, -0.4), (2.0, -2.0), 10.0), MooneyRivlin(0.3, 0.2, 10.0)
    F = rotation(seed) @ np.diag(stretches) @ rotation(seed + 5)
    assert np.abs(ogden(F) - mooney(F)).max() <= 1e-13
    assert abs(ogden.energy(F) - mooney.energy(F)) <= 1e-13
    way = np.random.default_rng(seed).standard_normal((3, 3))
    slopes = [np.imag(law(F + 1e-30j * way)) * 1e30 for law in (ogden, mooney)]
    assert np.abs(slopes[0] - slopes[1]).max() <= 1e-13 * np.abs(slopes[1]).max()


def test_ogden_of_what_is_no_number_is_none():
    F = np.stack([np.eye(3), np.full((3, 3), np.nan), np.diag([1.0, 1.0, np.inf])], axis=-1)
    with np.errstate(invalid="ignore"):
        P = Ogden(0.6, 2.0, 10.0)(F)
    assert np.abs(P[..., 0]).max() <= 1e-15
    assert np.isnan(P[..., 1]).all()
    assert not np.isfinite(P[..., 2]).any()


@pytest.mark.parametrize("law", [*METALS], **NAMES)
def test_shear_yields_at_the_stress_over_root_three(law):
    state = {name: as_points(v) for name, v in law.state.items()}
    F = np.eye(3)
    mu = 1000.0 / 2.6
    for gamma in np.linspace(0.0, 0.01, 21)[1:]:
        F[0, 1] = gamma
        P, state = law(F, state, 1.0)
    # Shear stress k + h gamma_p, by hand; G of the trial, H / 3 of shear.
    k, h = 1 / 3**0.5, 50.0 / 3
    expected = k + h * (0.01 - k / mu) * mu / (mu + h)
    assert abs((P @ F.T)[0, 1] - expected) <= 2e-4 * expected


@pytest.mark.parametrize("law", METALS, **NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_stresses_stay_on_the_yield_surface(law, seed):
    state = {name: as_points(v) for name, v in law.state.items()}
    way, alpha = some(seed) - np.eye(3), 0.0
    for s in np.linspace(0.0, 0.3, 7)[1:]:
        F = np.eye(3) + s * way
        P, state = law(F, state, 1.0)
        tau = P @ F.T if isinstance(law, FinitePlasticity) else P
        dev = tau - np.trace(tau) / 3 * np.eye(3)
        bound = (2 / 3) ** 0.5 * (1.0 + 50.0 * state["alpha"])
        assert np.linalg.norm(dev) <= bound * (1 + 1e-10)
        assert state["alpha"] >= alpha
        alpha = state["alpha"]
    assert alpha > 0.01
    if isinstance(law, Plasticity):
        assert abs(np.trace(state["ep"])) <= 1e-14
    else:
        assert abs(np.linalg.det(state["Cp"]) - 1) <= 0.02  # the scheme keeps it to second order


def test_finite_plasticity_turns_with_the_body():
    law, F, Q = METALS[1], some(6), rotation(7)
    state = {name: as_points(v) for name, v in law.state.items()}
    P, new = law(F, state, 1.0)
    turned, same = law(Q @ F, state, 1.0)
    assert np.abs(turned - Q @ P).max() <= 1e-12 * np.abs(P).max()
    assert np.abs(same["Cp"] - new["Cp"]).max() <= 1e-13


def test_finite_plasticity_agrees_with_that_of_small_strains():
    e = 3e-3 * (some(8) + some(8).T - 2 * np.eye(3))
    P = [law(np.eye(3) + e, law.state, 1.0)[0] for law in METALS]
    assert np.abs(P[0] - P[1]).max() <= 2e-2 * np.abs(P[0]).max()


@pytest.mark.parametrize("dt", [0.01, 0.3, 5.0])
def test_held_stretch_relaxes_exponentially(dt):
    elastic, g, tau = NeoHooke(1.0, 9.0), 0.4, 2.0
    law, F = Viscous(elastic, g, tau), np.diag([1.3, 0.9, 0.9])
    state = {name: as_points(v) for name, v in law.state.items()}
    P, state = law(F, state, 0.0)  # at once
    assert np.abs(P - elastic(F)).max() <= 1e-14
    for k in range(1, 6):
        P, state = law(F, state, dt)
        expected = (1 - g + g * np.exp(-k * dt / tau)) * elastic(F)
        assert np.abs(P - expected).max() <= 1e-13


def test_a_ramp_is_integrated_exactly_whatever_the_steps():
    law, tau = Viscous(SaintVenant(1.0, 0.0), 0.5, 1.0), 1.0
    found = []
    for n in (1, 7):
        state = {name: as_points(v) for name, v in law.state.items()}
        for s in np.linspace(0, 1, n + 1)[1:]:
            F = np.diag([np.sqrt(1 + 2 * s), 1.0, 1.0])  # Green strain s, stress E s
            P, state = law(F, state, 1.0 / n)
        found.append(P[0, 0] / F[0, 0])
    expected = 0.5 + 0.5 * tau * (1 - np.exp(-1.0))
    assert np.allclose(found, expected, rtol=1e-13)
