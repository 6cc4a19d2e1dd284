"""The solver on a sphere: a velocity, and splines of values or of means in cells."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cip.characteristics.feet import signed_step
from cip.errors import InputError
from cip.grid import Sphere
from cip.output.recorder import Recorder
from cip.profiles.catalogue import SPHERE
from cip.solver.scheme import bounds_of, check_state, form_of, tolerance_of
from cip.solver.time_loop import checked_callback, output_times, run
from cip.sphere.paths import in_space, traced, wind_of
from cip.sphere.remap import Remap
from cip.sphere.run import SphereTrajectory
from cip.sphere.splines import PAD, value_spline
from cip.stages.state import State, check_fields, state_of
from skfem_adini.ground.arguments import (
    choice,
    flag,
    keywords_named,
    own_array,
    real_array,
    real_number,
)

Array = NDArray[np.float64]
PROFILES = {
    "transport": ("quintic_spline", "cubic_spline"),
    "advection": ("csl4_spline", "csl2_spline"),
}


class SphereSolver:
    r"""Semi-Lagrangian scheme for u_t + c . grad u = 0 or p_t + div(c p) = 0 on a sphere.

    Paths are followed backward in space, so nothing is divided by the cosine of the latitude, and
    fields are splines along great circles that go on beyond the poles. There is no splitting and no
    stability limit on dt; a pole is a point like others.

    Parameters
    ----------
    sphere : Sphere
    velocity : callable or array_like
        ``velocity(lon, lat, t)`` gives the speeds to the east and to the north, two arrays of the
        shape of lon and lat (radians), in units of length over time; without t it is steady. At a
        pole east and north are those of lon = 0. An array of shape (2, nlon, nlat), of a steady
        wind, has these speeds at the centres of cells, from which quintic splines are made.
    form : {"transport", "advection"}
        ``"transport"`` (or ``"advective"``) for mixing ratios, values that are carried along;
        ``"advection"`` (or ``"conservative"``) for densities, whose integral is kept.
    profile : str, optional
        For transport ``"quintic_spline"`` (default) or ``"cubic_spline"``, of the values at the
        centres of cells; for advection ``"csl4_spline"`` (default) or ``"csl2_spline"``, quartic or
        quadratic in each direction with the means in cells.
    limiter : {None, "bounds"}
        ``"bounds"`` cuts what leaves (low, high) after each step. For advection what was cut is
        given back, over all cells by the room that they have within the bounds, so that the
        integral is kept.
    bounds : (low, high)
        For the limiter; a lower bound of 0 suits any density, an upper one only a velocity without
        divergence.
    foot_tolerance : float, optional
        Largest error of the paths, in cells; default 1e-7.

    Notes
    -----
    The error at a final time, with dt / h fixed, is of order 3 for ``cubic_spline`` and
    ``csl2_spline``, 5 for ``quintic_spline`` and ``csl4_spline``, of smooth fields, and lower at
    the poles by their small cells. The sum of cells is kept to rounding; a constant density stays
    constant up to the errors of the paths and of the curves through five traced points of each
    edge, and a constant mixing ratio to rounding. Waves around a pole that are shorter than the
    spacing of latitudes are left out of the splines.

    Raises
    ------
    InputError

    References
    ----------
    R. D. Nair and P. H. Lauritzen, A class of deformational flow test cases for linear transport
    problems on the sphere, J. Comput. Phys. 229 (2010), 8868-8887.

    Examples
    --------
    A cosine of the latitude, once around an axis in the plane of the equator, over both poles:

    >>> import numpy as np
    >>> from cip import Sphere, SphereSolver
    >>> over_poles = lambda lon, lat: (np.sin(lat) * np.cos(lon), -np.sin(lon))
    >>> solver = SphereSolver(Sphere(48, 24), over_poles, "conservative")
    >>> start = solver.state(lambda lon, lat: 1 + np.cos(lat) * np.cos(lon - 0.5))
    >>> end = solver.run(start, 2 * np.pi, dt=np.pi / 20).final
    >>> error = abs(end["mean"] - start["mean"]).max()
    >>> bool(error < 1e-5), bool(abs(end.mass / start.mass - 1) < 1e-14)
    (True, True)
    """

    land = None  # as of a Solver, for its trajectory

    @keywords_named
    def __init__(
        self,
        sphere: Sphere,
        velocity: Any,
        form: Literal["transport", "advective", "advection", "conservative"] = "transport",
        profile: str | None = None,
        limiter: str | None = None,
        bounds: Any = (0.0, np.inf),
        foot_tolerance: float | None = None,
    ) -> None:
        if not isinstance(sphere, Sphere):
            raise InputError(f"sphere: expected a Sphere, got {type(sphere).__name__}")
        self.grid = sphere
        self.form = form_of(form)
        among = PROFILES[self.form]
        self.profile = among[0] if profile is None else choice("profile", profile, among)
        if limiter not in (None, "bounds"):
            raise InputError(f"limiter: expected None or 'bounds', got {limiter!r}")
        self.limiter, self.bounds = limiter, bounds_of(bounds)
        self.foot_tolerance = tolerance_of(foot_tolerance) or 1e-7
        self.velocity = velocity if callable(velocity) else own_array("velocity", velocity)
        self._wind, self.steady = wind_of(self.velocity, sphere)
        self._remap = Remap(sphere, SPHERE[self.profile])
        self._feet: tuple[float, Any] = (0.0, None)

    def __reduce__(self) -> tuple[Any, ...]:
        choices = self.form, self.profile, self.limiter, self.bounds, self.foot_tolerance
        return SphereSolver, (self.grid, self.velocity, *choices)

    def __repr__(self) -> str:
        return f"SphereSolver({self.grid}, form={self.form!r}, profile={self.profile!r})"

    def state(self, f: Any, t: float = 0.0) -> State:
        """The values or means of a function.

        Parameters
        ----------
        f : callable, float, array_like or dict
            ``f(lon, lat)`` of arrays in radians, whose means over cells are taken by Gauss's rule
            with 4 x 4 points; a number; or what the cells hold, shape ``(nlon, nlat)``. A dict of
            these by names makes a state of several fields, which are carried on the same paths.
        t : float

        Returns
        -------
        State

        Raises
        ------
        InputError
            Values of another shape, or that are not finite.

        Examples
        --------
        >>> from cip import Sphere, SphereSolver
        >>> solver = SphereSolver(Sphere(16, 8), lambda lon, lat: (lat, lon * 0))
        >>> state = solver.state({"ozone": 1.0, "dust": lambda lon, lat: lat**2})
        >>> state.names, state["dust"].shape
        (('ozone', 'dust'), (16, 8))
        """
        fields = tuple(f) if isinstance(f, Mapping) else ()
        check_fields(fields, self.profile, 2)
        if isinstance(f, Mapping) and not fields:
            raise InputError("f: expected at least one field by name, got {}")
        rows = [self._cells(name, f[name]) for name in fields] or [self._cells("f", f)]
        data = np.stack(rows)[:, None] if fields else rows[0][None]
        state = state_of(self.grid, self.profile, data, real_number("t", t), fields=fields)
        state.check("f")
        return state

    def _cells(self, name: str, f: Any) -> Array:
        """Values at the centres of cells, or means."""
        if not callable(f):
            found = real_array(name, f).astype(float)
            if found.shape not in ((), self.grid.cells):
                raise InputError(
                    f"{name}: expected a function of lon and lat, a number or values of shape "
                    f"{self.grid.cells}, got shape {found.shape}"
                )
            return found + np.zeros(self.grid.cells)
        means = self.form == "advection"
        places, weights = np.polynomial.legendre.leggauss(4 if means else 1)
        total, area = np.zeros(self.grid.cells), np.zeros(self.grid.cells[1])
        lines = zip(self.grid.coordinates, self.grid.widths, strict=True)
        lons, lats = ([c + 0.5 * w * at for at in places] for c, w in lines)
        for lat, one in zip(lats, weights, strict=True):
            part = one * np.cos(lat)
            area += 2.0 * part
            for lon, other in zip(lons, weights, strict=True):
                with np.errstate(all="ignore"):
                    values = real_array(name, f(*np.meshgrid(lon, lat, indexing="ij")))
                if values.shape not in ((), self.grid.cells):
                    raise InputError(
                        f"{name}: it gives shape {values.shape} for lon and lat of shape "
                        f"{self.grid.cells}"
                    )
                total += other * part * values
        return np.asarray(total / area)

    def step(self, state: State, dt: float) -> State:
        """The state after one step.

        Parameters
        ----------
        state : State
            Of this sphere and profile.
        dt : float
            Length of the step; negative for one back in time.

        Returns
        -------
        State

        Raises
        ------
        InputError
            A state of another sphere or profile or with NaN; dt that is zero, or so long that an
            edge of a cell is drawn out over a radian.
        NotFinite
            The velocity is not finite; names the place and time.
        NotConverged
            Paths that need too many sub-steps.
        """
        dt = signed_step(dt)
        self._accept(state)
        return self._advance(state, dt).require_finite()

    @keywords_named
    def run(
        self,
        state: State,
        t_end: float,
        dt: float,
        snapshots: int | Sequence[float] | None = None,
        callback: Callable[[State], State | Any] | None = None,
        progress: bool = False,
        save: Any = None,
        resume: bool = False,
    ) -> SphereTrajectory:
        """Steps to `t_end`, landing exactly on it and on every snapshot's time.

        Parameters
        ----------
        state : State
        t_end : float
            After the time of `state`, or before it with a negative `dt`.
        dt : float
            Length of the steps; the last one before each snapshot may be shorter.
        snapshots, callback, progress, save, resume
            As for `Solver.run`.

        Returns
        -------
        SphereTrajectory

        Raises
        ------
        InputError
            Steps that do not lead to `t_end`, or what `step` refuses.
        """
        self._accept(state)
        length = signed_step(dt)
        times = output_times(state.t, t_end, snapshots)
        if length * (times[-1] - state.t) < 0.0:
            raise InputError(f"dt: steps of {dt!r} do not lead from t = {state.t:g} to {t_end:g}")
        recorder = Recorder(
            state, None, save, flag("resume", resume), self._plan(state, length, times)
        )

        def record(states: Sequence[State], interrupted: bool) -> SphereTrajectory:
            return SphereTrajectory(tuple(states), self, length, interrupted)

        change = checked_callback(callback, self._accept, lambda one: one)
        return run(
            state, t_end, length, snapshots, change, progress, self._advance, lambda one: one,
            record, recorder=recorder,
        )  # fmt: skip

    def _plan(self, state: State, dt: float, times: Sequence[float]) -> dict[str, Any]:
        """What a run depends on: choices, and the velocity at some points."""
        part: Array = np.arange(1.0, 17.0) * 0.6180339887 % 1.0
        at = [state.t, 0.5 * (state.t + times[-1]), times[-1]]
        with np.errstate(all="ignore"):
            found = [self._wind(6.0 * part, 3.0 * part - 1.5, t) for t in at]
        return {
            "grid": [line.tolist() for line in self.grid.edges], "radius": self.grid.radius,
            "dt": dt, "times": times, "form": self.form, "profile": self.profile,
            "limiter": self.limiter, "bounds": repr(self.bounds), "fields": list(state.fields),
            "foot_tolerance": self.foot_tolerance,
            "velocity": [[(one + np.zeros(16)).tolist() for one in pair] for pair in found],
        }  # fmt: skip

    def _accept(self, state: State) -> None:
        check_state(state, self.grid, self.profile, {})
        if getattr(state.grid, "radius", None) != self.grid.radius:
            raise InputError(f"state: it lives on {state.grid}, the solver on {self.grid}")

    def _advance(self, state: State, dt: float) -> State:
        t, tolerance = state.t + dt, self.foot_tolerance * self.grid.widths[1][0]
        rows = state.data.reshape(-1, *self.grid.cells)
        kept, feet = self._feet
        if self.form == "advection":
            if not (self.steady and kept == dt):
                feet = self._remap.edges(self._wind, t, dt, tolerance)
            new = self._remap.step(rows, feet)
        else:
            from cip.sphere.kernels import interpolate

            if not (self.steady and kept == dt):
                start = in_space(*self.grid.mesh()).reshape(3, -1)
                feet = traced(self._wind, start, t, dt, self.grid.radius, tolerance)
            # Without the mean, so that constants are kept to rounding.
            mean, degree = rows.mean((1, 2), keepdims=True), SPHERE[self.profile]
            new = np.empty_like(rows)
            coefs = value_spline(rows - mean, degree)
            interpolate(feet, coefs, degree, PAD, new.reshape(len(rows), -1))
            new += mean
        self._feet = (dt, feet if self.steady else None)
        if self.limiter == "bounds":
            new = self._within(new)
        return state_of(
            self.grid, self.profile, new.reshape(state.data.shape), t, fields=state.fields
        )

    def _within(self, values: Array) -> Array:
        """Values within the bounds, of the same sums over cells where these are kept."""
        low, high = self.bounds
        cut = np.clip(values, low, high)
        if self.form == "transport":
            return cut
        area = self.grid.weights
        for one, before in zip(cut, values, strict=True):
            lost = float(((before - one) * area).sum())
            if lost == 0.0:
                continue
            room = high - one if lost > 0.0 else one - low
            total = float((room * area).sum())
            if not abs(lost) <= total:
                raise InputError(
                    f"bounds: the mean of the field is not within {self.bounds}; widen them"
                )
            one += lost / total * room
        return cut
