"""Contact of bodies that conduct heat: conductance, heat of friction, expansion."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from contact.errors import InputError, NotConverged, warn
from contact.histories.load_history import checked_times
from contact.histories.load_program import Factor, checked_factor, value_at
from contact.histories.load_stepper import LoadStepper
from contact.problem.contact_problem import ContactProblem
from contact.result.certify import as_lines
from contact.result.contact_result import ContactResult
from contact.thermal.conduction import Conduction, field_at, steady
from contact.thermal.film import film_of
from contact.thermal.heat_system import Before, HeatSystem
from contact.thermal.thermal_result import ThermalResult
from skfem_adini.ground.arguments import (
    choice,
    finite_number,
    flag,
    integer,
    keywords_named,
    numbers,
    positive_number,
)

Array = NDArray[np.float64]
Csr = sparse.csr_array
Boundary = str | Sequence[str] | ArrayLike
Field = float | Callable[[Array], ArrayLike]
Conductance = float | Callable[[Array, Array], ArrayLike]
logger = logging.getLogger(__name__)
_THETA = {"euler": 1.0, "crank-nicolson": 0.5}


class _Limits(NamedTuple):
    depth: int = 6  # iterations that the acceleration combines
    dense: int = 30  # conductances up to which the whole derivative is computed
    step: float = 1e-6  # change of conductances in difference quotients, relative to the largest
    near: float = 0.1  # last change of the temperature over the tolerance of the certificate
    halvings: int = 60  # of intervals of overlaps
    late: float = 1e-4  # changes of conductances from which on those of the temperature count
    rounding: float = 3e-15  # of temperatures, in a change that is none: a few units of doubles


LIMITS = _Limits()


class _HeatedSteps(LoadStepper):
    """The mechanical steps: the loads of a time, and the thermal strain of a temperature."""

    def __init__(self, given: ContactProblem | LoadStepper) -> None:
        problem = given.problem if isinstance(given, LoadStepper) else given
        if isinstance(problem, ContactProblem) and problem.surface is not None:
            raise InputError("problem: thermal contact takes no adhesion, hardness or wear")
        if isinstance(given, ContactProblem):
            super().__init__(given)
            return
        if given._finite is not None or len(given.history):
            raise InputError("problem: a LoadStepper of small sliding without finished steps")
        self.__dict__.update(given.__dict__)


class ThermalContact:
    r"""Contact of bodies that conduct heat to each other, rub, and expand.

    The bodies conduct heat on their meshes with the scalar element of their displacement; through
    each contact point passes :math:`q = h(p, g) (T_1 - T_2)`, with the pressure p and the gap g;
    friction heats both sides; temperatures strain the bodies, which changes p and g. A step solves
    the equations of heat under given conductances and the contact under given temperatures in turn,
    accelerated by Anderson's method, until both hold together (`ThermalResult.history`). Where heat
    opens the contact it comes through, the conductance is implicit in p and g, so that it may go
    from open to closed as steeply as it likes, but not by a jump.

    Sums of heat are per unit depth in 2-D, and of the whole ring in axisymmetric bodies.

    Parameters
    ----------
    problem : ContactProblem or LoadStepper
        Of bodies with a mesh. A `LoadStepper` brings loads, supports and obstacles that vary in
        time; small sliding only.
    conductivity : float, ndarray or callable, or a list of these, one a body
        Number, one a cell (ncells,), tensor (dim, dim), or function of the places.
    conductance : float or callable (p, g) -> array, or a list of these, one a boundary
        Heat per area, time and temperature, never negative. A number holds where points are in
        contact, open ones are insulated. A function receives pressures and gaps of n points; it is
        not called for points without an obstacle.
    capacity : float, ndarray or callable, or a list of these, one a body, optional
        Density times specific heat; for `run`.
    expansion : float or ndarray, or a list of these, one a body
        Coefficient of thermal expansion, as for `ElasticBody.heat`.
    reference : float
        The temperature at which the bodies are free of thermal strain.
    obstacle_temperature : None, float, callable, or a list of these, one a boundary
        Of rigid obstacles, at places x of the boundary. None insulates.
    friction_heat : float, callable, or a list of these, one a boundary
        Friction coefficient times sliding speed, where bodies slide steadily: the heat per area
        and time is its product with the pressure. The work of friction in the steps of `run` is
        counted in addition, from the slip.
    friction_factor : callable t -> float, optional
        Of `friction_heat`, such as a speed that falls. Default: 1.
    partition : None, float or a list of these, one a boundary
        Part of the heat of friction, from 0 to 1, that enters the body with the contact points; the
        rest enters the other body or the obstacle. None: 1/2 between bodies, 1 at obstacles.
    method : {"euler", "crank-nicolson"}
        Of `run`: implicit, of first and second order in time.
    tol : float
        Of the certificate, see `ThermalResult.kkt`, and of the change of temperature in the last
        iteration, relative to the largest difference of temperatures.
    max_iterations : int

    Raises
    ------
    InputError
        A malformed argument; the message names it.

    References
    ----------
    J. R. Barber, J. Dundurs and M. Comninou, Stability considerations in thermoelastic contact, J.
    Appl. Mech. 47 (1980), 871-874. P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer
    2006, chapter 12. D. G. Anderson, J. ACM 12 (1965), 547-560.

    Examples
    --------
    A bar between a hot wall and a cold one that it just touches; its mean temperature is .75:

    >>> import numpy as np
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, ThermalContact
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> bar = ElasticBody.from_mesh(mesh, E=1.0, nu=0.0).fix("left", "x").fix("bottom", "y")
    >>> problem = ContactProblem(bar, "right", 0.0)
    >>> along = np.array([0.01, 0.0, 0.0])
    >>> model = ThermalContact(problem, 1.0, 1.0, expansion=along, obstacle_temperature=0.0)
    >>> result = model.fix("left", 1.0).solve()
    >>> print(result.flux.round(6).max(), result.contact.pressure.round(6).max())
    0.5 0.0075
    """

    @keywords_named
    def __init__(
        self,
        problem: ContactProblem | LoadStepper,
        conductivity: Any,
        conductance: Conductance | Sequence[Conductance],
        *,
        capacity: Any = None,
        expansion: Any = 0.0,
        reference: float = 0.0,
        obstacle_temperature: Any = None,
        friction_heat: Any = 0.0,
        friction_factor: Factor | None = None,
        partition: Any = None,
        method: str = "euler",
        tol: float = 1e-10,
        max_iterations: int = 100,
    ) -> None:
        if not isinstance(problem, ContactProblem | LoadStepper):
            raise InputError(
                f"problem: expected a ContactProblem or a LoadStepper, got {type(problem).__name__}"
            )
        self._steps = _HeatedSteps(problem)
        self.problem = self._steps.problem
        self.theta = _THETA[choice("method", method, _THETA)]
        self.reference = finite_number("reference", reference)
        self.tol = positive_number("tol", tol)
        self.max_iterations = integer("max_iterations", max_iterations, 1)
        bodies, rows = self.problem.body.bodies, self.problem.rows
        k = _each("conductivity", conductivity, len(bodies), "body")
        c = _each("capacity", capacity, len(bodies), "body")
        self._bodies = [Conduction(*one) for one in zip(bodies, k, c, strict=True)]
        self.expansion = _each("expansion", expansion, len(bodies), "body")
        self._points = np.split(np.arange(rows.gap.size), np.flatnonzero(np.diff(rows.part)) + 1)
        count = len(self._points)
        pairs: Any = self.problem.pairs or [None] * count
        rigid = [pair is None or not pair.two_bodies for pair in pairs]
        self.conductance = _each("conductance", conductance, count)
        for h in self.conductance:
            if not callable(h) and finite_number("conductance", h) < 0:
                raise InputError(f"conductance={h!r}: must not be negative")
        outside = _each("obstacle_temperature", obstacle_temperature, count)
        if any(T is not None and not one for T, one in zip(outside, rigid, strict=True)):
            raise InputError("obstacle_temperature: None where the opposite side is elastic")
        self._insulated = [one and T is None for T, one in zip(outside, rigid, strict=True)]
        self.film = film_of(self.problem, self._bodies, outside)
        self._speed = self._at_points("friction_heat", _each("friction_heat", friction_heat, count))
        self._slowing = _factor(friction_factor)
        share = [
            (1.0 if one else 0.5) if part is None else part
            for part, one in zip(_each("partition", partition, count), rigid, strict=True)
        ]
        self._share = self._at_points("partition", share)
        if np.any(self._share > 1):
            raise InputError("partition: expected parts from 0 to 1")

    def __repr__(self) -> str:
        return f"ThermalContact({self.problem!r}, {self.film.first.shape[1]} temperatures)"

    def _at_points(self, name: str, each: Sequence[Any]) -> Array:
        """Values at all contact points, from numbers or functions for each boundary."""
        x = self.problem.rows.x
        found = zip(each, self._points, strict=True)
        return np.concatenate([field_at(name, one, x[:, own], 0.0) for one, own in found])

    def _body(self, body: Any) -> Conduction:
        if body is None and len(self._bodies) > 1:
            raise InputError("body: there are several; say which, as in fix(..., body=upper)")
        return self._bodies[0 if body is None else self.problem.body.number_of(body)]

    def fix(
        self,
        boundary: Boundary,
        temperature: Field,
        factor: Factor | None = None,
        *,
        body: Any = None,
    ) -> Self:
        """Prescribe the temperature ``factor(t) * temperature`` on a boundary.

        Where two boundaries meet the later call counts; with Adini elements both have to agree.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        temperature : float or callable x -> array of shape x.shape[1:]
        factor : callable t -> float, optional
            Default: 1.
        body : Solid, str or int, optional
            Which one, if the problem has several.

        Raises
        ------
        InputError
            An unknown boundary or body, or a temperature that is not finite.
        """
        one = self._body(body)
        facets = one.body.facets(boundary)
        field_at("temperature", temperature, one.body.mesh.p[:, one.body.mesh.facets[:, facets]])
        one.held.append((facets, temperature, _factor(factor)))
        return self

    def convection(
        self,
        boundary: Boundary,
        coefficient: Field,
        ambient: Field,
        factor: Factor | None = None,
        *,
        body: Any = None,
    ) -> Self:
        """Add convection: the heat ``coefficient * (factor(t) * ambient - T)`` per area and time.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        coefficient, ambient : float or callable x -> array of shape x.shape[1:]
            Heat per area, time and temperature, not negative; temperature.
        factor : callable t -> float, optional
            Of the ambient temperature. Default: 1.
        body
            As for `fix`.

        Raises
        ------
        InputError
            An unknown boundary or body, a negative coefficient, or values that are not finite.
        """
        self._body(body).convect(boundary, coefficient, ambient, _factor(factor))
        return self

    def inflow(
        self, boundary: Boundary, flux: Field, factor: Factor | None = None, *, body: Any = None
    ) -> Self:
        """Let the heat ``factor(t) * flux`` per area and time flow into a boundary.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        flux : float or callable x -> array of shape x.shape[1:]
        factor, body
            As for `fix`.

        Raises
        ------
        InputError
            An unknown boundary or body, or a flux that is not finite.
        """
        self._body(body).inflow(boundary, flux, _factor(factor))
        return self

    def source(self, power: Any, factor: Factor | None = None, *, body: Any = None) -> Self:
        """Generate the heat ``factor(t) * power`` per volume and time in a body.

        Parameters
        ----------
        power : float, ndarray of shape (ncells,), or callable x -> array of shape x.shape[1:]
        factor, body
            As for `fix`.

        Raises
        ------
        InputError
            An unknown body, or a power that is not finite.
        """
        self._body(body).generate(power, _factor(factor))
        return self

    def solve(
        self,
        *,
        start: Any = None,
        time: float = 0.0,
        stability: bool = True,
        unstable: bool = False,
    ) -> ThermalResult:
        """Solve for a steady state and certify it.

        There may be several where heat makes bodies expand into the contact through which it comes.
        The iteration follows the heat from its start to one of them.

        Parameters
        ----------
        start : ThermalResult, float, callable or a list of these, one a body, optional
            Temperature to start from; default `reference`.
        time : float
            At which loads and conditions that vary are taken.
        stability : bool
            Compute `ThermalResult.gain`, for some contact solutions more.
        unstable : bool
            Look for the steady state next to the start, also for one that disturbances leave, such
            as the state between two stable ones.

        Returns
        -------
        ThermalResult

        Raises
        ------
        NotConverged
            Temperature and contact do not settle, or the certificate fails. A steady state need
            not exist where the conductance jumps.
        Unbounded
            Nothing determines the temperature of a body, or its position.
        InputError
            A malformed argument, or a contact that `ContactProblem.solve` refuses.

        Warns
        -----
        ContactWarning
            The steady state is unstable.
        """
        flag("stability", stability)
        system = self._system(finite_number("time", time), None)
        first = start.contact if isinstance(start, ThermalResult) else None
        found = self._coupled(
            system, self._temperature(start), None, np.nan, time, first, flag("unstable", unstable)
        )
        if stability and self._couples:
            found = replace(found, gain=self._gain(found, time))
            if found.gain > 1:
                warn(
                    f"the steady state is unstable: a small change of the conductance comes back "
                    f"{found.gain:.3g} times as large, so that any disturbance grows; start from "
                    "other temperatures for another state, or follow it in time by run(times)"
                )
        return replace(found, time=np.nan)

    def run(
        self,
        times: ArrayLike,
        *,
        initial: Any = None,
        callback: Callable[[ThermalResult], None] | None = None,
    ) -> tuple[ThermalResult, ...]:
        """Solve and certify steps in time; the first time is that of the initial state.

        Parameters
        ----------
        times : array of shape (n,)
            Increasing, at least two. Steps may differ in length.
        initial : ThermalResult, float, callable or a list of these, one a body, optional
            Temperature at the first time; default `reference`. A result continues its history.
        callback : callable, optional
            Receives each result as it is finished, the initial state included.

        Returns
        -------
        tuple of ThermalResult
            One for each time.

        Raises
        ------
        NotConverged
            A step does not settle, or fails its certificate; take shorter steps.
        InputError
            A body without capacity, times that do not increase, or a malformed argument.
        """
        schedule = checked_times(times, np.zeros(0))
        if schedule.size < 2:
            raise InputError("times: at least two, the first that of the initial state")
        if any(one.capacity is None for one in self._bodies):
            raise InputError("capacity: steps in time need density times specific heat")
        capacity = Csr(sparse.block_diag([one.mass for one in self._bodies]))
        results = [self._initial(initial, float(schedule[0]))]
        if callback is not None:
            callback(results[0])
        for t in schedule[1:]:
            last = results[-1]
            inflow = last.system.inflow(last.T, last.conductance)
            before = Before(last.T, inflow, capacity, float(t) - last.time, self.theta)
            system = self._system(float(t), before)
            contact = last.contact
            results.append(self._coupled(system, last.T, contact, last.time, float(t), contact))
            logger.info("t = %g: %r", t, results[-1])
            if callback is not None:
                callback(results[-1])
        return tuple(results)

    def _initial(self, given: Any, time: float) -> ThermalResult:
        """The state to start from: a temperature, with the contact under it."""
        T = self._temperature(given)
        system = replace(self._system(time, None), initial=True)
        if isinstance(given, ThermalResult):
            contact = given.contact
        else:
            contact = self._steps._solved(self._heated(T, time), None, np.nan, time, None)
        h, power = self._through(contact, time, None)[0]
        return ThermalResult(contact, T, system, h, power, time, tol=self.tol)

    def _temperature(self, given: Any) -> Array:
        """Dofs of a given temperature in all bodies."""
        if isinstance(given, ThermalResult):
            if given.T.size != self.film.first.shape[1]:
                raise InputError("start, initial: a result of other bodies")
            return given.T
        each = _each(
            "initial", self.reference if given is None else given, len(self._bodies), "body"
        )
        found = zip(self._bodies, each, strict=True)
        return np.concatenate([one.interpolated("initial", T) for one, T in found])

    def _system(self, time: float, before: Before | None) -> HeatSystem:
        """The equations of heat at a time."""
        bodies = self._bodies
        P, T0 = zip(*(one.prescribed(time) for one in bodies), strict=True)
        matrices = [one.stiffness for one in bodies], [one.convective for one in bodies], P
        vectors = [
            [one.load("sources", time) for one in bodies],
            [one.load("convection", time) for one in bodies],
            T0,
            [one.values for one in bodies],
        ]
        K, convective, P = (Csr(sparse.block_diag(each)) for each in matrices)
        sources, ambient, T0, values = map(np.concatenate, vectors)
        ends = np.cumsum([0, *(one.basis.N for one in bodies)])
        loads = K, convective, sources, ambient
        return HeatSystem(*loads, P, T0, values, ends, self.film, self._share, before)

    def _heated(self, T: Array, time: float) -> Any:
        """The bodies under the loads of a time and the thermal strain of a temperature."""
        self.problem.condense()  # bodies then compute on its device
        now = self._steps._body_at(time)
        change = T - self.reference * np.concatenate([one.values for one in self._bodies])
        start = 0
        for one, body, expansion in zip(self._bodies, now.bodies, self.expansion, strict=True):
            one.heat(body, change[start : start + one.basis.N], expansion)
            start += one.basis.N
        return now

    @property
    def _couples(self) -> bool:
        """Whether the contact depends on the temperature."""
        return any(np.any(numbers("expansion", one) != 0) for one in self.expansion)

    def _conductance(self, p: Array, gap: Array, closed: NDArray[np.bool_]) -> Array:
        """Conductance of all points under pressures and gaps, shape (m,)."""
        h = np.zeros(p.size)
        for given, own, none in zip(self.conductance, self._points, self._insulated, strict=True):
            at = own[np.isfinite(gap[own])]
            if at.size and not none:
                of_law = callable(given)
                h[at] = _conductances(given, p[at], gap[at]) if of_law else given * closed[at]
        return h

    def _through(
        self,
        contact: ContactResult,
        time: float,
        dt: float | None,
        last: ArrayLike = 0.0,
        resist: float = 0.0,
    ) -> tuple[Array, Array, Array]:
        """Conductance and heat of friction of each contact point, (2, m), and (m,) its overlap x,
        pressure in lengths minus gap, and s that solves ``s = resist (last - h(x + s))``."""
        rows, mu = contact.system.rows, contact.mu
        p, gap = np.maximum(mu, 0.0) / rows.weights, np.maximum(contact.gap, 0.0)
        closed = (mu > 1e-12 * mu.max(initial=0.0)) | rows.ties
        gap[rows.ties] = 0.0
        soft = self.problem.condense().point_scale ** 2 * rows.weights

        def law(s: Array) -> Array:
            """Under a shift of the overlap: gaps close before pressures grow."""
            more, less = np.maximum(s - gap, 0.0), np.maximum(-s - soft * p, 0.0)
            pressed = np.maximum(p + (more + np.minimum(s, 0.0)) / soft, 0.0)
            return self._conductance(
                pressed, np.maximum(gap - np.maximum(s, 0.0), 0.0) + less, closed
            )

        s = _implicit(law, np.broadcast_to(last, mu.shape), np.where(rows.ties, 0.0, resist))
        power = value_at(self._slowing, time) * self._speed * np.maximum(mu, 0.0)
        if dt is not None:
            work = np.sum(contact.t * contact.slip_increment, axis=1)
            power = power + np.maximum(work, 0.0) / dt
        x = np.where(np.isfinite(gap), soft * p - gap, 0.0)
        return np.array([law(s), np.where(rows.ties, 0.0, power)]), x, s

    def _coupled(
        self,
        system: HeatSystem,
        T: Array,
        last: ContactResult | None,
        begin: float,
        end: float,
        start: ContactResult | None,
        unstable: bool = False,
    ) -> ThermalResult:
        """Conductance and heat of friction that hold with the contact under their temperature, a
        fixed point by Anderson's method.

        Where a better conductance lessens the overlap x it is implicit: ``h = h(x + s)`` with ``s =
        resist (last - h)`` and the largest ``resist = -dx / dh`` seen. The map is Lipschitz then,
        however steep h is, with the same fixed points, s = 0, and the same stability."""
        dt = None if system.before is None else system.before.dt
        contact = self._steps._solved(self._heated(T, end), last, begin, end, start)
        now, x, _ = self._through(contact, end, dt)
        if not self._couples:
            return self._certified(contact, system.solve(*now), system, now, end, ())
        changes, tried = list[float](), list[tuple[Array, Array]]()
        resist, was = 0.0, now
        for _ in range(self.max_iterations):
            T, before = system.solve(*now), x
            contact = self._steps._solved(self._heated(T, end), last, begin, end, contact)
            through, x, s = self._through(contact, end, dt, now[0], resist)
            if changes and (slope := _fall(x - before, now[0] - was[0])) > 1.5 * resist:
                resist, tried = slope, []
                through, _, s = self._through(contact, end, dt, now[0], resist)
            largest = np.maximum(through, now).max(axis=1, initial=0.0, keepdims=True)
            units = 1.0 / np.where(largest > 0, largest, 1.0)
            reach = contact.solid.largest_displacement(contact.u) or 1.0
            off = float(np.abs(s).max(initial=0.0)) / reach
            changes.append(max(float(np.abs(units * (through - now)).max(initial=0.0)), off))
            logger.info(
                "iteration %d: heat through contact changes by %.1e", len(changes), changes[-1]
            )
            if changes[-1] <= LIMITS.late:
                image = system.solve(*through)
                if max(self._change(system, image, T), off) <= LIMITS.near * self.tol:
                    return self._certified(contact, image, system, through, end, tuple(changes))
            was = now
            now, tried = _next([*tried, (now, through - now)], units, unstable)
        raise NotConverged(self._unsettled(changes, was[0], through[0], end, dt is None))

    def _change(self, system: HeatSystem, T: Array, before: Array) -> float:
        """Change of a temperature over its largest difference, 0 within rounding."""
        values, change = T[system.values > 0], (T - before)[system.values > 0]
        # Differences of a thousandth of the change that strains the bodies count no more.
        strained = 1e-3 * float(np.abs(values - self.reference).max())
        size, off = max(float(np.ptp(values)), strained), float(np.abs(change).max())
        return 0.0 if off <= LIMITS.rounding * float(np.abs(values).max()) else off / max(size, off)

    def _certified(
        self,
        contact: ContactResult,
        T: Array,
        system: HeatSystem,
        through: Array,
        time: float,
        changes: tuple[float, ...],
    ) -> ThermalResult:
        """The result, its contact under the thermal strain of T; raises unless certified."""
        body = self._heated(T, time)
        contact = replace(contact, system=replace(contact.system, body=body, load=body.loads))
        h, power = through
        found = ThermalResult(contact, T, system, h, power, time, changes, tol=self.tol)
        if not max(found.kkt.values()) <= self.tol:
            raise NotConverged(
                f"the certificate of temperature and contact fails:\n{as_lines(found.kkt)}\n"
                "take a tol that is larger, or units in which numbers differ less"
            )
        self._steps._check(contact)
        return found

    def _unsettled(
        self, changes: list[float], before: Array, h: Array, time: float, steady: bool
    ) -> str:
        """What to say of an iteration that does not settle."""
        k = int(np.argmax(np.abs(h - before)))
        place = ", ".join(f"{x:.6g}" for x in self.problem.rows.x[:, k])
        remedy = "take shorter steps, or a conductance that is continuous in p and g"
        if steady:
            remedy = (
                "there may be no steady state, as where the conductance jumps between open and "
                "closed (Barber's instability): take a conductance that is continuous in p and g, "
                "start from other temperatures, or follow it in time by run(times)"
            )
        return (
            f"t = {time:g}: temperature and contact do not settle in {len(changes)} iterations; "
            f"the last change is {changes[-1]:.1e} of the largest conductance or heat of friction; "
            f"the conductance at ({place}) goes from {before[k]:.6g} to {h[k]:.6g}; {remedy}"
        )

    def _gain(self, found: ThermalResult, time: float) -> float:
        """Largest real eigenvalue of the derivative of ``h -> T -> p, g -> h``, if it leads."""
        m, known = found.conductance.size, (found.conductance, found.power)
        units = np.repeat([float(np.abs(v).max(initial=0.0)) or 1.0 for v in known], m)
        at = np.concatenate(known) / units

        def image(y: Array) -> Array:
            T = found.system.solve(*np.split(y * units, 2))
            contact = self._steps._solved(self._heated(T, time), None, np.nan, time, found.contact)
            return self._through(contact, time, None)[0].ravel() / units

        rest = image(at)

        live = np.flatnonzero(np.repeat([True, bool(np.any(self._speed > 0))], m))

        def derivative(v: Array) -> Array:
            step = LIMITS.step / (np.abs(v).max() or 1.0)
            moved = at.copy()
            moved[live] += step * v.ravel()
            return ((image(moved) - rest) / step)[live]

        if live.size <= LIMITS.dense:
            values = np.linalg.eigvals(np.array([derivative(v) for v in np.eye(live.size)]).T)
        elif not np.any(derivative(np.ones(live.size))):
            return 0.0
        else:
            op = LinearOperator((live.size,) * 2, matvec=derivative, dtype=float)
            ask: dict[str, Any] = {"which": "LR", "v0": np.ones(live.size), "tol": 1e-4}
            try:
                values = eigs(op, k=1, return_eigenvectors=False, **ask)
            except ArpackError as error:  # with the eigenvalues it has found, perhaps none
                values = np.asarray(getattr(error, "eigenvalues", ()))
        return float(np.max(np.real(values), initial=-np.inf)) if len(values) else np.nan


def _implicit(law: Callable[[Array], Array], last: Array, resist: Array) -> Array:
    """The s (m,) with ``s = resist (last - law(s))``, by bisection for a law that rises."""
    low, high = np.zeros(last.size), np.zeros(last.size)
    if resist.any():
        high = resist * (last - law(low))
        for _ in range(LIMITS.halvings):
            s = 0.5 * (low + high)
            beyond = (resist * (last - law(s)) - s) * high < 0
            low, high = np.where(beyond, low, s), np.where(beyond, s, high)
    return 0.5 * (low + high)


def _fall(dx: Array, dh: Array) -> float:
    """-dx / dh on average."""
    return -float(dx @ dh) / (float(dh @ dh) or 1.0)


def _next(
    tried: list[tuple[Array, Array]], units: Array, unstable: bool
) -> tuple[Array, list[tuple[Array, Array]]]:
    """Anderson's next state, and the iterations that it may still combine.
    Where changes grow in one direction a secant leads back, to an `unstable` state."""
    y, change = tried[-1]
    if len(tried) > 1:
        now, last = (units * tried[-1][1]).ravel(), (units * tried[-2][1]).ravel()
        grows = len(tried) == 2 and now @ now > last @ last and now @ last > 0
        dy, dF = (
            np.array([one - v for v in past]) for one, *past in zip(*tried[::-1], strict=True)
        )
        A = (units * dF).reshape(len(dF), -1).T
        step = change - np.tensordot(np.linalg.lstsq(A, now, rcond=1e-12)[0], dy + dF, 1)
        if (unstable or not grows) and np.abs(units * step).max() <= 2:
            return np.maximum(y + step, 0.0), tried[-LIMITS.depth :]
    return y + change, tried[-1:]


def _each(name: str, given: Any, count: int, of: str = "boundary") -> list[Any]:
    """One value for all, or a list or tuple of one each."""
    if not isinstance(given, list | tuple):
        return [given] * count
    if len(given) != count:
        raise InputError(f"{name}: expected one for all or a list of {count}, one a {of}")
    return list(given)


def _factor(factor: Factor | None) -> Factor:
    return steady if factor is None else checked_factor(factor)


def _conductances(given: Callable[[Array, Array], Any], p: Array, gap: Array) -> Array:
    """Conductances of a function of pressure and gap, both (n,)."""
    h = numbers("conductance", given(p, gap))
    if h.shape not in ((), p.shape) or not np.all(np.isfinite(h)) or np.any(h < 0):
        raise InputError(
            f"conductance: expected a function (p, g) of pressures and gaps of shape {p.shape} "
            f"that returns as many finite numbers, not negative; got shape {h.shape}"
        )
    return np.broadcast_to(h, p.shape)
