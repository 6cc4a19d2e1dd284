"""Contact on a grid beside closed forms: waves, balls, the edge of contact, coarser grids."""

import numpy as np
import pytest

from contact import (
    GridContact,
    HalfSpace,
    InputError,
    Parabola,
    PeriodicLayers,
    Rigid,
    Rough,
    Status,
    self_affine,
)
from contact.spectral.contact_edge import contact_edge
from skfem_adini import ElementQuadAdini

E, NU = 1.0, 0.3
E_STAR = E / (1 - NU**2)
HEIGHT = 1e-3  # amplitude of the waves, whose length is one
FULL = np.pi * E_STAR * HEIGHT  # mean pressure of full contact


def wave(n, mean, friction=0.0, nu=NU, shear=None):
    """A sinusoid under a mean pressure, with a shear force as well; the space has the same E*."""
    x = (np.arange(n) + 0.25) / n  # no point on the crest
    space = HalfSpace(1.0, n, E_STAR * (1 - nu**2), nu)
    ground = Rigid(HEIGHT * (1 - np.cos(2 * np.pi * x)), force=(shear or 0.0, mean))
    return x, GridContact(space, ground, friction).solve()


def westergaard(x, share):
    """Of the mean pressure of full contact: sin^2(pi a) = share with the half width a."""
    psi = np.pi * (x - np.round(x))
    return 2 * FULL * np.cos(psi) * np.sqrt(np.maximum(share - np.sin(psi) ** 2, 0.0))


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_partial_contact(share):
    """Westergaard (1939): the error falls with the order 3/2 of the root at the edge.

    The mean gap at 64 points a wave, within 1e-3 of its height, from the closed form's own
    displacement (Johnson, section 13.2): here by a fine sum of waves.
    """
    errors, sizes = [], (64, 128, 256, 512, 1024)
    for n in sizes:
        x, result = wave(n, share * FULL)
        if n == 64:
            opening = result.opening.mean()
        errors.append(np.sqrt(np.mean((result.pressure - westergaard(x, share)) ** 2)) / FULL)
    rate = -np.polyfit(np.log2(sizes), np.log2(errors), 1)[0]
    assert 0.7 < rate < 1.8
    assert errors[0] < 8e-3
    length = 2 / np.pi * np.arcsin(np.sqrt(share))
    assert result.area == pytest.approx(length, abs=2 / 1024)
    assert result.perimeter == 2
    n = 2**14
    x = np.arange(n) / n
    p = np.fft.rfft(westergaard(x, share))
    k = 2 * np.pi * np.arange(p.size)
    u = np.fft.irfft(np.where(k > 0, 2 / (E_STAR * np.maximum(k, 1)), 0.0) * p, n)
    gap = HEIGHT * (1 - np.cos(2 * np.pi * x)) + u
    assert opening == pytest.approx((gap - gap[0]).mean(), abs=1e-3 * HEIGHT)


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


TOP = np.sqrt(2) * FULL  # Johnson, Greenwood and Higginson (1985)


def two_waves(n, share, offset=0.3):
    x = (np.arange(n) + offset) / n
    product = np.cos(2 * np.pi * x)[:, None] * np.cos(2 * np.pi * x)
    ground = Rigid(HEIGHT * (1 - product), force=(0.0, 0.0, share * TOP))
    return product, GridContact(HalfSpace((1.0, 1.0), (n, n), E, NU), ground).solve()


def test_two_waves():
    """In full contact, in light contact (Hertz at two crests a period), and nearly closed.

    There the open places are penny cracks without stress at their rims, of radius b: the tension
    that full contact would have, (p* - p) - 2 p* (pi r)^2, has no intensity where
    b^2 = 3 (1 - p / p*) / (4 pi^2).
    """
    product, full = two_waves(48, 1.1, 0.0)
    assert full.pressure == pytest.approx(1.1 * TOP + TOP * product, rel=1e-9)
    _, light = two_waves(192, 0.004)
    force, radius = 0.004 * TOP, 1 / (4 * np.pi**2 * HEIGHT)
    a = (0.75 * 0.5 * force * radius / E_STAR) ** (1 / 3)
    assert light.pressure.max() == pytest.approx(0.75 * force / (np.pi * a**2), rel=0.02)
    assert light.corrected_area == pytest.approx(2 * np.pi * a**2, rel=0.04)
    _, closed = two_waves(192, 0.96)
    b2 = 3 * 0.04 / (4 * np.pi**2)
    assert 1 - closed.corrected_area == pytest.approx(2 * np.pi * b2, rel=0.06)


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


BODIES = {
    "half plane": lambda n: HalfSpace(1.0, n, E, NU),
    "Adini": lambda n: PeriodicLayers(1.0, [(2.0, 2 * n, E, NU)], n, element=ElementQuadAdini()),
    "linear": lambda n: PeriodicLayers(1.0, [(2.0, 2 * n, E, NU)], n),
}


def sinusoid(body, share, n):
    """Errors of the pressures before and after, over the largest, and of the half-width: rms.

    Over offsets of the grid: the ends of contact lie anywhere between its points.
    """
    block, half = BODIES[body](n), np.arcsin(np.sqrt(share)) / np.pi
    errors = []
    for offset in np.arange(8) / 16:
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
def test_the_edge_at_64_points_a_wave(body):
    """Pressure within 1e-3 of the largest one, rms over the wave; without the fit it is not."""
    for share in (0.2, 0.35, 0.5, 0.8):
        raw, pressure, half_width = sinusoid(body, share, 64)
        assert raw > 1.2e-3
        assert 0.02 * raw < pressure < 1e-3
        assert half_width < 1e-3


@pytest.mark.parametrize("h", [(1.0, 1.0), (0.8, 1.1)])
def test_edge_of_the_exact_fields_of_a_ball(h):
    """Hertz, E* = R = 1, p0 = 2 a / pi: lines in both directions, oblique ones among them."""
    a, rng = 24.3, np.random.default_rng(0)
    x = [h[0] * (np.arange(96) - 48.0) - 0.3, h[1] * (np.arange(80) - 40.0) - 0.1]
    r = np.hypot(x[0][:, None], x[1])
    s = np.maximum(r / a, 1.0)
    gap = a**2 / np.pi * (np.sqrt(s**2 - 1) - (2 - s**2) * np.arccos(1 / s))
    exact = 2 / np.pi * np.sqrt(np.maximum(a**2 - r**2, 0.0))
    near = abs(r - a) < 0.5 * min(h)
    given = np.where(near, exact * rng.uniform(0.5, 1.5, r.shape), exact)
    edge = contact_edge(given, gap, h, 1.0)
    assert edge.places.shape[1] > 140
    off = np.hypot(edge.places[0] - 48 * h[0] - 0.3, edge.places[1] - 40 * h[1] - 0.1) - a
    assert abs(off.mean()) < 0.01 * min(h)
    assert np.sqrt(np.mean(off**2)) < 0.03 * min(h)
    assert np.sqrt(np.mean((given - exact)[near] ** 2)) > 0.02 * exact.max()
    assert np.sqrt(np.mean((edge.pressure - exact)[near] ** 2)) < 3e-3 * exact.max()
    assert np.array_equal(edge.pressure[~edge.recovered], given[~edge.recovered])
    assert np.mean(edge.recovered[near & (exact > 0)]) > 0.95


def test_edges_between_mirrored_sides_are_halves_of_a_period():
    gap = HEIGHT * (1 - np.cos(np.pi * np.arange(33) / 32))
    layers = [(1.0, 32, E, NU)]
    half = GridContact(PeriodicLayers(1.0, layers, 32, sides="x"), Rigid(gap, force=(None, 4e-4)))
    whole = np.concatenate([gap, gap[-2:0:-1]])
    both = GridContact(PeriodicLayers(2.0, layers, 64), Rigid(whole, force=(None, 8e-4)))
    one, two = half.solve().edge(), both.solve().edge()
    assert one.places.shape == (1, 1)
    assert one.places[0, 0] == pytest.approx(two.places.min(), abs=1e-9)
    assert one.pressure == pytest.approx(two.pressure[:33], abs=1e-8)
    assert np.array_equal(one.recovered, two.recovered[:33])


def test_where_no_edge_fits_the_pressure_is_left():
    """Full contact, a punch whose pressure rises towards its corners, spots of few points."""
    gap = HEIGHT * (1 - np.cos(2 * np.pi * np.arange(32) / 32))
    space = HalfSpace(1.0, 32, E, NU)
    full = GridContact(space, Rigid(gap, force=(None, 1.5 * FULL))).solve()
    edge = full.edge()
    assert edge.places.shape == (1, 0)
    assert not edge.recovered.any()
    assert np.array_equal(edge.pressure, full.pressure)
    flat = np.where(abs(np.arange(64) / 64 - 0.5) < 0.2, 0.0, 1.0)
    punch = GridContact(HalfSpace(1.0, 64, E, NU), Rigid(flat, force=(None, 1e-3))).solve()
    assert not punch.edge().recovered.any()
    heights = self_affine(48, 0.8, 0.01, (2, 16), 4)
    rough = Rigid(Rough(heights - heights.max(), (1.0, 1.0)), force=(None, None, 0.01))
    edge = GridContact(HalfSpace((1.0, 1.0), (48, 48), E, NU), rough).solve().edge()
    assert np.mean(edge.recovered) < 0.05
    assert edge.pressure.min() >= 0
    rubbed = GridContact(space, Rigid(gap, force=(1e-4, 1e-3)), friction=0.4).solve()
    with pytest.raises(InputError, match="edge: known for frictionless contact"):
        rubbed.edge()
    del space.contact_modulus
    with pytest.raises(InputError, match="edge: the compliance does not tell its modulus"):
        GridContact(space, Rigid(gap, force=(None, 1e-3))).solve().edge()


LAYERS = [(0.25, 4, 1.0, 0.3), (0.5, 6, 20.0, 0.2)]
COARSENED = {
    "half plane": lambda: HalfSpace(1.0, 64, 1.0, 0.3),
    "half space": lambda: HalfSpace((1.0, 2.0), (64, 128), 1.0, 0.3),
    "periodic": lambda: PeriodicLayers((1.0, 1.0), LAYERS, (64, 64)),
    "rollers": lambda: PeriodicLayers(1.0, LAYERS, 64, sides="x"),
    "held": lambda: PeriodicLayers((1.0, 1.0), LAYERS, (64, 64), sides=("periodic", "xz")),
    "mirrored": lambda: PeriodicLayers((1.0, 1.0), LAYERS, (64, 64), sides=("x", "y")),
}


@pytest.mark.parametrize("pressed", [True, False])
@pytest.mark.parametrize("name", COARSENED)
def test_coarser_grids_give_the_same_forces_by_fewer_products(name, pressed):
    body = COARSENED[name]()
    if not pressed and body.constant.any():
        pytest.skip("nothing holds its mean displacement")
    n = body.normal_filter.cells
    heights = self_affine(n, 0.8, 5e-3, (2, 16), seed=3)
    heights = np.pad(heights, [(0, m - k) for m, k in zip(body.shape, n, strict=True)], "wrap")
    if hasattr(body, "fixed"):
        heights -= 0.1 * body.fixed[-1]  # out of reach of what a side holds
    drive = {"force": [None] * heights.ndim + [2e-2]}
    if not pressed:
        drive = {"displacement": [0.0] * heights.ndim + [4e-3]}
    products, forces = [], []

    def counting(given):
        products[-1] += 1
        return body.normal_filter.apply_normal(given)

    body.apply_normal, known = counting, body.normal_filter.coarser
    for coarser in (None, known):
        vars(body.normal_filter)["coarser"] = coarser
        products.append(0)
        forces.append(GridContact(body, Rigid(heights.max() - heights, **drive)).solve().forces)
    wanted, found = forces
    assert np.abs(found - wanted).max() < 1e-9 * wanted.max()
    assert products[1] < products[0]
