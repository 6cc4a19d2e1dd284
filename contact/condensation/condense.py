"""Choice of the condensation by the type of the body."""

from __future__ import annotations

from functools import singledispatch

from contact.arrays.dense_arrays import arrays_on
from contact.body.basis_solid import BasisSolid
from contact.body.distributed_body import DistributedBody
from contact.body.layers.layered_block import LayeredBlock
from contact.body.solid import Solid
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.condensation.distributed import CondensedDistributed
from contact.condensation.layers import CondensedLayers
from contact.condensation.sparse import SparseBody
from contact.errors import InputError


@singledispatch
def condense(body: Solid, rows: BodyRows, solver: str, device: str) -> CondensedBody:
    """Reduce a body to its contact boundary.

    Another kind of body registers its own function: ``@condense.register(Kind)``.

    Parameters
    ----------
    body : Solid
    rows : BodyRows
        Its columns of the contact rows.
    solver : {"auto", "pardiso", "superlu"}
        Sparse factorisation.
    device : {"cpu", "cuda"}

    Raises
    ------
    InputError
        A solver or a device that this kind of body does not support, or an unknown kind of body.
    """
    raise InputError(f"body: no way is known to condense a {type(body).__name__}")


@condense.register(BasisSolid)
def _by_factorisation(body: BasisSolid, rows: BodyRows, solver: str, device: str) -> CondensedBody:
    if device == "cpu":
        return SparseBody(body, rows, solver)
    if solver != "auto":
        raise InputError(
            f"solver={solver!r}: with device={device!r} a body is factored by cuDSS; leave 'auto'"
        )
    return SparseBody(body, rows, arrays=arrays_on(device))


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
