"""Where to put sensors: greedy choice among candidates, with an upper bound over all choices."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve

from cip.assimilation.assimilation_window import AssimilationWindow, Linearised
from cip.assimilation.covariance import Covariance
from cip.assimilation.sensors import Sensors
from cip.errors import InputError
from cip.grid import Array, Grid
from cip.solver.solver import Solver
from cip.stages.state import State
from skfem_adini.ground.arguments import choice, real_array, real_number


class _Limits(NamedTuple):  # limits of the choice and of its relaxation
    tie: float = 1e-9  # relative: gains that differ by less are equal, up to rounding of kernels
    gap: float = 1e-3  # relative gap of the two bounds at which the relaxation ends
    steps: int = 200  # at most, of the relaxation
    bisections: int = 20  # at most, of the interval of step lengths


LIMITS = _Limits()


@dataclass(frozen=True, eq=False)
class Placement:
    """Sensors chosen among candidates. `place_sensors` returns it.

    Attributes
    ----------
    sensors : Sensors
        The chosen ones, in the order of choice.
    chosen : tuple of int
        Their numbers among the candidates.
    ties : tuple of tuple of int
        For each choice the candidates that were as good, up to rounding; the first was taken.
    value : float
        What the choice achieves: nats of information about all unknowns ("D"), or the variance that
        it removes ("A"), of ``prior``.
    gains : ndarray
        What each sensor added when it was chosen.
    prior : float
        For "A" the variance without sensors: the mean over the grid of that of the start's values,
        or the number of parameters or amplitudes, each in units of its prior variance. For "D" 0.
    bound : float
        No choice of as many candidates has a larger value.
    criterion : {"A", "D"}

    Examples
    --------
    >>> from cip import Covariance, Grid, Sensors, Solver, place_sensors
    >>> grid = Grid((0, 1), 32, periodic=True)
    >>> solver = Solver(grid, 1.0)
    >>> B = Covariance.diffusion(grid, "cubic", deviation=1.0, length=0.15)
    >>> places = Sensors([0.1, 0.12, 0.35, 0.6, 0.85], [0.1], deviations=0.1)
    >>> found = place_sensors(solver, solver.state(0.0), B, places, budget=3, dt=0.05)
    >>> sorted(found.chosen), found.efficiency > 0.8
    ([0, 2, 3], True)
    """

    sensors: Sensors
    chosen: tuple[int, ...]
    ties: tuple[tuple[int, ...], ...]
    value: float
    gains: Array
    prior: float
    bound: float
    criterion: str

    def __repr__(self) -> str:
        return (
            f"Placement({len(self.chosen)} sensors by {self.criterion}-optimality, at least "
            f"{100 * self.efficiency:.1f} % of what any others achieve)"
        )

    @property
    def efficiency(self) -> float:
        """The value over its bound: at least this fraction of the best choice is achieved."""
        return self.value / self.bound if self.bound > 0.0 else 1.0


def place_sensors(
    solver: Solver,
    background: State,
    covariance: Covariance,
    candidates: Sensors,
    *,
    budget: int,
    dt: float,
    criterion: str = "A",
    goal: str = "start",
    parameters: Mapping[str, float] | None = None,
    model_error: Covariance | Sequence[Covariance | None] | None = None,
    excluded: ArrayLike | Callable[..., ArrayLike] | None = None,
    apart: float = 0.0,
) -> Placement:
    r"""Greedy choice of the most informative candidates as sensors, and a bound for every choice.

    Each step takes the candidate that lowers the posterior variance most ("A"), or adds the most
    information ("D"). Information is submodular: without exclusions, the greedy choice has at least
    1 - 1/e of the best one's (Nemhauser, Wolsey and Fisher). The bound, from the continuous
    relaxation and for "D" also from the gains that remain, is mostly much closer; for "A", which
    is not submodular, it is the only one.

    The problem is linearised around the run from `background`; each report of a candidate costs one
    adjoint run, or each unknown one run where these are fewer.

    Parameters
    ----------
    solver, background, covariance, dt, parameters, model_error
        As for `four_d_var`.
    candidates : Sensors
        Places, the times at which all report, and deviations; values are not used, but a report
        that is NaN does not count.
    budget : int
        Number of sensors.
    criterion : {"A", "D"}
    goal : {"start", "parameters", "amplitudes"}
        Whose variance "A" lowers: that of the start's nodal values, of the parameters, or of the
        numbers of the model error (strengths of sources).
    excluded : array_like of bool or callable, optional
        Candidates that must not be taken, or a function ``excluded(x1, ..)`` of their coordinates.
    apart : float
        Least distance between two chosen sensors; across periodic ends too.

    Returns
    -------
    Placement

    Raises
    ------
    InputError
        Arguments that do not belong together, or fewer allowed candidates than `budget`.

    References
    ----------
    G. L. Nemhauser, L. A. Wolsey and M. L. Fisher, An analysis of approximations for maximizing
    submodular set functions I, Math. Program. 14 (1978), 265-294; A. Krause, A. Singh and C.
    Guestrin, Near-optimal sensor placements in Gaussian processes, J. Mach. Learn. Res. 9 (2008),
    235-284.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Covariance, Grid, Sensors, Solver, Velocity, place_sensors
    >>> grid = Grid((0, 1), 32, periodic=True)
    >>> solver = Solver(grid, Velocity.from_expression("a", parameters={"a": 1.0}))
    >>> B = Covariance.diffusion(grid, "cubic", deviation=0.1, length=0.15)
    >>> places = Sensors(np.linspace(0, 0.95, 20), [0.2], deviations=0.1)
    >>> start = solver.state("sin(2*pi*x1)")  # at t = 0.2 steepest at 0.2 and 0.7
    >>> found = place_sensors(
    ...     solver, start, B, places, budget=2, dt=0.05, parameters={"a": 0.1}, goal="parameters"
    ... )
    >>> np.sort(found.sensors.points[0]).round(2).tolist()
    [0.2, 0.7]
    """
    window = AssimilationWindow(
        solver, background, covariance, candidates, dt, parameters, model_error
    )
    choice("criterion", criterion, ("A", "D"))
    allowed = _allowed(excluded, candidates.points)
    whole = isinstance(budget, int | np.integer) and not isinstance(budget, bool)
    if not whole or not 1 <= budget <= np.count_nonzero(allowed):
        raise InputError(
            f"budget: expected 1 to {np.count_nonzero(allowed)} sensors, the candidates that are "
            f"allowed, got {budget!r}"
        )
    distance = real_number("apart", apart)
    if not (np.isfinite(distance) and distance >= 0.0):
        raise InputError(f"apart: expected a distance >= 0, got {apart!r}")
    linear = window.linearised(window.path(np.zeros(window.layout.size)))
    rows, owner = _dense(linear, window), np.nonzero(candidates.reported)[1]
    C, prior = None, 0.0
    if criterion == "A":
        X, prior = _aims(window, rows, goal)
        C = X @ X.T
    kernels = DesignKernels(rows @ rows.T, C, owner, candidates.points.shape[1])
    chosen, ties, gains, left = _greedy(
        kernels, allowed, int(budget), candidates.points, solver.grid, distance
    )
    value, bound = float(np.sum(gains)), relaxed_bound(kernels, allowed, int(budget))
    if criterion == "D":
        bound = min(bound, value + float(np.sort(left[allowed])[-int(budget) :].sum()))
    return Placement(
        candidates.at(chosen), tuple(chosen), tuple(ties), value, gains, prior, bound, criterion
    )


def _allowed(excluded: Any, points: Array) -> NDArray[np.bool_]:
    if excluded is None:
        return np.ones(points.shape[1], dtype=bool)
    mask = real_array("excluded", excluded(*points) if callable(excluded) else excluded)
    if mask.shape != points.shape[1:] or mask.dtype != bool:
        raise InputError(
            f"excluded: expected True or False for each of {points.shape[1]} candidates, got "
            f"{mask.dtype} of shape {mask.shape}"
        )
    return np.asarray(~mask)


def _dense(linear: Linearised, window: AssimilationWindow) -> Array:
    """The operator as a dense matrix, by rows or by columns, whichever are fewer."""
    if linear.reports <= window.layout.size:
        return np.stack([linear.backward(unit) for unit in np.eye(linear.reports)])
    return np.stack([linear.forward(unit) for unit in np.eye(window.layout.size)], axis=1)


def _aims(window: AssimilationWindow, rows: Array, goal: str) -> tuple[Array, float]:
    """A F^T, F from the unknowns to the quantities of interest, and the prior trace of F F^T."""
    layout, covariance = window.layout, window.covariance
    if goal == "start":
        w = window.solver.grid.weights.ravel() / window.solver.grid.weights.sum()
        root = np.sqrt(w)
        found = [root * covariance.root.matvec(row[layout.background])[: root.size] for row in rows]
        return np.stack(found), float(w @ covariance.deviations.ravel() ** 2)
    if goal == "parameters" and window.names:
        return rows[:, layout.parameters], float(len(window.names))
    if goal == "amplitudes" and any(one is not None for one in window.errors):
        first = layout.parameters.stop
        return rows[:, first:], float(layout.size - first)
    needs = {"parameters": "parameters=", "amplitudes": "model_error="}
    if goal in needs:
        raise InputError(f"goal: {goal!r} needs {needs[goal]}")
    raise InputError(f"goal: expected one of start, parameters, amplitudes, got {goal!r}")


def _greedy(
    kernels: DesignKernels,
    allowed: NDArray[np.bool_],
    budget: int,
    points: Array,
    grid: Grid,
    apart: float,
) -> tuple[list[int], list[tuple[int, ...]], Array, Array]:
    """Greedy choices, their ties and gains, and the gains of each candidate after them."""
    free, chosen, ties, gains = allowed.copy(), list[int](), list[tuple[int, ...]](), []
    now, fresh = kernels, kernels.gains()
    for _ in range(budget):
        if not free.any():
            raise InputError(
                f"apart: only {len(chosen)} of {budget} sensors fit with this distance; take a "
                "smaller one"
            )
        best = fresh[free].max()
        equal = np.flatnonzero(free & (fresh >= best - LIMITS.tie * abs(best)))
        pick = int(equal[0])
        chosen.append(pick)
        ties.append(tuple(int(j) for j in equal[1:]))
        gains.append(float(fresh[pick]))
        free[pick] = False
        free &= ~(_distances(points, points[:, pick], grid) < apart)
        now = kernels.after(chosen)
        fresh = now.gains()
    return chosen, ties, np.array(gains), np.where(np.isin(np.arange(free.size), chosen), 0, fresh)


def _distances(points: Array, point: Array, grid: Grid) -> Array:
    pairs = zip(grid.bounds, grid.periodic, strict=True)
    turn = np.array([[high - low if periodic else np.inf] for (low, high), periodic in pairs])
    d = np.abs(points - point[:, None]) % turn
    return np.asarray(np.linalg.norm(np.minimum(d, turn - d), axis=0))


@dataclass(frozen=True)
class DesignKernels:
    """The kernels :math:`G = A A^T` and :math:`C = A F^T F A^T` of all reports of all candidates, A
    and F map independent unknowns to the reports and to the quantities of interest. Both criteria
    are concave in weights of the candidates (Pukelsheim, Optimal Design of Experiments, 1993)."""

    G: Array  # shape (m, m)
    C: Array | None  # (m, m) for the criterion "A", None for "D"
    owner: NDArray[np.int64]  # shape (m,): candidate of each report
    count: int  # number of candidates

    def after(self, chosen: list[int]) -> DesignKernels:
        """The kernels once the reports of some candidates are known."""
        weights = np.zeros(self.count)
        weights[chosen] = 1.0
        G, C = self._posterior(weights)
        return DesignKernels(G, C, self.owner, self.count)

    def gains(self) -> Array:
        """The gain of each candidate alone."""
        found = np.zeros(self.count)
        for j in range(self.count):
            own = np.flatnonzero(self.owner == j)
            T = np.eye(own.size) + self.G[np.ix_(own, own)]
            if self.C is None:
                found[j] = 0.5 * np.linalg.slogdet(T)[1]
            else:
                found[j] = np.trace(np.linalg.solve(T, self.C[np.ix_(own, own)]))
        return found

    def value(self, weights: Array) -> float:
        """The criterion, 0 without sensors: nats of information, or variance removed."""
        s = np.sqrt(weights[self.owner])
        factor = cho_factor(np.eye(s.size) + s[:, None] * self.G * s)
        if self.C is None:
            return float(np.sum(np.log(np.diag(factor[0]))))
        return float(np.trace(cho_solve(factor, s[:, None] * self.C * s)))

    def slopes(self, weights: Array) -> Array:
        """Its derivative in each weight."""
        G, C = self._posterior(weights)
        each = 0.5 * np.diag(G) if C is None else np.diag(C)
        return np.bincount(self.owner, each, minlength=self.count).astype(float)

    def _posterior(self, weights: Array) -> tuple[Array, Array | None]:
        s = np.sqrt(weights[self.owner])
        factor = cho_factor(np.eye(s.size) + s[:, None] * self.G * s)
        E = np.eye(s.size) - (s[:, None] * cho_solve(factor, s[:, None] * self.G)).T
        return E @ self.G, None if self.C is None else E @ self.C @ E.T


def relaxed_bound(kernels: DesignKernels, allowed: NDArray[Any], budget: int) -> float:
    """An upper bound of the value of any choice of `budget` allowed candidates, by Frank and
    Wolfe's method for the relaxation: at any weights the tangent plane lies above the concave
    criterion, so its maximum over all choices is a bound, even far from the optimum."""
    weights = np.where(allowed, budget / np.count_nonzero(allowed), 0.0)
    bound = np.inf
    for _ in range(LIMITS.steps):
        value, slopes = kernels.value(weights), kernels.slopes(weights)
        best = np.flatnonzero(allowed)[np.argsort(-slopes[allowed], kind="stable")[:budget]]
        vertex = np.zeros(weights.size)
        vertex[best] = 1.0
        gap = float(slopes @ (vertex - weights))
        bound = min(bound, value + gap)
        if bound - value <= LIMITS.gap * abs(bound):
            break
        weights = weights + _length(kernels, weights, vertex - weights) * (vertex - weights)
    return bound


def _length(kernels: DesignKernels, weights: Array, direction: Array) -> float:
    """The step in [0, 1] at which the slope along a direction vanishes, by bisection."""
    low, high = 0.0, 1.0
    if kernels.slopes(weights + direction) @ direction >= 0.0:
        return 1.0
    for _ in range(LIMITS.bisections):
        middle = 0.5 * (low + high)
        if kernels.slopes(weights + middle * direction) @ direction > 0.0:
            low = middle
        else:
            high = middle
        if high - low < 0.05 * high:  # an exact step gains nothing over a near one
            break
    return low if low > 0.0 else high
