"""The solver on a sphere: a velocity, and splines of values or of means in cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from cip.errors import InputError
from cip.formulas.sphere_spline import interpolated, value_spline
from cip.grid import Array, Sphere, in_space
from cip.profiles.catalogue import SPHERE, moments
from cip.solver.runs import Runs
from cip.solver.scheme import Rule, Scheme, form_of, tolerance_of
from cip.sources.diffusion import within
from cip.sphere.paths import traced, wind_of
from cip.sphere.remap import Remap
from cip.stages.state import State, averaged, check_fields, state_of
from skfem_adini.ground.arguments import (
    choice,
    keywords_named,
    own_array,
    real_array,
    real_number,
)

PROFILES = {
    "transport": ("quintic_spline", "cubic_spline"),
    "advection": ("csl4_spline", "csl2_spline"),
}


class SphereSolver(Runs):
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
        Of several fields one pair for all or a dict by name.
    foot_tolerance : float, optional
        Largest error of the paths, in cells; default 1e-7.
    source, decay : Source, or what `Source` takes, optional
        As for `Solver`: formulas in lon, lat (radians) and t, callables of these, numbers, or
        values at the centres of cells.
    diffusion : float, optional
        Constant coefficient >= 0, length^2 / time: u_t + .. = diffusion lap u on the sphere. With
        the limiter no value leaves the range that the field has.
    reactions : dict, optional
        As for `Solver`.

    Notes
    -----
    The error at a final time, with dt / h fixed, is of order 3 for ``cubic_spline`` and
    ``csl2_spline``, 5 for ``quintic_spline`` and ``csl4_spline``, of smooth fields, and lower at
    the poles by their small cells. The sum of cells is kept to rounding; a constant density stays
    constant up to the errors of the paths and of the curves through five traced points of each
    edge, and a constant mixing ratio to rounding. Waves around a pole that are shorter than the
    spacing of latitudes are left out of the splines.

    Sources, decay, diffusion and reactions act for half a step before and after the transport, with
    an error of order dt^2. Diffusion is exact for any dt: spherical harmonics of degree n decay as
    exp(-n (n + 1) k t / R^2), those of values to rounding, means with the error of the spline, and
    the integral of means is kept. A run has gauges, budgets, files and restarts as on grids. There
    is one level, and there are no derivatives and no devices.

    Raises
    ------
    InputError
    NotSupported
        A source of snapshots.

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
        source: Any = None,
        decay: Any = None,
        diffusion: Any = None,
        reactions: Mapping[str, Any] | None = None,
    ) -> None:
        if not isinstance(sphere, Sphere):
            raise InputError(f"sphere: expected a Sphere, got {type(sphere).__name__}")
        self.grid = sphere
        self.form = form_of(form)
        among = PROFILES[self.form]
        self.profile = among[0] if profile is None else choice("profile", profile, among)
        if limiter not in (None, "bounds"):
            raise InputError(f"limiter: expected None or 'bounds', got {limiter!r}")
        self.limiter = limiter
        self.foot_tolerance = tolerance_of(foot_tolerance) or 1e-7
        self.velocity = velocity if callable(velocity) else own_array("velocity", velocity)
        self._kernels = Carrier(sphere, self.velocity, SPHERE[self.profile], self.foot_tolerance)
        self.steady = self._kernels.steady
        self._set_terms(source, decay, diffusion, reactions, bounds, None)
        self._first_scheme(diffusion)

    def _scheme(self, fields: tuple[str, ...]) -> Scheme:
        if fields not in self._schemes:
            rules = []
            for name in fields or ("",):
                _, acting, bounds = self._acting(name)
                rules.append(Rule(acting, {}, {}, bounds))
            stage: Any = [rule.bounds for rule in rules] if self.limiter else None
            self._schemes[fields] = Scheme([stage], rules)
        return self._schemes[fields]

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
        self._accept(state)
        return state

    def _cells(self, name: str, f: Any) -> Array:
        """Values at the centres of cells, or means."""
        if not callable(f):
            found = real_array(name, f).astype(float)
            if found.shape not in ((), self.grid.cells):
                raise InputError(
                    f"{name}: expected a function of lon and lat, a number or values of shape "
                    f"{self.grid.cells} (a sphere has one level), got shape {found.shape}"
                )
            return found + np.zeros(self.grid.cells)

        def values(lon: Array, lat: Array, *rest: Any) -> Array:
            with np.errstate(all="ignore"):
                found = real_array(name, f(*np.broadcast_arrays(lon, lat)))
            if found.shape not in ((), self.grid.cells):
                raise InputError(
                    f"{name}: it gives shape {found.shape} for lon and lat of shape "
                    f"{self.grid.cells}"
                )
            return found

        (moment,) = moments(self.profile, 2)
        return np.asarray(averaged(values, self.grid, moment, 0.0))

    def _time_scale(self, t: float) -> float:
        return self._kernels.time_scale(t)

    def _velocity_at(self, point: list[Any], times: Sequence[float]) -> Any:
        with np.errstate(all="ignore"):
            found = [self._kernels.wind(point[0], point[1], t) for t in times]
        return [[(one + np.zeros(point[0].size)).tolist() for one in pair] for pair in found]

    def _plan(self, state: State, times: Sequence[float]) -> dict[str, Any]:
        return super()._plan(state, times) | {"radius": self.grid.radius}

    def _accept(self, state: State) -> None:
        super()._accept(state)
        if getattr(state.grid, "radius", None) != self.grid.radius:
            raise InputError(f"state: it lives on {state.grid}, the solver on {self.grid}")


class Carrier:
    """What an engine is to grids: the transport of all fields by feet that they share. `degree` is
    that of splines, even of means, odd of values."""

    xp = np

    def __init__(self, sphere: Sphere, velocity: Any, degree: int, tolerance: float) -> None:
        self._sphere, self._degree = sphere, degree
        self.wind, self.steady = wind_of(velocity, sphere)
        self._tolerance = tolerance * sphere.widths[1][0]
        self._remap = Remap(sphere, degree) if degree % 2 == 0 else None
        self._feet: tuple[float, Any] = (0.0, None)

    def place(self, state: State) -> State:
        """Host memory is where it works."""
        return state

    def apply(
        self, bounds: Sequence[tuple[float, float]] | None, data: Array, t: float, dt: float,
        tallies: Any = (),
    ) -> Array:  # fmt: skip
        """The moments after a step, within the bounds of each field if there are some."""
        rows, feet = data.reshape(-1, *self._sphere.cells), self._traced(t + dt, dt)
        means = self._remap is not None
        new = self._remap.step(rows, feet) if self._remap else self._values(rows, feet)
        if bounds is not None:
            area = self._sphere.weights if means else None
            new = np.stack([within(*one, area) for one in zip(new, bounds, strict=True)])
        return new.reshape(data.shape)

    def _traced(self, t: float, dt: float) -> Any:
        """Feet of the centres of cells, or traced edges, which are kept for a steady wind."""
        kept, feet = self._feet
        if not (self.steady and kept == dt):
            if self._remap is not None:
                feet = self._remap.edges(self.wind, t, dt, self._tolerance)
            else:
                start = in_space(*self._sphere.mesh()).reshape(3, -1)
                feet = traced(self.wind, start, t, dt, self._sphere.radius, self._tolerance)
            self._feet = (dt, feet if self.steady else None)
        return feet

    def _values(self, rows: Array, feet: Array) -> Array:
        # Without the mean, so that constants are kept to rounding.
        mean = rows.mean((1, 2), keepdims=True)
        new = interpolated(value_spline(rows - mean, self._degree), feet, self._degree)
        return new.reshape(rows.shape) + mean

    def time_scale(self, t: float) -> float:
        """The time in which the fastest point moves by a width of latitude."""
        lon, lat = self._sphere.mesh()
        speed = float(np.hypot(*self.wind(lon.ravel(), lat.ravel(), t)).max())
        if not 0.0 < speed < np.inf:
            raise InputError("cfl: the velocity at the start is zero or not finite; pass dt")
        return self._sphere.radius * float(self._sphere.widths[1][0]) / speed
