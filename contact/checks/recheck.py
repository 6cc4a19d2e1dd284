"""The certificate of a result, computed on the host in pairs of numbers."""

from __future__ import annotations

import numpy as np

from contact.checks.paired_bodies import paired_body
from contact.checks.paired_residuals import PairedResiduals
from contact.errors import InputError
from contact.laws.options import default_tolerance
from contact.result.certify import refuse_residuals
from contact.result.contact_result import ContactResult
from skfem_adini.ground.arguments import numbers


def recheck(result: ContactResult, tol: float | None = None) -> dict[str, float]:
    r"""Compute the certificate of a result anew, on the host and in twice the working precision.

    The residuals have the names and scales of ``result.kkt``, so that both can stand side by side.
    They are computed by other code and in other arithmetic, wherever the result comes from: all
    sums that cancel are formed in pairs of float64, of about 32 digits (`contact.arrays.pairs`).
    What is left is the residual of the numbers u, mu and t as they are stored, while that of
    ``result.kkt`` includes the rounding of its own sums.

    ==================  ============================================================================
    equilibrium         ``S u + G^T mu + T^T t - f`` at the free unknowns; S is the matrix of the
                        body, in slender cells the strains, in a `LayeredBlock` its cells
    balance             loads, reactions and contact forces of each body, added up
    support             ``u - u0`` where displacements are prescribed
    penetration, ...    the laws of contact and friction, of ties and of driven obstacles, from
                        ``G u - d``, ``T u`` and the forces
    ==================  ============================================================================

    Parameters
    ----------
    result : ContactResult
        Of any body with a mesh, of several, or of a `LayeredBlock`; also one from a file, or of a
        step of a load history.
    tol : float, optional
        Tolerance of the residuals, which are relative; default: that of the solve.

    Returns
    -------
    dict
        The residuals, see `ContactResult.kkt`.

    Raises
    ------
    NotConverged
        A residual exceeds the tolerance; the message names it.
    InputError
        Not a ContactResult, one of a `DistributedBody`, NaN, or a tolerance outside (0, 1).

    Notes
    -----
    The curves of compliant surfaces, and the scales that residuals are divided by, are evaluated in
    float64. A `GridResult` holds no displacements: its own certificate transforms them anew.

    References
    ----------
    T. J. Dekker, Numer. Math. 18 (1971), 224-242. T. Ogita, S. M. Rump and S. Oishi, Accurate sum
    and dot product, SIAM J. Sci. Comput. 26 (2005), 1955-1988.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, recheck
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> result = ContactProblem(body, "bottom", 0.0, friction=0.3).solve()
    >>> again = recheck(result)
    >>> again.keys() == result.kkt.keys(), max(again.values()) < 1e-12
    (True, True)
    """
    if not isinstance(result, ContactResult):
        raise InputError(f"result: expected a ContactResult, got {type(result).__name__}")
    if tol is None:
        tol = default_tolerance(result.method) if result.tol is None else result.tol
    elif numbers("tol", tol).shape != () or not 0 < tol < 1:
        raise InputError(f"tol={tol!r}: expected a number between 0 and 1")
    bodies = [paired_body(body) for body in result.system.body.bodies]
    kkt = PairedResiduals(result, bodies).all()
    if any(np.isnan(value) for value in kkt.values()):
        raise InputError("result: the state (u, mu, t) holds NaN")
    refuse_residuals(result, kkt, tol, result.slack)
    return kkt
