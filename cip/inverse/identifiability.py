"""Which parts of a velocity the data determine: singular values and vectors of the sensitivity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cip.grid import AXES, Array, Grid


class _Seen(NamedTuple):  # thresholds of identifiability
    deviation: float = 0.5  # largest change of a determined part, relative to the velocity
    # A part that changes the data this much less than the best determined one is not determined:
    # the inverse would amplify errors of the scheme, which the noise level does not include.
    faint: float = 1e-3
    rounding: float = 1e-12  # relative: smaller singular values and changes of the velocity


SEEN = _Seen()


class IdentifiabilityWarning(UserWarning):
    """The data do not determine a part of the velocity, which the message names.

    What is returned there comes from the regularisation or the start, not from the data. Add
    snapshots at times that are no multiples of each other, start from a field that varies
    everywhere, or take fewer parameters.

    Examples
    --------
    A wave that has come back to where it was tells the mean speed alone:

    >>> import warnings
    >>> from cip import Grid, Solver, SplineVelocity, identify_velocity
    >>> grid = Grid((0, 1), 32, periodic=True)
    >>> solver = Solver(grid, SplineVelocity(grid, 8, 1.0))
    >>> start = solver.state("sin(2*pi*x1)")
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     found = identify_velocity(solver, start, {1.0: start["u"]}, dt=0.05, noise=1e-3)
    >>> "do not determine" in str(caught[0].message)
    True
    """


@dataclass(frozen=True)
class Identifiability:
    """Singular values and vectors of the sensitivity, in units of noise and velocity.

    Parameters are scaled so that one unit of each changes the velocity by one unit, root mean
    square over the grid.

    Attributes
    ----------
    singular_values : ndarray, shape (P,)
        Decreasing: root sum of squares of the changes of all data, in standard deviations, for a
        unit vector of scaled parameters.
    vectors : ndarray, shape (P, P)
        Rows: the directions, as changes of the parameters that change the velocity by one unit,
        root mean square.
    patterns : ndarray, shape (P, components) + nodes
        These changes of the velocity.
    deviations : ndarray, shape (P,)
        What the data alone leave of each: standard deviation of the velocity along it, over the
        root mean square of the velocity.
    seen : ndarray of bool, shape (P,)
        Which directions the data determine.
    unseen : tuple of str
        The others in words, the least visible first.

    Examples
    --------
    >>> from cip import Grid, Solver, SplineVelocity, identify_velocity
    >>> grid = Grid((0, 1), 48, periodic=True)
    >>> solver = Solver(grid, SplineVelocity(grid, 6, 1.0))
    >>> start = solver.state("sin(2*pi*x1) + cos(4*pi*x1)")
    >>> seen = Solver(grid, 1.1).run(start, 0.3, dt=0.03).final["u"]
    >>> found = identify_velocity(solver, start, {0.3: seen}, dt=0.03, noise=0.01)
    >>> found.identifiability.unseen, bool(found.identifiability.seen.all())
    ((), True)
    """

    singular_values: Array
    vectors: Array
    patterns: Array
    deviations: Array
    seen: NDArray[np.bool_]
    unseen: tuple[str, ...]

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Whether each direction changes no data at all."""
        return np.isinf(self.deviations)

    @property
    def condition(self) -> float:
        """The largest singular value over the smallest."""
        least = float(self.singular_values[-1])
        return float(self.singular_values[0]) / least if least > 0.0 else float("inf")

    def message(self) -> str:
        """A sentence on the undetermined parts; empty if everything is determined."""
        if not self.unseen:
            return ""
        several = len(self.unseen) > 3
        parts = "; ".join(self.unseen[:3]) + ("; ..." if several else "")
        return (
            f"velocity: the data do not determine {len(self.unseen)} of "
            f"{self.singular_values.size} directions: {parts}. Add snapshots at times that are no "
            "multiples of each other, a start that varies everywhere, or take fewer parameters"
        )


def identifiability(
    J: Array, slopes: Array, speed: float, variance: float, grid: Grid, names: tuple[str, ...]
) -> Identifiability:
    """Identifiability from the sensitivity J, shape (data, parameters), in units of noise, with its
    `variance` in units of J. `slopes`, shape (parameters, components) + nodes, are derivatives of
    the velocity, `speed` is its root mean square; `names` are empty for nameless coefficients."""
    weight = grid.weights / grid.weights.sum()
    inner = tuple(range(1, slopes.ndim))
    size = np.sqrt(np.sum(weight * slopes**2, axis=inner))
    moved = np.where(size > 0.0, size, 1.0)
    _, s, Vt = np.linalg.svd(J / moved, full_matrices=True)
    s = np.append(s, np.zeros(len(Vt) - s.size)) / np.sqrt(max(variance, np.finfo(float).tiny))
    patterns = np.tensordot(Vt / moved, slopes, axes=1)
    amplitude = np.sqrt(np.sum(weight * patterns**2, axis=inner))
    # A direction that changes no velocity at the nodes stays a direction of scaled parameters.
    amplitude[amplitude <= SEEN.rounding] = 1.0
    s[s <= SEEN.rounding * s[0]] = 0.0
    with np.errstate(divide="ignore"):
        deviations = np.where(s > 0.0, amplitude / (s * speed), np.inf)
    visible = s / amplitude
    seen = (deviations <= SEEN.deviation) & (visible > SEEN.faint * visible.max())
    described = [_described(Vt[q], patterns[q], grid, names) for q in np.flatnonzero(~seen)[::-1]]
    vectors = Vt / moved / amplitude[:, None]
    patterns = patterns / amplitude.reshape(-1, *([1] * (patterns.ndim - 1)))
    return Identifiability(s, vectors, patterns, deviations, seen, tuple(described))


def _described(vector: Array, pattern: Array, grid: Grid, names: tuple[str, ...]) -> str:
    """Describe a direction by parameters, a wavelength, or the place where it is largest."""
    if names:
        order = [q for q in np.argsort(-np.abs(vector)) if abs(vector[q]) > 0.1]
        return " ".join(f"{vector[q]:+.2f} {names[q]}" for q in order[:4]) + " (scaled)"
    component = int(np.argmax(np.abs(pattern).reshape(len(pattern), -1).max(axis=1)))
    values = pattern[component]
    which = "" if grid.dim == 1 else f"component {component + 1} "
    if grid.dim == 1 and grid.periodic[0] and grid.uniform[0]:
        power = np.abs(np.fft.rfft(values)) ** 2
        k = int(np.argmax(power))
        if k == 0:
            return "the mean"
        share = power[k] / power.sum()
        length = (grid.bounds[0][1] - grid.bounds[0][0]) / k
        return f"waves of length {length:.3g} ({share:.0%} of it)"
    place: Any = np.unravel_index(int(np.argmax(np.abs(values))), grid.nodes)
    where = ", ".join(
        f"{name} = {line[q]:.3g}"
        for name, line, q in zip(AXES, grid.coordinates, place)  # noqa: B905
    )
    return f"{which}near {where}"
