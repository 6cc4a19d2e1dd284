"""Paths of points on the unit sphere, followed in space, where a pole is a point like others."""

from __future__ import annotations

from collections.abc import Callable
from inspect import Parameter, signature
from typing import Any

import numpy as np

from cip.errors import InputError, NotConverged, NotFinite
from cip.formulas.sphere_spline import interpolated, value_spline
from cip.grid import Array, Sphere, in_space
from skfem_adini.ground.arguments import real_array

Wind = Callable[[Array, Array, float], Any]

# Dormand and Prince's pair of orders 5 and 4 (J. Comput. Appl. Math. 6, 1980, 19-26): rows of
# the stages, of which the last one is the step, their times, and the difference of the results.
STAGES = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
TIMES = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
ERROR = (
    71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40,
)  # fmt: skip
SUBSTEPS = 1024  # of a step: with more the velocity is not smooth, or dt far too long


def wind_of(velocity: Any, sphere: Sphere) -> tuple[Wind, bool]:
    """A velocity as a function of (lon, lat, t), and whether it is steady."""
    if callable(velocity):
        try:
            found = signature(velocity).parameters.values()
        except (TypeError, ValueError):
            return velocity, False
        plain = [
            one
            for one in found
            if one.kind in (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
            and one.default is Parameter.empty
        ]
        if len(plain) == 2:
            return lambda lon, lat, t: velocity(lon, lat), True
        return velocity, False
    what = "velocity: expected a function (lon, lat, t) of two speeds, or of one level their values"
    speeds = real_array(what, velocity).astype(float)
    if speeds.shape != (2, *sphere.cells):
        raise InputError(f"{what}, shape {(2, *sphere.cells)}; got shape {speeds.shape}")
    if not np.isfinite(speeds).all():
        raise InputError("velocity: some of its values are not finite")
    lon, lat = sphere.mesh()
    coefs = value_spline(_vector(speeds, in_space(lon, lat)), 5)

    def wind(lon: Array, lat: Array, t: float) -> tuple[Array, Array]:
        x, y, z = interpolated(coefs, in_space(lon, lat))
        along = np.cos(lon) * x + np.sin(lon) * y
        return np.cos(lon) * y - np.sin(lon) * x, np.cos(lat) * z - np.sin(lat) * along

    return wind, True


def _vector(speeds: Any, at: Array) -> Array:
    """The velocity in space with speeds to the east and north, at points of the unit sphere."""
    (u, v), (x, y, z) = speeds, at
    r = np.hypot(x, y)
    pole = r == 0.0
    along, across = np.where(pole, 1.0, x) / (r + pole), y / (r + pole)
    return np.stack([-z * along * v - across * u, -z * across * v + along * u, r * v])


def traced(
    wind: Wind, points: Array, t_end: float, dt: float, radius: float, tolerance: float
) -> Array:
    """Where the flow carried points (3, n) from, dt before t_end. The number of equal sub-steps is
    found on some of them, and grows where the estimate of all, the sum of the differences of both
    orders along a path, exceeds the `tolerance`, an angle."""

    def rate(at: Array, t: float) -> Array:
        lon, lat = np.arctan2(at[1], at[0]), np.arctan2(at[2], np.hypot(at[0], at[1]))
        with np.errstate(all="ignore"):
            found = wind(lon, lat, t)
        try:
            u, v = (
                np.broadcast_to(real_array("they are not real", one), lon.shape) for one in found
            )
        except (TypeError, ValueError, InputError) as error:
            raise InputError(
                "velocity: expected two arrays, speeds to the east and to the north, of the shape "
                f"of lon and lat ({error})"
            ) from error
        if not (np.isfinite(u).all() and np.isfinite(v).all()):
            k = int(np.argmin(np.isfinite(u) & np.isfinite(v)))
            place = f"lon = {lon[k]:.6g}, lat = {lat[k]:.6g} at t = {t:.6g}"
            raise NotFinite(f"velocity: it is ({u[k]}, {v[k]}) at {place}")
        return _vector((u, v), at / np.sqrt((at * at).sum(0))) / radius

    def follow(at: Array, count: int) -> tuple[Array, float]:
        h, error = dt / count, np.zeros(at.shape[1])
        for k in range(count):
            t, now = t_end - k * h, at
            rates: list[Array] = []
            for row, when in zip(STAGES, TIMES, strict=True):
                at = now - h * sum(a * one for a, one in zip(row, rates, strict=True) if a)
                rates.append(rate(at, t - when * h))
            error += np.abs(h * sum(a * one for a, one in zip(ERROR, rates, strict=True))).max(0)
            at = at / np.sqrt((at * at).sum(0))
        return at, float(error.max())

    count, some = 1, points[:, :: max(1, points.shape[1] // 512)]
    for sample in (some, points):
        while True:
            found, error = follow(sample, count)
            if error <= tolerance:
                break
            if count >= SUBSTEPS:
                raise NotConverged(
                    f"paths: after {count} sub-steps over dt = {dt:.6g} from t = {t_end:.6g} the "
                    f"error is {error:.1e} radians, above {tolerance:.1e}; is the velocity smooth? "
                    "Take a smaller dt, or a larger foot_tolerance"
                )
            # Where the velocity is not smooth, half as many more each time reach the end soon.
            more = count * min(max(1.1 * (error / tolerance) ** 0.2, 1.5), 8.0)
            count = min(SUBSTEPS, int(np.ceil(more)))
    return found
