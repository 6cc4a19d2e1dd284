"""The solver: a velocity, a profile and a limiter on a grid."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse.linalg import LinearOperator

from cip.characteristics.feet import time_scale
from cip.engines.engine import Engine, Setting
from cip.errors import InputError, LeftDomain, NotSupported
from cip.formulas.formula import Formula
from cip.formulas.snapshots import snapshots_of
from cip.formulas.velocity import Velocity, check_periodic
from cip.grid import Grid, check_grid, wall_name
from cip.output.budget import Tally
from cip.output.trajectory import Trajectory
from cip.profiles.catalogue import LINE, moments
from cip.solver.derivatives import derivative
from cip.solver.runs import Runs, values_at
from cip.solver.scheme import (
    Form,
    Rule,
    Scheme,
    check_choices,
    check_within,
    checked_coast,
    form_of,
    made_scheme,
    of_field,
    tolerance_of,
)
from cip.sources.reaction import reacted
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State, _real, default_profile
from cip.stages.walls import check_split, portable_boundary, walls
from skfem_adini.ground.arguments import keywords_named, real_number


class Solver(Runs):
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
        None is Strang's for one-dimensional profiles on grids of two and three dimensions.
    boundary : optional
        Inflow data: a number, a formula or a callable ``g(x1, .., t)`` for all walls, or a dict of
        these by wall, ``{"x-": g, "y+": 0.0}``; a `Source` where a formula has named parameters. A
        characteristic that enters through a wall without data raises `LeftDomain`; outflow walls
        need none. ``"closed"``: nothing passes (csl2 and csl4). In a splitting, csl2, csl4 and
        linear take all data, best smooth along the wall; other profiles a constant (transport) or
        0 (advection).
    backend : {"cpu", "cupy"}
    dtype : float64 or float32
    bounds : (low, high)
        For the limiter ``"bounds"``, in the unit of the field; data that begin or enter outside are
        refused. Of several fields one pair for all or a dict by name, without limits for others.
    bounds_tolerance : float
        The limiter leaves a profile unchanged that exceeds the bounds by less than this, in the
        unit of the field; it should exceed the rounding errors of the field.
    store_feet : bool, optional
        Whether feet are stored, or computed again by every kernel, which needs a velocity that is a
        formula; default: stored for steady velocities.
    source : Source, or what `Source` takes, optional
        What is added in each unit of time, s(x, t).
    decay : float, str, callable, array or Source, optional
        Rate k >= 0 at which the field decays, 1 / time, with the same forms as a source. Where a
        state has several fields, `source`, `decay`, `diffusion` and `boundary` hold for all, or
        are dicts by their names, ``{"dust": 0.1}``: then a field that is not there has none.
    diffusion : float, or one for each direction, optional
        Constant coefficient >= 0, length^2 / time, on uniform grids: u_t + .. = diffusion lap u,
        with no diffusive flux through walls.
    reactions : dict, optional
        Rates of change of fields by name, formulas in all fields, the coordinates and t, as
        ``{"a": "-0.2*a*b", "b": "0.2*a*b"}``, in the unit of the field over time.
    land : array of bool, shape ``grid.cells``, optional
        Cells that carry nothing and let nothing through, whatever the velocity there (finite), for
        csl2 and csl4. Where the flow runs against a coast, what it brings gathers in the coastal
        cell; where it runs off one, nothing follows.
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
    adds an error of order dt^2, and for csl2 and csl4 one of order h^2 where a component of the
    velocity varies across its own direction, since means across a sweep move with the velocity at
    the middle of their cell. Errors of order dt^2 come from sources and decay too
    (`cip.sources.reaction`), which act for half a step before and after the transport. The integral
    then changes by that of the source, exact for csl2 and csl4, and falls by exp(-k t) exactly for
    the same k everywhere. In a
    splitting with slopes (cubic, quintic) a source should vanish on walls with inflow; its error
    there is of order dt. Diffusion
    and reactions act for half a step before and after, too. Diffusion is exact for any dt, with the
    same integral; where a flow enters through walls its error there is of order dt. With a limiter
    it is that of second differences, of order 2 in the spacing, whose values never leave the range.
    Reactions take as many sub-steps as they need and keep linear invariants, such as a + b above,
    also of the integrals; data on walls should be in balance, or their error there is of order dt.

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

    @keywords_named
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
        bounds: Any = (0.0, np.inf),
        bounds_tolerance: float = 1e-14,
        store_feet: bool | None = None,
        source: Any = None,
        decay: Any = None,
        diffusion: Any = None,
        reactions: Mapping[str, Any] | None = None,
        land: Any = None,
        foot_tolerance: float | None = None,
    ) -> None:
        check_grid(grid)
        self.grid = grid
        self.velocity = velocity if isinstance(velocity, Velocity) else Velocity(velocity)
        self.form: Form = form_of(form)
        self.profile = default_profile(grid) if profile is None else profile
        if splitting is None and grid.dim > 1 and self.profile in LINE:
            splitting = "strang"
        self.limiter, self.splitting = limiter, splitting
        self.dtype, self.backend = _real(dtype), backend
        check_choices(grid, self.form, self.profile, limiter, splitting, backend)
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
        self._coast = checked_coast(grid, self.profile, land, boundary)
        self.land = None if self._coast is None else self._coast.land
        self._set_terms(source, decay, diffusion, reactions, bounds, boundary)
        setting = Setting(
            grid, self._formulas, self.profile, limiter,
            of_field(self.bounds, "") or (-np.inf, np.inf), self.bounds_tolerance,
            self.dtype, store_feet, self.steady, self.velocity._feet,
        )  # fmt: skip
        self._kernels = engine_of(backend, setting)
        if self._coast is not None and self._coast.land is not None:
            self._sea = self._kernels.xp.asarray(self._coast.sea(self.profile))
        first = self._first_scheme(diffusion)
        self._stages, self._reactions = first.stages, first.rules[0].reactions
        if limiter == "bounds":
            for rule in first.rules:
                for name, formula in rule.inflow.items():
                    if formula.exact and formula.steady:
                        self._check_inflow(name, formula, np.zeros(1), rule.bounds)

    def _scheme(self, fields: tuple[str, ...]) -> Scheme:
        """The stages for a state of these fields, and what holds for each of them."""
        if fields in self._schemes:
            return self._schemes[fields]
        if self._named or not fields:
            rules = [self._rule(name) for name in fields or ("",)]
            own = bool({*self._named} - {"diffusion", "reactions"})
            advect = self.form == "advection"
            given = self.grid, self._formulas, self.profile, advect, rules, own, self._coast
            found = made_scheme(*given)
            for stage in found.stages:
                stage.foot_tolerance = self.foot_tolerance
        else:
            alike = self._scheme(())
            found = Scheme(alike.stages, alike.rules * len(fields))
        self._schemes[fields] = found
        return found

    def _rule(self, field: str) -> Rule:
        """What holds for a field of this name."""
        data = walls(of_field(self._boundary, field), self.grid)
        made, acting, bounds = self._acting(field)
        slopes = any(any(moment.orders) for moment in moments(self.profile, self.grid.dim))
        fixed = slopes and self.grid.dim > 1 and self.profile in LINE
        if fixed:
            check_split(data, self.form == "advection", self.profile)
        inflow = {wall_name(*wall): one for wall, one in data.items()}
        if self.land is not None and len(acting) > (made is not None):
            raise NotSupported("diffusion: it would cross land; leave one of both away")
        return Rule(acting, reacted(data, made, fixed), inflow, bounds)

    def _portable(self) -> tuple[Any, ...]:
        return self._arguments(portable_boundary(self._boundary, self.grid))

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
        if self._coast is not None:
            made.data[...] = np.where(self._coast.sea(self.profile), made.data, 0.0)
        self._accept(made)
        return self._kernels.place(made)

    def _time_scale(self, t: float) -> float:
        return time_scale(self.grid, self._formulas, t)

    def _velocity_at(self, point: list[Any], times: Sequence[float]) -> Any:
        return [values_at(self.grid, c, point, times) for c in self._formulas]

    def _plan(self, state: State, times: Sequence[float]) -> dict[str, Any]:
        return super()._plan(state, times) | {
            "backend": self.backend, "dtype": str(self.dtype), "store_feet": self.store_feet,
            "periodic": list(self.grid.periodic),
            "land": None if self.land is None else sha256(self.land.tobytes()).hexdigest(),
            "closed": None if self._coast is None else sorted(self._coast.closed),
        }  # fmt: skip

    def _memory_at(self, state: State) -> list[Any] | None:
        """The memory of the engine after a step, with a name of what it belongs to."""
        engine = self._kernels
        counts = [[list(key), *found] for key, found in engine.substep_counts.items()]
        if not counts and not engine.paths_left:
            return None
        return [self._name_at(state), engine.paths_left, counts]

    def _name_at(self, state: State) -> str:
        told = [self.grid.nodes, self._plan(state, [state.t])]
        return sha256(json.dumps(told).encode()).hexdigest()

    def _begin(self, state: State) -> State:
        """Place the first state of a run; one that is a snapshot of a run goes on as that would."""
        placed, engine = self._kernels.begin(state), self._kernels
        if state._memory is not None and state._memory[0] == self._name_at(state):
            _, engine.paths_left, counts = state._memory
            engine.substep_counts = {tuple(key): (t, count) for key, t, count in counts}
        return placed

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
        super()._accept(state)
        if self._coast is not None and (state.host().data * ~self._coast.sea(self.profile)).any():
            raise InputError("state: it is not zero on land; make it with solver.state(f)")

    def _check_times(self, state: State, end: float) -> None:
        """Raise `InputError` if velocity or sources are not known until `end`, or if data on walls
        leave the bounds of the limiter then."""
        super()._check_times(state, end)
        rules, winds = self._scheme(state.fields).rules, snapshots_of(self._formulas)
        if winds is not None:
            winds.check_times(min(state.t, end), max(state.t, end))
        if self.limiter == "bounds" and np.isfinite(end):
            for rule in rules:
                for name, formula in rule.inflow.items():
                    if not formula.steady:
                        times = np.linspace(state.t, end, 65)
                        self._check_inflow(name, formula, times, rule.bounds)

    def _check_inflow(
        self, name: str, formula: Formula, times: NDArray[np.float64], bounds: tuple[float, float]
    ) -> None:
        """Raise `InputError` for data on a wall outside the bounds of the limiter."""
        axis, side = "xyz".index(name[0]), "-+".index(name[1])
        lines = [*self.grid.coordinates]
        lines[axis] = np.array([self.grid.bounds[axis][side]])
        points = np.meshgrid(*lines, times, indexing="ij")
        point = [*points[:-1], *([np.zeros(())] * (3 - self.grid.dim)), points[-1]]
        found = formula.derivative((0, 0, 0, 0), (*self.grid.spacing, 1.0, 1.0, 1.0))(*point)
        if np.isfinite(found).all():
            what, remedy = f"boundary {name!r}: the field there", "change it, or widen bounds"
            check_within(found, bounds, self.bounds_tolerance, what, remedy)

    def _advance(self, state: State, dt: float, tallies: Sequence[Tally] = ()) -> State:
        try:
            return super()._advance(state, dt, tallies)
        except LeftDomain as error:
            rules = self._scheme(state.fields).rules
            most = max(len(rule.inflow) for rule in rules)
            pairs = zip(state.fields, rules, strict=False)
            if short := [name for name, rule in pairs if len(rule.inflow) < most]:
                raise LeftDomain(f"{error}, for {', '.join(short)} as for others") from error
            raise

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


def engine_of(backend: str, setting: Setting) -> Engine:
    """The engine of a backend."""
    if backend == "cupy":
        from cip.engines.cuda_engine import CudaEngine

        return CudaEngine(setting)
    from cip.engines.cpu_engine import CpuEngine

    return CpuEngine(setting)
