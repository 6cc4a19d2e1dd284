"""Self-affine surfaces beside the spectrum that was asked for, and Parseval's equation."""

import numpy as np
import pytest

from contact import InputError, Rough, self_affine


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


def test_isotropic():
    """No direction is preferred: both slopes have the same mean square, averaged over seeds."""
    shares = []
    for seed in range(20):
        h = self_affine((64, 128), 0.8, 1.0, (2, 16), seed)  # square cells by default
        q, C = Rough(h, (1.0, 2.0)).spectrum()
        shares.append(np.sum(q[0] ** 2 * C) / np.sum((q[0] ** 2 + q[1] ** 2) * C))
    assert np.mean(shares) == pytest.approx(0.5, abs=0.02)


def test_heights_are_nearly_gaussian():
    """Many independent waves: skewness 0 and kurtosis 3."""
    h = self_affine(512, 0.8, 1.0, (8, 128), 2, rolloff=32)
    assert np.mean(h**3) == pytest.approx(0, abs=0.03)
    assert np.mean(h**4) == pytest.approx(3, abs=0.06)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"n": 3}, "n="),
        ({"n": (8, 8, 8)}, "n="),
        ({"n": 8.5}, "n="),
        ({"hurst": 1.2}, "hurst"),
        ({"hurst": np.nan}, "hurst"),
        ({"rms": -1.0}, "rms"),
        ({"cutoffs": (4, 2)}, "cutoffs"),
        ({"cutoffs": (0, 2)}, "cutoffs"),
        ({"cutoffs": (1, 16)}, "cutoffs"),
        ({"cutoffs": (1.1, 1.2)}, "cutoffs"),
        ({"seed": "one"}, "seed"),
        ({"rolloff": 0.0}, "rolloff"),
        ({"lengths": (1.0,)}, "lengths"),
        ({"lengths": (1.0, 4.0), "cutoffs": (1, 8)}, "cutoffs"),
    ],
)
def test_refused(settings, words):
    given = {"n": 32, "hurst": 0.8, "rms": 1.0, "cutoffs": (1, 8), "seed": 0}
    with pytest.raises(InputError, match=f"^{words}"):
        self_affine(**(given | settings))
