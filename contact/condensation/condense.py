"""Choice of the condensation by the type of the body."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import singledispatch
from typing import Any, NamedTuple

from contact.arrays.dense_arrays import arrays_on
from contact.body.basis_solid import BasisSolid
from contact.body.distributed_body import DistributedBody
from contact.body.layers.layered_block import LayeredBlock
from contact.body.solid import Solid
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.condensation.device_choice import Device
from contact.condensation.distributed import CondensedDistributed
from contact.condensation.layers import CondensedLayers
from contact.condensation.solved_body import SolvedBody
from contact.condensation.sparse import SparseBody
from contact.errors import InputError

_log = logging.getLogger(__name__)


class _Limits(NamedTuple):  # contact rows up to which the compliance is a dense matrix
    rows: int = 25_000  # 5 GB; beyond, Krylov's method
    columns: int = 5_000  # if each column costs a solution
    alone: int = 300  # if a device deterministically solves for one column at a time


LIMITS = _Limits()


@singledispatch
def condense(body: Solid, rows: BodyRows, solver: str, device: str) -> CondensedBody:
    """Reduce a body to its contact boundary; other kinds register ``@condense.register(Kind)``.
    Raises InputError for an unknown kind of body, or a solver or device that it does not
    support."""
    raise InputError(f"body: no way is known to condense a {type(body).__name__}")


@condense.register(BasisSolid)
def _by_factorisation(body: BasisSolid, rows: BodyRows, solver: str, device: str) -> CondensedBody:
    if device == "cpu":
        return SparseBody(body, rows, solver)
    if solver != "auto":  # layers take no solver
        raise _refused(solver, device)
    return SparseBody(body, rows, arrays=arrays_on(device))


def solved(
    body: BasisSolid, rows: BodyRows, solver: str, device: Device, deterministic: bool = False
) -> SolvedBody:
    """A body without elimination, whose compliance comes from solutions.
    Several devices, "cuda:0" and so on, share the factors; if `deterministic`, a device refuses
    operations that are not bitwise reproducible."""
    if device == "cpu":
        return SolvedBody(body, rows, solver)
    several = None if isinstance(device, str) else tuple(int(word[5:]) for word in device)
    return SolvedBody(
        body, rows, arrays=arrays_on("cuda"), devices=several, deterministic=deterministic
    )


def repeatable(body: Solid, rows: BodyRows, solver: str, device: str) -> CondensedBody:
    """A body condensed on a device, bitwise reproducibly.
    cuDSS has no deterministic Schur complement, so that bodies with a Basis use solutions."""
    if isinstance(body, BasisSolid):
        return solved(body, rows, solver, device, deterministic=True)
    return condense(body, rows, solver, device)


def choose_condensation(
    bodies: Sequence[Solid], rows: int, solver: str, device: Device, deterministic: bool
) -> tuple[Any, bool]:
    """The function that condenses bodies with `rows` rows, and whether their compliance is dense.
    Raises InputError for several devices with `deterministic` or without an assembled stiffness,
    and for a solver of the host with such a stiffness on a device."""
    way: Any = solved
    assembled = all(isinstance(body, BasisSolid) for body in bodies)
    if assembled and device != "cpu" and solver != "auto":
        raise _refused(solver, device)
    if not isinstance(device, str):
        if not assembled:
            raise InputError(f"device={device!r}: several devices take bodies with a Basis alone")
        if deterministic:
            raise InputError("deterministic: cuDSS has no such mode on several devices; take one")
        if rows <= LIMITS.columns:
            return solved, True
    elif deterministic and device == "cuda":
        way = repeatable
        if not assembled or rows <= LIMITS.alone:
            return way, True
    elif not assembled or (rows <= LIMITS.rows and _fits(rows, device)):
        return condense, True
    _log.info(
        "%d contact rows: their compliance is not made dense; Newton's steps are solved by "
        "Krylov's method, whose products are solutions by the factors of the bodies",
        rows,
    )
    return way, False


def _fits(rows: int, device: str) -> bool:
    """Whether the dense compliance and the Schur complement fit into the device's memory."""
    room = None if device == "cpu" else arrays_on(device).room()
    return room is None or 16 * rows**2 <= room


def _refused(solver: str, device: Device) -> InputError:
    return InputError(
        f"solver={solver!r}: with device={device!r} a body is factored by cuDSS; leave 'auto'"
    )


@condense.register(LayeredBlock)
def _by_slab_doubling(
    body: LayeredBlock, rows: BodyRows, solver: str, device: str
) -> CondensedBody:
    if solver != "auto":
        raise InputError(
            f"solver={solver!r}: a LayeredBlock is condensed without sparse factorisation; "
            "leave 'auto', or use block.elastic()"
        )
    return CondensedLayers(body, rows, body.compute_on(device))


@condense.register(DistributedBody)
def _on_many_processes(
    body: DistributedBody, rows: BodyRows, solver: str, device: str
) -> CondensedBody:
    if device != "cpu":
        raise InputError(f"device={device!r}: a DistributedBody is condensed on the 'cpu'")
    alone = body.comm.size == 1
    known = ("auto", "mumps", "pardiso", "superlu") if alone else ("auto", "mumps")
    if solver not in known:
        raise InputError(
            f"solver={solver!r}: a DistributedBody on {body.comm.size} processes takes {known}"
        )
    return CondensedDistributed(body, rows, solver)
