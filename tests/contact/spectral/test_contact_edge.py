"""Edge of contact between points of a grid, and the pressure next to it, beside closed forms."""

import numpy as np
import pytest

from contact import GridContact, HalfSpace, InputError, PeriodicLayers, Rigid, Rough, self_affine
from contact.spectral.contact_edge import contact_edge
from skfem_adini import ElementQuadAdini

E, NU, HEIGHT = 1.0, 0.3, 1e-3
STAR = E / (1 - NU**2)
FULL = np.pi * STAR * HEIGHT  # mean pressure of full contact
OFFSETS = np.arange(8) / 16  # of the grid: the ends of contact lie anywhere between its points
BODIES = {
    "half plane": lambda n: HalfSpace(1.0, n, E, NU),
    "Adini": lambda n: PeriodicLayers(1.0, [(2.0, 2 * n, E, NU)], n, element=ElementQuadAdini()),
    "linear": lambda n: PeriodicLayers(1.0, [(2.0, 2 * n, E, NU)], n),
}


def westergaard(x, share):
    inside = np.maximum(share - np.sin(np.pi * x) ** 2, 0.0)
    return 2 * FULL * abs(np.cos(np.pi * x)) * np.sqrt(inside)


def sinusoid(body, share, n):
    """Errors of the pressures before and after, over the largest, and of the half-width: rms."""
    block, half = BODIES[body](n), np.arcsin(np.sqrt(share)) / np.pi
    errors = []
    for offset in OFFSETS:
        x = (np.arange(n) + offset) / n
        ground = Rigid(HEIGHT * (1 - np.cos(2 * np.pi * x)), force=(None, share * FULL))
        result = GridContact(block, ground).solve()
        edge, wanted = result.edge(), westergaard(x, share)
        right, left = edge.places[0] + offset / n
        off = [np.sqrt(np.mean((p - wanted) ** 2)) / wanted.max()
               for p in (result.pressure, edge.pressure)]  # fmt: skip
        errors.append([*off, abs(0.5 * (right + 1 - left) / half - 1)])
    return np.sqrt(np.mean(np.square(errors), axis=0))


@pytest.mark.parametrize("body", BODIES)
def test_westergaard_at_64_points_a_wave(body):
    """Pressure within 1e-3 of the largest one, rms over the wave; without the fit it is not."""
    for share in (0.2, 0.35, 0.5, 0.8):
        raw, pressure, half_width = sinusoid(body, share, 64)
        assert raw > 1.2e-3
        assert 0.02 * raw < pressure < 1e-3
        assert half_width < 1e-3


def test_order():
    """One over all meshes, as without the fit, from a twentieth of its errors.

    Next to an edge the equations of the mesh always have the same error, on ever fewer points.
    """
    sizes = (64, 128, 256, 512)
    errors = np.array([sinusoid("half plane", 0.35, n) for n in sizes])
    orders = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert 0.8 < orders[0] < 1.4
    assert 0.8 < orders[1] < 1.4
    assert np.all(errors[:, 1] < 0.2 * errors[:, 0])
    assert 0.8 < orders[2] < 2.0


def ball(h, a, place):
    """Hertz' pressure and gap of a ball, E* = R = 1, exactly, where p0 = 2 a / pi."""
    x = [h[0] * np.arange(96) - 48.0 * h[0] - place[0], h[1] * np.arange(80) - 40 * h[1] - place[1]]
    r = np.hypot(x[0][:, None], x[1])
    s = np.maximum(r / a, 1.0)
    gap = a**2 / np.pi * (np.sqrt(s**2 - 1) - (2 - s**2) * np.arccos(1 / s))
    return r, 2 / np.pi * np.sqrt(np.maximum(a**2 - r**2, 0.0)), gap


@pytest.mark.parametrize("h", [(1.0, 1.0), (0.8, 1.1)])
def test_exact_fields_of_a_ball(h):
    """Lines in both directions, oblique ones among them; what the points next to the edge say."""
    a, rng = 24.3, np.random.default_rng(0)
    r, exact, gap = ball(h, a, (0.3, 0.1))
    near = abs(r - a) < 0.5 * min(h)
    given = np.where(near, exact * rng.uniform(0.5, 1.5, r.shape), exact)
    edge = contact_edge(given, gap, h, 1.0)
    x, y = edge.places[0] - 48 * h[0] - 0.3, edge.places[1] - 40 * h[1] - 0.1
    assert edge.places.shape[1] > 140
    off = np.hypot(x, y) - a
    assert abs(off.mean()) < 0.01 * min(h)
    assert np.sqrt(np.mean(off**2)) < 0.03 * min(h)
    assert np.sqrt(np.mean((given - exact)[near] ** 2)) > 0.02 * exact.max()
    assert np.sqrt(np.mean((edge.pressure - exact)[near] ** 2)) < 3e-3 * exact.max()
    assert np.array_equal(edge.pressure[~edge.recovered], given[~edge.recovered])
    assert np.mean(edge.recovered[near & (exact > 0)]) > 0.95


def test_mirrored_sides_are_halves_of_a_period():
    n, x = 64, np.arange(33) / 32
    gap = HEIGHT * (1 - np.cos(np.pi * x))
    layers = [(1.0, 32, E, NU)]
    half = GridContact(PeriodicLayers(1.0, layers, 32, sides="x"), Rigid(gap, force=(None, 4e-4)))
    whole = np.concatenate([gap, gap[-2:0:-1]])
    both = GridContact(PeriodicLayers(2.0, layers, n), Rigid(whole, force=(None, 8e-4)))
    one, two = half.solve().edge(), both.solve().edge()
    assert one.places.shape == (1, 1)
    assert one.places[0, 0] == pytest.approx(two.places.min(), abs=1e-9)
    assert one.pressure == pytest.approx(two.pressure[:33], abs=1e-8)
    assert np.array_equal(one.recovered, two.recovered[:33])


def test_where_nothing_fits_the_pressure_is_left():
    wave = HEIGHT * (1 - np.cos(2 * np.pi * np.arange(32) / 32))
    full = GridContact(HalfSpace(1.0, 32, E, NU), Rigid(wave, force=(None, 1.5 * FULL))).solve()
    edge = full.edge()
    assert edge.places.shape == (1, 0)
    assert not edge.recovered.any()
    assert np.array_equal(edge.pressure, full.pressure)
    x = np.arange(64) / 64 - 0.5
    flat = np.where(abs(x) < 0.2, 0.0, 1.0)  # a punch: the pressure rises towards its corners
    punch = GridContact(HalfSpace(1.0, 64, E, NU), Rigid(flat, force=(None, 1e-3))).solve()
    assert not punch.edge().recovered.any()


def test_spots_of_few_points_are_left():
    heights = self_affine(48, 0.8, 0.01, (2, 16), 4)
    rough = Rigid(Rough(heights - heights.max(), (1.0, 1.0)), force=(None, None, 0.01))
    result = GridContact(HalfSpace((1.0, 1.0), (48, 48), E, NU), rough).solve()
    edge = result.edge()
    assert np.mean(edge.recovered) < 0.05
    assert edge.pressure.min() >= 0


def test_what_is_refused():
    wave = HEIGHT * (1 - np.cos(2 * np.pi * np.arange(32) / 32))
    space = HalfSpace(1.0, 32, E, NU)
    rubbed = GridContact(space, Rigid(wave, force=(1e-4, 1e-3)), friction=0.4).solve()
    with pytest.raises(InputError, match="edge: known for frictionless contact"):
        rubbed.edge()
    unknown = HalfSpace(1.0, 32, E, NU)
    del unknown.contact_modulus
    with pytest.raises(InputError, match="edge: the compliance does not tell its modulus"):
        GridContact(unknown, Rigid(wave, force=(None, 1e-3))).solve().edge()
