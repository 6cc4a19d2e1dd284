"""The contact problem: body, boundary, obstacle and friction law; choice of the method."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.blas_threads import one_blas_thread
from contact.body import ElasticBody
from contact.condense import CondensedContact
from contact.errors import InputError, NotConverged, numbers
from contact.methods import Options, solve_boundary
from contact.newton import Iteration
from contact.obstacles import Gap
from contact.result import ContactResult, certify
from contact.rows import ContactRows, contact_rows
from contact.system import ContactSystem
from gpu import Infeasible as QPInfeasible
from gpu import InputError as QPInputError
from gpu import NotConverged as QPNotConverged

Array = NDArray[np.float64]
Friction = float | ArrayLike | Callable[[Array], ArrayLike]
logger = logging.getLogger(__name__)


class ContactProblem:
    """Contact of an elastic body with a rigid obstacle, with or without friction.

    Find u and contact forces (pressure p, shear) with equilibrium in the body and on the contact
    boundary, with u_n the displacement along the outward normal and d the gap,

    * Signorini: ``u_n <= d``, ``p >= 0``, ``p (u_n - d) = 0``;
    * friction with bound g: ``|shear| <= g``, and ``shear = -g u_t / |u_t|`` where u_t is not 0;
      Coulomb: ``g = F p``; Tresca: g is given.

    Parameters
    ----------
    body : ElasticBody
    boundary : str, list of str or array of facet numbers
        The boundary where contact may occur.
    obstacle : obstacle, number, callable, array or None
        See `contact.obstacles`. None: friction without a contact law, the problem (4.9).
    friction : float, callable x -> array, or ndarray of shape (m,)
        Coulomb: the coefficient. Tresca: the bound, a traction. Never negative.
    law : {"coulomb", "tresca", None}
        None is frictionless, as is friction = 0.
    functional : str, optional
        How multipliers meet the trace, see `contact.functionals`.
    solver : {"auto", "pardiso", "superlu"}
        Sparse factorisation.

    Raises
    ------
    InputError
        A malformed argument; the message names it.

    Examples
    --------
    A unit square pressed by its upper side on a foundation .03 below it:

    >>> from skfem import MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=2.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -1.0))
    >>> result = ContactProblem(body, "bottom", 0.03, friction=0.4).solve()
    >>> round(float(result.resultant[1]), 6)
    1.0
    """

    def __init__(
        self,
        body: ElasticBody,
        boundary: str | Sequence[str] | ArrayLike,
        obstacle: Gap,
        friction: Friction = 0.0,
        law: str | None = "coulomb",
        functional: str | None = None,
        solver: str = "auto",
    ) -> None:
        if not isinstance(body, ElasticBody):
            raise InputError(f"body: expected an ElasticBody, got {type(body).__name__}")
        if law not in ("coulomb", "tresca", None):
            raise InputError(f"law={law!r}: expected 'coulomb', 'tresca' or None")
        self.body, self.obstacle, self.solver = body, obstacle, solver
        self.rows: ContactRows = contact_rows(body, body.facets(boundary), obstacle, functional)
        self.friction = self._friction(friction)
        self.law = law if np.any(self.friction > 0) else None
        if obstacle is None and self.law != "tresca":
            raise InputError(
                "obstacle: None (no contact law) needs given friction, law='tresca' and friction "
                "> 0; there is no pressure for Coulomb's law to act on"
            )

    def _friction(self, friction: Friction) -> Array:
        value = numbers("friction", friction(self.rows.x) if callable(friction) else friction)
        if value.shape not in ((), self.rows.gap.shape):
            raise InputError(
                f"friction: expected a number or {self.rows.gap.size} values, one for each "
                f"contact point, got shape {value.shape}"
            )
        if not np.all(np.isfinite(value)) or np.any(value < 0):
            raise InputError("friction: must be finite and not negative")
        return np.broadcast_to(value, self.rows.gap.shape).copy()

    @property
    def system(self) -> ContactSystem:
        """The discrete system under the body's present loads."""
        friction = self.friction * self.rows.weights if self.law == "tresca" else self.friction
        return ContactSystem(self.body, self.rows, self.body.f, self.law, friction)

    def condense(self) -> CondensedContact:
        """Factor once; the result is kept and serves every later `solve`."""
        return self._condensed

    @cached_property
    def _condensed(self) -> CondensedContact:
        return CondensedContact(self.body, self.rows, self.solver)

    def solve(
        self,
        method: str = "newton",
        *,
        tol: float | None = None,
        max_iterations: int | None = None,
        start: ContactResult | None = None,
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
            1e-10; ``fixed_point`` 1e-6 and ``qp:`` 1e-7. ``fixed_point`` may miss the friction
            law by its regularisation eps besides.
        max_iterations : int, optional
            Default 2000 for ``fixed_point``, else 100.
        start : ContactResult, optional
            A neighbouring solution to start from, e.g. of the last load step.
        eps : float, optional
            Only ``fixed_point``: slip below which friction is linear. Default 1e-5 of the
            largest displacement of the contact boundary.
        callback : callable, optional
            Receives each `Iteration`.
        verbose : bool
            Print one line an iteration.

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
            The body is not held; the message names the rigid motion.
        InputError
            A malformed argument.
        """
        options = Options.checked(self.law, self.body.dim, method, tol, max_iterations, eps)
        condensed, system = self.condense(), self.system
        history: list[Iteration] = []

        def report(line: Iteration) -> None:
            history.append(line)
            logger.info("%s", line)
            if verbose:
                print(line)
            if callback is not None:
                callback(line)

        boundary = condensed.boundary_problem(system.load, system.rows.gap)
        scale = condensed.point_scale
        law = system.scaled_friction(scale)
        if start is not None and not isinstance(start, ContactResult):
            raise InputError(f"start: expected a ContactResult, got {type(start).__name__}")
        warm = None if start is None else start.forces(boundary, scale)
        try:
            with one_blas_thread(condensed.size):
                forces, slack = solve_boundary(boundary, law, options, warm, scale, report)
        except QPInfeasible as error:
            raise condensed.not_held(error.certificate) from error
        except QPInputError as error:
            raise InputError(
                f"functional {self.rows.functional!r}: its rows depend on each other where the "
                "supports hold the contact boundary; choose another functional, or refine"
            ) from error
        except (QPNotConverged, NotConverged) as error:
            raise NotConverged(str(error), tuple(history)) from error
        result = ContactResult(
            system, *condensed.recover(system.load, boundary, forces), method, tuple(history)
        )
        certify(result, options.tol, slack)
        return result
