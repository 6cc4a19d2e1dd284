"""Fields on many processes as VTK files, one from each, with an index."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from skfem_adini.distributed.distributed_basis import DistributedBasis
from skfem_adini.errors import AdiniError, InputError
from skfem_adini.ground.files import complete_file
from skfem_adini.ground.vtk_files import write_grid
from skfem_adini.output.vtk_fields import to_pyvista

Array = NDArray[np.float64]


def save_pvtu(
    path: str | Path,
    space: DistributedBasis,
    fields: Array | Mapping[str, Array],
    subdivide: int | None = None,
    point_data: Mapping[str, Any] | None = None,
    cell_data: Mapping[str, Any] | None = None,
) -> Path:
    """Write fields to a `.vtu` file of each process and a `.pvtu` index, which ParaView reads.

    Parameters
    ----------
    path
        A name ending in `.pvtu`, in a folder that all processes see; the files of the processes
        lie beside it as `name_0.vtu` and so on.
    space
    fields
        Local vectors, by name, or one vector, named u.
    subdivide, point_data, cell_data
        As for `skfem_adini.to_pyvista`, on the local mesh.

    Returns
    -------
    Path
        The index, which is written last: as long as it is missing the files are not complete.

    Raises
    ------
    InputError
        Another suffix, or a field that does not fit; on all processes.
    AdiniError
        A process could not write; the index is not written then.

    Examples
    --------
    >>> import tempfile
    >>> from skfem import MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> from skfem_adini.distributed import DistributedBasis, save_pvtu
    >>> space = DistributedBasis(MeshQuad().refined(2), ElementQuadAdini())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_pvtu(f"{folder}/field.pvtu", space, space.basis.ones()).name
    'field.pvtu'
    """
    named = fields if isinstance(fields, Mapping) else {"u": fields}

    def grid() -> Any:
        basis = space.basis.with_elements(space.own_cells)
        return to_pyvista(
            basis, named, subdivide=subdivide, point_data=point_data, cell_data=cell_data
        )

    return write_pieces(path, space.comm, grid)


def write_pieces(path: str | Path, comm: Any, make_grid: Callable[[], Any]) -> Path:
    """Write a grid of each process to its file, and the index once all are written.

    Parameters
    ----------
    path : str or Path
        The index.
    comm : Communicator
    make_grid : callable () -> pyvista.UnstructuredGrid
        The cells that belong to the process.
    """
    path = Path(path)
    if path.suffix != ".pvtu":
        raise InputError(f"path: expected a name ending in .pvtu, got {path.name!r}")
    grid, failure = None, ""
    try:
        grid = make_grid()
        write_grid(path.with_name(f"{path.stem}_{comm.rank}.vtu"), grid)
    except Exception as error:
        failure = f"{type(error).__name__}: {error}"
    for rank, each in enumerate(comm.allgather(failure)):
        if each:
            raise AdiniError(f"path: process {rank} could not write its part: {each}")
    if comm.rank == 0 and grid is not None:
        with complete_file(path) as file:
            _index(grid, path.stem, comm.size).write(file, xml_declaration=True, encoding="utf-8")
    comm.allgather(None)  # all processes wait until the index is written
    return path


def _index(grid: Any, stem: str, size: int) -> ElementTree.ElementTree[Any]:
    """The list of files, with the names and types of their arrays."""
    root = ElementTree.Element(
        "VTKFile", type="PUnstructuredGrid", version="1.0", byte_order="LittleEndian"
    )
    whole = ElementTree.SubElement(root, "PUnstructuredGrid", GhostLevel="0")
    for kind, data in (("PPointData", grid.point_data), ("PCellData", grid.cell_data)):
        listed = ElementTree.SubElement(whole, kind)
        for name in data.keys():  # noqa: SIM118
            _array(listed, name, np.asarray(data[name]))
    _array(ElementTree.SubElement(whole, "PPoints"), "Points", np.asarray(grid.points))
    for rank in range(size):
        ElementTree.SubElement(whole, "Piece", Source=f"{stem}_{rank}.vtu")
    ElementTree.indent(root)
    return ElementTree.ElementTree(root)


def _array(parent: Any, name: str, values: NDArray[Any]) -> None:
    types = {"float64": "Float64", "float32": "Float32", "int64": "Int64", "int32": "Int32"}
    components = 1 if values.ndim == 1 else values.shape[1]
    ElementTree.SubElement(
        parent,
        "PDataArray",
        type=types.get(str(values.dtype), "UInt8"),
        Name=name,
        NumberOfComponents=str(components),
    )
