"""Abaqus input files: cells by all their names, boundaries by sets of nodes."""

import numpy as np
import pytest
from skfem import MeshHex, MeshQuad, MeshTet, MeshTet2, MeshTri, MeshTri2
from skfem.io.meshio import HEX_MAPPING

from contact import ContactProblem, ElasticBody, InputError, Plane

MESHES = {
    "CPE3": MeshTri().refined(2),
    "CAX3": MeshTri().refined(2),
    "CPE4R": MeshQuad().refined(2),
    "CAX4": MeshQuad().refined(2),
    "CPE6M": MeshTri2.from_mesh(MeshTri().refined(1)),
    "C3D8R": MeshHex().refined(1),
    "C3D4": MeshTet().refined(1),
    "C3D10": MeshTet2.from_mesh(MeshTet().refined(1)),
}


def written(path, kind, mesh):
    """A file as a preprocessor writes it, with nodes in another order, and their sets."""
    cells = mesh.dofs.element_dofs if kind in ("CPE6M", "C3D10") else mesh.t
    cells = cells[HEX_MAPPING[:8]] if kind == "C3D8R" else cells
    number = np.random.default_rng(3).permutation(mesh.doflocs.shape[1])
    points = np.zeros((number.size, 3))
    points[number, : mesh.dim()] = mesh.doflocs.T
    lines = ["*HEADING", "a part", "*NODE"]
    lines += [f"{k + 1}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist())]
    lines.append(f"*Element, type={kind}, elset=body")
    lines += [", ".join(map(str, [k + 1, *(number[c] + 1)])) for k, c in enumerate(cells.T)]
    height = points[:, mesh.dim() - 1]
    sets = {"top": height == 1.0, "bottom": height == 0.0, "corner": np.arange(number.size) == 0}
    for name, chosen in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{k + 1}," for k in np.flatnonzero(chosen))]
    path.write_text("\n".join([*lines, "*MATERIAL, NAME=steel", "*ELASTIC", "210000., 0.3", ""]))
    return path


@pytest.mark.parametrize("kind", MESHES)
def test_a_part_from_abaqus_is_pressed_as_its_mesh(kind, tmp_path):
    mesh = MESHES[kind]
    body = ElasticBody.from_mesh(written(tmp_path / "part.inp", kind, mesh), E=1.0, nu=0.3)
    assert set(body.mesh.boundaries) == {"top", "bottom"}  # a single node is no facet
    last = mesh.dim() - 1
    sides = {"top": lambda x: x[last] == 1.0, "bottom": lambda x: x[last] == 0.0}
    direct = ElasticBody.from_mesh(mesh.with_boundaries(sides), E=1.0, nu=0.3)
    up = np.eye(last + 1)[last]
    found = [
        ContactProblem(one.fix("top"), "bottom", Plane(0.01 * up, up), 0.3).solve().resultant
        for one in (body, direct)
    ]
    assert found[0][last] > 1e-3
    np.testing.assert_allclose(found[0], found[1], atol=1e-12)


def test_serendipity_cells_are_refused_in_words(tmp_path):
    path = written(tmp_path / "part.inp", "CPE4R", MESHES["CPE4R"])
    path.write_text(path.read_text().replace("type=CPE4R", "type=CPE8R"))
    with pytest.raises(InputError, match=r"part\.inp cannot be read"):
        ElasticBody.from_mesh(path, E=1.0, nu=0.3)
