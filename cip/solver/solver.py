"""The solver: a velocity, a profile and a limiter on a grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse.linalg import LinearOperator

from cip.characteristics.feet import signed_step
from cip.engines.engine import Engine, Setting
from cip.errors import InputError
from cip.formulas.formula import Formula
from cip.formulas.parameters import Parametrised
from cip.formulas.snapshots import snapshots_of
from cip.formulas.source import Source
from cip.formulas.velocity import Velocity, check_periodic
from cip.grid import Grid
from cip.output.trajectory import Trajectory
from cip.profiles.catalogue import LIMITER_CODES, LIMITERS, LINE, PLANE, moments
from cip.solver.derivatives import derivative
from cip.solver.time_loop import checked_callback, run, step_length
from cip.sources.diffusion import diffusion as spread
from cip.sources.reaction import Reaction, halves, reacted, reaction
from cip.stages.stage import Stage, StageFeet, stages
from cip.stages.state import State, _real, default_profile, state_of
from cip.stages.walls import check_split, portable_boundary, walls
from skfem_adini.ground.arguments import real_array, real_number


class Solver(Parametrised):
    r"""Multi-moment semi-Lagrangian scheme for u_t + c . grad u = 0 or p_t + div(c p) = 0.

    A source and decay, s - k u, may stand on the right.
    A step follows the characteristics of all nodes backward, with a tolerance far below the error
    of the profiles, and evaluates the field at their feet by its profile; derivatives of the field
    follow by the chain rule with the derivatives of the foot (King 2012, chapters 2 and 3; Yabe and
    Aoki, Comput. Phys. Commun. 66, 1991, 219-232). There is no stability limit on dt. Feet of a
    steady velocity are computed once for each dt.

    Parameters
    ----------
    grid : Grid
    velocity : Velocity, or what `Velocity` takes
    form : {"transport", "advection"}
        ``"transport"`` (or ``"advective"``) for u_t + c . grad u = 0, which carries values along;
        ``"advection"`` (or ``"conservative"``) for p_t + div(c p) = 0, which keeps the integral.
        The names are King's; many authors use "transport" for the second.
    profile : str, optional
        One-dimensional: ``linear``, ``piecewise_linear``, ``smoothed`` (its printed form, for
        comparison), ``cubic``, ``quintic``, and for advection ``csl2``, ``csl4``;
        two-dimensional: ``adini``, ``bicubic``. One-dimensional profiles serve two and three
        dimensions through the splitting (``csl4`` then takes its slopes from values and means).
    limiter : {None, "clamp", "eno", "rational", "bounds"}
        See the notes; ``eno`` guarantees no bounds and loses mass in two dimensions.
    splitting : {None, "strang"}
        Required for one-dimensional profiles on grids of two and three dimensions.
    boundary : optional
        Inflow data: a number, a formula or a callable ``g(x1, .., t)`` for all walls, or a dict of
        these by wall, ``{"x-": g, "y+": 0.0}``; a `Source` where a formula has named parameters. A
        characteristic that enters through a wall without data raises `LeftDomain`; outflow walls
        need none.
    backend : {"cpu", "cupy"}
    dtype : float64 or float32
    bounds : (low, high)
        For the limiter ``"bounds"``, in the unit of the field; data that begin or enter outside are
        refused.
    bounds_tolerance : float
        The limiter leaves a profile unchanged that exceeds the bounds by less than this, in the
        unit of the field; it should exceed the rounding errors of the field.
    store_feet : bool, optional
        Whether feet are stored, or computed again by every kernel, which needs a velocity that is a
        formula; default: stored for steady velocities.
    source : Source, or what `Source` takes, optional
        What is added in each unit of time, s(x, t).
    decay : float, str, callable, array or Source, optional
        Rate k >= 0 at which the field decays, 1 / time, with the same forms as a source.
    diffusion : float, or one for each direction, optional
        Constant coefficient >= 0, length^2 / time, on uniform grids: u_t + .. = diffusion lap u,
        with no diffusive flux through walls.
    foot_tolerance : float, optional
        Largest error of the feet, in cells; default 1e-5 for velocities from snapshots, whose
        interpolation in time errs by as much, and for others 1e-10, or 1e-8 if they depend on t.

    Notes
    -----
    What holds exactly, up to rounding:

    * constants are kept by every scheme for transport, and for advection with constant velocity;
    * the integral is kept by csl2 and csl4 always, in any dimension, up to the flux through the
      walls; by the other profiles for constant velocity on uniform grids;
    * ``linear`` for transport, and ``clamp`` for transport by a direct or one-dimensional step,
      keep the range of the initial values; ``clamp`` does not conserve;
    * ``bounds`` keeps values and means within (low, high) if each one-dimensional motion is
      divergence-free: on lines for constant c, in a splitting for rotations and shears. A bound 0
      (lower or upper) is always kept. Otherwise take ``(0, inf)``: where the flow compresses, the
      exact field itself exceeds an upper bound, and between the sweeps of a splitting it does so
      even if div c = 0. Bounds other than 0 are therefore imposed only in sweeps before which no
      sweep of the step has compressed the field; the result may exceed them by the splitting error;
    * ``eno`` takes the piecewise linear profile in cells whose data are not smooth. It guarantees
      no bounds: at constant speed new extrema are below .001 of the range on Jiang and Shu's
      profile, at a speed that varies by a factor 19 they were .04 to .36 (.07 to .1 without a
      limiter). In two dimensions it flattens features few cells wide: a bell stretched by a swirl
      lost 10 to 50 % of its integral, 3 to 11 % with ``clamp`` and less than .1 % without a
      limiter. Take ``clamp`` where no value may leave the range, csl2 or csl4 with ``bounds`` where
      the integral must be kept;
    * ``rational`` keeps the profile convex or concave (cubic), or monotone (csl2), in cells whose
      data are.

    On lines and in direct steps the error at a final time, with dt / h fixed, is of order 3 for
    cubic, adini, bicubic and csl2, 5 for quintic and csl4, 2 for piecewise_linear; the splitting
    adds an error of order dt^2, and so do sources and decay (`cip.sources.reaction`), which act for
    half a step before and after the transport. The integral then changes by that of the source,
    exact for csl2 and csl4, and falls by exp(-k t) exactly for the same k everywhere. In a
    splitting a source should vanish on walls with inflow; its error there is of order dt. Diffusion
    acts for half a step before and after, too, exactly for any dt and with the same integral; where
    a flow enters through walls its error there is of order dt. With a limiter it is that of second
    differences, of order 2 in the spacing, whose values never leave the range.

    Raises
    ------
    InputError, NotSupported, MissingDependency
        Among others for a velocity that jumps between the sides of a periodic direction, and for
        data outside the bounds of the limiter ``"bounds"``.

    Warns
    -----
    PeriodicityWarning
        A velocity whose derivative jumps there, or which itself does a little.

    References
    ----------
    T. Yabe and T. Aoki, A universal solver for hyperbolic equations by cubic-polynomial
    interpolation I, Comput. Phys. Commun. 66 (1991), 219-232. S. A. King, Multi-Moment Methods for
    PDEs and GPUs for Large-Scale Scientific Computations, dissertation, North Carolina State
    University 2012.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, Solver
    >>> grid = Grid((0, 1), 40, periodic=True)
    >>> solver = Solver(grid, 1.0)
    >>> start = solver.state(lambda x: np.sin(2 * np.pi * x))
    >>> end = solver.run(start, 1.0, dt=0.01).final
    >>> print(f"{np.abs(end['u'] - start['u']).max():.1e}")
    1.5e-04
    """

    _kind = "solver"

    def __init__(
        self,
        grid: Grid,
        velocity: Any,
        form: Literal["transport", "advective", "advection", "conservative"] = "transport",
        profile: str | None = None,
        limiter: str | None = None,
        splitting: str | None = None,
        boundary: Any = None,
        backend: str = "cpu",
        dtype: DTypeLike = np.float64,
        bounds: tuple[float, float] = (0.0, np.inf),
        bounds_tolerance: float = 1e-14,
        store_feet: bool | None = None,
        source: Any = None,
        decay: Any = None,
        diffusion: Any = None,
        foot_tolerance: float | None = None,
    ) -> None:
        if not isinstance(grid, Grid):
            raise InputError(f"grid: expected a Grid, got {type(grid).__name__}")
        self.grid = grid
        self.velocity = velocity if isinstance(velocity, Velocity) else Velocity(velocity)
        self.form: Form = form_of(form)
        self.profile = default_profile(grid) if profile is None else profile
        if profile is None and grid.dim == 3:
            splitting = splitting or "strang"
        self.limiter, self.splitting = limiter, splitting
        self.dtype, self.backend = _real(dtype), backend
        check_choices(grid, self.form, self.profile, limiter, splitting, backend)
        self.bounds = bounds_of(bounds)
        self.bounds_tolerance = real_number("bounds_tolerance", bounds_tolerance)
        if not self.bounds_tolerance >= 0.0:
            raise InputError(f"bounds_tolerance: expected >= 0, got {bounds_tolerance!r}")
        self._formulas = self.velocity.on(grid)
        check_periodic(self._formulas, grid)
        self.steady = self.velocity.steady and all(c.steady for c in self._formulas)
        if store_feet not in (None, True, False):
            raise InputError(f"store_feet: expected True, False or None, got {store_feet!r}")
        self.store_feet = store_feet
        self.foot_tolerance = tolerance_of(foot_tolerance)
        self._boundary = dict(boundary) if isinstance(boundary, Mapping) else boundary
        self.source, self.decay = Source.of(source, "source"), Source.of(decay, "decay")
        self._parameters = parameters_of(self.velocity, self.source, self.decay, boundary)
        setting = Setting(
            grid, self._formulas, self.profile, limiter, self.bounds, self.bounds_tolerance,
            self.dtype, store_feet, self.steady,
        )  # fmt: skip
        if backend == "cupy":
            from cip.engines.cuda_engine import CudaEngine

            self._kernels: Engine = CudaEngine(setting)
        else:
            from cip.engines.cpu_engine import CpuEngine

            self._kernels = CpuEngine(setting)
        xp = self._kernels.xp
        self._reaction = reaction(grid, self.profile, self.source, self.decay, xp)
        spreads = spread(grid, self.profile, diffusion, limiter is not None, xp)
        self.diffusion = None if spreads is None else spreads.rates
        self._reactions = [one for one in (self._reaction, spreads) if one is not None]
        self._inflow = {
            f"{'xyz'[axis]}{'-+'[side]}": formula
            for (axis, side), formula in walls(boundary, grid).items()
        }
        if limiter == "bounds":
            for name, formula in self._inflow.items():
                if formula.exact and formula.steady:
                    self._check_inflow(name, formula, np.zeros(1))
        self._stages = made_stages(
            grid, self._formulas, self.profile, self.form == "advection", boundary, self._reaction
        )
        for stage in self._stages:
            stage.foot_tolerance = self.foot_tolerance

    def __reduce__(self) -> Any:
        return Solver, self._arguments(portable_boundary(self._boundary, self.grid))

    def _with(self, values: dict[str, float]) -> Solver:
        return Solver(*(with_values(one, values) for one in self._arguments(self._boundary)))

    def __deepcopy__(self, memo: dict[int, Any]) -> Solver:
        return Solver(*deepcopy(self._arguments(self._boundary), memo))

    def _arguments(self, boundary: Any) -> tuple[Any, ...]:
        """The arguments of the constructor, from which a copy is made."""
        return (
            self.grid, self.velocity, self.form, self.profile, self.limiter, self.splitting,
            boundary, self.backend, self.dtype, self.bounds, self.bounds_tolerance,
            self.store_feet, self.source, self.decay, self.diffusion, self.foot_tolerance,
        )  # fmt: skip

    def state(self, f: Any, derivatives: Any = None, t: float = 0.0) -> State:
        """`State.from_function` with the grid, profile and precision of this solver.

        Parameters
        ----------
        f, derivatives, t
            As for `State.from_function`.

        Returns
        -------
        State
            Where the solver works: in host memory, or on the device.
        """
        made = State.from_function(f, self.grid, self.profile, derivatives, t, self.dtype)
        self._accept(made)
        return self._kernels.place(made)

    def step(self, state: State, dt: float) -> State:
        """The state after one step of length dt, of any size.

        Parameters
        ----------
        state : State
            On this solver's grid, with the moments of its profile.
        dt : float
            Negative for a step back in time, along the same characteristics.

        Returns
        -------
        State
            At the time ``state.t + dt``.

        Raises
        ------
        InputError
            A state of another grid, profile or with NaN; dt that is zero.
        LeftDomain
            A characteristic comes in through a wall without data.
        NotFinite
            The velocity, a characteristic or the new field is not finite; names node and time.
        """
        dt = signed_step(dt)
        self._accept(state)
        self._check_times(state.t, state.t + dt)
        return self._advance(self._kernels.place(state), dt).require_finite()

    def run(
        self,
        state: State,
        t_end: float,
        dt: float | None = None,
        cfl: float | None = None,
        snapshots: int | Sequence[float] | None = None,
        callback: Callable[[State], State | Any] | None = None,
        progress: bool = False,
    ) -> Any:
        """Steps to `t_end`, landing exactly on it and on every snapshot's time.

        With `t_end` before the time of `state`, and a negative `dt`, the run leads back in time:
        the equation is solved for the past, sources and decay included, and what was outflow
        becomes inflow, for which `boundary` needs data.

        Parameters
        ----------
        state : State
        t_end : float
            After the time of `state`, or before it.
        dt : float, optional
            Length of the steps; the last one before each snapshot may be shorter. Negative in a
            run back in time.
        cfl : float, optional
            Instead of `dt`: the largest number of cells that a node moves in a step, by the
            velocity at the start.
        snapshots : int or sequence of float, optional
            The number of equal intervals whose ends are kept, or the times to keep; default start
            and end.
        callback : callable, optional
            Called with the state after every step. A State that it returns takes the place of this
            one, for instance with a field that was corrected; `tangent` and `adjoint` refuse such
            a run. What else it returns is ignored. It may raise StopIteration to end the run.
        progress : bool
            Log one line for each snapshot at level INFO.

        Returns
        -------
        Trajectory
            After an interruption from the keyboard or a StopIteration it ends with the last
            finished step and is marked ``interrupted``.
        """
        self._accept(state)
        self._check_times(state.t, real_number("t_end", t_end))
        length = step_length(dt, cfl, self.grid, self._formulas, state.t, float(t_end))

        def record(states: Sequence[State], interrupted: bool) -> Trajectory:
            return Trajectory(tuple(states), self, length, interrupted)

        loop = (self._advance, self._kernels.begin, record)
        change = checked_callback(callback, self._accept, self._kernels.place)
        return run(state, t_end, length, snapshots, change, progress, *loop)

    def tangent(self, run: Trajectory, checkpoints: int | None = None) -> LinearOperator:
        """The derivative of a run's last state in its first one and in the solver's parameters.

        It is that of the discrete steps with the sub-steps that the characteristics took, exact to
        rounding (`cip.sensitivities.window`); for cubic, quintic, csl2, csl4, adini and bicubic,
        with sources, decay, and what enters through walls. Where a foot lies on an edge of a cell,
        as at rest or after whole cells, derivatives of the profile may jump: the mean of both sides
        is taken, as by a central difference. A uniform velocity takes one sub-step: for changes
        that are not uniform dt should be short there.

        Parameters
        ----------
        run : Trajectory
            Of this solver; it is computed once more.
        checkpoints : int, optional
            How many states the adjoint keeps, beside those between two of them, which it computes
            again; default all if that is at most 1 GiB, else the square root of the steps.

        Returns
        -------
        scipy.sparse.linalg.LinearOperator (on a device that of cupyx.scipy, for arrays of CuPy)
            Shape (N, N + P): columns are the N moments of the first state, ``state.data.ravel()``,
            then the P parameters, in the order of ``solver.parameters``. Its method
            ``feet_on_edges()`` counts the feet, over all steps, whose derivatives in the parameters
            are means of both sides: none where it is 0.

        Raises
        ------
        NotSupported
            A profile or limiter without derivatives.
        InputError
            A run of another solver.

        Examples
        --------
        >>> import numpy as np
        >>> from cip import Grid, Solver, Velocity
        >>> shift = Velocity.from_expression("a", parameters={"a": 1.0})
        >>> solver = Solver(Grid((0, 1), 32, periodic=True), shift, profile="quintic")
        >>> run = solver.run(solver.state("sin(2*pi*x1)"), 0.5, dt=0.05)
        >>> by_speed = solver.tangent(run) @ np.append(np.zeros(96), 1.0)  # -0.5 u_x(x - 0.5)
        >>> bool(abs(by_speed[0] - np.pi) < 1e-4)
        True
        """
        return derivative(self, run, checkpoints).operator()

    def adjoint(self, run: Trajectory, checkpoints: int | None = None) -> LinearOperator:
        """The transpose of `tangent`, which gives gradients at a cost that does not grow with N.

        Parameters
        ----------
        run, checkpoints
            As for `tangent`.

        Returns
        -------
        scipy.sparse.linalg.LinearOperator
            Shape (N + P, N).

        Examples
        --------
        >>> from cip import Grid, Solver
        >>> solver = Solver(Grid((0, 1), 32, periodic=True), 1.0)
        >>> run = solver.run(solver.state("sin(2*pi*x1)"), 0.5, dt=0.05)
        >>> (solver.adjoint(run) @ run.final.data.ravel()).shape
        (64,)
        """
        return derivative(self, run, checkpoints).operator().T

    def _accept(self, state: State) -> None:
        check_state(state, self.grid, self.profile)
        if self.limiter == "bounds":
            check_bounded(state, self.bounds, self.bounds_tolerance)

    def _check_times(self, start: float, end: float) -> None:
        """Raise `InputError` if velocity or source are not known from `start` to `end`, or if data
        on walls leave the bounds of the limiter then.
        """
        for known in (snapshots_of(self._formulas), self._reaction):
            if known is not None:
                known.check_times(min(start, end), max(start, end))
        if self.limiter == "bounds" and np.isfinite(end):
            for name, formula in self._inflow.items():
                if not formula.steady:
                    self._check_inflow(name, formula, np.linspace(start, end, 65))

    def _check_inflow(self, name: str, formula: Formula, times: NDArray[np.float64]) -> None:
        """Raise `InputError` for data on a wall outside the bounds of the limiter."""
        axis, side = "xyz".index(name[0]), "-+".index(name[1])
        lines = [*self.grid.coordinates]
        lines[axis] = np.array([self.grid.bounds[axis][side]])
        points = np.meshgrid(*lines, times, indexing="ij")
        point = [*points[:-1], *([np.zeros(())] * (3 - self.grid.dim)), points[-1]]
        found = formula.derivative((0, 0, 0, 0), (*self.grid.spacing, 1.0, 1.0, 1.0))(*point)
        if np.isfinite(found).all():
            what, remedy = f"boundary {name!r}: the field there", "change it, or widen bounds"
            check_within(found, self.bounds, self.bounds_tolerance, what, remedy)

    def _advance(self, state: State, dt: float) -> State:
        new = advanced(self._kernels, self._stages, self._reactions, state, dt)
        if self.limiter == "bounds":
            new.__dict__["_bounded"] = self.bounds
        return new

    def feet(self, stage: Stage, t: float, dt: float) -> StageFeet:
        """Feet of a stage in the precision of the solver, kept for a steady velocity.

        Parameters
        ----------
        stage : Stage
        t : float
            Time at the beginning of the step.
        dt : float
            Length of the step.

        Returns
        -------
        StageFeet
        """
        return self._kernels.feet(stage, t, dt)


def parameters_of(velocity: Any, source: Any, decay: Any, boundary: Any) -> dict[str, float]:
    """The values of all parameters of the solver's arguments, in order. Raises `InputError` for two
    values of one name, since code takes one name for one parameter.
    """
    found: dict[str, float] = {}
    first: dict[str, str] = {}
    functions = {"velocity": velocity, "source": source, "decay": decay, "boundary": boundary}
    for label, function in functions.items():
        parts = function.values() if isinstance(function, Mapping) else [function]
        for part in parts:
            own = part.parameters if isinstance(part, Parametrised) else {}
            for name, value in own.items():
                if found.setdefault(name, value) != value:
                    raise InputError(
                        f"{label}: its parameter {name!r} is {value:.6g}, that of {first[name]} "
                        f"{found[name]:.6g}; one name is one parameter: rename one of them"
                    )
                first.setdefault(name, label)
    return found


def with_values(function: Any, values: Mapping[str, float]) -> Any:
    """An argument of a solver with new values of those parameters that it has."""
    if isinstance(function, Mapping):
        return {wall: with_values(part, values) for wall, part in function.items()}
    if not isinstance(function, Parametrised):
        return function
    own = {name: values[name] for name in function.parameters if name in values}
    return function.with_parameters(**own) if own else function


def made_stages(
    grid: Grid,
    velocity: tuple[Formula, ...],
    profile: str,
    advect: bool,
    boundary: Any,
    reaction: Reaction | None,
) -> list[Stage]:
    """Make the stages of one step; `reaction` acts before and after them."""
    data = walls(boundary, grid)
    split = grid.dim > 1 and profile in LINE
    if split:
        check_split(data, advect)
    return stages(grid, velocity, profile, advect, reacted(data, reaction, split))


def advanced(
    kernels: Engine, made: list[Stage], reactions: Sequence[Any], state: State, dt: float
) -> State:
    """The state after a step: the stages between the halves of sources, decay and diffusion."""
    data, t = state.data, state.t
    before, after = halves(reactions, t, dt)
    for half in before:
        data = half.applied(data)
    for stage in made:
        data = kernels.apply(stage, data, t, dt)
    for half in after:
        data = half.applied(data)
    return state_of(state.grid, state.profile, data, t + dt)


Form = Literal["transport", "advection"]


def check_choices(
    grid: Grid, form: Form, profile: str, limiter: Any, splitting: Any, backend: Any
) -> None:
    """Raise `InputError` for options of a solver that do not exist or are incompatible."""
    moments(profile, grid.dim)
    if not isinstance(limiter, str | None) or limiter not in LIMITER_CODES:
        raise InputError(
            f"limiter: expected one of {', '.join(map(str, LIMITER_CODES))}, got {limiter!r}"
        )
    if limiter is not None and limiter not in LIMITERS[profile]:
        allowed = ", ".join(LIMITERS[profile]) or "no limiter"
        raise InputError(f"limiter: {limiter!r} does not fit {profile!r}, which takes {allowed}")
    if splitting is not None and not _is(splitting, "strang"):
        raise InputError(f"splitting: expected None or 'strang', got {splitting!r}")
    if profile in PLANE and splitting is not None:
        raise InputError(f"splitting: {profile!r} is direct; pass splitting=None")
    if profile in LINE and grid.dim > 1 and splitting is None:
        raise InputError(
            f"splitting: {profile!r} is one-dimensional; pass splitting='strang', or "
            "profile='adini' or 'bicubic' in two dimensions"
        )
    if profile.startswith("csl") and form != "advection":
        raise InputError(
            f"form: {profile!r} conserves the integral and so needs form='advection' "
            "(the same equation where div c = 0)"
        )
    if not _is(backend, "cpu", "cupy"):
        raise InputError(f"backend: expected 'cpu' or 'cupy', got {backend!r}")


def _is(value: Any, *names: str) -> bool:
    return isinstance(value, str) and value in names


def form_of(form: Any) -> Form:
    """The equation of this name."""
    forms: dict[Any, Form] = {
        "transport": "transport",
        "advective": "transport",
        "advection": "advection",
        "conservative": "advection",
    }
    found = forms.get(form) if isinstance(form, str) else None
    if found is None:
        raise InputError(f"form: expected one of {', '.join(forms)}, got {form!r}")
    return found


def bounds_of(bounds: Any) -> tuple[float, float]:
    """The argument `bounds` as two numbers."""
    pair = real_array("bounds: expected (low, high)", bounds)
    if pair.shape != (2,):
        raise InputError(f"bounds: expected (low, high), got {bounds!r}")
    low, high = map(float, pair)
    if not low < high:
        raise InputError(f"bounds: low must be below high, got {bounds!r}")
    return low, high


def tolerance_of(given: float | None) -> float | None:
    """The argument `foot_tolerance`."""
    if given is None:
        return None
    value = real_number("foot_tolerance", given)
    if not 1e-12 <= value <= 1.0:
        raise InputError(f"foot_tolerance: expected 1e-12 to 1 cells, got {given!r}")
    return value


def check_within(
    values: Any, bounds: tuple[float, float], tolerance: float, what: str, remedy: str
) -> None:
    """Raise `InputError` for values outside the bounds by more than a tolerance and rounding."""
    low, high = float(values.min()), float(values.max())
    slack = tolerance + 8.0 * float(np.finfo(values.dtype).eps) * max(abs(low), abs(high))
    if low < bounds[0] - slack or high > bounds[1] + slack:
        worst = low if low < bounds[0] - slack else high
        raise InputError(
            f"{what} reaches {worst:.6g}, outside the bounds {bounds} of the limiter, which cannot "
            f"keep what was never inside; {remedy}"
        )


def check_bounded(state: State, bounds: tuple[float, float], tolerance: float) -> None:
    """Raise `InputError` for values or means outside the bounds of the limiter. A state that this
    limiter has stepped is accepted: sources and splitting may exceed the bounds.
    """
    if state._bounded == bounds:
        return
    for moment in moments(state.profile, state.grid.dim):
        if not any(moment.orders):
            what = f"state: moment {moment.name!r}"
            check_within(state[moment.name], bounds, tolerance, what, "clip it, or widen bounds")


def check_state(state: Any, grid: Grid, profile: str) -> None:
    """Raise `InputError` unless it is a state on this grid with the moments of this profile."""
    if not isinstance(state, State):
        raise InputError(f"state: expected a State, got {type(state).__name__}")
    if state.profile != profile:
        raise InputError(
            f"state: it carries the moments of {state.profile!r}, the solver those of "
            f"{profile!r}; make it with solver.state(f)"
        )
    state.check()
    if state.grid is not grid and (
        state.grid.nodes != grid.nodes
        or state.grid.periodic != grid.periodic
        or any(not np.array_equal(a, b) for a, b in zip(state.grid.edges, grid.edges, strict=True))
    ):
        raise InputError(f"state: it lives on {state.grid}, the solver on {grid}")
