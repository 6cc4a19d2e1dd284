"""VTK data sets in files, one or a series.

VTK writes to a string and Python to the file: VTK's file writers end the process on a full disk.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from skfem_adini.errors import AdiniError
from skfem_adini.output.complete_file import complete_file


def write_grid(path: Path, grid: Any) -> None:
    """Write a `pyvista.UnstructuredGrid` or `pyvista.PolyData`, in whole or not at all.
    The name ends in `.vtu`, `.vtp` or, not for polygons, `.vtk`; missing folders are made."""
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
    Blocks lie beside it as `name_0.vtu` (polygons: `.vtp`) and are complete before the list
    appears."""
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
    """Write (time, data set) pairs as a `.pvd` collection, with one file for each step beside it.
    Steps are `name_0000.vtu` (polygons: `.vtp`, several blocks: `.vtm`); the collection comes
    last."""
    collection = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    listed = ElementTree.SubElement(collection, "Collection")
    for k, (time, grid) in enumerate(steps):
        file = _write_beside(path, f"{k:04d}", grid)
        ElementTree.SubElement(listed, "DataSet", timestep=repr(float(time)), file=file.name)
    return _write_list(path, collection)
