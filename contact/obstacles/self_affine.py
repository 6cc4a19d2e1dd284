"""Periodic rough surfaces with a prescribed power spectrum."""

from __future__ import annotations

import operator
from collections.abc import Sequence

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from contact.errors import InputError
from skfem_adini.ground.arguments import finite_number, numbers, positive_number

Array = NDArray[np.float64]


def self_affine(
    n: int | Sequence[int],
    hurst: float,
    rms: float,
    cutoffs: tuple[float, float],
    seed: int,
    *,
    rolloff: float | None = None,
    lengths: Sequence[float] | None = None,
) -> Array:
    r"""Heights of a periodic self-affine surface or profile, with mean zero.

    The power spectral density is a power law of the wave number between the cutoffs and zero
    elsewhere, with phases from a generator of random numbers,

    .. math:: C(q) \propto \max(q, q_r)^{-2 (1 + H)}, \qquad q_0 \le q \le q_1,

    for a surface, and with the exponent :math:`-(1 + 2 H)` for a profile. The amplitudes are
    exactly those of C, and the root mean square of the heights is exactly `rms`.

    Parameters
    ----------
    n : int or sequence of int
        Points along each direction: an int for a square surface, a sequence of one for a profile.
    hurst : float
        The Hurst exponent H, between 0 and 1; the fractal dimension of the surface is 3 - H.
    rms : float
        Root mean square of the heights, in length units.
    cutoffs : (float, float)
        Lowest and highest wave number q_0, q_1, in waves along the first side. The highest lies
        below that of Nyquist: half the points of any direction, measured likewise.
    seed : int
        Of the phases. They belong to the waves, so that the same seed with more points gives the
        same surface on a finer grid.
    rolloff : float, optional
        Wave number q_r, below which the spectrum is constant. Default: q_0.
    lengths : sequence of float, optional
        Sides, of which only the proportions matter. Default: proportional to n.

    Returns
    -------
    ndarray, shape (n,) or (nx, ny)

    Raises
    ------
    InputError
        Wave numbers that the grid does not resolve, or none between the cutoffs; numbers out of
        their range.

    References
    ----------
    T. D. B. Jacobs, T. Junge and L. Pastewka, Quantitative characterization of surface topography
    using spectral analysis, Surface Topography: Metrology and Properties 5 (2017) 013001: the
    spectrum and its normalisation. M. H. Mueser et al., Meeting the contact-mechanics challenge,
    Tribology Letters 65 (2017) 118: constant below the roll-off, random phases.

    Examples
    --------
    >>> h = self_affine(64, 0.8, 1e-6, (2, 16), seed=1)
    >>> print(h.shape, np.sqrt(np.mean(h**2)))
    (64, 64) 1e-06
    >>> fine = self_affine(128, 0.8, 1e-6, (2, 16), seed=1)
    >>> bool(np.allclose(fine[::2, ::2], h, rtol=0, atol=1e-18))
    True
    """
    shape = _points(n)
    exponent = 2 * finite_number("hurst", hurst) + len(shape)
    if not 0 <= hurst <= 1:
        raise InputError(f"hurst={hurst!r}: expected a number between 0 and 1")
    low, high = _cutoffs(cutoffs)
    aspect = _aspect(shape, lengths)
    if any(high >= 0.5 * m / a for m, a in zip(shape, aspect, strict=True)):
        raise InputError(
            f"cutoffs={cutoffs!r}: waves beyond half the points a side are not resolved by "
            f"{shape} points; lower the second or take more points"
        )
    flat = low if rolloff is None else positive_number("rolloff", rolloff)
    try:
        generator = np.random.default_rng(seed)
    except (TypeError, ValueError) as error:
        raise InputError(f"seed={seed!r}: {error}") from None
    # Half of the waves, the others being conjugate: numbers within a box that no grid changes.
    most = [int(high * a) for a in aspect]
    waves = np.meshgrid(
        *(np.arange(-m, m + 1) for m in most[:-1]), np.arange(most[-1] + 1), indexing="ij"
    )
    phases = 2 * np.pi * generator.random(waves[0].shape)
    q = np.sqrt(sum((k / a) ** 2 for k, a in zip(waves, aspect, strict=True)))
    kept = (q >= low) & (q <= high) & ~((waves[-1] == 0) & (waves[0] < 0))
    if not np.any(kept):
        raise InputError(f"cutoffs={cutoffs!r}: no wave of the period lies between them")
    amplitude = np.maximum(q[kept], flat) ** (-0.5 * exponent) * np.exp(1j * phases[kept])
    h = _sum_of_waves(shape, [k[kept] for k in waves], amplitude)
    # By Parseval: every kept wave stands for itself and its conjugate.
    exact = np.sqrt(2 * np.sum(np.abs(amplitude) ** 2))
    return np.asarray(h * (positive_number("rms", rms) / exact))


def _points(n: int | Sequence[int]) -> tuple[int, ...]:
    try:
        given = tuple(operator.index(m) for m in (n if isinstance(n, Sequence) else (n, n)))
    except TypeError:
        given = ()
    if len(given) not in (1, 2) or min(given) < 4:
        raise InputError(f"n={n!r}: expected one or two numbers of points, each at least 4")
    return given


def _cutoffs(cutoffs: tuple[float, float]) -> tuple[float, float]:
    pair = numbers("cutoffs", cutoffs)
    if pair.shape != (2,) or not 0 < pair[0] <= pair[1] < np.inf:
        raise InputError(f"cutoffs={cutoffs!r}: expected two wave numbers, 0 < lowest <= highest")
    return float(pair[0]), float(pair[1])


def _aspect(shape: tuple[int, ...], lengths: Sequence[float] | None) -> list[float]:
    """Sides in units of the first."""
    sides = (
        np.array(shape, float) if lengths is None else np.atleast_1d(numbers("lengths", lengths))
    )
    if sides.shape != (len(shape),) or not np.all((sides > 0) & np.isfinite(sides)):
        raise InputError(f"lengths={lengths!r}: expected {len(shape)} positive numbers")
    return list((sides / sides[0]).tolist())


def _sum_of_waves(
    shape: tuple[int, ...], waves: list[NDArray[np.int64]], amplitude: NDArray[np.complex128]
) -> Array:
    """The sum of amplitude exp(i k x) and its conjugate on the grid."""
    spectrum = np.zeros((*shape[:-1], shape[-1] // 2 + 1), dtype=complex)
    spectrum[tuple(waves)] = amplitude
    alone = waves[-1] == 0  # the conjugate is not implied by the half spectrum
    if len(shape) == 2:
        spectrum[-waves[0][alone], 0] = amplitude[alone].conj()
    return np.asarray(scipy.fft.irfftn(spectrum, s=shape)) * float(np.prod(shape))
