"""The result of a body on many processes as VTK files, one from each, with an index."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from contact.body.distributed_body import DistributedBody
from contact.errors import ContactError, InputError
from contact.output.vtk import body_grid
from contact.result.body_result import BodyResult
from contact.result.contact_result import ContactResult
from skfem_adini.distributed import write_pieces


def save_pvtu(path: str | Path, result: ContactResult) -> Path:
    """Write a result of a `DistributedBody` to a `.vtu` file of each process and a `.pvtu` index.

    All processes must call it together; ParaView and pyvista read the index. The fields are those
    of ``ContactResult.to_pyvista``.

    Parameters
    ----------
    path : str or Path
        A name ending in ``.pvtu``, in a folder that all processes see.
    result : ContactResult

    Returns
    -------
    Path
        The index, which is written last: as long as it is missing the files are not complete.

    Raises
    ------
    InputError
        Another suffix, another body, or a process that could not write; the index is not written
        then.

    Examples
    --------
    >>> import tempfile
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, DistributedBody, save_pvtu
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = DistributedBody(mesh, contact="bottom", E=1.0, nu=0.3).fix("top", "xy", -0.01)
    >>> result = ContactProblem(body, "bottom", 0.0, friction=0.3).solve()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_pvtu(f"{folder}/block.pvtu", result).name
    'block.pvtu'
    """
    body = result.body
    if not isinstance(body, DistributedBody):
        raise InputError(
            f"result: its body is a {type(body).__name__}, not a DistributedBody; write "
            "result.to_pyvista() instead"
        )
    u, applied = body.to_local(result.u), body.to_local(result.applied)
    forces = (body.to_local(f) for f in (result.contact_forces, result.tie_forces))
    piece = BodyResult(body.local, u, applied, *forces)

    def grid() -> Any:
        own = body.space.own_cells
        return body_grid(piece).extract_cells(own, pass_point_ids=False, pass_cell_ids=False)

    try:
        return write_pieces(path, body.comm, grid)
    except ContactError as error:
        raise InputError(str(error)) from error
