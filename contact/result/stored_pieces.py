"""What files tell of a body on many processes."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from contact.body.distributed_body import DistributedBody


def words_of_distributed(
    body: DistributedBody, rows: dict[str, str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What shows that a body on many processes is the same; no file holds its mesh."""
    law = body.local
    constants = {"E": law.E, "nu": law.nu} if law.anisotropy is None else {"C": law.anisotropy.C}
    arrays = {
        name: value for name, value in constants.items() if np.ndim(value) == 0 or name == "C"
    }
    about = {
        "mesh": f"{type(body.trace.mesh).__name__} on many processes (see LoadStepper.resume)",
        "element": type(body.element).__name__,
        "dofs": body.space.N,
        "plane": body.plane,
        "dilatation": law.dilatation,
        "supports": [[*names, str(components)] for names, components in body._supports],
        **rows,
    }
    return arrays, about


def on_all_processes(body: Any, rows: sparse.csr_array) -> sparse.csr_array:
    """The columns of contact rows that all processes have; all of them if there is one process."""
    return rows[:, : body.trace.basis.N] if isinstance(body, DistributedBody) else rows
