"""Newton's method on a body whose unknowns include the contact rows.

Normal rows of points in contact and tangential rows of sticking points are prescribed; equations of
slipping points are replaced by their law, with the forces ``l = (f - K x)_c``. The other unknowns
are solved by conjugate gradients or, with slip, by GMRES, both with multigrid of the symmetric
part; forces and displacements of a step are therefore in equilibrium, and no compliance is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from contact.condensation.boundary_problem import Array, Forces
from contact.condensation.primal import PrimalForces, PrimalProblem
from contact.errors import InputError, NotConverged
from contact.laws.condensed_newton import Condensed, blocks_in
from contact.laws.friction import Coulomb, Friction, Tresca
from contact.laws.iteration import Report
from contact.laws.law import SlipLaw, State, Zones
from contact.laws.load_balance import check_held
from contact.laws.newton import newton
from contact.laws.options import Options
from skfem_adini.distributed import Alteration


def primal_newton(
    problem: PrimalProblem,
    friction: Friction | None,
    options: Options,
    start: Forces | None,
    report: Report,
) -> PrimalForces:
    """Solve for contact; without a start all points with a finite gap initially stick."""
    if options.method != "newton" or problem.compliance is not None:
        raise InputError(
            f"method={options.method!r}: without condensation only 'newton' is offered, on hard "
            "surfaces; take DistributedBody(..., backend='mumps')"
        )
    check_held(problem, friction)
    laws = Primal(problem, friction or Tresca(np.zeros(problem.gap.size)))
    tol = max(0.1 * options.tol, 1e-11)  # linear systems are solved to 1e-13
    now = laws.stuck() if start is None else laws.given(start)
    failure, limit = None, options.max_iterations
    for _ in range(2):
        try:
            return laws.solved(now, tol, limit, "newton", report)
        except NotConverged as error:
            failure = error
        if isinstance(laws.friction, Tresca):
            break
        for _ in range(4):  # restarts of Newton's method
            given = Primal(problem, Tresca(laws.friction.bound(now.mu)))
            now = given.solved(now, 1e-3, limit, "tresca step", report)
    raise NotConverged(f"{failure}; try a smaller friction coefficient, or backend='mumps'")


@dataclass(frozen=True)
class Primal(Condensed):
    """A problem with contact rows as unknowns, for `contact.laws.newton.newton`."""

    problem: PrimalProblem

    def solved(
        self, start: PrimalForces, tol: float, limit: int, phase: str, report: Report
    ) -> PrimalForces:
        """Newton's method from a start."""
        found = newton(
            self, start, zones=self._zones(start), tol=tol, max_iterations=limit, phase=phase,
            report=report,
        )  # fmt: skip
        assert isinstance(found, PrimalForces)
        return found

    def state(self, forces: Forces) -> State:
        """Forces and their displacements; the prescribed ones if none are known."""
        x = getattr(forces, "x", None)
        if x is None:
            return super().state(forces)
        at = replace(self.problem, v=self.problem.v0 + self.problem.system.of_chosen(x))
        return Condensed(at, self.friction).state(forces)

    def _zones(self, now: PrimalForces) -> Zones:
        """Zones at a state, from the forces only if it has no displacements."""
        problem = self.problem
        if now.x is not None:
            return self.law.zones(self.state(now))
        touches = problem.can_touch & ((now.mu > 0) | problem.ties)
        g = self.law.bound(now.mu)
        rubs = (g > 0) & np.any(problem.tangent >= 0, axis=1) & touches
        # A force within 0.1 % of its bound counts as slip.
        slip = rubs & (np.linalg.norm(now.t, axis=1) >= 0.999 * g)
        return Zones(touches, rubs & ~slip, slip, np.where(slip, 1.5 * now.t.T, now.t.T), g, 1.0)

    def stuck(self) -> PrimalForces:
        """Zones with all points of finite gap in contact, sticking if there is friction."""
        problem, touch = self.problem, self.problem.can_touch
        mu, t = problem.zeros()
        rubs = self.friction.bound(np.ones(mu.size)) > 0
        rubs = (rubs | problem.ties) & np.any(problem.tangent >= 0, axis=1)
        if isinstance(self.friction, Coulomb):
            rubs &= touch
        zones = Zones(touch, rubs, np.zeros_like(touch), t.T, np.zeros(mu.size), 1.0)
        start = PrimalForces(mu, t, np.zeros(problem.s.size), np.zeros(problem.load.size))
        return self.step(self.state(start), zones, "radial")

    def given(self, start: Forces) -> PrimalForces:
        """A start, with displacements if it has any."""
        motions = np.zeros(self.problem.s.size)
        return PrimalForces(start.mu, start.t, motions, getattr(start, "x", None))

    def step(self, state: State, zones: Zones, form: str, size: float = 0.0) -> PrimalForces:
        """Forces that solve the linearised laws."""
        problem, now = self.problem, state.forces
        system, tangent = problem.system, problem.tangent
        rubbing = (zones.stick | zones.slip)[:, None] & (tangent >= 0)
        held = np.zeros(problem.v0.size, dtype=bool)
        value = -problem.v0
        at_n = problem.normal[zones.active]
        held[at_n] = True
        value[at_n] += problem.gap[zones.active]
        held[tangent[zones.stick[:, None] & (tangent >= 0)]] = True
        load = system.of_chosen(problem.load)
        alteration, right = Alteration.none(held), load
        if zones.slip.any():
            law = self.law.slip(zones, state.t, form, np.flatnonzero(zones.slip))
            alteration, right = _slipping(problem, law, zones, held, load)
        begin = np.zeros(problem.load.size) if now.x is None else now.x
        x, product = system.solve(
            alteration, problem.load, np.where(held, value, right), begin, tol=1e-13
        )
        forces = load - system.of_chosen(product)
        mu, t = problem.zeros()
        mu[zones.active] = forces[at_n]
        t[rubbing] = forces[tangent[rubbing]]
        return PrimalForces(mu, t, now.a, x)


def _slipping(
    problem: PrimalProblem, law: SlipLaw, zones: Zones, held: np.ndarray, load: Array
) -> tuple[Alteration, Array]:
    """Rows of slip ``t = r / (1 - r) (I - a b^T) c v + a (F mu + g)``: the law of
    `contact.laws.law`, in both forms, solved for t.
    """
    points, n = np.flatnonzero(zones.slip), held.size
    at, of_normal = problem.tangent[points], problem.normal[points]
    # Limit r near one, where points nearly stick.
    turned = law.blocks()[1] / np.maximum(1.0 - law.ratio, 1e-8)[:, None, None]
    share, known = ((law.a * part).T for part in (law.coefficient, law.bound))
    with_x = blocks_in(n, at, at, turned)
    # The bound of Coulomb's law is F mu, where mu = f_n - K_n x.
    touches = np.where(zones.active[points], of_normal, -1)
    normal = blocks_in(n, at, touches[:, None], share[:, :, None])
    right = load - with_x @ problem.v0 - normal @ load
    right[at[at >= 0]] -= known[at >= 0]
    of_rows = sparse.diags_array((~held).astype(float)) - normal
    return Alteration(held, sparse.csr_array(of_rows), with_x), right
