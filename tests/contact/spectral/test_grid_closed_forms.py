"""Contact of the periodic half space beside closed forms."""

import numpy as np
import pytest

from contact import GridContact, HalfSpace, Parabola, Rigid, Status

E, NU = 1.0, 0.3
E_STAR = E / (1 - NU**2)
HEIGHT = 1e-3  # amplitude of the waves, whose length is one
FULL = np.pi * E_STAR * HEIGHT  # mean pressure of full contact


def wave(n, mean, friction=0.0, nu=NU, shear=None, height=HEIGHT):
    """A sinusoid under a mean pressure, with a shear force as well; the space has the same E*."""
    x = (np.arange(n) + 0.25) / n  # no point on the crest
    space = HalfSpace(1.0, n, E_STAR * (1 - nu**2), nu)
    ground = Rigid(height * (1 - np.cos(2 * np.pi * x)), force=(shear or 0.0, mean))
    return x, GridContact(space, ground, friction).solve()


def westergaard(x, mean):
    psi, edge = np.pi * (x - np.round(x)), np.sqrt(mean / FULL)
    inside = np.maximum(edge**2 - np.sin(psi) ** 2, 0.0)
    return 2 * mean * np.cos(psi) / edge**2 * np.sqrt(inside)


def test_full_contact():
    """p = mean + p* cos(2 pi x): the transform has it exactly."""
    x, result = wave(64, 1.2 * FULL)
    wanted = 1.2 * FULL + FULL * np.cos(2 * np.pi * x)
    assert result.pressure == pytest.approx(wanted, rel=1e-9)
    assert result.area == pytest.approx(1.0)
    assert max(result.kkt.values()) < 1e-10


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_partial_contact(share):
    """Westergaard (1939): the error falls with the order 3/2 of the root at the edge."""
    errors = []
    for n in (64, 128, 256, 512, 1024):
        x, result = wave(n, share * FULL)
        error = result.pressure - westergaard(x, share * FULL)
        errors.append(np.sqrt(np.mean(error**2)) / FULL)
    rate = -np.polyfit(np.log2([64, 128, 256, 512, 1024]), np.log2(errors), 1)[0]
    assert 0.7 < rate < 1.8
    assert errors[0] < 8e-3
    length = 2 / np.pi * np.arcsin(np.sqrt(share))
    assert result.area == pytest.approx(length, abs=2 / 1024)
    assert result.perimeter == 2


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_mean_gap(share):
    """At 64 points a wave, within 1e-3 of its height, from the closed form's own displacement.

    Johnson, section 13.2: the pressure determines the displacement; here by a fine sum of waves.
    """
    _, result = wave(64, share * FULL)
    n = 2**14
    x = np.arange(n) / n
    p = np.fft.rfft(westergaard(x, share * FULL))
    k = 2 * np.pi * np.arange(p.size)
    u = np.fft.irfft(np.where(k > 0, 2 / (E_STAR * np.maximum(k, 1)), 0.0) * p, n)
    gap = HEIGHT * (1 - np.cos(2 * np.pi * x)) + u
    assert result.opening.mean() == pytest.approx((gap - gap[0]).mean(), abs=1e-3 * HEIGHT)


@pytest.mark.parametrize(("shear", "normal"), [(0.2, 0.5), (0.35, 0.5), (0.5, 1.4)])
def test_partial_slip_of_a_plane_contact(shear, normal):
    """Ciavarella (1998), Jaeger (1998): the shear is F (p(P) - p(P - Q / F)), on any grid.

    Without coupling, nu = 1/2, both pressures being those of frictionless contact.
    """
    F, nu = 0.8, 0.5 - 1e-13
    mean = normal * FULL
    _x, result = wave(96, mean, F, nu, shear=shear * mean)
    _, whole = wave(96, mean, 0.0, nu)
    _, core = wave(96, mean * (1 - shear / F), 0.0, nu)
    wanted = F * (whole.pressure - core.pressure)
    assert result.pressure == pytest.approx(whole.pressure, abs=1e-9 * FULL)
    # The force drags the obstacle along x, and the obstacle the body.
    assert result.shear[0] == pytest.approx(wanted, abs=1e-8 * FULL)
    stick = result.status == Status.STICK
    assert np.array_equal(stick, core.pressure > 0)
    assert result.resultant == pytest.approx((shear * mean, mean), rel=1e-9)


def test_two_waves_full_contact():
    """Johnson, Greenwood and Higginson (1985): p* = sqrt(2) pi E* h / wavelength."""
    n = 48
    x = np.arange(n) / n
    product = np.cos(2 * np.pi * x)[:, None] * np.cos(2 * np.pi * x)
    top = np.sqrt(2) * FULL
    ground = Rigid(HEIGHT * (1 - product), force=(0.0, 0.0, 1.1 * top))
    result = GridContact(HalfSpace((1.0, 1.0), (n, n), E, NU), ground).solve()
    assert result.pressure == pytest.approx(1.1 * top + top * product, rel=1e-9)


def test_two_waves_light_contact():
    """Hertz at each of the two crests of a period."""
    n, top = 192, np.sqrt(2) * FULL
    x = (np.arange(n) + 0.3) / n
    product = np.cos(2 * np.pi * x)[:, None] * np.cos(2 * np.pi * x)
    force, radius = 0.004 * top, 1 / (4 * np.pi**2 * HEIGHT)
    ground = Rigid(HEIGHT * (1 - product), force=(0.0, 0.0, force))
    result = GridContact(HalfSpace((1.0, 1.0), (n, n), E, NU), ground).solve()
    a = (0.75 * 0.5 * force * radius / E_STAR) ** (1 / 3)
    assert result.pressure.max() == pytest.approx(0.75 * force / (np.pi * a**2), rel=0.02)
    assert result.corrected_area == pytest.approx(2 * np.pi * a**2, rel=0.04)


def test_two_waves_near_full_contact():
    """The open places are penny cracks without stress at their rims, of radius b.

    The tension that full contact would have, (p* - p) - 2 p* (pi r)^2, has no intensity where
    b^2 = 3 (1 - p / p*) / (4 pi^2).
    """
    n, top = 192, np.sqrt(2) * FULL
    x = (np.arange(n) + 0.3) / n
    product = np.cos(2 * np.pi * x)[:, None] * np.cos(2 * np.pi * x)
    ground = Rigid(HEIGHT * (1 - product), force=(0.0, 0.0, 0.96 * top))
    result = GridContact(HalfSpace((1.0, 1.0), (n, n), E, NU), ground).solve()
    b2 = 3 * 0.04 / (4 * np.pi**2)
    assert 1 - result.corrected_area == pytest.approx(2 * np.pi * b2, rel=0.06)


def test_hertz_in_a_wide_period():
    n, radius, force = 192, 2.0, 2e-4
    ball = Rigid(Parabola((0.501, 0.4985, 0.0), radius), force=(0.0, 0.0, force))
    contact = GridContact(HalfSpace((1.0, 1.0), (n, n), E, NU), ball)
    result = contact.solve()
    a = (0.75 * force * radius / E_STAR) ** (1 / 3)
    top = 1.5 * force / (np.pi * a**2)
    x = contact.points()
    r = np.hypot(x[0] - 0.501, x[1] - 0.4985)
    wanted = top * np.sqrt(np.maximum(1 - (r / a) ** 2, 0.0))
    assert np.abs(result.pressure - wanted)[r < 0.8 * a].max() < 0.02 * top
    assert abs(result.corrected_area - np.pi * a**2) < 0.6 * abs(result.area - np.pi * a**2)
    assert result.corrected_area == pytest.approx(np.pi * a**2, rel=0.03)


def test_slip_annulus_of_a_ball():
    """Cattaneo and Mindlin: the radius c of the stuck core, (c / a)^3 = 1 - Q / (F P)."""
    n, radius, force, F = 128, 2.0, 2e-3, 0.3
    ball = Rigid(Parabola((0.501, 0.4985, 0.0), radius), force=(0.5 * F * force, 0.0, force))
    result = GridContact(HalfSpace((1.0, 1.0), (n, n), E, 0.49), ball, F).solve()
    stuck = np.sqrt(np.mean(result.status == Status.STICK))
    touching = np.sqrt(np.mean(result.status != Status.OPEN))
    assert stuck / touching == pytest.approx(0.5 ** (1 / 3), abs=0.03)
    assert np.hypot(*result.shear).max() <= F * result.pressure.max()
