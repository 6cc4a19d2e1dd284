r"""Diffusion of all moments on uniform grids and spheres, exact in time at any diffusion number.

Values, derivatives and means of a field all solve :math:`m_t = \kappa \Delta m`, so each is
convolved with the kernel of its grid: in Fourier space a product with
:math:`e^{-\kappa s(\theta) \tau / h^2}`, after reflection at walls, through which nothing diffuses
(Strang, SIAM Review 41, 1999, 135-147). :math:`s = \theta^2` is exact for what the grid resolves;
the second difference :math:`s = 2 - 2 \cos\theta` has a kernel without negative values.

On a sphere a field is a double Fourier series, of cosines or sines of the distance s from a pole
for even or odd waves around it, in which sin(s)^2 times the Laplacian has three diagonals (Cheong,
J. Comput. Phys. 157, 2000, 327-349) and harmonics their eigenvalues -n (n + 1). The exponential is
the integral of the resolvent along a hyperbola (Trefethen, Weideman and Schmelzer, BIT 46, 2006,
653-670).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.errors import InputError, NotSupported
from cip.formulas.sphere_spline import cell_means, centre_values
from cip.grid import AXES, GridLike, Sphere
from cip.profiles.catalogue import SPHERE, moments
from skfem_adini.ground.arguments import real_array


class Diffusion:
    """Constant coefficients `rates`, length^2 / time, one for each direction; as part of a step it
    is called like a `Reaction` without parameters. `positive`: by the second difference."""

    parameters = source_parameters = decay_parameters = ()

    def __init__(
        self, grid: Any, profile: str, rates: tuple[float, ...], positive: bool, xp: Any
    ) -> None:
        self._grid, self._xp, self._moments = grid, xp, moments(profile, grid.dim)
        self._profile = profile
        self.rates, self._positive = rates, positive
        self._kept: dict[Any, Any] = {}

    def check_times(self, start: float, end: float) -> None:
        """It does not depend on t."""

    def added(self, data: Any, t: float, length: float) -> Any:
        """The moments themselves: diffusion adds nothing."""
        return data

    def decayed(self, data: Any, t: float, length: float, transpose: bool = False) -> Any:
        """The moments after a time, or the transpose of that map."""
        if length < 0.0:
            raise InputError("dt: diffusion cannot be undone; run forward in time")
        return self._after(data, length, transpose)

    def _after(self, data: Any, length: float, transpose: bool) -> Any:
        new = self._xp.empty_like(data)
        for q, moment in enumerate(self._moments):
            values = data[q]
            for axis, rate in enumerate(self.rates):
                if rate:
                    odd, means = moment.orders[axis] % 2 == 1, axis in moment.averaged
                    values = self._spread(values, axis, odd, means, length, transpose)
            new[q] = values
        return new

    def _spread(
        self, values: Any, axis: int, odd: bool, means: bool, length: float, transpose: bool
    ) -> Any:
        """The convolution along an axis: of values at nodes, at walls `odd` or even, or `means`."""
        xp, n = self._xp, self._grid.cells[axis]
        v = xp.moveaxis(values, axis, -1)
        if self._grid.periodic[axis]:
            return xp.moveaxis(self._convolved(v, axis, n, length), -1, axis)
        sign, count = -1.0 if odd else 1.0, n if means else n + 1
        first = 0 if means else 1  # of the values that have an image of their own
        if transpose:
            whole = xp.zeros((*v.shape[:-1], 2 * n), v.dtype)
            whole[..., :count] = v[..., :count]
        else:
            whole = xp.concatenate([v[..., :count], sign * v[..., first:n][..., ::-1]], axis=-1)
            if odd:
                whole[..., [0, n]] = 0.0
        spread = self._convolved(whole, axis, 2 * n, length)
        new = xp.zeros_like(v)
        new[..., :count] = spread[..., :count]
        if transpose:
            new[..., first:n] += sign * spread[..., count:][..., ::-1]
            if odd:
                new[..., [0, n]] = 0.0
        return xp.moveaxis(new, -1, axis)

    def _convolved(self, values: Any, axis: int, size: int, length: float) -> Any:
        """A periodic convolution of `size` values in the last direction."""
        key = axis, length
        if key not in self._kept:
            theta = 2.0 * np.pi * np.arange(size // 2 + 1) / size
            symbol = 2.0 - 2.0 * np.cos(theta) if self._positive else theta**2
            number = self.rates[axis] * length / self._grid.widths[axis][0] ** 2
            # A new dict: other threads may be reading the old one.
            last = dict(list(self._kept.items())[-2 * self._grid.dim :])
            self._kept = {**last, key: self._xp.asarray(np.exp(-number * symbol))}
        fft = self._xp.fft
        return fft.irfft(fft.rfft(values) * self._kept[key], size)


NODES = 28  # of the contour: the exponential of what is not positive to 1e-14
Bands = tuple[Any, ...]


class SphereDiffusion(Diffusion):
    """The same on a sphere, with a rate in all directions. With `positive` the values stay in the
    range that they have."""

    def _after(self, data: Any, length: float, transpose: bool) -> Any:
        degree = SPHERE[self._profile] if self._moments[0].averaged else 0
        values = centre_values(data, degree) if degree else data
        values = values - values.mean((-2, -1), keepdims=True)
        change = np.stack([self._spread_out(one, length) for one in values]) - values
        area = self._grid.volumes
        if degree:  # the means of harmonics sum to zero up to the error of splines
            change = cell_means(change, degree)
            change -= ((change * area).sum((-2, -1)) / area.sum())[..., None, None]
        new = data + change
        if not self._positive:
            return new
        given = area if degree else None
        rows = zip(new, data, strict=True)
        return np.stack([within(one, (old.min(), old.max()), given) for one, old in rows])

    def _spread_out(self, values: Any, length: float) -> Any:
        """Values at the centres of cells, (nlon, nlat), after a time."""
        import scipy.fft as fft

        waves, n = fft.rfft(values, axis=0), values.shape[1]
        series = np.empty_like(waves)
        series[0::2] = fft.dct(waves[0::2], axis=1) / n
        series[1::2] = fft.dst(waves[1::2], axis=1) / n
        series[0::2, 0] *= 0.5
        series[1::2, -1] *= 0.5
        series = self._after_series(series.T, length).T
        series[0::2, 0] *= 2.0
        series[1::2, -1] *= 2.0
        waves[0::2] = fft.idct(series[0::2] * n, axis=1)
        waves[1::2] = fft.idst(series[1::2] * n, axis=1)
        return fft.irfft(waves, n=values.shape[0], axis=0)

    def _after_series(self, series: Any, length: float) -> Any:
        """The coefficients, (nlat, waves around the pole), after a time."""
        if self._kept.get("length") != length:
            number = self.rates[0] * length / self._grid.radius**2
            self._kept = {"length": length, "factors": _factors(series.shape, number)}
        (below, diagonal, above), lower, pivots, upper, weights = self._kept["factors"]
        parts = np.stack([series.real, series.imag], axis=1)
        b = diagonal * parts
        b[2:] += below[2:] * parts[:-2]
        b[:-2] += above[:-2] * parts[2:]
        x = np.broadcast_to(b[:, None], (len(b), weights.size, *b.shape[1:])).astype(complex)
        for j in range(2, len(x)):
            x[j] -= lower[j, :, None] * x[j - 2]
        for j in reversed(range(len(x))):
            if j + 2 < len(x):
                x[j] -= upper[j, :, None] * x[j + 2]
            x[j] /= pivots[j, :, None]
        found = 2.0 * np.einsum("p,jprm->jrm", weights, x).real
        return found[:, 0] + 1j * found[:, 1]


def _factors(shape: tuple[int, int], number: float) -> Bands:
    """The diagonals of sin(s)^2, (nlat, 1, waves), and the factors, (nlat, nodes, waves), of z
    sin(s)^2 - number times those of the Laplacian with it, for z on the contour, with weights."""
    n, m = shape[0], np.arange(shape[1])
    k = np.arange(n)[:, None] + m % 2.0  # of cos(k s) for even m, sin(k s) for odd ones
    before, beyond = k - 2.0, k + 2.0
    below = np.where(before == 0.0, -0.5, -0.25)
    diagonal = np.where(k == 1.0, np.where(m % 2, 0.75, 0.25), 0.5)
    above = np.full_like(k, -0.25)
    spread = (
        0.25 * before * (before + 1.0), -0.5 * k * k - 1.0 * m * m, 0.25 * beyond * (beyond - 1.0)
    )  # fmt: skip
    angle = 1.1721 - 0.3443j * np.pi * (2.0 * np.arange(NODES // 2) + 1.0) / NODES
    z = 2.246 * NODES * (1.0 - np.sin(angle))
    weights = np.exp(z) * 2.246 * 0.3443 * np.cos(angle)
    bands = [
        z[:, None] * one[:, None] - number * other[:, None]
        for one, other in zip((below, diagonal, above), spread, strict=True)
    ]
    lower, pivots, upper = bands
    for j in range(2, n):
        lower[j] /= pivots[j - 2]
        pivots[j] -= lower[j] * upper[j - 2]
    return tuple(one[:, None] for one in (below, diagonal, above)), lower, pivots, upper, weights


def within(values: Any, bounds: tuple[float, float], area: Any = None) -> Any:
    """Values within the bounds; with `area` of the same sum, what is cut given to cells by the room
    that they have."""
    low, high = bounds
    cut = np.clip(values, low, high)
    lost = 0.0 if area is None else float(((values - cut) * area).sum())
    if lost == 0.0:
        return cut
    room = high - cut if lost > 0.0 else cut - low
    total = float((room * area).sum())
    if not abs(lost) <= total:
        raise InputError(f"bounds: the mean of the field is not within {bounds}; widen them")
    return cut + lost / total * room


def diffusion(grid: GridLike, profile: str, value: Any, limited: bool, xp: Any) -> Diffusion | None:
    """The diffusion of a solver, from its argument; None without it. Raises `InputError` for
    coefficients that are negative, `NotSupported` on grids that are not uniform."""
    if value is None:
        return None
    kind, count = (SphereDiffusion, 1) if isinstance(grid, Sphere) else (Diffusion, grid.dim)
    found = real_array("diffusion: expected a number, or one for each direction", value)
    if found.shape not in ((), (count,)) or not np.isfinite(found).all() or (found < 0.0).any():
        raise InputError(
            f"diffusion: expected a number >= 0, or {count} of them, in length^2 / time, got "
            f"{value!r}"
        )
    rates = tuple(float(rate) for rate in np.broadcast_to(found, (count,)))
    for axis, rate in enumerate(rates):
        if rate and not grid.uniform[axis]:
            raise NotSupported(
                f"diffusion: the grid is not uniform in {AXES[axis]}; take a uniform grid, or 0 "
                "for that direction"
            )
    return kind(grid, profile, rates, limited, xp) if any(rates) else None
