"""The moments of a field on a grid at one time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, ClassVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cip.errors import InputError, NotFinite
from cip.formulas.expression import COORDINATES
from cip.formulas.formula import Formula, spline
from cip.grid import Grid, node_name
from cip.profiles.catalogue import Moment, moments
from skfem_adini.ground.arguments import real_number
from skfem_adini.ground.arrays import host

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class State:
    """The moments that a profile carries, at the nodes of a grid.

    Attributes
    ----------
    grid : Grid
    profile : str
    data : ndarray
        All moments, copied, shape ``(number of moments, *grid.nodes)``; on the device for the CuPy
        backend. A mean belongs to the cell that begins at the node; in a direction that is not
        periodic no cell begins at the last node, and the entry there is unused.
    t : float

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, State
    >>> state = State.from_function(lambda x: np.sin(x), Grid((0, 2 * np.pi), 8, periodic=True))
    >>> state.names, round(float(state["u_x"][0]), 12)
    (('u', 'u_x'), 1.0)
    """

    grid: Grid
    profile: str
    data: Any
    t: float = 0.0
    _bounded: ClassVar[tuple[float, float] | None] = None

    def __post_init__(self) -> None:
        """Copy the moments, so that changes of the caller's array do not affect the state."""
        if isinstance(self.data, np.ndarray):
            if np.ma.is_masked(self.data):
                raise InputError("data: some moments are masked; fill them")
            object.__setattr__(self, "data", np.array(self.data))
        elif hasattr(self.data, "get") and hasattr(self.data, "copy"):  # CuPy's
            object.__setattr__(self, "data", self.data.copy())

    @classmethod
    def from_function(
        cls,
        f: Callable[..., Any] | str | float | Array,
        grid: Grid,
        profile: str | None = None,
        derivatives: Mapping[str, Callable[..., Any]] | None = None,
        t: float = 0.0,
        dtype: DTypeLike = np.float64,
    ) -> State:
        """The moments of a function.

        Parameters
        ----------
        f : callable, str, float or array
            ``f(x1, x2, ...)`` of coordinate arrays, or a formula. A callable that is plain
            arithmetic of NumPy functions is differentiated exactly, another one by sixth-order
            differences over a quarter of the spacing. An array holds the values at the nodes:
            derivatives and means are those of the interpolating quintic spline. For data with jumps
            pass `derivatives`.
        grid : Grid
        profile : str, optional
            As for `Solver`; default ``"cubic"`` (``"bicubic"`` in two dimensions).
        derivatives : dict, optional
            Callables of the coordinates by the names of the moments, as ``{"u_x": df}``.
        t : float
        dtype : float64 or float32

        Returns
        -------
        State

        Raises
        ------
        InputError
            A malformed argument, or moments that are not finite (with the node).
        """
        if not isinstance(grid, Grid):
            raise InputError(f"grid: expected a Grid, got {type(grid).__name__}")
        if not isinstance(derivatives, Mapping | None):
            raise InputError(f"derivatives: expected callables by names, got {derivatives!r}")
        profile = default_profile(grid) if profile is None else profile
        wanted = moments(profile, grid.dim)
        given = dict(derivatives or {})
        unknown = set(given) - {moment.name for moment in wanted if any(moment.orders)}
        if unknown:
            raise InputError(
                f"derivatives: {sorted(unknown)} are no derivatives that {profile!r} carries"
            )
        array = isinstance(f, np.ndarray) and f.ndim > 0
        t = real_number("t", t)
        formula = spline(f, grid, "f") if array else Formula.of(f, grid.bounds, "f", sparse=True)
        steps = (*grid.spacing, *([1.0] * (4 - grid.dim)))
        data = np.zeros((len(wanted), *grid.nodes), dtype=_real(dtype))
        for row, moment in zip(data, wanted, strict=True):
            if moment.name in given:
                source = Formula.of(given[moment.name], grid.bounds, moment.name, sparse=True)
                values = source.derivative((0, 0, 0, 0), steps)
            else:
                values = formula.derivative(moment.orders, steps)
            with np.errstate(over="ignore"):  # `check` reports overflow in single precision
                row[...] = averaged(values, grid, moment, t)
        state = state_of(grid, profile, data, t)
        state.check("f")
        return state

    def __repr__(self) -> str:
        moments = ", ".join(self.names)
        return f"State({self.profile!r}: {moments} on {self.grid} at t = {self.t:.6g})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the moments."""
        return tuple(moment.name for moment in moments(self.profile, self.grid.dim))

    def __getitem__(self, name: str) -> Any:
        for q, moment in enumerate(moments(self.profile, self.grid.dim)):
            if moment.name == name:
                keep = tuple(
                    slice(0, cells if axis in moment.averaged else nodes)
                    for axis, (cells, nodes) in enumerate(
                        zip(self.grid.cells, self.grid.nodes, strict=True)
                    )
                )
                return self.data[q][keep]
        raise InputError(f"moment: {name!r} is none of {', '.join(self.names)}")

    @property
    def mass(self) -> float:
        """Integral of the field: of the cell means where they are carried, else of the values."""
        if "mean" in self.names:
            volume: Any = np.ones(())
            for width in self.grid.widths:
                volume = volume[..., None] * width
            return _sum(self["mean"], volume)
        return _sum(self["u"], self.grid.weights)

    def host(self) -> State:
        """The same state in NumPy arrays.

        Returns
        -------
        State
            The same object if it is in host memory already.
        """
        if isinstance(self.data, np.ndarray):
            return self
        return state_of(self.grid, self.profile, host(self.data), self.t, self._bounded)

    def check(self, name: str = "state") -> None:
        """Raise `InputError` unless the moments are real, finite and of the right shape.

        Parameters
        ----------
        name : str
            Name of the state in messages.

        Raises
        ------
        InputError
            The message names the first moment and node that is not.
        """
        if not isinstance(self.grid, Grid):
            raise InputError(f"{name}: expected a Grid, got {type(self.grid).__name__}")
        expected = (len(self.names), *self.grid.nodes)
        if getattr(self.data, "shape", None) != expected:
            raise InputError(
                f"{name}: the moments {', '.join(self.names)} on this grid have shape {expected}, "
                f"got {getattr(self.data, 'shape', type(self.data).__name__)}"
            )
        if self.data.dtype not in (np.float64, np.float32):
            raise InputError(f"{name}: expected float64 or float32, got {self.data.dtype}")
        if not np.isfinite(real_number(f"{name}: t", self.t)):
            raise InputError(f"{name}: expected a finite time, got t = {self.t}")
        where = self.first_not_finite()
        if where is not None:
            raise InputError(f"{name}: {where} at t = {self.t:.6g}")

    def require_finite(self) -> State:
        """This state; raises `NotFinite` with moment, node and time when it is not finite.

        Returns
        -------
        State

        Raises
        ------
        NotFinite
            A moment is NaN or infinite.
        """
        where = self.first_not_finite()
        if where is not None:
            raise NotFinite(
                f"{where} at t = {self.t:.6g}: the field grew beyond the range of "
                f"{self.data.dtype}, or NaN came in through the boundary data"
            )
        return self

    def first_not_finite(self) -> str | None:
        """Where the first NaN or infinity is, in words.

        Returns
        -------
        str or None
            None where all moments are finite.
        """
        data = self.data.reshape(len(self.names), -1)
        # One pass without a temporary array: if the sum is finite, all terms are.
        with np.errstate(all="ignore"):
            if np.isfinite(float(data.sum())):
                return None
        host = self.host().data.reshape(len(self.names), -1)
        if np.isfinite(host).all():
            return None
        q, flat = (int(i) for i in np.argwhere(~np.isfinite(host))[0])
        return f"moment {self.names[q]!r} is {host[q, flat]} at {node_name(self.grid, flat)}"


def state_of(
    grid: Grid,
    profile: str,
    data: Any,
    t: float = 0.0,
    bounded: tuple[float, float] | None = None,
) -> State:
    """The state of an array that no one else modifies, which is not copied. `bounded` are the
    bounds of the limiter of its step; the state may exceed them as far as that step may.
    """
    state = object.__new__(State)
    state.__dict__.update(grid=grid, profile=profile, data=data, t=t)
    if bounded is not None:
        state.__dict__["_bounded"] = bounded
    return state


def default_profile(grid: Grid) -> str:
    """Name of the default profile: bicubic in two dimensions, else cubic."""
    return "bicubic" if grid.dim == 2 else "cubic"


def _real(dtype: DTypeLike) -> np.dtype[Any]:
    try:
        kind = np.dtype(dtype)
    except TypeError as error:
        raise InputError(f"dtype: expected float64 or float32, got {dtype!r}") from error
    if kind not in (np.dtype(np.float64), np.dtype(np.float32)):
        raise InputError(f"dtype: expected float64 or float32, got {kind}")
    return kind


def _sum(values: Any, weights: Array) -> float:
    return float(np.sum(host(values) * weights, dtype=np.float64))


@cache
def _gauss(points: int) -> tuple[Array, Array]:
    """Gauss's rule on [-1, 1]; finding its points takes longer than using them on a small grid."""
    places, weights = np.polynomial.legendre.leggauss(points)
    return places, weights


def averaged(
    values: Callable[..., Any],
    grid: Grid,
    moment: Moment,
    t: float,
    xp: Any = np,
    points: int = 4,
) -> Any:
    """A function of (x1, x2, x3, t) at the nodes, shape ``grid.nodes``, averaged over cells in the
    directions ``moment.averaged`` by Gauss's rule with `points` (one: the midpoint; four:
    exact to degree 7); 0 where no cell begins. `xp` is NumPy or CuPy."""
    rules = []
    for axis in range(grid.dim):
        line = grid.coordinates[axis]
        if axis not in moment.averaged:
            rules.append([(line, 1.0)])
            continue
        width = np.append(grid.widths[axis], grid.widths[axis][-1])[: line.size]
        rules.append(
            [
                (line + 0.5 * (1.0 + place) * width, 0.5 * weight)
                for place, weight in zip(*_gauss(points), strict=True)
            ]
        )
    total = xp.zeros(grid.nodes)
    for rule in product(*rules):
        lines = np.meshgrid(*(line for line, _ in rule), indexing="ij", sparse=True)
        point = [xp.asarray(line) for line in lines]
        weight = float(np.prod([weight for _, weight in rule]))
        point += [np.zeros(())] * (len(COORDINATES) - 1 - grid.dim)
        total += weight * values(*point, t)
    for axis in moment.averaged:
        if not grid.periodic[axis]:
            xp.moveaxis(total, axis, 0)[-1] = 0.0
    return total
