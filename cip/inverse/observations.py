"""What was observed, when, and which linear map of the state it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, issparse

from cip.assimilation.sensors import Sensors
from cip.errors import InputError
from cip.grid import Grid
from cip.reals import masked_array, real_array, real_number

Array = NDArray[np.float64]
_ENTRIES = "data: entries of the operators"


@runtime_checkable
class Observations(Protocol):
    """Data of `identify_velocity` besides snapshots: linear maps of states at some times."""

    times: Any  # increasing
    values: Any  # for each time the data, shape (m,)
    operators: Any  # for each time (m, N), applied to state.data.ravel()


class Data:
    """Observations, each divided by its standard deviation; all are later than `start`. `given`
    maps times to nodal values (masked: missing), or is `Sensors` or `Observations`. `weights` are 1
    / deviation, or 1 / rms of all data if the noise is 0 (`exact`) or not `known`."""

    def __init__(
        self, given: Any, noise: Any, grid: Grid, profile: str, moments: int, start: float
    ) -> None:
        if isinstance(given, Sensors):
            given = given.reports(grid, profile)
        if isinstance(given, Mapping):
            self.times, self.values, self.operators = _snapshots(given, grid, moments)
        elif isinstance(given, Observations):
            self.times, self.values, self.operators = _observed(given, grid.size * moments)
        else:
            raise InputError(
                "data: expected arrays of nodal values by times, {t: array}, Sensors, or an object "
                f"with times, values and operators, got {type(given).__name__}"
            )
        if not self.times[0] > start:
            raise InputError(
                f"data: the first time is {self.times[0]:.6g}, expected one after that of the "
                f"start, {start:.6g}"
            )
        sizes = [one.size for one in self.values]
        if not sum(sizes):
            raise InputError("data: every value is masked or missing")
        several = noise is not None and real_array(noise, "noise").ndim > 0
        if isinstance(given, Mapping) and several and list(given) != sorted(given):
            raise InputError(
                "noise: with one for each time give the data in the order of time, too"
            )
        own = getattr(given, "deviations", None)
        if own is not None and noise is not None:
            raise InputError("noise: the data have deviations of their own; leave it out")
        found = _own(own, sizes) if own is not None else _deviations(noise, sizes)
        self.known = bool(np.all(found > 0.0))
        self.exact = noise is not None and not self.known
        if not self.known:
            size = float(np.sqrt(np.mean(self.flat() ** 2)))
            found = np.full(sum(sizes), size if size > 0.0 else 1.0)
        self.weights = 1.0 / found

    @property
    def size(self) -> int:
        """Number of values."""
        return self.weights.size

    def flat(self) -> Array:
        """All values in one row."""
        return np.concatenate(self.values)


def _snapshots(
    given: Mapping[Any, Any], grid: Grid, moments: int
) -> tuple[list[float], list[Array], list[Any]]:
    if not given:
        raise InputError("data: expected at least one snapshot")
    keys = sorted((real_number(key, "data: times"), key) for key in given)
    times, values, operators = [t for t, _ in keys], [], []
    if not np.isfinite(times).all():
        raise InputError("data: expected finite times")
    for t, key in keys:
        name = f"data: snapshot at t = {t:.6g}"
        array, hidden = masked_array(given[key], name)
        array = array.astype(float)
        if array.shape != grid.nodes:
            raise InputError(
                f"{name}: expected nodal values, shape {grid.nodes}, got {array.shape}"
            )
        if not np.isfinite(array).all():
            raise InputError(f"{name}: NaN or infinity; mask what is missing (numpy.ma)")
        kept = np.arange(grid.size) if hidden is None else np.flatnonzero(~hidden)
        ones = (np.ones(kept.size), (np.arange(kept.size), kept))
        values.append(array.ravel()[kept])
        operators.append(csr_array(ones, shape=(kept.size, grid.size * moments)))
    return times, values, operators


def _observed(given: Observations, size: int) -> tuple[list[float], list[Array], list[Any]]:
    times = real_array(given.times, "data: times").astype(float)
    if times.ndim != 1 or not times.size or np.any(np.diff(times) <= 0.0):
        raise InputError("data: expected increasing times")
    for one in (given.values, given.operators):
        if not (hasattr(one, "__len__") and len(one) == times.size):
            raise InputError("data: expected values and an operator for each time")
    values = [real_array(one, "data: values").astype(float) for one in given.values]
    for one, operator in zip(values, given.operators, strict=True):
        shape = getattr(operator, "shape", None)
        if shape != (one.size, size) or one.ndim != 1:
            raise InputError(
                f"data: expected values of shape (m,) and operators of shape (m, {size}), got "
                f"{one.shape} and {shape or type(operator).__name__}"
            )
        entries = getattr(operator, "data", None) if issparse(operator) else operator
        if isinstance(entries, np.ndarray) and not np.isfinite(real_array(entries, _ENTRIES)).all():
            raise InputError(f"{_ENTRIES}: NaN or infinity among them")
        if not np.isfinite(one).all():
            raise InputError("data: NaN or infinity among the values; leave missing ones out")
    return [float(t) for t in times], values, list(given.operators)


def _own(given: Any, sizes: list[int]) -> Array:
    """Standard deviations that the data bring with them, flat."""
    if not (hasattr(given, "__len__") and len(given) == len(sizes)):
        raise InputError(f"data: expected deviations for each of {len(sizes)} times")
    found = [real_array(one, "data: deviations").astype(float) for one in given]
    if [one.shape for one in found] != [(n,) for n in sizes]:
        raise InputError("data: expected deviations of the shapes of the values")
    flat = np.concatenate(found)
    if not (np.isfinite(flat).all() and np.all(flat > 0.0)):
        raise InputError("data: expected finite, positive deviations")
    return flat


def _deviations(noise: Any, sizes: list[int]) -> Array:
    """The argument `noise` for each value; 0 where it is unknown."""
    times = len(sizes)
    if noise is None:
        return np.zeros(sum(sizes))
    found = real_array(noise, "noise: expected standard deviations").astype(float)
    if found.ndim and found.shape != (times,):
        raise InputError(f"noise: expected one number, or one for each of {times} times")
    found = np.broadcast_to(found, (times,))
    if not np.isfinite(found).all() or np.any(found < 0.0):
        raise InputError(f"noise: expected standard deviations >= 0, got {noise!r}")
    if np.any(found == 0.0) and np.any(found > 0.0):
        raise InputError("noise: expected 0 for all times or for none")
    return np.repeat(found, sizes)
