"""The contact problem: body, boundary, obstacle and friction law; choice of the method."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.body.cut_arc import CutArc
from contact.body.distributed_body import DistributedBody
from contact.body.solid import Solid, Surface
from contact.condensation.condensed_contact import CondensedContact
from contact.condensation.device_choice import Device, chosen_device
from contact.condensation.primal import PrimalContact
from contact.errors import InputError, warn
from contact.laws.adhesion import Adhesion
from contact.laws.iteration import Iteration
from contact.laws.options import Options
from contact.laws.pressure_overclosure import PressureOverclosure, checked
from contact.laws.surface_law import SurfaceState
from contact.laws.wear import Wear
from contact.obstacles.rigid import ObstacleMotion
from contact.obstacles.rigid_motion import same_gaps
from contact.obstacles.shapes import ObstacleLike
from contact.portable import Origin, Portable
from contact.problem.large_motion import check_motion, with_jump
from contact.problem.sagitta import warn_of_sagitta
from contact.problem.solve_system import solve_system
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactSystem
from contact.rows.contact_boundaries import ContactBoundaries
from contact.rows.contact_rows import ContactRows, refuse_other_points
from contact.rows.interfaces import Interfaces
from contact.rows.pairs import Pair, between, given_pairs
from contact.settled import settled
from skfem_adini.ground.arguments import keywords_named

Array = NDArray[np.float64]
FrictionLike = float | ArrayLike | Callable[[Array], ArrayLike] | Sequence[Any]
OverclosureLike = float | PressureOverclosure | Sequence[float | PressureOverclosure | None] | None
Laws = tuple[Any, FrictionLike | None, str | None]
logger = logging.getLogger(__name__)
_SAME: Any = object()  # stands for the obstacle of the problem or the last step


@settled("make a new ContactProblem", "body", "boundary", "functional", "solver", "pairs")
@settled("make a new ContactProblem", "adhesion", "hardness", "wear", "surface")
@settled("set the obstacle, or make a new ContactProblem", "boundaries", "rows", "motion")
class ContactProblem(Portable):
    """Contact of elastic bodies with each other and with rigid obstacles, frictional or not.

    Find u and contact forces (pressure p, shear) with equilibrium in the body and on the contact
    boundary, with u_n the displacement along the outward normal and d the gap,

    * Signorini: ``u_n <= d``, ``p >= 0``, ``p (u_n - d) = 0``;
    * friction with bound g: ``|shear| <= g``, and ``shear = -g u_t / |u_t|`` where u_t is not 0;
      Coulomb: ``g = F p``; Tresca: g is given. Where supports prescribe the whole tangential
      displacement of a contact point, its friction acts on them only and is omitted.

    Parameters
    ----------
    body : ElasticBody, LayeredBlock or CutBody, or a list of these
    boundary : str, list of str, array of facet numbers or CutArc; or a list of Pair and Tie
        The boundary where contact may occur. Together with a list of obstacles: a list of
        boundaries, each with its own; friction and functional may then be lists as well. For a list
        of bodies: the pairs of boundaries that may touch, or are tied.
    obstacle : obstacle, Rigid, Surface, number, callable, array, None, or a list of these
        See `contact.obstacles.shapes`; `ElasticBody.surface` is that of another body. None:
        friction without a contact law, (4.9) in King. Omitted for a list of pairs.
    friction : float, callable x -> array, or ndarray of shape (m,)
        Coulomb: the coefficient. Tresca: the bound, a traction. Never negative. For a list of pairs
        it replaces their friction.
    law : {"coulomb", "tresca", None}
        None is frictionless, as is friction = 0.
    functional : str, optional
        The values of the displacement that contact conditions act on; see
        `contact.rows.functionals`, also on the accuracy of P1. Where bodies touch each other the
        multipliers, see `Pair`.
    solver : {"auto", "pardiso", "superlu"}
        Sparse factorisation.
    overclosure : None, float, PressureOverclosure, or a list of these, one a boundary
        Law of compliant surfaces; a number is a stiffness, pressure per length of overclosure.
        None is hard contact.
    adhesion : Adhesion, optional
        Tension between the surfaces, of all contact points; not together with `overclosure`.
    hardness : float, callable x -> array, or ndarray of shape (m,), optional
        Largest pressure of an elastic, perfectly plastic surface; it keeps the indentation that the
        pressure has left, see `ContactResult.indentation`. Not together with `overclosure`.
    wear : float, callable x -> array, ndarray of shape (m,), or Wear, optional
        Coefficient of Archard's law, area per force, see `Wear` and `ContactResult.worn`.

    Raises
    ------
    InputError
        A malformed argument; the message names it.

    References
    ----------
    N. Kikuchi and J. T. Oden, Contact Problems in Elasticity, SIAM 1988: the problems. M.
    Hintermüller, K. Ito and K. Kunisch, SIAM J. Optim. 13 (2003), 865-888: the active set. P. Alart
    and A. Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991), 353-375: Newton with friction.
    S. A. King, Multi-Moment Methods for PDEs and GPUs for Large-Scale Scientific Computations,
    dissertation, North Carolina State University, 2012: numbers of equations and algorithms.

    Examples
    --------
    A unit square pressed by its upper side on a foundation .03 below it:

    >>> from skfem import MeshQuad
    >>> from contact import ElasticBody
    >>> from skfem_adini import ElementQuadAdini
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=2.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -1.0))
    >>> result = ContactProblem(body, "bottom", 0.03, friction=0.4).solve()
    >>> round(float(result.resultant[1]), 6)
    1.0
    """

    _ANEW, _FUNCTIONS = ("_condensed",), ("_laws", "hardness", "wear")
    _condensed: tuple[Device, bool, Any, CondensedContact] | None = None

    @keywords_named
    def __init__(
        self,
        body: Solid | Sequence[Solid],
        boundary: str | Sequence[str] | ArrayLike | CutArc | Sequence[Pair],
        obstacle: ObstacleLike | Surface | Sequence[ObstacleLike | Surface] = None,
        friction: FrictionLike = 0.0,
        law: str | None = "coulomb",
        functional: str | Sequence[str | None] | None = None,
        solver: str = "auto",
        overclosure: OverclosureLike = None,
        *,
        adhesion: Adhesion | None = None,
        hardness: FrictionLike | None = None,
        wear: FrictionLike | Wear | None = None,
    ) -> None:
        if not isinstance(solver, str):
            raise InputError(f"solver={solver!r}: expected 'auto', 'pardiso' or 'superlu'")
        self.body: Any
        self.pairs: tuple[Pair, ...]
        given: FrictionLike | None = friction
        if isinstance(body, Solid):
            self.body, self.pairs = between(body, boundary, obstacle, functional)
        else:
            self.body, self.pairs = given_pairs(body, boundary, obstacle, functional)
            given = None if np.isscalar(friction) and friction == 0.0 else friction
        self.boundary, self.functional, self.solver = boundary, functional, solver
        self.boundaries: ContactBoundaries | Interfaces
        self.rows: ContactRows
        self.motion: ObstacleMotion | None
        self.adhesion, self.hardness, self.wear = adhesion, hardness, wear
        self.surface: SurfaceState | None
        self._discretise((obstacle, given, law))
        self.overclosure = overclosure

    def __repr__(self) -> str:
        return f"ContactProblem({self.body!r}, {self.friction.size} points, law={self.law!r})"

    @property
    def obstacle(self) -> ObstacleLike:
        """The obstacle, or a list of them; may be reassigned."""
        return self._laws[0]

    @obstacle.setter
    def obstacle(self, obstacle: ObstacleLike) -> None:
        if self.pairs:
            raise InputError("obstacle: make a new ContactProblem where bodies touch each other")
        self._discretise((obstacle, *self._laws[1:]))

    @property
    def friction(self) -> Array:
        """Coefficient or bound of each contact point, shape (m,), read-only; may be reassigned."""
        return self._friction

    @friction.setter
    def friction(self, friction: FrictionLike) -> None:
        self._take((self._laws[0], friction, self._laws[2]), self.boundaries)

    @property
    def given_friction(self) -> Any:
        """Friction as given; None for that of the pairs."""
        return self._laws[1]

    @property
    def law(self) -> str | None:
        """The friction law; None without friction. It may be reassigned."""
        return self._laws[2] if np.any(self._friction > 0) else None

    @law.setter
    def law(self, law: str | None) -> None:
        self._take((*self._laws[:2], law), self.boundaries)

    @property
    def overclosure(self) -> tuple[PressureOverclosure | None, ...]:
        """Law of compliant surfaces of each boundary; empty for hard contact. May be reassigned."""
        return self._overclosure

    @overclosure.setter
    def overclosure(self, overclosure: OverclosureLike) -> None:
        count = int(self.rows.part.max(initial=0)) + 1
        laws = checked(overclosure, count, self.rows.part.size > 0)
        if laws and (self.adhesion is not None or self.hardness is not None):
            raise InputError(
                "overclosure: it has no adhesion and no hardness; give one of the three"
            )
        self._overclosure = laws

    def _discretise(self, laws: Laws) -> None:
        """Compute the contact rows; their frames depend on the body's supports."""
        self.body.check_unchanged()
        supports = len(self.body._supports)
        found = self._boundaries(laws[0])
        opposite = [pair.opposite for pair in self.pairs] if self.pairs else laws[0]
        gap, motion = found.gap(opposite), found.motion(opposite)
        self._take(laws, found)
        G, T = (self.body.embed(part) for part in (found.rows.G, found.rows.T))
        rows = replace(found.rows, G=G, T=T, gap=gap)
        surface = SurfaceState.of(self.adhesion, self.hardness, self.wear, rows.x)
        self.__dict__.update(boundaries=found, rows=rows, motion=motion, surface=surface)
        self._supports = supports
        self._condensed = None

    def _boundaries(self, obstacle: Any) -> ContactBoundaries | Interfaces:
        if self.pairs:
            return Interfaces.of(self.body, self.pairs)
        return ContactBoundaries.of(self.body.trace, self.boundary, obstacle, self.functional)

    @property
    def opposite(self) -> Any:
        """The obstacle; for pairs a list with the opposite side of each."""
        return [pair.opposite for pair in self.pairs] if self.pairs else self.obstacle

    def _take(self, laws: Laws, boundaries: ContactBoundaries | Interfaces) -> None:
        """Check and store obstacle, friction and law."""
        obstacle, given, law = laws
        if law is not None and not (isinstance(law, str) and law in ("coulomb", "tresca")):
            raise InputError(f"law={law!r}: expected 'coulomb', 'tresca' or None")
        friction = boundaries.friction(given)
        rubs = bool(np.any(friction > 0))
        if law is None and rubs:
            raise InputError(
                "friction: law=None is contact without friction; leave friction out, or choose "
                "law='coulomb' or 'tresca'"
            )
        if obstacle is None and not self.pairs and not (law == "tresca" and rubs):
            raise InputError(
                "obstacle: None (no contact law) needs given friction, law='tresca' and friction "
                "> 0; there is no pressure for Coulomb's law to act on"
            )
        friction.flags.writeable = False
        self._laws, self._friction = laws, friction

    def _follow_body(self) -> None:
        self.body.check_unchanged()
        if len(self.body._supports) != self._supports:
            self._discretise(self._laws)

    @property
    def system(self) -> ContactSystem:
        """The discrete system under the body's current loads."""
        return self.system_of(self.body)

    def system_of(
        self,
        body: Solid,
        after: ContactResult | None = None,
        obstacle: ObstacleLike = _SAME,
        *,
        since: ObstacleLike = _SAME,
        said: Any = None,
    ) -> ContactSystem:
        """The discrete system of a body under other loads, with another obstacle, after a step.
        `since` is the obstacle of the last step, by default that of `after`; `said` is its
        displacement, if the caller knows it. Of pairs obstacles are lists, one entry a pair."""
        self._follow_body()
        rows, motion, now, surface = self.rows, self.motion, obstacle, self.surface
        if obstacle is not _SAME:
            rows = replace(rows, gap=self.boundaries.gap(obstacle))
            motion = self.boundaries.motion(obstacle)
        else:
            now = self.opposite
        friction = self.friction * rows.weights if self.law == "tresca" else self.friction
        if after is not None:
            refuse_other_points(rows, after.system.rows)
            since = after.system.obstacle if since is _SAME else since
        if since is not _SAME:
            motion = self.with_travel(motion, since, now, said, after, rows.gap)
        slip_from = None if after is None else np.where(rows.ties[:, None], 0.0, after.slip)
        if surface is not None:
            if after is not None and after.system.surface is not None:
                surface = surface.after(after.indentation, after.worn)
            if surface.adhesion is not None:
                surface = surface.ramped(rows.weights * self.condense().point_scale ** 2)
            rows = replace(rows, gap=rows.gap + surface.lost)
        loads, law, laws = body.loads, self.law, self.overclosure
        rigid = self.rigid(now)
        return ContactSystem(
            body, rows, loads, law, friction, slip_from, motion, laws, rigid, surface=surface
        )

    def rigid(self, opposite: Any) -> Any:
        """The rigid obstacles; for pairs None where the other side is elastic."""
        if not self.pairs:
            return opposite
        each = zip(self.pairs, opposite, strict=True)
        return [None if pair.two_bodies else o for pair, o in each]

    def with_travel(
        self,
        motion: ObstacleMotion | None,
        since: Any,
        now: Any,
        said: Any,
        after: ContactResult | None,
        gap: Array,
    ) -> ObstacleMotion | None:
        """The motion of obstacles, with the path of their shapes up to this step."""
        last = self.rows.gap if after is None else after.system.given_gap
        wears = self.wear is not None
        moved = self.boundaries.travel(
            since,
            now,
            said,
            unchanged=same_gaps(last, gap),
            felt=np.ones_like(gap) if wears else self.friction,
            first=after is None,
        )
        before = None if after is None else after.system.motion
        if before is not None and before.travel is not None:
            moved = moved + before.travel
        elif not np.any(moved):
            return motion
        return ObstacleMotion.with_travel(motion, moved)

    def condense(
        self, device: str | Sequence[str] | None = None, deterministic: bool | None = None
    ) -> CondensedContact:
        """Factor once; the result is cached for later calls of `solve`.

        Parameters
        ----------
        device : {"cpu", "cuda", "auto"} or sequence of str, optional
            Where to condense and solve; default: as before, or "cpu". "cuda" needs CuPy and, except
            for a `LayeredBlock`, cuDSS; "auto" uses it if available and faster, and logs why.
            ``("cuda:0", "cuda:1")`` shares the factors of bodies with a Basis among devices.
        deterministic : bool, optional
            Whether equal calls give equal bits on the same device; default: as before, or False.
            cuDSS has no deterministic Schur complement: a body with a Basis is then solved once per
            contact force, which takes longer. No effect on the host.

        Returns
        -------
        CondensedContact

        Raises
        ------
        InputError
            An unknown device, a body that it does not take, several devices with `deterministic`,
            or a contact boundary fixed entirely.
        Unbounded
            A piece of the body is neither fixed nor connected to the contact boundary.
        MissingDependency
            The package of the solver, CuPy or cuDSS is not installed.
        """
        self._follow_body()
        device = chosen_device(device, self.body, self.solver)
        if not isinstance(deterministic, bool | None):
            raise InputError(f"deterministic={deterministic!r}: expected True, False or None")
        kept, material = self._condensed, self.body.materials
        before, same_bits = ("cpu", False) if kept is None else kept[:2]
        where = device or before, same_bits if deterministic is None else deterministic
        if kept is None or kept[:2] != where or not _same(kept[2], material):
            made = condensed_contact(self.body, self.rows, self.solver, *where)
            kept = self._condensed = *where, material, made
        return kept[3]

    def kept_condensation(self, body: Solid) -> CondensedContact | None:
        """The cached condensation, if there is one and it is that of a body with this material."""
        kept = self._condensed
        return kept[3] if kept is not None and _same(kept[2], body.materials) else None

    @keywords_named
    def solve(
        self,
        method: str = "newton",
        *,
        tol: float | None = None,
        max_iterations: int | None = None,
        start: ContactResult | None = None,
        after: ContactResult | None = None,
        motion: Any = None,
        eps: float | None = None,
        callback: Callable[[Iteration], None] | None = None,
        verbose: bool = False,
    ) -> ContactResult:
        """Solve and certify.

        =============  ======================  ====================  ============================
        method         frictionless            Tresca                Coulomb
        =============  ======================  ====================  ============================
        newton         primal-dual active set  radial-return Newton  monolithic Newton
        pdas           primal-dual active set  damped Newton (4.16)  outer loop over (4.16)
        fixed_point    --                      (4.12)                Algorithm 3
        tresca_loop    --                      --                    outer loop over exact Tresca
        qp:<solver>    the QP                  the split QP (2-D)    outer loop over it
        =============  ======================  ====================  ============================

        Parameters
        ----------
        method : str
        tol : float, optional
            Every residual of the certificate is at most this; see `ContactSystem.kkt`. Default
            1e-10; ``fixed_point`` 1e-6 and ``qp:`` 1e-7. With ``fixed_point`` the residual of the
            friction law may be larger, because of the regularisation eps.
        max_iterations : int, optional
            Default 2000 for ``fixed_point``, else 100.
        start : ContactResult, optional
            A neighbouring solution to start from: of other loads, another obstacle or friction, or
            of a coarser mesh (nested iteration), whose tractions are interpolated.
        after : ContactResult, optional
            The last step of a load history: friction opposes the slip since then, and the solver
            starts from there. See `LoadStepper`.
        motion : sequence of float, or 0, optional
            Only with `after`: displacement of the obstacle's contact points since then; 0 if along
            the normal. By default derived from the obstacle's shapes; required if these do not
            determine it. For several boundaries a list, with None for the default.
        eps : float, optional
            Only ``fixed_point``: slip below which friction is linear. Default 1e-5 of the
            largest displacement of the contact boundary.
        callback : callable, optional
            Receives each `Iteration`.
        verbose : bool
            Print one line per iteration.

        Returns
        -------
        ContactResult

        Raises
        ------
        NotConverged
            The certificate fails; nothing is returned.
        Infeasible
            A prescribed displacement contradicts the obstacle.
        Unbounded
            The body is not supported; the message names the rigid motion.
        InputError
            A malformed argument; displacements beyond the size of the body, or along the obstacle
            so far that the gap changes by more than the penetration.

        Warns
        -----
        LargeMotionWarning
            The gap changes noticeably along such a displacement.
        """
        for name, value in (("start", start), ("after", after)):
            if value is not None and not isinstance(value, ContactResult):
                raise InputError(f"{name}: expected a ContactResult, got {type(value).__name__}")
        if callback is not None and not callable(callback):
            raise InputError(f"callback={callback!r}: expected a function of an Iteration")
        if motion is not None and after is None:
            raise InputError("motion: that of the obstacle since the step given as after")
        options = Options.checked(self.law, self.body.dim, method, tol, max_iterations, eps)

        def report(line: Iteration) -> None:
            logger.info("%s", line)
            if verbose:
                print(line)
            if callback is not None:
                callback(line)

        start = after if start is None else start
        condensed = self.condense()
        system = self.system_of(self.body.snapshot(), after, said=motion)
        result = solve_system(system, condensed, options, start, report)
        result = with_jump(result, after)
        check_motion(result, self.boundaries, self.opposite)
        warn_of_sagitta(result, self.boundaries.rise(self.opposite), condensed, options)
        if isinstance(self.boundaries, Interfaces):
            warn_of_coarse_facets(result, self.boundaries.facet_ratio)
        vars(result)["origin"] = Origin(self)
        return result


def _same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    return all(a is b for a, b in zip(one, other, strict=True))


if TYPE_CHECKING:
    from contact.result.contact_result import ContactResult


def warn_of_coarse_facets(result: ContactResult, ratio: Array) -> None:
    """Warn (ContactWarning) if facets in contact face others of less than a quarter the length.
    The coarser mesh limits the accuracy of the pressure; `ratio` (m,) is that of `facet_ratio`."""
    p = result.pressure
    loaded = p > 1e-12 * p.max(initial=0.0)
    if not loaded.any() or np.ptp(p) <= 0.05 * p.max():  # any facets resolve smaller variations
        return
    worst = float(ratio[loaded].max())
    if worst > 4.0 * (1 + 1e-9):
        warn(
            f"facets in contact are up to {worst:.0f} times as long as those of the other body: "
            "the coarser mesh limits the accuracy of the pressure; refine it there"
        )


def condensed_contact(
    body: Any,
    rows: ContactRows,
    solver: str = "auto",
    device: Device = "cpu",
    deterministic: bool = False,
) -> CondensedContact:
    """Condense the contact rows of bodies; with the backend "krylov" make them unknowns.
    Arguments as of `CondensedContact`; raises InputError if one of several bodies needs
    "krylov"."""
    if isinstance(body, DistributedBody):
        if body.chosen_backend(rows.G.shape[0] * body.dim) == "krylov":
            return PrimalContact(body, rows, body.multigrid)
    elif any(getattr(one, "backend", "") == "krylov" for one in body.bodies):
        raise InputError(
            "backend='krylov': bodies that touch each other are condensed; take "
            "DistributedBody(..., backend='auto') or 'mumps'"
        )
    return CondensedContact(body, rows, solver, device, deterministic=deterministic)
