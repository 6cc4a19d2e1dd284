"""Whether bodies are condensed on the host or on a CUDA device."""

from __future__ import annotations

import logging
import re
from typing import Any

from contact.arrays.dense_arrays import arrays_on
from contact.body.basis_solid import BasisSolid
from contact.body.distributed_body import DistributedBody
from contact.condensation.device_schur import missing_for_cudss
from contact.errors import InputError, MissingDependency

_log = logging.getLogger(__name__)
Device = str | tuple[str, ...]  # "cpu", "cuda", or "cuda:0" and so on for several
LARGE = 100_000  # unknowns from which a device is faster despite 3 s to load its libraries


def chosen_device(device: Any, body: Any, solver: str) -> Device | None:
    """Check device names, several if they share the factors; choose for "auto" and log why.
    Raises InputError for another name, or the same device twice."""
    if device is None:
        return None
    if isinstance(device, (tuple, list)) and device:
        words = tuple(device)
        if all(_names_one(word) for word in words) and len(set(words)) == len(words):
            return words
    if not (isinstance(device, str) and device in ("cpu", "cuda", "auto")):
        raise InputError(
            f"device={device!r}: expected 'cpu', 'cuda', 'auto', or several devices as "
            "('cuda:0', 'cuda:1')"
        )
    if device != "auto":
        return device
    found, why = choose_device(body, solver)
    _log.info("%s: %s", found, why)
    return found


def _names_one(word: Any) -> bool:
    return isinstance(word, str) and re.fullmatch(r"cuda:(0|[1-9][0-9]*)", word) is not None


def choose_device(body: Any, solver: str) -> tuple[str, str]:
    """The device for a body and a solver, and the reason."""
    if isinstance(body, DistributedBody):
        return "cpu", "a DistributedBody is condensed on the processes of the host"
    if solver != "auto":
        return "cpu", f"solver={solver!r} runs on the host"
    unknowns = body.ndofs
    if unknowns < LARGE:
        return "cpu", f"{unknowns} unknowns are fewer than {LARGE}, from which a device pays"
    try:
        arrays_on("cuda")
    except (MissingDependency, InputError) as error:
        return "cpu", str(error)
    missing = missing_for_cudss() if any(isinstance(b, BasisSolid) for b in body.bodies) else None
    if missing:
        return "cpu", missing
    return "cuda", f"{unknowns} unknowns, and a CUDA device answers"
