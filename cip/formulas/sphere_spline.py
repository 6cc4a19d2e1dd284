"""Splines through the poles: fields of longitude and latitude as periodic functions on a torus.

With s the distance from the south pole a field goes on beyond a pole along its great circle,
u(lon, -s) = u(lon + pi, s). It is smooth there, and so is the odd continuation of u sin(s).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cip.grid import Array, in_space

PAD = 4  # coefficients kept beyond each side, at least half of the largest degree + 1


def over_poles(values: Array, sign: float) -> Array:
    """Values in cells, shape (.., nlon, nlat), on whole great circles, shape (.., nlon, 2 nlat)."""
    beyond = np.roll(values, values.shape[-2] // 2, axis=-2)[..., ::-1]
    return np.concatenate([values, sign * beyond], axis=-1)


def resolved(values: Array) -> Array:
    """Values without more than 2 + 1.5 (nlon / 2) cos(lat) waves around a pole, beyond what the
    spacing of latitudes resolves; sums along the circle stay. Noise in the narrow cells at a pole
    would grow without bound in short steps over it."""
    import scipy.fft as fft

    nlon, nlat = values.shape[-2:]
    waves = fft.rfft(values, axis=-2)
    most = 2.0 + 0.75 * nlon * _middles(nlat)
    waves *= np.arange(waves.shape[-2])[:, None] <= most
    return np.asarray(fft.irfft(waves, n=nlon, axis=-2))


@cache
def at_integers(degree: int) -> Array:
    """The central B-spline of a degree at -PAD .. PAD."""
    return np.array([_central(degree, float(k)) for k in range(-PAD, PAD + 1)])


def _central(degree: int, x: float) -> float:
    """The central B-spline of a degree at x, by the recursion of de Boor and Cox: at integers all
    digits are right, of SciPy's the last is not."""
    if degree == 0:
        return float(-0.5 <= x < 0.5)
    left, right = 0.5 * (degree + 1) + x, 0.5 * (degree + 1) - x
    lower = left * _central(degree - 1, x + 0.5) + right * _central(degree - 1, x - 0.5)
    return lower / degree


@cache
def _symbol(degree: int, count: int) -> Array:
    """The discrete Fourier transform of the central B-spline at `count` integers of a period."""
    found = np.zeros(count)
    np.add.at(found, np.arange(-PAD, PAD + 1) % count, at_integers(degree))
    return np.asarray(np.fft.fft(found).real)


def coefficients(data: Array, degree: int) -> Array:
    """Coefficients of the periodic spline that has the data as values at the integers."""
    import scipy.fft as fft

    nlon, count = data.shape[-2:]
    waves: Any = fft.rfft2(data)
    waves /= _symbol(degree, nlon)[:, None] * _symbol(degree, count)[: count // 2 + 1]
    return np.asarray(fft.irfft2(waves, s=(nlon, count)))


def padded(data: Array, nlat: int) -> Array:
    """Periodic coefficients with `PAD` more on each side, of latitudes up to the north pole."""
    rows = np.arange(-PAD, data.shape[-2] + PAD) % data.shape[-2]
    return data[..., rows, :][..., np.arange(-PAD, nlat + PAD) % data.shape[-1]]


def value_spline(values: Array, degree: int) -> Array:
    """Padded coefficients of the spline through values at the centres of cells."""
    return padded(coefficients(over_poles(resolved(values), 1.0), degree), values.shape[-1])


def interpolated(coefs: Array, points: Array, degree: int = 5) -> Array:
    """`value_spline`s of a degree, (fields, ..), at points in space (3, ...): (fields, ...)."""
    from cip.formulas.spline_loops import interpolate

    found = np.empty((len(coefs), points[0].size))
    interpolate(points.reshape(3, -1), coefs, degree, PAD, found)
    return found.reshape(-1, *points.shape[1:])


def at_places(values: Array, lon: ArrayLike, lat: ArrayLike) -> Array:
    """Values at the centres of cells, (nlon, nlat), between these, by quintic splines."""
    return np.asarray(interpolated(value_spline(values[None], 5), in_space(lon, lat))[0])


def sines(nlat: int) -> Array:
    """Means of sin(s) over cells."""
    edges = np.linspace(-0.5 * np.pi, 0.5 * np.pi, nlat + 1)
    return np.asarray(np.diff(np.sin(edges)) * (nlat / np.pi))


def centre_values(means: Array, degree: int) -> Array:
    """Values at the centres of cells, (.., nlon, nlat), of the spline of a degree, 2 or 4, that
    has these means."""
    nlat = means.shape[-1]
    return _converted(means * sines(nlat), degree + 1, degree) / _middles(nlat)


def cell_means(values: Array, degree: int) -> Array:
    """The inverse of `centre_values`."""
    nlat = values.shape[-1]
    return _converted(values * _middles(nlat), degree, degree + 1) / sines(nlat)


def _middles(nlat: int) -> Array:
    """sin(s) at the centres of cells."""
    return np.asarray(np.sin((np.arange(nlat) + 0.5) * np.pi / nlat))


def _converted(density: Array, of: int, to: int) -> Array:
    """f sin(s) at the integers from one periodic spline of a degree to that of another."""
    import scipy.fft as fft

    whole = over_poles(density, -1.0)
    nlon, count = whole.shape[-2:]
    waves: Any = fft.rfft2(whole)
    waves *= (_symbol(to, nlon) / _symbol(of, nlon))[:, None]
    waves *= (_symbol(to, count) / _symbol(of, count))[: count // 2 + 1]
    return np.asarray(fft.irfft2(waves, s=(nlon, count)))[..., : density.shape[-1]]
