"""The moments of a field on a grid at one time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, reduce
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cip.errors import InputError, NotFinite, NotSupported
from cip.formulas.expression import COORDINATES
from cip.formulas.formula import Formula, spline
from cip.grid import Grid, GridLike, Sphere, check_grid, node_name
from cip.profiles.catalogue import Moment, moment_names, moments
from cip.stages.state_files import Stored, read_states, write_states
from skfem_adini.ground.arguments import real_number
from skfem_adini.ground.arrays import host

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class State:
    """The moments that a profile carries, at the nodes of a grid.

    Attributes
    ----------
    grid : Grid or Sphere
    profile : str
    data : ndarray
        All moments, copied, shape ``(number of moments, *grid.nodes)``, of named fields ``(number
        of fields, number of moments, *grid.nodes)``; on the device for the CuPy backend. A mean
        belongs to the cell that begins at the node; in a direction that is not periodic no cell
        begins at the last node, and the entry there is unused.
    t : float
    fields : tuple of str
        Names of several fields, which stand in the names of their moments in the place of ``u``;
        empty for one field without a name.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, State
    >>> grid = Grid((0, 2 * np.pi), 8, periodic=True)
    >>> state = State.from_function(lambda x: np.sin(x), grid)
    >>> state.names, round(float(state["u_x"][0]), 12)
    (('u', 'u_x'), 1.0)
    >>> both = State.from_function({"smoke": lambda x: np.sin(x), "dust": 1.0}, grid)
    >>> both.names, round(both.mass["dust"], 6)
    (('smoke', 'smoke_x', 'dust', 'dust_x'), 6.283185)
    """

    grid: Any
    profile: str
    data: Any
    t: float = 0.0
    fields: tuple[str, ...] = ()
    _bounded: ClassVar[Any] = None
    # Of a snapshot: a name of what made it, and the memory of its engine, for the run's next step.
    _memory: ClassVar[Any] = None

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
        f: Callable[..., Any] | str | float | Array | Mapping[str, Any],
        grid: Grid,
        profile: str | None = None,
        derivatives: Mapping[str, Any] | None = None,
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
            pass `derivatives`. A dict of these by names makes a state of several fields.
        grid : Grid
        profile : str, optional
            As for `Solver`; default ``"cubic"`` (``"bicubic"`` in two dimensions).
        derivatives : dict, optional
            Callables of the coordinates by the names of the moments, as ``{"u_x": df}``; of
            several fields dicts of these by field.
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
        check_grid(grid)
        if not isinstance(derivatives, Mapping | None):
            raise InputError(f"derivatives: expected callables by names, got {derivatives!r}")
        profile = default_profile(grid) if profile is None else profile
        if isinstance(f, Mapping):
            own = derivatives or {}
            if not f:
                raise InputError("f: expected at least one field by name, got {}")
            check_fields(tuple(f), profile, grid.dim)
            if beyond := [name for name in own if name not in f]:
                raise InputError(f"derivatives: {beyond[0]!r} is no field of {', '.join(f)}")
            parts = [
                _named(name, cls.from_function, one, grid, profile, own.get(name), t, dtype)
                for name, one in f.items()
            ]
            data = np.stack([part.data for part in parts])
            return state_of(grid, profile, data, parts[0].t, fields=tuple(f))
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
        """Names of the moments, of one field after another."""
        return moment_names(self.fields, self.profile, self.grid.dim)

    def field(self, name: str) -> State:
        """One of several fields as a state of its own, whose moments are not copied.

        Parameters
        ----------
        name : str
            One of `fields`.

        Returns
        -------
        State

        Raises
        ------
        InputError
            A name that is none of the fields.
        """
        if name not in self.fields:
            known = ", ".join(self.fields) or "it has one without a name"
            raise InputError(f"field: {name!r} is no field of the state: {known}")
        data = self.data[self.fields.index(name)]
        return state_of(self.grid, self.profile, data, self.t)

    def __getitem__(self, name: str) -> Any:
        own = moments(self.profile, self.grid.dim)
        rows = self.data.reshape(-1, *self.grid.nodes)
        for q, (moment, known) in enumerate(zip(own * max(1, len(self.fields)), self.names)):  # noqa: B905
            if known == name:
                keep = tuple(
                    slice(0, cells if axis in moment.averaged else nodes)
                    for axis, (cells, nodes) in enumerate(
                        zip(self.grid.cells, self.grid.nodes, strict=True)
                    )
                )
                return rows[q][keep]
        raise InputError(f"moment: {name!r} is none of {', '.join(self.names)}")

    @property
    def mass(self) -> Any:
        """Integral of the field: of the cell means where they are carried, else of the values. Of
        several fields a dict by name."""
        if self.fields:
            return by_field(self, lambda one: one.mass)
        if "mean" in self.names:
            return _sum(self["mean"], self.grid.volumes)
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
        return state_of(
            self.grid, self.profile, host(self.data), self.t, self._bounded, self.fields
        )

    def save(self, path: str | Path) -> Path:
        """Write the state to a file, complete or not at all; `load` gives the same bits.

        A run that goes on from a snapshot takes the steps of one that was never interrupted.

        Parameters
        ----------
        path : path
            Ends in ``.npz`` (an archive of NumPy), ``.nc`` or ``.zarr`` (netCDF and Zarr, by
            xarray). An existing file is replaced, an existing Zarr store refused.

        Returns
        -------
        Path

        Raises
        ------
        MissingDependency
            xarray or zarr is not installed.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from cip import Grid, State
        >>> state = State.from_function({"smoke": "x1", "dust": 1.0}, Grid((0, 1), 8))
        >>> with TemporaryDirectory() as folder:
        ...     again = State.load(state.save(f"{folder}/state.npz"))
        >>> again.fields, bool((again.data == state.data).all())
        (('smoke', 'dust'), True)
        """
        return write_states(path, [self])

    @staticmethod
    def load(path: str | Path) -> State:
        """Read a file of `save`; of a file with several states the last one.

        Parameters
        ----------
        path : path

        Returns
        -------
        State

        Raises
        ------
        InputError
            A file that is damaged, or none of states.
        """
        return states_in(read_states(path))[-1]

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
        if not isinstance(self.grid, Grid | Sphere):
            raise InputError(f"{name}: expected a Grid, got {type(self.grid).__name__}")
        check_fields(self.fields, self.profile, self.grid.dim)
        count = len(moments(self.profile, self.grid.dim))
        expected = (*([len(self.fields)] if self.fields else []), count, *self.grid.nodes)
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
    grid: GridLike,
    profile: str,
    data: Any,
    t: float = 0.0,
    bounded: Any = None,
    fields: tuple[str, ...] = (),
) -> State:
    """The state of an array that no one else modifies, which is not copied. `bounded` are the
    bounds of the limiter of its step; the state may exceed them as far as that step may."""
    state = object.__new__(State)
    state.__dict__.update(grid=grid, profile=profile, data=data, t=t, fields=fields)
    if bounded is not None:
        state.__dict__["_bounded"] = bounded
    return state


def values_of(state: State) -> Any:
    """The values of a field, or its means where a profile carries only these."""
    return state["u" if "u" in state.names else "mean"]


def by_field(state: State, function: Callable[[State], Any]) -> Any:
    """What a function gives for the state; of several fields a dict of that by field."""
    if not state.fields:
        return function(state)
    return {name: function(state.field(name)) for name in state.fields}


def states_in(stored: Stored) -> list[State]:
    """The states of a file; `InputError` for moments that do not fit its grid."""
    about, found = stored.about, []
    for data, t, bounded, memory in zip(
        stored.data, stored.t, about["bounded"], about["memory"], strict=True
    ):
        if isinstance(bounded, list):
            bounded = tuple(bounded)
        elif isinstance(bounded, dict):
            bounded = {name: tuple(pair) for name, pair in bounded.items()}
        state = state_of(stored.grid, about["profile"], data, float(t), bounded, about["fields"])
        state.__dict__["_memory"] = memory
        state.check("path")
        found.append(state)
    return found


def check_fields(fields: Any, profile: str, dim: int) -> None:
    """Raise `InputError` for names of fields that are no names, or that moments or axes have."""
    if fields == ():
        return
    if not isinstance(fields, tuple):
        raise InputError(f"fields: expected a tuple of names, got {fields!r}")
    for name in fields:
        if (
            not isinstance(name, str)
            or not name.isidentifier()
            or name in (*"xyzt", "u", "lon", "lat")
        ):
            raise InputError(
                f"fields: {name!r} is no name of a field; x, y, z, t, u, lon, lat have a meaning"
            )
    names = moment_names(fields, profile, dim)
    twice = [name for q, name in enumerate(names) if name in names[:q]]
    if twice:
        raise InputError(f"fields: two moments would be called {twice[0]!r}; rename a field")


def one_field(state: Any, what: str) -> None:
    """Raise `NotSupported` for a state of several fields."""
    if getattr(state, "fields", ()):
        raise NotSupported(
            f"{what} are of one field; take state.field(name), or run[name], for each of "
            f"{', '.join(state.fields)}"
        )


def _named(name: str, make: Callable[..., State], *arguments: Any) -> State:
    """A state of a field, whose name is put before messages."""
    try:
        return make(*arguments)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


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
    grid: GridLike,
    moment: Moment,
    t: float,
    xp: Any = np,
    points: int = 4,
) -> Any:
    """A function of (x1, x2, x3, t) at the nodes, shape ``grid.nodes``, averaged over cells in the
    directions ``moment.averaged`` by Gauss's rule with `points` (one: the midpoint; four:
    exact to degree 7); 0 where no cell begins. `xp` is NumPy or CuPy."""
    rules = [_rule(grid, axis, axis in moment.averaged, points) for axis in range(grid.dim)]
    total = xp.zeros(grid.nodes)
    for rule in product(*rules):
        lines = np.meshgrid(*(line for line, _ in rule), indexing="ij", sparse=True)
        point = [xp.asarray(line) for line in lines]
        weight = xp.asarray(reduce(np.multiply, [weight for _, weight in rule]))
        point += [np.zeros(())] * (len(COORDINATES) - 1 - grid.dim)
        total += weight * values(*point, t)
    for axis in moment.averaged:
        if grid.nodes[axis] > grid.cells[axis]:
            xp.moveaxis(total, axis, 0)[-1] = 0.0
    return total


def _rule(grid: GridLike, axis: int, means: bool, points: int) -> list[tuple[Array, Any]]:
    """Places in a direction with their weights, those of latitudes by the lengths of circles."""
    line = grid.coordinates[axis]
    if not means:
        return [(line, 1.0)]
    width = np.append(grid.widths[axis], grid.widths[axis][-1])[: line.size]
    rule = [
        (grid.edges[axis][: line.size] + 0.5 * (1.0 + place) * width, 0.5 * weight)
        for place, weight in zip(*_gauss(points), strict=True)
    ]
    if not (isinstance(grid, Sphere) and axis == 1):
        return rule
    area = sum(weight * np.cos(lat) for lat, weight in rule)
    return [(lat, weight * np.cos(lat) / area) for lat, weight in rule]
