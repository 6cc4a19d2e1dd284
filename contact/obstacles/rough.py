"""A rough surface as a rigid obstacle: heights over a plane, measured or from a spectrum."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy
import scipy.fft
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from contact.obstacles.arguments import (
    GRAZING,
    column,
    direction,
    positive_lengths,
    reading,
    vector,
)
from contact.obstacles.rigid_motion import RigidMotion, turn_of
from contact.obstacles.signed_distance import SignedDistance
from skfem_adini.ground.arguments import (
    array_of,
    choice,
    evaluated,
    finite_number,
    flag,
    numbers,
    positive_number,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Rough:
    r"""The obstacle behind a surface of given heights over a plane.

    Between the points of the grid the heights are a tensor product of cubic splines, with two
    continuous derivatives, or bilinear. Along the normal of the plane the gap is the difference of
    heights; along other normals it is the distance to the first intersection of the ray with the
    surface.

    Parameters
    ----------
    heights : array_like, shape (n,) for a body in 2-D, (nx, ny) in 3-D
        In length units, measured out of the obstacle, the first index along the first axis.
    lengths : float or sequence of float
        The period, one number an axis; a patch's size if it is not periodic. The points of a period
        are length / n apart, those of a patch length / (n - 1), from edge to edge.
    point : sequence of float, optional
        Where the first height would be zero. Default: the origin.
    normal : sequence of float, optional
        Out of the obstacle, towards the body; need not be a unit vector. Default: along y in 2-D
        and along z in 3-D. The axes of the grid are the other coordinate axes in their order, made
        perpendicular to the normal and to each other where it is oblique.
    periodic : bool
        Beyond the edge of a patch, if it is not periodic, there is no obstacle.
    interpolation : "cubic" or "linear"

    Attributes
    ----------
    rms_height, rms_slope : float
        Root mean square of the heights about their mean, and of the length of their gradient. Both
        are sums over the spectrum, and need a periodic surface.

    Raises
    ------
    InputError
        Heights with NaN or of another number of axes, too few of them; lengths that are not
        positive.

    Notes
    -----
    In a `ClosestPoint` the distance is the height above the surface over the length of
    :math:`(1, -\nabla h)`: exact to first order in the gap. Its gradient is the normal of the
    surface below the place.

    References
    ----------
    T. D. B. Jacobs, T. Junge and L. Pastewka, Quantitative characterization of surface topography
    using spectral analysis, Surface Topography: Metrology and Properties 5 (2017) 013001.

    Examples
    --------
    A wavy foundation, whose crests are .1 below the origin:

    >>> x = np.arange(32) / 32
    >>> wavy = Rough(0.01 * (np.cos(2 * np.pi * x) - 1.0), 1.0, point=(0.0, -0.1))
    >>> wavy
    Rough(32 points, rms height 0.00707)
    >>> wavy(np.array([[0.0, 1.5], [0.0, 0.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]])).round(12)
    array([0.1 , 0.12])
    >>> print(round(wavy.rms_slope / wavy.rms_height / (2 * np.pi), 12))
    1.0
    """

    heights: Array
    lengths: float | Sequence[float]
    point: Sequence[float] | None = None
    normal: Sequence[float] | None = None
    periodic: bool = True
    interpolation: Literal["cubic", "linear"] = "cubic"
    _surface: HeightSpline = field(init=False)
    _frame: tuple[Array, Array, Array] = field(init=False)

    def __post_init__(self) -> None:
        degrees = {"linear": 1, "cubic": 3}
        degree = degrees[choice("interpolation", self.interpolation, degrees)]
        periodic = flag("periodic", self.periodic)
        heights = numbers("heights", self.heights)
        if heights.ndim not in (1, 2) or min(heights.shape) <= degree:
            raise InputError(
                f"heights: of shape {heights.shape}, expected (n,) for a body in two dimensions or "
                f"(nx, ny) in three, with more than {degree} points along each axis"
            )
        if not np.all(np.isfinite(heights)):
            raise InputError("heights: hold NaN or infinite values; fill them in")
        lengths = positive_lengths(self.lengths, heights.ndim)
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "lengths", tuple(lengths.tolist()))
        object.__setattr__(self, "_frame", self._placed(heights.ndim + 1))
        surface = HeightSpline.through(heights, lengths, degree, periodic)
        object.__setattr__(self, "_surface", surface)

    def _placed(self, dim: int) -> tuple[Array, Array, Array]:
        """Origin (dim,), axes of the grid (dim - 1, dim) and unit normal (dim,)."""
        upright = np.eye(dim)[-1]
        origin = np.zeros(dim) if self.point is None else vector("point", self.point)
        normal = upright if self.normal is None else direction("normal", self.normal)
        for name, given in (("point", origin), ("normal", normal)):
            if given.size != dim:
                raise InputError(f"{name}: expected {dim} numbers, for heights of {dim - 1} axes")
        unit = normal / np.linalg.norm(normal)
        axes: list[Array] = []
        for e in np.delete(np.eye(dim), np.argmax(np.abs(unit)), axis=0):
            for known in (unit, *axes):
                e = e - known * (known @ e)
            axes.append(e / np.linalg.norm(e))
        return origin, np.array(axes), unit

    @classmethod
    def from_file(
        cls,
        path: str | PathLike[str],
        lengths: float | Sequence[float],
        scale: float = 1.0,
        **settings: Any,
    ) -> Rough:
        """Read heights from a `.npy` file, a table of numbers or a grey image.

        Parameters
        ----------
        path : str or path
            Tables (`.txt`, `.csv`, `.dat`, `.asc`) hold a row of numbers a line, which runs along
            the last axis, with decimal commas if blanks or semicolons part the numbers; `.xyz`
            files hold a line x y height for each point of a grid, of which the heights are taken;
            grey values of a `.png` lie between 0 and 1, the first axis of the surface runs to the
            right and the second up.
        lengths : float or sequence of float
        scale : float
            Unit of the file's heights in that of the body: 1e-9 for nm and a body in m.
        **settings
            `point`, `normal`, `periodic`, `interpolation` of `Rough`.

        Returns
        -------
        Rough

        Raises
        ------
        InputError
            No such file, another format, nothing in it; what `Rough` refuses.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     np.savetxt(folder + "/map.txt", np.arange(30.0).reshape(5, 6))
        ...     Rough.from_file(folder + "/map.txt", (1.0, 1.0), scale=1e-9, periodic=False)
        Rough(5 x 6 points, patch)
        """
        return cls(positive_number("scale", scale) * read_heights(path), lengths, **settings)

    @classmethod
    def from_function(
        cls,
        function: Callable[[Array], ArrayLike],
        lengths: float | Sequence[float],
        shape: int | Sequence[int],
        **settings: Any,
    ) -> Rough:
        """Take a function's heights at the points of a grid.

        Parameters
        ----------
        function : callable t -> ndarray
            Of places t on the plane, of shape (dim - 1, npoints).
        lengths : float or sequence of float
        shape : int or sequence of int
            Points along each axis.
        **settings
            `point`, `normal`, `periodic`, `interpolation` of `Rough`.

        Returns
        -------
        Rough

        Raises
        ------
        InputError
            A function that returns no heights, numbers of points that are not positive; what
            `Rough` refuses.

        Examples
        --------
        >>> Rough.from_function(lambda t: np.cos(t[0]) * np.cos(t[1]), (2 * np.pi,) * 2, (16, 16))
        Rough(16 x 16 points, rms height 0.5)
        """
        sides = np.atleast_1d(numbers("lengths", lengths))
        points = np.atleast_1d(array_of("shape", shape))
        if points.dtype.kind not in "iu" or points.shape != sides.shape or np.any(points < 2):
            raise InputError(f"shape={shape!r}: expected {sides.size} numbers of points")
        closed = not flag("periodic", settings.get("periodic", True))
        axes = [np.linspace(0, s, m, endpoint=closed) for s, m in zip(sides, points, strict=True)]
        t = np.array([a.ravel() for a in np.meshgrid(*axes, indexing="ij")])
        values = evaluated("function", function, t)
        if values.shape != t.shape[1:]:
            raise InputError(f"function: returned {values.shape}, expected {t.shape[1:]} heights")
        return cls(values.reshape(tuple(points.tolist())), lengths, **settings)

    def __repr__(self) -> str:
        """Return the class with the number of points, not the heights."""
        size = " x ".join(map(str, self.heights.shape))
        kind = f"rms height {self.rms_height:.3g}" if self.periodic else "patch"
        return f"Rough({size} points, {kind})"

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        _, axes, unit = self._frame
        towards = -np.sum(n * column(unit, x), axis=0)
        across = np.abs(np.tensordot(axes, n, axes=1)).sum(axis=0)
        straight = (across <= 1e-14) & (towards > GRAZING)
        gap = np.where(straight, self._above(x), np.inf)
        skew = ~straight & (towards > GRAZING)
        if np.any(skew):
            march = SignedDistance(lambda y: self._above(y) / np.hypot(1.0, self._surface.steepest))
            gap[skew] = march(x[:, skew], n[:, skew])
        met = x + np.where(np.isfinite(gap), gap, 0.0) * n
        gap[~self._surface.within(self._on_plane(met))] = np.inf
        return gap

    def gap_over(self, axes: Sequence[Array], n: Array) -> Array | None:
        """Gap along n from the points of a grid on the coordinate plane through the origin.

        Parameters
        ----------
        axes : sequence of ndarray
            Coordinates along each axis of the grid.
        n : ndarray, shape (dim,)
            Along a coordinate axis.

        Returns
        -------
        ndarray, shape (n,) or (nx, ny)
            None if the surface ends, is oblique or faces away: then evaluate point by point.

        Examples
        --------
        >>> wavy = Rough([0.0, 0.2, 0.4, 0.2], 1.0, point=(0.0, -1.0), interpolation="linear")
        >>> print(wavy.gap_over([np.array([0.0, 0.25, 0.375])], np.array([0.0, -1.0])))
        [1.  0.8 0.7]
        """
        origin, frame, unit = self._frame
        if not self.periodic or np.any(frame @ n) or unit @ n >= 0:
            return None
        places = [x - frame[i] @ origin for i, x in enumerate(axes)]
        return np.asarray(-(origin @ unit) - self._surface.over(places))

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Distance from the surface to first order, positive above, and its gradient.

        Parameters
        ----------
        x : ndarray, shape (dim, ...)

        Returns
        -------
        distance : ndarray, shape (...)
        gradient : ndarray, shape (dim, ...)

        Examples
        --------
        >>> ramp = Rough(np.linspace(0.0, 0.75, 5), 1.0, periodic=False)
        >>> d, normal = ramp.distance(np.array([[0.5], [1.375]]))
        >>> print(d.round(12), normal.ravel().round(12))
        [0.8] [-0.6  0.8]
        """
        _, axes, unit = self._frame
        on = self._on_plane(x)
        slope = self._surface.slope(on)
        length = np.sqrt(1.0 + np.sum(slope**2, axis=0))
        upward = column(unit, x) - np.tensordot(axes.T, slope, axes=1)
        distance = np.where(self._surface.within(on), self._above(x) / length, np.inf)
        return distance, upward / length

    def spectrum(self) -> tuple[Array, Array]:
        r"""Wave numbers and the power spectral density of the periodic heights.

        With N heights over the area (or length) A it is :math:`C(q) = A |\hat h(q)|^2`, where
        :math:`\hat h = N^{-1} \sum h e^{-i q x}`, so that the mean square of the heights is
        :math:`A^{-1} \sum C(q)`.

        Returns
        -------
        q : ndarray, shape (dim - 1, n) or (dim - 1, nx, ny)
            Wave vectors, in radians a length, in the order of `scipy.fft`.
        C : ndarray, shape (n,) or (nx, ny)
            Length cubed of a profile, to the fourth of a surface; zero at q = 0.

        Raises
        ------
        InputError
            A patch, which has no spectrum without a window.

        Examples
        --------
        >>> wave = Rough(np.cos(2 * np.pi * np.arange(8) / 8), 1.0)
        >>> q, C = wave.spectrum()
        >>> print(np.flatnonzero(C > 1e-9), C.sum().round(12))
        [1 7] 0.5
        """
        if not self.periodic:
            raise InputError("periodic: the spectrum of a patch depends on a window; none is taken")
        return power_spectrum(self.heights, list(self._surface.lengths))

    @property
    def rms_height(self) -> float:
        """Root mean square of the heights about their mean."""
        return float(np.sqrt(np.sum(self.spectrum()[1]) / np.prod(self._surface.lengths)))

    @property
    def rms_slope(self) -> float:
        """Root mean square of the gradient's length, by the derivative of the Fourier series."""
        q, C = self.spectrum()
        return float(np.sqrt(np.sum(np.sum(q**2, axis=0) * C) / np.prod(self._surface.lengths)))

    def motion_from(self, before: Rough) -> RigidMotion | None:
        """Motion of `point` and the axes of the grid.

        Parameters
        ----------
        before : Rough

        Returns
        -------
        RigidMotion or None
            None if the heights differ.
        """
        same = before.heights is self.heights or np.array_equal(before.heights, self.heights)
        settings = ("lengths", "periodic", "interpolation")
        if not same or any(getattr(before, name) != getattr(self, name) for name in settings):
            return None
        (p, *was), (q, *now) = before._frame, self._frame
        turn = turn_of(np.vstack(now).T @ np.vstack(was))
        return None if turn is None else RigidMotion.between(p, q, turn)

    def _on_plane(self, x: Array) -> Array:
        """Coordinates on the plane (dim - 1, ...) of places x."""
        origin, axes, _ = self._frame
        return np.asarray(np.tensordot(axes, x - column(origin, x), axes=1))

    def _above(self, x: Array) -> Array:
        """Height of points x above the surface, along the normal of the plane."""
        origin, _, unit = self._frame
        level = np.sum((x - column(origin, x)) * column(unit, x), axis=0)
        return np.asarray(level - self._surface.height(self._on_plane(x)))


def power_spectrum(values: Array, lengths: Sequence[float]) -> tuple[Array, Array]:
    """Wave vectors and power spectral density of periodic values; see `Rough.spectrum`."""
    sides = zip(values.shape, lengths, strict=True)
    waves = [2 * np.pi * scipy.fft.fftfreq(m, s / m) for m, s in sides]
    part = scipy.fft.fftn(values - values.mean()) / values.size
    C = float(np.prod(lengths)) * np.abs(part) ** 2
    return np.array(np.meshgrid(*waves, indexing="ij")), C


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
    shape = _grid(n)
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
    # Half of the waves (the others are conjugate), within a box that does not depend on the grid.
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


def _grid(n: int | Sequence[int]) -> tuple[int, ...]:
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
    sides = positive_lengths(shape if lengths is None else lengths, len(shape))
    return list((sides / sides[0]).tolist())


def _sum_of_waves(
    shape: tuple[int, ...], waves: list[NDArray[np.int64]], amplitude: NDArray[np.complex128]
) -> Array:
    """The sum of amplitude exp(i k x) and its conjugate on the grid."""
    spectrum = np.zeros((*shape[:-1], shape[-1] // 2 + 1), dtype=complex)
    spectrum[tuple(waves)] = amplitude
    alone = waves[-1] == 0  # the half spectrum does not imply their conjugates
    if len(shape) == 2:
        spectrum[-waves[0][alone], 0] = amplitude[alone].conj()
    return np.asarray(scipy.fft.irfftn(spectrum, s=shape)) * float(np.prod(shape))


@dataclass(frozen=True, eq=False)
class HeightSpline:
    """A spline through the heights, periodic or on one patch."""

    lengths: Array  # period, or size of the patch, shape (dim - 1,)
    periodic: bool
    steepest: float  # bound of the slope
    _spline: Any
    _heights: Array

    @classmethod
    def through(cls, heights: Array, lengths: Array, degree: int, periodic: bool) -> HeightSpline:
        """The spline of degree 1 or 3 that takes the given heights on an equidistant grid."""
        knots, slopes = [], []
        closed = np.pad(heights, [(0, 1)] * heights.ndim, mode="wrap") if periodic else heights
        c = closed
        for axis, length in enumerate(lengths):
            x = np.linspace(0.0, length, closed.shape[axis])
            kind: Literal["periodic"] | None = "periodic" if periodic and degree > 1 else None
            piece = scipy.interpolate.make_interp_spline(x, c, degree, bc_type=kind, axis=axis)
            knots.append(piece.t)
            c = np.moveaxis(np.asarray(piece.c), 0, axis)
        for axis, t in enumerate(knots):
            # Coefficients of the derivative bound it, as its B-splines sum to one.
            rise = np.diff(c, axis=axis)
            run = (t[degree + 1 : -1] - t[1 : -degree - 1]) / degree
            shape = [1] * rise.ndim
            shape[axis] = run.size
            slopes.append(float(np.abs(rise / run.reshape(shape)).max()))
        spline = scipy.interpolate.NdBSpline(tuple(knots), c, degree, extrapolate=False)
        return cls(lengths, periodic, float(np.hypot.reduce(slopes)), spline, heights)

    def within(self, places: Array) -> NDArray[np.bool_]:
        """Whether places (dim - 1, ...) lie on the surface: all of them do if it is periodic."""
        if self.periodic:
            return np.ones(places.shape[1:], dtype=bool)
        size = column(self.lengths, places)
        slack = 1e-9 * size
        return np.asarray(np.all((places >= -slack) & (places <= size + slack), axis=0))

    def height(self, places: Array) -> Array:
        """Heights at places (dim - 1, ...), constant beyond the edge of a patch."""
        return self._value(places, np.zeros(len(places), dtype=int))

    def over(self, axes: Sequence[Array]) -> Array:
        """Heights of a periodic surface on the tensor grid of the coordinates `axes`.
        At the surface's own points they are the given heights."""
        numbers = []
        for x, length, n in zip(axes, self.lengths, self._heights.shape, strict=True):
            number = np.rint(x * (n / length))
            if np.abs(x * (n / length) - number).max(initial=0.0) > 1e-12 * n:
                return self._on_grid(list(axes), np.zeros(len(axes), dtype=int))
            numbers.append(number.astype(np.int64) % n)
        return self._heights[np.ix_(*numbers)]

    def slope(self, places: Array) -> Array:
        """Derivatives along each direction at places (dim - 1, ...), of the same shape."""
        return np.array([self._value(places, row) for row in np.eye(len(places), dtype=int)])

    def _value(self, places: Array, order: NDArray[np.int64]) -> Array:
        size = column(self.lengths, places)
        axes = _axes(places)
        if axes is not None:
            return self._on_grid(axes, order)
        inside = places % size if self.periodic else places
        return np.asarray(self._spline(np.moveaxis(np.clip(inside, 0.0, size), 0, -1), nu=order))

    def _on_grid(self, axes: list[Array], order: NDArray[np.int64]) -> Array:
        """Values on a tensor grid, direction by direction: much faster than point by point."""
        values = self._spline.c
        for axis, (x, length, nu) in enumerate(zip(axes, self.lengths, order, strict=True)):
            inside = np.clip(x % length if self.periodic else x, 0.0, length)
            t, degree = self._spline.t[axis], self._spline.k[axis]
            values = scipy.interpolate.BSpline(t, values, degree, axis=axis)(inside, nu=nu)
        return np.asarray(values)


def _axes(places: Array) -> list[Array] | None:
    """Coordinates along each axis if points (dim - 1, ...) form a tensor grid, else None."""
    if places.ndim != len(places) + 1 or not places.size:
        return None
    axes = []
    for i, x in enumerate(places):
        lines = np.moveaxis(x, i, 0).reshape(x.shape[i], -1)
        if not np.all(lines == lines[:, :1]):
            return None
        axes.append(lines[:, 0])
    return axes


def read_heights(path: str | PathLike[str]) -> Array:
    """The numbers of a file: first index along the first axis of the surface."""
    tables = (".txt", ".csv", ".dat", ".asc")
    with reading(path, (".npy", *tables, ".xyz", ".png"), "heights") as place:
        kind = place.suffix.lower()
        if kind == ".npy":
            return _array(place)
        if kind == ".xyz":
            return _points(place)
        return _table(place) if kind in tables else _image(place)


def _array(place: Path) -> Array:
    # Memory-mapped: a header that declares more numbers than the file has is refused unread.
    found = np.load(place, mmap_mode="r", allow_pickle=False)
    kind = found.dtype if isinstance(found, np.ndarray) else type(found).__name__
    if getattr(kind, "kind", "") not in tuple("biuf"):
        raise ValueError(f"expected real numbers, not {kind}")
    return np.array(found, dtype=float)


def _table(place: Path) -> Array:
    """One row of numbers per line, separated by blanks, commas or semicolons; # begins a comment.
    A comma is the decimal mark if other marks separate the numbers."""
    text = [line.partition("#")[0].strip() for line in place.read_text().splitlines()]
    lines = [line for line in text if line]
    if not lines:
        raise ValueError("it holds no numbers")
    comma = "." if _decimal_commas(lines) else " "
    rows = np.loadtxt([line.replace(",", comma).replace(";", " ") for line in lines], ndmin=2)
    return np.asarray(rows[:, 0] if rows.shape[1] == 1 else rows)


def _decimal_commas(lines: list[str]) -> bool:
    """Whether commas are decimal marks; raises `ValueError` if they may also be separators."""
    parts = [part for line in lines for part in line.replace(";", " ").split()]
    exponent = r"(?:[eE][+-]?\d+)?"
    with_comma, whole = (re.compile(n + exponent) for n in (r"[+-]?\d*,\d+", r"[+-]?\d+"))
    inside = [bool(with_comma.fullmatch(part)) for part in parts]
    if not any(inside):
        return False
    points, semicolons = (any(mark in line for line in lines) for mark in ".;")
    if points and not semicolons:
        return False
    plain = all(own or whole.fullmatch(part) for own, part in zip(inside, parts, strict=True))
    if plain and len(parts) > len(lines):
        return True
    raise ValueError(
        "its commas may be decimal marks or part the numbers; write decimal points, or a blank "
        "after each comma that parts numbers"
    )


def _points(place: Path) -> Array:
    """Lines x y height of all points of a rectangular grid, in any order."""
    found = _table(place)
    if found.ndim != 2 or found.shape[1] != 3:
        raise ValueError("expected three numbers a line: x, y and the height")
    size = np.ptp(found[:, :2], axis=0)
    index = []
    for t, length in zip(found[:, :2].T, size, strict=True):
        order = np.argsort(t)
        step = np.diff(t[order], prepend=t[order[0]]) > 1e-4 * length
        place_of = np.empty(t.size, dtype=int)
        place_of[order] = np.cumsum(step)
        apart = np.diff(t[order][np.flatnonzero(step)], prepend=t[order[0]])
        if apart.size and np.ptp(apart) > 0.2 * apart.mean():  # more than rounding of coordinates
            raise ValueError("the points of the grid are not equally far apart; interpolate them")
        index.append(place_of)
    shape = tuple(int(i.max()) + 1 for i in index)
    heights = np.full(shape, np.nan)
    heights[tuple(index)] = found[:, 2]
    if (
        found.shape[0] != heights.size
        or np.unique(np.ravel_multi_index(index, shape)).size < heights.size
    ):
        raise ValueError(f"{found.shape[0]} points do not fill a grid of {shape[0]} x {shape[1]}")
    return heights


def _image(place: Path) -> Array:
    """Grey values between 0 and 1, the mean of the colours; rows of pixels run downwards."""
    from matplotlib.image import imread

    pixels = np.asarray(imread(place), dtype=float)
    grey = pixels[..., :3].mean(axis=2) if pixels.ndim == 3 else pixels
    return np.ascontiguousarray(grey[::-1].T)
