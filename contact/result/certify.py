"""Whether a result meets the tolerance it is held to."""

from __future__ import annotations

import skfem

from contact.errors import NotConverged
from contact.result.contact_result import ContactResult


def certify(result: ContactResult, tol: float, slack: float) -> None:
    """Raise unless every residual of the result meets the tolerance.

    Parameters
    ----------
    result : ContactResult
    tol : float
    slack : float
        Allowed besides in the friction law, by a method that regularises it.

    Raises
    ------
    NotConverged
    """
    limits = dict.fromkeys(("cone", "slip"), tol + slack)
    missed = {
        name: value for name, value in result.kkt.items() if not value <= limits.get(name, tol)
    }
    if missed:
        found = ", ".join(f"{name} {value:.1e}" for name, value in missed.items())
        remedy = ""
        if "balance" in missed:
            remedy = (
                "; the displacements hold too few digits for the reactions of cells as slender as "
                "these: make them squarer, or let tol be larger"
            )
        if isinstance(result.system.body.element, skfem.ElementQuadBFS):
            remedy = (
                "; take skfem_adini's ElementQuadBFS, scikit-fem's own loses digits in small cells"
            )
        raise NotConverged(
            f"the solution fails its certificate at tolerance {tol:.1e}: {found}{remedy}",
            result.history,
        )
