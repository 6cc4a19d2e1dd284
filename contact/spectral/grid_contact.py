"""Contact of a periodic grid with an obstacle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from contact.errors import CHANGED, Infeasible, InputError, LargeMotionWarning, NotConverged, warn
from contact.laws.adhesion import Adhesion
from contact.laws.friction import Friction, Tresca
from contact.laws.iteration import Iteration
from contact.laws.newton import LIMITS, followed, newton, proximal_point
from contact.laws.options import checked_tolerance
from contact.laws.status import Status
from contact.laws.surface_checks import jump_between, warn_of_coarse, warn_of_jump, warn_of_wear
from contact.laws.surface_law import SurfaceLaw, SurfaceState
from contact.obstacles.rigid import Rigid
from contact.obstacles.rigid_motion import (
    RigidMotion,
    along_normal,
    gap_tells_place,
    motion_between,
    said_motion,
    same_gaps,
    unknown_motion,
)
from contact.obstacles.rough import Rough
from contact.obstacles.shapes import ObstacleLike, evaluate_gap
from contact.spectral.friction_newton import Waves
from contact.spectral.frictionless import frictionless
from contact.spectral.grid_case import GridCase
from contact.spectral.grid_compliance import GridCompliance
from contact.spectral.grid_problem import GridProblem, NormalRows
from contact.spectral.grid_result import GridResult, certified
from skfem_adini.ground.arguments import choice, evaluated
from skfem_adini.ground.arrays import host

Array = NDArray[np.float64]

_NEWTON = 60  # steps of Newton's method at most
_STEPS = 200  # where adhesion peels, or a surface yields, point by point


@dataclass(frozen=True, eq=False, repr=False)
class GridContact:
    """Contact of a surface grid, whose compliance is a product of transforms, with an obstacle.

    The points lie at multiples of the spacing in the plane through the origin, and the obstacle
    before it, as for the side of a block whose corner is the origin.

    Parameters
    ----------
    compliance : GridCompliance
        `HalfSpace`, or any object with the members that `contact.spectral.grid_compliance` lists.
    obstacle : obstacle, number, callable, array or Rigid
        As in `ContactProblem`, an array of the shape of the grid; a `Rigid` moves by a displacement
        or under a force, component by component, and does not turn.
    friction : float, callable or array
        The coefficient of Coulomb's law; the bound, a traction, of Tresca's.
    law : "coulomb" or "tresca"
    adhesion, hardness, wear : optional
        As in `ContactProblem`; values by place in the shape of the grid.

    Raises
    ------
    InputError
        Gaps with NaN or of another shape, negative friction, an obstacle that turns; a component in
        which the body is free; sides that fix all points.

    References
    ----------
    H. M. Stanley and T. Kato, An FFT-based method for rough surface contact, J. Tribology 119
    (1997) 481. L. Gallego, D. Nelias and S. Deyber, A fast and efficient contact algorithm for
    fretting problems applied to fretting modes I, II and III, Wear 268 (2010) 208, for friction.

    Examples
    --------
    A wavy ground pressed against a half plane, partial contact (Westergaard, 1939): under the mean
    pressure p the half width a of the contact is given by sin^2(pi a) = p / (pi E* h):

    >>> import numpy as np
    >>> from contact import HalfSpace, Rigid
    >>> x, h, p = np.arange(256) / 256, 1e-3, 1e-3
    >>> ground = Rigid(h * (1 - np.cos(2 * np.pi * x)), force=(0.0, p))
    >>> result = GridContact(HalfSpace(1.0, 256, E=1.0, nu=0.3), ground).solve()
    >>> length = 2 * np.arcsin(np.sqrt(p * 0.91 / (np.pi * h))) / np.pi
    >>> print(round(result.area, 2), length.round(2))
    0.36 0.36
    """

    compliance: GridCompliance
    obstacle: ObstacleLike | Rigid
    friction: Any = 0.0
    law: str = "coulomb"
    adhesion: Adhesion | None = None
    hardness: Any = None
    wear: Any = None

    def __post_init__(self) -> None:
        choice("law", self.law, ("coulomb", "tresca"))
        if not all(hasattr(self.compliance, name) for name in ("shape", "constant", "initial")):
            raise InputError(
                f"compliance: expected HalfSpace(...), PeriodicLayers(...) or another "
                f"GridCompliance, got {type(self.compliance).__name__}; ContactProblem takes bodies"
            )
        rigid = self._rigid
        if rigid.rotation is not None or rigid.moment is not None:
            raise InputError("obstacle: a periodic one does not turn; leave rotation and moment")
        motion = self._controls()[0]
        rubs = bool(np.any(self._friction > 0)) or self.wear is not None
        for i in np.flatnonzero(np.asarray(self.compliance.constant)):
            across = np.asarray(self.compliance.normal)[i] == 0
            if not np.isnan(motion[i]) and (rubs or not across):
                raise InputError(
                    f"obstacle: nothing holds the body along {'xyz'[i]}; drive the obstacle there "
                    "by a force, Rigid(obstacle, force=...)"
                )
        axis = int(np.argmax(np.abs(self.compliance.normal)))
        if np.all(getattr(self.compliance, "fixed", np.zeros(3))[axis]):
            raise InputError(
                "compliance: its sides fix the normal displacement of every point of the grid; "
                "take more cells"
            )
        _ = self._gap  # raise its errors here
        if self._surface is not None and not isinstance(self.compliance.initial, np.ndarray):
            raise InputError(
                "compliance: on a device there is no adhesion, hardness and wear; leave xp=cupy"
            )

    @property
    def _rigid(self) -> Rigid:
        return self.obstacle if isinstance(self.obstacle, Rigid) else Rigid(self.obstacle)

    def _controls(self) -> tuple[Array, Array]:
        """Prescribed motions and given forces of the obstacle, NaN where not given."""
        dim = len(self.compliance.shape) + 1
        motion, force = self._rigid.components(dim)
        return motion[:dim], force[:dim]

    def points(self) -> Array:
        """Coordinates of the grid points.

        Returns
        -------
        ndarray, shape (dim, nx[, ny])
        """
        normal, axes = np.asarray(self.compliance.normal), self._axes()
        axes.insert(int(np.argmax(np.abs(normal))), np.zeros(1))
        shape = (normal.size, *self.compliance.shape)
        return np.array(np.meshgrid(*axes, indexing="ij")).reshape(shape)

    def _axes(self) -> list[Array]:
        """Coordinates along each direction of the surface."""
        return [
            h * np.arange(float(m))
            for h, m in zip(self.compliance.spacing, self.compliance.shape, strict=True)
        ]

    def gap(self) -> Array:
        """Distance of the obstacle before it moves, along the normal of the body.

        Returns
        -------
        ndarray, shape (nx[, ny])

        Raises
        ------
        InputError
            NaN, another shape than that of the grid.
        """
        return self._gap.copy()

    @cached_property
    def _gap(self) -> Array:
        obstacle, normal = self._rigid.obstacle, np.asarray(self.compliance.normal, dtype=float)
        if isinstance(obstacle, Rough):
            known = obstacle.gap_over(self._axes(), normal)
            if known is not None:
                return known
        x = self.points()
        normal = normal.reshape((-1,) + (1,) * (x.ndim - 1))
        return evaluate_gap(self._rigid.obstacle, x, np.broadcast_to(normal, x.shape))

    @cached_property
    def _surface(self) -> SurfaceState | None:
        return SurfaceState.of(self.adhesion, self.hardness, self.wear, self.points())

    @cached_property
    def _friction(self) -> Array:
        places = self.points() if callable(self.friction) else np.zeros((0,))
        value = evaluated("friction", self.friction, places)
        shape = self.compliance.shape
        if value.shape not in ((), shape) or not np.all((value >= 0) & np.isfinite(value)):
            raise InputError(f"friction: expected numbers >= 0, one or of shape {shape}")
        return np.broadcast_to(value, shape)

    def solve(
        self,
        *,
        tol: float = 1e-10,
        after: GridResult | None = None,
        motion: Any = None,
        verbose: bool = False,
    ) -> GridResult:
        """Forces, displacements and their certificate.

        Parameters
        ----------
        tol : float
            Of every residual of the certificate, less than one.
        after : GridResult, optional
            The step before: friction acts on the displacement since then, and the iteration starts
            there.
        motion : sequence of float, or 0, optional
            Only with `after`: displacement of the obstacle since then; see `history`.
        verbose : bool
            Print a line an iteration.

        Returns
        -------
        GridResult

        Raises
        ------
        InputError
            A tolerance out of its range, a step before on another grid.
        Infeasible
            The force pulls the obstacle off, drags it beyond the friction, or presses where no
            point is within its reach.
        NotConverged
            The iteration does not settle, or its result fails the certificate.

        Warns
        -----
        LargeMotionWarning
            Loaded points have moved past a neighbour, to positions with a different gap.
        """
        self._check(tol, after)
        if motion is not None and after is None:
            raise InputError("motion: that of the obstacle since the step given as after")
        case = self._case(after)
        if after is not None:
            last = after._proof[0] if after._proof is not None else case
            case = replace(case, travel=self._travel(last, motion))
        return self._solved(case, after, tol, verbose)

    def _solved(
        self, case: GridCase, after: GridResult | None, tol: float, verbose: bool
    ) -> GridResult:
        history: list[Iteration] = []
        problem = case.problem()

        def report(iteration: Iteration) -> None:
            history.append(iteration)
            if verbose:
                print(iteration)

        friction = self._friction
        _check_forces(case, problem)
        inner, surface = LIMITS.inner * tol, case.surface_law(problem)
        law, xp, before = case.friction_law(problem.xp), problem.xp, None
        if after is not None and np.any(after.pressure > 0):
            before = problem.xp.asarray(after.forces[0])
        l, a = xp.zeros_like(problem.v0), np.zeros(len(problem.v0))
        if surface is not None and surface.softens and after is not None and after._proof:
            l, a = xp.asarray(after.forces), after._proof[1]
        elif problem.force[0] < 0:  # pulled at adhesion: from surfaces that just touch
            a[0] = float((problem.gap - problem.v0[0])[problem.can_touch].min())
        else:
            l[0], a[0] = frictionless(problem, before, tol=inner, report=report)
            _check_fixed(problem, l, a)
        mu = l[0]
        rubs = np.any(friction > 0) and (bool((mu > 0).any()) or isinstance(law, Tresca))
        if rubs and not l[1:].any():
            share = mu if bool((mu > 0).any()) else xp.broadcast_to(law.bound(mu), mu.shape)
            for i in problem.free:
                if i:
                    l[i] = share / share.sum() * problem.force[i]
        if surface is not None:
            l, a = _with_surface(problem, law, surface, (l, a), inner, report)
        elif rubs:
            l, a = _with_friction(problem, law, (l, a), inner, report)
        if rubs and problem.at_rest is not None:
            l[1:] = xp.where(problem.at_rest, 0.0, l[1:])
        lines, given, way = tuple(history), case.motion, case.travel
        result = certified(problem, law, (l, a), given, tol, lines, way, surface)
        _check_motion(problem, result, way)
        result = replace(result, jump=_jump(after, result, case), _proof=(case, a, tol))
        if surface is not None:
            warn_of_wear(host(result._fields["worn"]), min(self.compliance.spacing))
        if surface is not None and surface.surface and surface.surface.adhesion:
            glue = surface.surface.adhesion
            warn_of_coarse(surface.surface.ramps, host(result._fields["opening"]), glue)
        return result

    def history(
        self,
        obstacles: Sequence[Rigid],
        *,
        motion: Sequence[Any] | None = None,
        tol: float = 1e-10,
        verbose: bool = False,
    ) -> list[GridResult]:
        """Solve for one motion or force of the obstacle after the other, with friction's memory.

        Friction takes the motion from a shape that is moved from step to step, such as a `Rough`
        with another `point`; the first step counts from the obstacle of this problem, unless that
        is a plain number. The motion of changing heights, such as a rolled array, is unknown.

        Parameters
        ----------
        obstacles : sequence of Rigid
            The obstacle of each step, with its displacement or force from the beginning.
        motion : sequence, optional
            For each step the displacement of the obstacle's shape since the beginning, dim numbers,
            without that of its `Rigid`; 0 for along the normal only, None to derive it from the
            shape.
        tol, verbose
            See `solve`.

        Returns
        -------
        list of GridResult

        Raises
        ------
        InputError
            Not a sequence of obstacles; a motion that friction needs and the shape does not
            determine; and as `solve`.
        """
        if isinstance(obstacles, str) or not isinstance(obstacles, Iterable):
            raise InputError(f"obstacles={obstacles!r}: expected a sequence, one a step")
        each = list(obstacles)
        if motion is None:
            motion = [None] * len(each)
        if isinstance(motion, str) or np.ndim(motion) == 0 or len(motion) != len(each):
            raise InputError(f"motion={motion!r}: expected a list of {len(each)}, one a step")
        results: list[GridResult] = []
        last, before = self._case(None), said_motion(0.0, len(self.compliance.normal))
        for obstacle, now in zip(each, motion, strict=True):
            step = replace(self, obstacle=obstacle)
            after = results[-1] if results else None
            if after is not None:
                after.to_host()  # a history may be longer than the memory of a device
            place = said_motion(now, len(self.compliance.normal))
            said = None if place is None or before is None else place - before
            before = place
            step._check(tol)
            last = replace(step._case(after), travel=step._travel(last, said, after is None))
            results.append(step._solved(last, after, tol, verbose))
        return results

    def _travel(self, last: GridCase, said: Any, first: bool = False) -> Array | None:
        """Path of the obstacle's shape along the surface up to this step, (dim,)."""
        across = np.asarray(self.compliance.normal) == 0
        now, given = self._rigid.obstacle, said_motion(said, across.size)
        motion = motion_between(last.obstacle, now)
        if given is not None:
            motion = RigidMotion.between(0.0 * given, given)
        if motion is None or np.any(motion.rotation):
            known = along_normal(last.obstacle, now, first)
            if last.obstacle is not None or gap_tells_place(now):
                known = known or bool(np.all(same_gaps(last.gap, self._gap)))
            if not known and (np.any(self._friction > 0) or self.wear is not None):
                raise unknown_motion(last.obstacle, now)
            return last.travel
        if motion.still:
            return last.travel
        moved = np.where(across, motion.translation, 0.0)
        return moved if last.travel is None else last.travel + moved

    def _case(self, after: GridResult | None) -> GridCase:
        motion, force = self._controls()
        since, surface = None if after is None else after.slip, self._surface
        if surface is not None and after is not None:
            surface = surface.after(after.indentation, after.worn)
        friction = self._friction
        obstacle = self._rigid.obstacle
        return GridCase(
            self.compliance, self._gap, friction, self.law, motion, force, since, None, obstacle,
            surface,
        )  # fmt: skip

    def _check(self, tol: Any, after: Any = None) -> None:
        checked_tolerance(tol)
        expected = (len(self.compliance.shape) + 1, *self.compliance.shape)
        if after is not None and not isinstance(after, GridResult):
            raise InputError(f"after: expected a GridResult, got {type(after).__name__}")
        if after is not None and after.forces.shape != expected:
            raise InputError(
                f"after: a result on {after.pressure.shape} points, not on {self.compliance.shape}"
            )


def _check_forces(case: GridCase, problem: GridProblem) -> None:
    total, friction, surface = problem.force[0], case.friction, case.surface
    if surface is not None and surface.hardness is not None:
        most = float((np.isfinite(case.gap) * surface.hardness * host(case.areas)).sum())
        if total >= most * (1 - 1e-12):
            raise Infeasible(
                f"obstacle: the force {total:.6g} is beyond what the hardness carries, {most:.6g}"
            )
    if total < 0 and (surface is None or surface.adhesion is None):
        raise Infeasible("obstacle: the force pulls it off the body; turn it round")
    if total > 0 and not bool(problem.can_touch.any()):
        raise Infeasible("obstacle: it is within reach of no point that the force could press")
    drag = np.linalg.norm(np.nan_to_num(problem.force[1:]))
    held = friction.max() * total if case.coulomb else (friction * host(case.areas)).sum()
    most = float(held)
    if np.any(friction > 0) and drag > 0 and drag >= most * (1 - 1e-12):
        raise Infeasible(
            f"obstacle: the force {drag:.6g} along the surface is beyond the friction, which "
            f"holds {most:.6g}; let it move by a displacement"
        )


def _check_motion(problem: GridProblem, result: GridResult, travel: Any) -> None:
    """Warn where points slip past others and the gap changes noticeably on their way."""
    xp, slip, p = problem.xp, result._fields["slip"], result._fields["pressure"]
    if travel is not None:  # the gap is that of the current shape
        slip = slip + xp.asarray(travel[problem.order[0][1:]]).reshape((-1,) + (1,) * p.ndim)
    steps = slip / xp.asarray(problem.compliance.spacing).reshape((-1,) + (1,) * p.ndim)
    far = (xp.abs(steps).max(axis=0) > 1.0) & (p > 1e-3 * p.max())  # less is negligible
    if not bool(far.any()):
        return
    far, steps, gap = host(far), host(steps), host(problem.gap)
    places = np.array(np.nonzero(far)) + steps[:, far]
    mode: Any = "nearest" if hasattr(problem.compliance, "weights") else "grid-wrap"
    open_ = ~np.isfinite(gap)
    there, lost = (
        scipy.ndimage.map_coordinates(values, places, order=1, mode=mode)
        for values in (np.where(open_, 0.0, gap), open_.astype(float))
    )
    change = np.where(lost > 0, np.inf, there - gap[far])
    u_n = problem.turned(result._fields["u"])[0]
    depth = max(float(u_n.max() - u_n.min()), float(xp.abs(u_n).max()))
    if np.abs(change).max() > CHANGED * depth:
        warn(
            f"grid points in contact have moved by up to {np.abs(steps[:, far]).max():.3g} spacings"
            f" along the obstacle, where the gap is {change[np.abs(change).argmax()]:+.3g} off that"
            " at rest, on which the linearised problem stands; give the heights or the obstacle "
            "where it has moved to",
            LargeMotionWarning,
        )


def _check_fixed(problem: GridProblem, l: Any, a: Any) -> None:
    """Raise an `Infeasible` if the obstacle penetrates a point fixed by a side."""
    if problem.fixed is None:
        return
    through = problem.xp.where(
        problem.fixed[0], problem.displacements(l, a)[0] - problem.gap, -np.inf
    )
    deepest, place = float(through.max()), int(through.argmax())
    if deepest > 1e-10 * float(problem.xp.abs(problem.v0[0]).max() + abs(a[0])):
        point = tuple(map(int, np.unravel_index(place, problem.gap.shape)))
        raise Infeasible(
            f"obstacle: it enters grid point {point} by {deepest:.6g}, where a side holds the "
            "normal displacement"
        )


def _with_surface(
    problem: GridProblem, law: Friction, surface: SurfaceLaw, start: Any, tol: float, report: Any
) -> Any:
    """Newton's method for adhesion, hardness and wear; without friction on normal rows alone."""
    rubs = bool((law.bound(problem.xp.ones_like(problem.gap)) > 0).any())
    wears = surface.surface is not None and surface.surface.wear is not None
    (l, a), whole = start, Waves(problem, law, surface)
    solve, options = followed if surface.softens else newton, {"tol": tol, "report": report}
    try:
        if rubs or wears:
            return solve(whole, start, max_iterations=_NEWTON, **options)
        normal = Waves(NormalRows.of(problem), law, surface)
        mu, lift = solve(normal, (l[:1], a[:1]), max_iterations=_STEPS, **options)
    except NotConverged:
        if surface.softens:
            raise
        return proximal_point(whole, start, max_iterations=30, **options)
    return problem.xp.concatenate((mu, 0.0 * l[1:])), np.concatenate((lift, 0.0 * a[1:]))


def _jump(last: GridResult | None, result: GridResult, case: GridCase) -> str:
    """The instability that a step with adhesion has passed, with a warning; else empty."""
    if last is None or case.surface is None or case.surface.adhesion is None:
        return ""
    status, opening = (host(result._fields[name]) for name in ("status", "opening"))
    touched, touches = (one != Status.OPEN for one in (last.status, status))
    reach = case.surface.adhesion.range
    jump = jump_between(touched, last.opening, touches, opening, reach)
    warn_of_jump(jump)
    return jump


def _with_friction(problem: GridProblem, law: Friction, start: Any, tol: float, report: Any) -> Any:
    """Newton's method; if it stalls, proximal points (Tresca) or solves with given friction."""
    waves = Waves(problem, law)
    if isinstance(law, Tresca):
        return _with_given_friction(waves, start, tol, report)
    try:
        return newton(waves, start, tol=tol, max_iterations=_NEWTON, report=report)
    except NotConverged:
        now = start
    try:
        for _ in range(6):  # fixed-point steps with Tresca's law towards Coulomb's
            given = Waves(problem, Tresca(law.bound(now[0][0])))
            now = _with_given_friction(given, now, 1e-6, report, "tresca")
        return newton(waves, now, tol=tol, max_iterations=_NEWTON, report=report)
    except NotConverged:
        _check_drag(problem, law, start)
        raise


def _with_given_friction(
    waves: Waves, start: Any, tol: float, report: Any, phase: str = "newton"
) -> Any:
    """Newton's method for Tresca's law; if it stalls, proximal points."""
    try:
        return newton(waves, start, tol=tol, max_iterations=_NEWTON, phase=phase, report=report)
    except NotConverged:
        return proximal_point(waves, start, tol=tol, max_iterations=30, report=report)


def _check_drag(problem: GridProblem, law: Friction, start: Any) -> None:
    """Raise an `Infeasible` if the tangential force exceeds the sliding friction."""
    along = np.nan_to_num(problem.force) * (np.arange(len(problem.force)) > 0)
    drag = float(np.linalg.norm(along))
    if drag == 0:
        return
    far = 10 * drag / problem.scale_along  # farther than the whole force would move one point
    force = np.where(np.arange(along.size) > 0, np.nan, problem.force)
    v0 = problem.v0 + problem.moved(far / drag * along)
    sliding = GridProblem(problem.compliance, v0, problem.gap, force)
    forces, _ = newton(Waves(sliding, law), start, tol=1e-6, max_iterations=_NEWTON)
    held = float(sliding.sums(forces) @ along) / drag
    if drag >= held * (1 - 1e-6):
        raise Infeasible(
            f"obstacle: the force {drag:.6g} along the surface is beyond the friction, which "
            f"holds {held:.6g} where all points slide; let it move by a displacement"
        )
