"""Choice between condensation and contact rows as unknowns, by the type of the body."""

from __future__ import annotations

from typing import Any

from contact.body.distributed_body import DistributedBody
from contact.condensation.condensed_contact import CondensedContact
from contact.condensation.primal import PrimalContact
from contact.rows.contact_rows import ContactRows


def condensed_contact(
    body: Any, rows: ContactRows, solver: str = "auto", device: str = "cpu"
) -> CondensedContact:
    """The contact rows of bodies, reduced to the contact boundary where that is possible.

    Parameters
    ----------
    body, rows, solver, device
        As for `CondensedContact`.
    """
    if (
        isinstance(body, DistributedBody)
        and body.chosen_backend(rows.G.shape[0] * body.dim) == "krylov"
    ):
        return PrimalContact(body, rows, body.multigrid)
    return CondensedContact(body, rows, solver, device)
