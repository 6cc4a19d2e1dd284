"""Damaged files end in an InputError or in a surface, never in the end of the process."""

import re
import resource
from multiprocessing import get_context

import meshio
import numpy as np
import pytest
import pyvista
from meshio.gmsh import _gmsh22, _gmsh40, _gmsh41
from skfem import MeshTet
from surfaces import ball, ring

from contact import ElasticBody, InputError, Rough, SurfaceMesh


def whole_file(folder, kind):
    """A good file of a kind: format, and whether it is binary."""
    ending, binary = kind
    path = folder / f"{'binary' if binary else 'text'}.{ending}"
    if ending in ("stl", "ply", "vtp"):
        SurfaceMesh(*ball(1)).to_pyvista().save(path, binary=binary)
    elif ending == "obj":
        SurfaceMesh(*ball(1)).to_pyvista().save(path)
    elif ending == "npy":
        np.save(path, np.random.default_rng(0).random((8, 8)))
    else:
        mesh = MeshTet()
        mesh = meshio.Mesh(mesh.p.T, [("tetra", mesh.t.T)])
        meshio.write(path, mesh, "gmsh" if ending == "msh" else ending, binary=binary)
    return path


def damaged(data, rng):
    """Cut short, a bit turned, four bytes or a number exchanged, or a piece missing."""
    kind, place = rng.integers(5), rng.integers(len(data))
    if kind == 0:
        return data[:place]
    if kind == 1:
        return data[:place] + bytes([data[place] ^ 1 << rng.integers(8)]) + data[place + 1 :]
    if kind == 2:
        return data[:place] + rng.bytes(4) + data[place + 4 :]
    if kind == 3 and (numbers := list(re.finditer(rb"\d+", data))):
        one = numbers[rng.integers(len(numbers))]
        new = rng.choice([b"99999999", b"2000000000", b"-1", b"0", b"10000000000000", b"7"])
        return data[: one.start()] + new + data[one.end() :]
    return data[:place] + data[rng.integers(place, len(data)) :]


def read(path):
    if path.suffix == ".npy":
        return Rough.from_file(path, (1.0, 1.0))
    if path.suffix in (".msh", ".vtu"):
        return ElasticBody.from_mesh(path, E=1.0, nu=0.3)
    return SurfaceMesh.from_file(path, sheet=True)


def read_all(path, seed, count):
    """In a process of its own, with little memory: it may end here."""
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
    data, rng = path.read_bytes(), np.random.default_rng(seed)
    read(path)
    for _ in range(count):
        path.write_bytes(damaged(data, rng))
        try:
            read(path)
        except InputError:
            continue


KINDS = [(ending, b) for ending in ("stl", "ply", "vtp", "msh", "vtu") for b in (True, False)]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", [*KINDS, ("obj", False), ("npy", True)], ids=str)
def test_damaged_files_do_not_end_the_process(tmp_path, kind):
    process = get_context("fork").Process(target=read_all, args=(whole_file(tmp_path, kind), 3, 60))
    process.start()
    process.join(100)
    alive = process.is_alive()
    process.kill()
    assert not alive
    assert process.exitcode == 0


HEADER = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
HEADER += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.parametrize(
    ("count", "face", "words"),
    [
        (3, "3 0 1 99999999", "names point 99999999 of 3"),
        (3, "3 0 1 -1", "names point -1 of 3"),
        (3, "2 0 1", "a face of 2 points"),
        (3, "-3 0 1 2", "a list of -3 entries"),
        (3, "2000000000 0 1 2", "a list of 2000000000 entries"),
        (2000000000, "3 0 1 2", "element vertex: 2000000000 announced, the file ends after 4"),
    ],
)
def test_counts_and_indices_of_a_ply_file(tmp_path, count, face, words):
    corners = "0 0 0\n1 0 0\n0 1 0\n"
    (tmp_path / "one.ply").write_text(HEADER.format(count) + corners + face + "\n")
    with pytest.raises(InputError, match=words):
        SurfaceMesh.from_file(tmp_path / "one.ply")


def test_heights_that_a_header_claims(tmp_path):
    np.save(tmp_path / "map.npy", np.eye(10))
    data = (tmp_path / "map.npy").read_bytes()
    claim = b"(10000000000, 1000)"
    (tmp_path / "map.npy").write_bytes(data.replace(b"(10, 10), }" + b" " * 11, claim + b", }"))
    assert claim in (tmp_path / "map.npy").read_bytes()
    with pytest.raises(InputError, match="not readable as"):
        Rough.from_file(tmp_path / "map.npy", (1.0, 1.0))


@pytest.mark.parametrize("order", ["<", ">", "text"])
def test_polygons_of_a_ply_file(tmp_path, order):
    """Facets of three to five vertices with other properties beside them, in each order."""
    cube = pyvista.Cylinder(resolution=5, capping=True).clean()
    faces = [face.point_ids for face in cube.cell]
    form = {"<": "binary_little_endian", ">": "binary_big_endian", "text": "ascii"}[order]
    head = f"ply\r\nformat {form} 1.0\r\ncomment by hand\r\nelement vertex {cube.n_points}\r\n"
    head += "property uchar red\r\nproperty double x\r\nproperty float y\r\nproperty float z\r\n"
    head += f"element patch 2\r\nproperty list uchar short of\r\nelement face {len(faces)}\r\n"
    head += "property float area\r\nproperty list uchar uint vertex_index\r\nend_header\r\n"
    rows = [("u1 f8 f4 f4", [7, *p]) for p in cube.points]
    rows += [("u1 i2 i2", [2, -1, 5]), ("u1", [0])]
    rows += [("f4 u1" + " u4" * len(f), [0.5, len(f), *f]) for f in faces]
    if order == "text":
        body = "".join(" ".join(map(repr, map(float, row))) + "\r\n" for _, row in rows).encode()
    else:
        body = b"".join(
            np.array(value, order + kind).tobytes()
            for kinds, row in rows
            for kind, value in zip(kinds.split(), row, strict=True)
        )
    (tmp_path / "cylinder.ply").write_bytes(head.encode() + body)
    cube.triangulate().save(tmp_path / "cylinder.vtp")
    mine, theirs = (SurfaceMesh.from_file(tmp_path / f"cylinder.{e}") for e in ("ply", "vtp"))
    x = np.random.default_rng(0).uniform(-2, 2, (3, 50))
    np.testing.assert_allclose(mine.distance(x)[0], theirs.distance(x)[0], atol=1e-6)


def test_vertices_of_an_obj_file(tmp_path):
    """Counted from 1 or backwards from the last, with textures and normals; outlines by lines."""
    text = "v 0 0 0\nv 1 0 0 .5 .5 .5\nv 1 1 0\nvt 0 0\nv 0 1 0\nf 1/1/3 2//3 \\\n3 -1\n"
    (tmp_path / "sheet.obj").write_text(text)
    sheet = SurfaceMesh.from_file(tmp_path / "sheet.obj", sheet=True)
    assert sheet.facets.shape == (3, 2)
    np.testing.assert_allclose(np.ptp(sheet.points, axis=1), [1, 1, 0])
    points = SurfaceMesh(*ring(6)).points.T
    text = "".join(f"v {x} {y} 0\n" for x, y in points) + "l 1 2 3 4\nl 4 5 6 1\n"
    (tmp_path / "ring.obj").write_text(text)
    assert SurfaceMesh.from_file(tmp_path / "ring.obj").facets.shape == (2, 6)
    (tmp_path / "none.obj").write_text("v 0 0 0\nf 0 1 2\n")
    with pytest.raises(InputError, match="names point 0"):
        SurfaceMesh.from_file(tmp_path / "none.obj")


@pytest.mark.parametrize("size", [1e150, 1e300])
@pytest.mark.parametrize("shape", [ball(1), ring(8)], ids=["space", "plane"])
def test_coordinates_whose_powers_overflow(shape, size):
    points, facets = shape
    with pytest.raises(InputError, match="points: a coordinate is 1e"):
        SurfaceMesh(points * size, facets)
    near = SurfaceMesh(points * 1e70, facets).distance(points * 1.1e70)[0]
    np.testing.assert_allclose(near, SurfaceMesh(points, facets).distance(1.1 * points)[0] * 1e70)


WRITERS = {"4.1": _gmsh41, "4.0": _gmsh40, "2.2": _gmsh22}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("version", WRITERS)
def test_numbers_of_nodes_in_gmsh_files(tmp_path, version, binary):
    """meshio makes an array as long as the largest number: 32 GB for one damaged byte."""
    mesh = MeshTet()
    path = tmp_path / "cube.msh"
    mesh = meshio.Mesh(mesh.p.T, [("tetra", mesh.t.T)])
    WRITERS[version].write(path, mesh, binary=binary)
    read(path)
    data = path.read_bytes()
    start = data.index(b"$Nodes")
    lines = data[start:].split(b"\n")
    for number in (2**31 - 2, 0, 1):
        if binary:
            kind = "<u8" if version == "4.1" else "<i4"
            tag = np.array([8 if version == "4.1" else 1], kind).tobytes()
            skip = {"4.1": 32 + 20 + 7 * 8, "4.0": 16 + 20, "2.2": 2}[version]
            at = data.index(tag, start + 7 + skip)
            new = data[:at] + np.array([number], kind).tobytes() + data[at + len(tag) :]
        else:
            row = {"4.1": 3 + 7, "4.0": 3, "2.2": 2}[version]
            own = lines[row].split()
            changed = [*lines[:row], b" ".join([str(number).encode(), *own[1:]]), *lines[row + 1 :]]
            new = data[:start] + b"\n".join(changed)
        path.write_bytes(new)
        if new != data:
            with pytest.raises(InputError, match=r"a node has the number|are announced"):
                read(path)


@pytest.mark.parametrize("claim", ["-1", "2000000000"])
@pytest.mark.parametrize("name", [b"NumberOfComponents", b"NumberOfPoints"])
def test_counts_of_a_vtp_file(tmp_path, name, claim):
    data = whole_file(tmp_path, ("vtp", True)).read_bytes()
    spoilt = re.sub(name + rb'="\d+"', name + b'="' + claim.encode() + b'"', data, count=1)
    assert spoilt != data
    (tmp_path / "ball.vtp").write_bytes(spoilt)
    with pytest.raises(InputError, match=f"{claim}.* in a file of"):
        SurfaceMesh.from_file(tmp_path / "ball.vtp")
