"""VTK data sets in files, one or a series.

VTK writes to a string and Python to the file: VTK's file writers end the process on a full disk.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from skfem_adini.errors import AdiniError
from skfem_adini.ground.files import complete_file


def write_grid(path: Path, grid: Any) -> None:
    """Write a data set of pyvista, in whole or not at all.

    Parameters
    ----------
    path
        A name ending in `.vtu` or `.vtp`, as the grid demands, or in `.vtk` (not for polygons).
        Missing folders are made, an existing file is replaced.
    grid
        A `pyvista.UnstructuredGrid` or `pyvista.PolyData`.

    Raises
    ------
    OSError
        No space left, or no right to write.
    AdiniError
        VTK refuses the data set.
    """
    from vtkmodules import vtkIOLegacy, vtkIOXML

    writer: Any
    if path.suffix == ".vtk":
        writer = vtkIOLegacy.vtkUnstructuredGridWriter()
        writer.SetFileTypeToBinary()
    else:
        polygons = path.suffix == ".vtp"
        name = "vtkXMLPolyDataWriter" if polygons else "vtkXMLUnstructuredGridWriter"
        writer = getattr(vtkIOXML, name)()
        writer.SetDataModeToBinary()
    writer.SetInputData(grid)
    writer.WriteToOutputStringOn()
    if writer.Write() != 1:
        raise AdiniError(f"VTK could not write a {type(grid).__name__}")
    legacy = path.suffix == ".vtk"
    data: bytes = writer.GetOutputStdString() if legacy else writer.GetOutputString().encode()
    path.parent.mkdir(parents=True, exist_ok=True)
    with complete_file(path) as file:
        file.write(data)


def write_blocks(path: Path, blocks: Any) -> Path:
    """Write a `pyvista.MultiBlock` as a `.vtm` file that lists a file for each block, by name.

    Parameters
    ----------
    path
        A name ending in `.vtm`; the blocks lie beside it as `name_0.vtu` (polygons: `.vtp`) and so
        on, and are complete before the list appears.
    blocks
        Data sets with names, not nested.

    Raises
    ------
    OSError
        No space left, or no right to write.
    AdiniError
        VTK refuses a data set.
    """
    whole = ElementTree.Element("VTKFile", type="vtkMultiBlockDataSet", version="1.0")
    listed = ElementTree.SubElement(whole, "vtkMultiBlockDataSet")
    for k, name in enumerate(blocks.keys()):
        file = _write_beside(path, str(k), blocks[k])
        ElementTree.SubElement(listed, "DataSet", index=str(k), name=name, file=file.name)
    return _write_list(path, whole)


def _write_beside(path: Path, number: str, data: Any) -> Path:
    """Write one data set of a list of them; its file has the list's name and a number."""
    kinds = ("vtkMultiBlockDataSet", ".vtm"), ("vtkPolyData", ".vtp")
    suffix = next((suffix for kind, suffix in kinds if data.IsA(kind)), ".vtu")
    file = path.with_name(f"{path.stem}_{number}{suffix}")
    if suffix == ".vtm":
        return write_blocks(file, data)
    write_grid(file, data)
    return file


def _write_list(path: Path, root: ElementTree.Element) -> Path:
    ElementTree.indent(root)
    with complete_file(path) as whole:
        ElementTree.ElementTree(root).write(whole, xml_declaration=True, encoding="utf-8")
    return path


def write_series(path: Path, steps: Iterable[tuple[float, Any]]) -> Path:
    """Write data sets of pyvista as a `.pvd` collection, with one file for each step beside it.

    Parameters
    ----------
    path
        A name ending in `.pvd`; the steps are `name_0000.vtu` (polygons: `.vtp`) and so on. A step
        of several blocks is `name_0000.vtm`, see `write_blocks`.
    steps
        Times and data sets, read one after the other.

    Raises
    ------
    OSError
        No space left, or no right to write. Files of earlier steps stay; the collection is written
        last.
    """
    collection = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    listed = ElementTree.SubElement(collection, "Collection")
    for k, (time, grid) in enumerate(steps):
        file = _write_beside(path, f"{k:04d}", grid)
        ElementTree.SubElement(listed, "DataSet", timestep=repr(float(time)), file=file.name)
    return _write_list(path, collection)
