"""Choice between condensation and contact rows as unknowns, by the type of the body."""

from __future__ import annotations

from typing import Any

from contact.body.distributed_body import DistributedBody
from contact.condensation.condensed_contact import CondensedContact
from contact.condensation.device_choice import Device
from contact.condensation.primal import PrimalContact
from contact.errors import InputError
from contact.rows.contact_rows import ContactRows


def condensed_contact(
    body: Any,
    rows: ContactRows,
    solver: str = "auto",
    device: Device = "cpu",
    deterministic: bool = False,
) -> CondensedContact:
    """Reduce the contact rows of bodies to the contact boundary where that is possible.
    Arguments as of `CondensedContact`; raises InputError where one of several bodies asks for
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
