"""Rough obstacles: heights between grid points, rays, files, spectra, contact beside a gap."""

import numpy as np
import pytest
import skfem
from matplotlib.image import imsave

from contact import (
    ClosestPoint,
    ContactProblem,
    ElasticBody,
    GridContact,
    HalfSpace,
    Rough,
    self_affine,
)
from contact.obstacles.rough import read_heights

L = (1.7, 0.9)


def wave(t):
    """A smooth periodic surface, its gradient below."""
    a, b = 2 * np.pi * t[0] / L[0], 2 * np.pi * t[1] / L[1]
    return 0.03 * np.cos(a) * np.sin(2 * b)


def wave_slope(t):
    a, b = 2 * np.pi * t[0] / L[0], 2 * np.pi * t[1] / L[1]
    along = -0.03 * 2 * np.pi / L[0] * np.sin(a) * np.sin(2 * b)
    return np.array([along, 0.03 * 4 * np.pi / L[1] * np.cos(a) * np.cos(2 * b)])


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize(("kind", "order"), [("cubic", 4), ("linear", 2)])
def test_order_of_heights_between_grid_points(kind, order, periodic):
    t = np.random.default_rng(0).uniform(0, 1, (2, 400)) * np.array(L)[:, None]
    x = np.vstack((t, 0 * t[:1] + 0.2))
    down = np.zeros_like(x)
    down[2] = -1
    errors = []
    for n in (16, 32, 64):
        rough = Rough.from_function(wave, L, (n, n), periodic=periodic, interpolation=kind)
        errors.append(np.abs(rough(x, down) - (0.2 - wave(t))).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((rates > order - 0.7) & (rates < order + 1.3))


@pytest.mark.parametrize("kind", ["cubic", "linear"])
@pytest.mark.parametrize("periodic", [True, False])
def test_heights_at_grid_points_are_exact(kind, periodic):
    h = np.random.default_rng(1).standard_normal((6, 9))
    rough = Rough(h, L, periodic=periodic, interpolation=kind)
    axes = [np.linspace(0, s, m, endpoint=not periodic) for s, m in zip(L, h.shape, strict=True)]
    a, b = np.meshgrid(*axes, indexing="ij")
    x, down = np.array([a, b, 0 * a]), np.stack((0 * a, 0 * a, 0 * a - 1))
    assert rough(x, down) == pytest.approx(-h, abs=1e-13)
    shifted = x + np.array([2 * L[0], -L[1], 0.0]).reshape(3, 1, 1)
    if periodic:
        assert rough(shifted, down) == pytest.approx(-h, abs=1e-13)
    else:
        assert np.all(np.isinf(rough(shifted + 1e-3, down)))


@pytest.mark.parametrize("kind", ["cubic", "linear"])
@pytest.mark.parametrize("periodic", [True, False])
def test_a_tensor_grid_of_places_and_the_same_places_in_a_row(kind, periodic):
    """Grids are evaluated direction by direction, other places one by one."""
    rng = np.random.default_rng(5)
    rough = Rough(rng.standard_normal((7, 11)), L, periodic=periodic, interpolation=kind)
    axes = [rng.uniform(-0.3, 1.3, m) * s for m, s in ((12, L[0]), (9, L[1]))]
    x = np.array(np.meshgrid(*axes, [0.1], indexing="ij"))[..., 0]
    down = np.stack((0 * x[0], 0 * x[0], 0 * x[0] - 1))
    row = rough(x.reshape(3, -1), down.reshape(3, -1)).reshape(x.shape[1:])
    assert np.isfinite(row).any()
    assert rough(x, down) == pytest.approx(row, abs=1e-12)
    for one, other in zip(rough.distance(x), rough.distance(x.reshape(3, -1)), strict=True):
        assert one == pytest.approx(other.reshape(one.shape), abs=1e-11)
    # No grid, though of the same shape: rows of it are rolled.
    rolled = x.copy()
    rolled[1, 0] = np.roll(x[1, 0], 1)
    expected = np.vstack((np.roll(row[0], 1), row[1:]))
    assert rough(rolled, down) == pytest.approx(expected, abs=1e-12)


def test_gradient_of_the_distance():
    t = np.random.default_rng(2).uniform(0, 1, (2, 50)) * np.array(L)[:, None]
    x = np.vstack((t, wave(t)[None]))
    rough = Rough.from_function(wave, L, (96, 96))
    d, normal = rough.distance(x)
    slope = wave_slope(t)
    wanted = np.vstack((-slope, np.ones((1, 50)))) / np.sqrt(1 + np.sum(slope**2, axis=0))
    assert d == pytest.approx(0, abs=1e-7)
    assert normal == pytest.approx(wanted, abs=1e-4)
    assert ClosestPoint(rough).direction(x) == pytest.approx(-wanted, abs=1e-4)


def test_distance_to_first_order():
    """Half the gap, a quarter of the error: compared with a search along the curve."""
    rough = Rough.from_function(lambda t: 0.1 * np.cos(t[0]), 2 * np.pi, 256)
    s = np.linspace(0, 2, 200_001)
    curve = np.array([s, 0.1 * np.cos(s)])
    errors = []
    for above in (0.08, 0.04, 0.02):
        x = np.array([1.0, 0.1 * np.cos(1.0) + above])
        exact = np.linalg.norm(curve - x[:, None], axis=0).min()
        errors.append(abs(rough.distance(x[:, None])[0][0] - exact))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates == pytest.approx(2, abs=0.3)


def test_oblique_rays_meet_the_surface_first():
    """Against a dense walk along each ray, on a surface that some rays meet more than once."""
    rng = np.random.default_rng(3)
    rough = Rough(self_affine((64,), 0.9, 0.05, (1, 6), 5), 2.0, interpolation="linear")
    d = np.linspace(0, 3, 300_001)
    met = 0
    for _ in range(25):
        x, angle = np.array([rng.uniform(0, 2), 0.4]), rng.uniform(-1.35, 1.35)
        n = np.array([np.sin(angle), -np.cos(angle)])
        at = x[:, None] + d * n[:, None]
        below = np.flatnonzero(
            -np.interp(at[0] % 2, np.arange(65) / 32, rough.heights[np.r_[:64, 0]]) + at[1] <= 0
        )
        found = rough(x[:, None], n[:, None])[0]
        if below.size:
            assert found == pytest.approx(d[below[0]], abs=2e-5)
            met += 1
    assert met > 15
    assert np.isinf(rough(np.array([[0.1], [0.4]]), np.array([[0.0], [1.0]]))[0])


@pytest.mark.parametrize("normal", [(0, 0, -2.0), (0, 3.0, 0), (-1.0, 0, 0), (0.3, -0.4, 1.2)])
def test_placed_anywhere(normal):
    """Turned with its plane: the axes are the other coordinate axes, in their order."""
    n = np.array(normal) / np.linalg.norm(normal)
    e = np.delete(np.eye(3), np.argmax(np.abs(n)), axis=0)
    first = e[0] - n * (n @ e[0])
    first /= np.linalg.norm(first)
    second = e[1] - n * (n @ e[1]) - first * (first @ e[1])
    second /= np.linalg.norm(second)
    point = np.array([0.2, -0.1, 0.4])
    rough = Rough.from_function(wave, L, (64, 64), point=point, normal=normal)
    t = np.random.default_rng(4).uniform(-1, 2, (2, 30))
    x = point[:, None] + np.outer(first, t[0]) + np.outer(second, t[1]) + 0.5 * n[:, None]
    towards = np.repeat(-n[:, None], 30, axis=1)
    assert rough(x, towards) == pytest.approx(0.5 - wave(t), abs=1e-5)


@pytest.mark.parametrize("element", [skfem.ElementQuad1, skfem.ElementQuad2])
@pytest.mark.parametrize("unit", [1e-6, 1.0])
def test_contact_equals_that_of_the_gap(element, unit):
    """A body on a rough line finds what it finds on the gap as a function."""
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, unit, 25), np.linspace(0, 0.5 * unit, 9))
    body = ElasticBody.from_mesh(mesh.with_defaults(), element(), E=1.0, nu=0.3)
    body = body.fix("top", "x").fix("top", "y", value=-0.01 * unit)
    h = unit * self_affine((24,), 0.7, 0.01, (1, 8), 2)
    rough = Rough(h - h.max(), unit, interpolation="linear")

    def gap(x):
        return -np.interp(x[0], np.arange(25) / 24 * unit, (h - h.max())[np.r_[:24, 0]])

    one = ContactProblem(body, "bottom", rough, friction=0.3).solve()
    two = ContactProblem(body, "bottom", gap, friction=0.3).solve()
    assert np.any(one.pressure > 0)
    assert np.any(one.pressure == 0)
    assert one.pressure == pytest.approx(two.pressure, abs=1e-9 * two.pressure.max())


# Gaps over a whole grid are those of its points, on the points of the heights and between.
HEIGHTS = 1e-2 * self_affine((12, 10), hurst=0.8, rms=1.0, cutoffs=(1, 4), seed=3)


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
@pytest.mark.parametrize("shape", [(12, 10), (24, 5), (7, 9)])
@pytest.mark.parametrize("point", [None, (0.25, -0.2, -0.3), (0.11, 0.0, 0.0)])
def test_gaps_of_points(interpolation, shape, point):
    rough = Rough(HEIGHTS, (3.0, 2.0), point=point, interpolation=interpolation)
    axes = [length * np.arange(m) / m for length, m in zip((3.0, 2.0), shape, strict=True)]
    n = np.array([0.0, 0.0, -1.0])
    x = np.array([*np.meshgrid(*axes, indexing="ij"), np.zeros(shape)])
    found = rough.gap_over(axes, n)
    exact = rough(x, np.broadcast_to(n[:, None, None], x.shape))
    np.testing.assert_allclose(found, exact, atol=1e-15)
    contact = GridContact(HalfSpace((3.0, 2.0), shape, E=1.0, nu=0.3), rough)
    np.testing.assert_allclose(contact.gap(), found, atol=1e-15)


def test_surfaces_along_another_axis():
    rough = Rough(HEIGHTS, (3.0, 2.0), normal=(0.0, 2.0, 0.0), point=(0.0, -0.1, 0.0))
    axes = [np.arange(4) * 0.75, np.arange(5) * 0.4]
    x = np.array(np.meshgrid(axes[0], [0.0], axes[1], indexing="ij"))[:, :, 0]
    n = np.array([0.0, -1.0, 0.0])
    exact = rough(x, np.broadcast_to(n[:, None, None], x.shape))
    np.testing.assert_allclose(rough.gap_over(axes, n), exact, atol=1e-15)


def lines(heights, spacing=(0.25, 0.5), seed=0):
    """Points in random order, with the rounding of decimal numbers."""
    i, j = np.indices(heights.shape)
    points = np.stack([i * spacing[0] - 3.0, j * spacing[1], heights], axis=-1).reshape(-1, 3)
    return np.random.default_rng(seed).permutation(points)


def test_files(tmp_path):
    """Arrays, lines of text in any order, and grey values: the first axis right, the second up."""
    h = np.random.default_rng(5).uniform(0, 1, (5, 7))
    np.save(tmp_path / "a.npy", h)
    np.savetxt(tmp_path / "a.txt", h, header="nm")
    np.savetxt(tmp_path / "a.csv", h, delimiter=",")
    np.savetxt(tmp_path / "a.xyz", lines(h), fmt="%.9g", header="x/um y/um z/nm")
    for name in ("a.npy", "a.txt", "a.csv", "a.xyz"):
        rough = Rough.from_file(tmp_path / name, (1.0, 3.0), scale=1e-9, periodic=False)
        assert rough.heights == pytest.approx(1e-9 * h, rel=1e-15 if name != "a.xyz" else 1e-8)
    np.savetxt(tmp_path / "line.dat", h[0])
    assert Rough.from_file(tmp_path / "line.dat", 1.0).heights == pytest.approx(h[0])
    grey = np.linspace(0, 1, 30).reshape(5, 6)
    imsave(tmp_path / "a.png", grey, cmap="gray", vmin=0, vmax=1)
    rough = Rough.from_file(tmp_path / "a.png", L, scale=2.0)
    assert rough.heights == pytest.approx(2 * grey[::-1].T, abs=2 / 128)  # of eight bits


@pytest.mark.parametrize(
    "text", ["0,5;-1,25\n3;4e-1", "0,5 -1,25\n3 0,4", "0,5\t-1,25\n3,0\t,4", "0.5,-1.25\n3,0.4"]
)
def test_decimal_commas(tmp_path, text):
    """They are known where other marks part the numbers, of which none has a point."""
    (tmp_path / "map.csv").write_text(f"# x,y\n{text}\n")
    found = read_heights(tmp_path / "map.csv")
    assert np.array_equal(found, [[0.5, -1.25], [3.0, 0.4]])


def wave_numbers(q, lengths):
    """Waves along the first side, from wave vectors in radians a length."""
    return (
        np.linalg.norm(q.reshape(len(q), -1), axis=0).reshape(q.shape[1:])
        * lengths[0]
        / (2 * np.pi)
    )


@pytest.mark.parametrize("hurst", [0.0, 0.5, 0.8, 1.0])
@pytest.mark.parametrize(
    ("n", "lengths"),
    [((64, 64), (2.0, 2.0)), ((96, 48), (3.0, 1.5)), ((81,), (0.1,)), ((64, 32), (1.0, 2.0))],
)
def test_spectrum_is_the_prescribed_one(n, lengths, hurst):
    low, high, flat = 2, 7.5, 4
    h = self_affine(n, hurst, 3e-7, (low, high), 11, rolloff=flat, lengths=lengths)
    q, C = Rough(h, lengths).spectrum()
    k = wave_numbers(q, lengths)
    inside = (k >= low) & (k <= high)
    law = np.maximum(k[inside], flat) ** (-2 * hurst - len(n))
    scale = 9e-14 * np.prod(lengths) / law.sum()
    assert C[inside] == pytest.approx(scale * law, rel=1e-10)
    assert np.all(C[~inside] <= 1e-25 * C.max())
    assert abs(h.mean()) < 1e-20


def test_parseval_height_and_slope():
    """Sums over the spectrum beside sums over the surface, its slope by fine differences."""
    lengths = (2.0, 1.0)
    h = self_affine((64, 32), 0.7, 0.01, (1, 6), 3, lengths=lengths)
    rough = Rough(h, lengths)
    assert rough.rms_height == pytest.approx(0.01, rel=1e-13)
    assert np.sqrt(np.mean(h**2)) == pytest.approx(0.01, rel=1e-13)
    fine = self_affine((2048, 1024), 0.7, 0.01, (1, 6), 3, lengths=lengths)
    step = [s / m for s, m in zip(lengths, fine.shape, strict=True)]
    slopes = [(np.roll(fine, -1, a) - np.roll(fine, 1, a)) / (2 * step[a]) for a in (0, 1)]
    assert rough.rms_slope == pytest.approx(
        np.sqrt(np.mean(slopes[0] ** 2 + slopes[1] ** 2)), rel=1e-4
    )


@pytest.mark.parametrize("n", [(48, 48), (48,)])
def test_same_surface_on_every_grid(n):
    coarse = self_affine(n, 0.6, 1.0, (1, 20), 5)
    for times in (2, 3):
        fine = self_affine(tuple(times * m for m in n), 0.6, 1.0, (1, 20), 5)
        assert fine[(slice(None, None, times),) * len(n)] == pytest.approx(coarse, abs=1e-12)
    assert not np.allclose(coarse, self_affine(n, 0.6, 1.0, (1, 20), 6))
