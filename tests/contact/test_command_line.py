"""``python -m contact``: a part is pressed, a mesh is described, mistakes are answered in words."""

import re
import subprocess
import sys

import meshio
import numpy as np
import pytest
import pyvista
from skfem import MeshHex, MeshQuad, MeshTri
from skfem.io.meshio import to_file

from contact import ContactProblem, ContactResult, ElasticBody, Plane, Rigid
from contact.__main__ import main

STEEL = ["--E", "210e3", "--nu", "0.3"]
PRESSED = [*STEEL, "--fix", "top", "--press", "bottom", "--by", "0.01"]


@pytest.fixture
def part(tmp_path, monkeypatch):
    """Files of a square and a cube, without names, in the folder where the commands run."""
    monkeypatch.chdir(tmp_path)
    to_file(MeshQuad().refined(2), "square.vtu")
    to_file(MeshHex().refined(1), "cube.vtu")
    return tmp_path


def sides(mesh):
    """Names of the lowest and the highest side."""
    names = mesh.with_defaults().boundaries
    middle = {n: mesh.p[-1, mesh.facets[:, f]].mean() for n, f in names.items()}
    return min(middle, key=middle.get), max(middle, key=middle.get)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_result_is_that_of_a_script(dim, part, capsys):
    mesh = MeshQuad().refined(2) if dim == 2 else MeshHex().refined(1)
    low, high = sides(mesh)
    line = [
        "square.vtu" if dim == 2 else "cube.vtu",
        *STEEL,
        "--friction",
        "0.2",
        "--out",
        "o/r.vtu",
    ]
    line += ["--press", low, "--fix", high]
    up = np.eye(dim)[-1]
    body = ElasticBody.from_mesh(mesh.with_defaults(), E=210e3, nu=0.3).fix(high)
    for more, tool in (
        (["--by", "0.01"], Plane(0.01 * up, up)),
        (["--force", "70"], Rigid(Plane(0 * up, up), force=[*[None] * (dim - 1), 70.0])),
    ):
        assert main([*line, *more]) == 0
        assert "certificate" in capsys.readouterr().out
        expected = ContactProblem(body, low, tool, 0.2).solve()
        found = ContactResult.load("o/r.npz")
        np.testing.assert_allclose(found.resultant, expected.resultant, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(found.pressure, expected.pressure, rtol=1e-9, atol=1e-6)
    assert np.ptp(pyvista.read("o/r.vtu")["displacement"]) > 1e-4
    assert pyvista.read("o/r_boundary.vtp").n_points == found.pressure.size
    assert (part / "o" / "r.png").stat().st_size > 10_000


def test_options_from_a_file_and_loads(part, capsys):
    (part / "case.toml").write_text(
        'mesh = "square.vtu"\nE = 1e3\nnu = 0.3\nfix = ["left:x", "right:x"]\n'
        'load = "top=0,-2"\npress = "bottom"\nout = "loaded.vtu"\n'
    )
    assert main(["case.toml", "--E", "2e3"]) == 0
    result = ContactResult.load("loaded.npz")
    assert abs(result.resultant[1] - 2.0) < 1e-12
    # A column held at its sides: u_y = -p H (1 + nu) (1 - 2 nu) / ((1 - nu) E).
    squeezed = 2.0 * 1.3 * 0.4 / (0.7 * 2e3)
    assert abs(-result.u.min() - squeezed) < 1e-12
    assert "towards (0, 1)" in capsys.readouterr().out


def test_a_tilted_boundary_is_pressed_along_its_own_normal(part, capsys):
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    mesh = MeshTri().refined(2).with_defaults()
    names = {n: mesh.p[:, mesh.facets[:, f]] for n, f in mesh.boundaries.items()}
    low = np.isclose(names["bottom"][1], 0).all() and mesh.boundaries["bottom"]
    nodes = {"low": low, "high": mesh.boundaries["top"]}
    points = np.vstack((turn @ mesh.p, np.zeros(mesh.p.shape[1]))).T
    lines = np.hstack([mesh.facets[:, f] for f in nodes.values()]).T
    tags = [np.full(mesh.nelements, 3), np.repeat([1, 2], [len(f) for f in nodes.values()])]
    meshio.write(
        "tilted.msh",
        meshio.Mesh(
            points,
            [("triangle", mesh.t.T), ("line", lines)],
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={"low": [1, 1], "high": [2, 1], "body": [3, 2]},
        ),
        file_format="gmsh22",
    )
    assert main(["tilted.msh", *STEEL, "--fix", "high", "--press", "low", "--by", "0.01"]) == 0
    result = ContactResult.load("result.npz")
    straight = ElasticBody.from_mesh(mesh, E=210e3, nu=0.3).fix("top")
    expected = ContactProblem(straight, "bottom", Plane((0, 0.01), (0, 1))).solve()
    np.testing.assert_allclose(result.resultant, turn @ expected.resultant, atol=1e-8)
    assert "towards (-0.0998334, 0.995004)" in capsys.readouterr().out


def test_a_tool_from_a_file(part):
    ball = pyvista.Sphere(
        radius=2.0, center=(0.5, 0.5, 3.0), theta_resolution=90, phi_resolution=90
    )
    ball.save("ball.stl")
    low, top = sides(MeshHex())
    line = ["cube.vtu", *STEEL, "--fix", low, "--press", top, "--on", "ball.stl", "--by", "0.02"]
    assert main(line) == 0
    result = ContactResult.load("result.npz")
    assert result.resultant[2] < 0
    assert np.linalg.norm(result.x[:2, result.pressure.argmax()] - 0.5) < 1e-6


def test_a_mesh_is_described(part, capsys):
    assert main(["square.vtu", "--check", "--scale", "2"]) == 0
    said = capsys.readouterr().out
    assert "16 quadrilaterals, 25 nodes" in said
    assert "size 2 x 2, area 4" in said
    assert "boundary left: 4 facets, length 2, about (0, 1)" in said
    assert "0 facets of the outside have no name" in said
    assert "all cells are sound" in said


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        (["sqare.vtu", *PRESSED], "does not exist"),
        (["square.vtu", "--fix", "top", "--press", "bottom", "--by", ".1"], "needs both"),
        (
            ["square.vtu", *PRESSED, "--fix", "topp"],
            r"'topp' is unknown; the mesh names \['bottom'",
        ),
        (["square.vtu", *STEEL, "--fix", "top", "--by", ".1"], "--press is missing"),
        (["square.vtu", *PRESSED[:-2]], "nothing presses"),
        (["square.vtu", *PRESSED, "--force", "2"], "leave one of them"),
        (["square.vtu", *PRESSED, "--fix", "left:x=1,5"], "'1,5' is no number"),
        (["square.vtu", *PRESSED, "--load", "left=1"], "expected 2 numbers after left="),
        (["square.vtu", *PRESSED, "--on", "die.stl"], "die.stl"),
        (["square.vtu", *PRESSED, "--element", "p7"], "expected p1, p2"),
        (["square.vtu", *PRESSED, "--friction", "-1"], "friction"),
        (["square.vtu", *PRESSED, "--out", "picture.png"], "ends in .vtu"),
        (["square.vtu", *PRESSED, "--direction", "1,0,0"], "expected 2 numbers"),
        (["square.vtu", *PRESSED, "--scale", "0"], "positive number"),
        (["square.vtu", *STEEL, "--load", "top=0.1,1", "--press", "bottom"], "not held"),
        (["square.vtu", *PRESSED[:-2], "--force", "1", "--direction", "1,1"], "is no axis"),
        (["cube.vtu", *PRESSED, "--nu", "0.5"], "nu"),
        (["text.vtu", *PRESSED], "cannot be read"),
        (["bad.toml"], "line 1"),
        (["key.toml"], "frction is no option; friction is"),
        (["type.toml"], "by"),
        (["none.toml"], "mesh is missing"),
    ],
)
def test_mistakes_are_answered_in_words(line, answer, part, capsys):
    (part / "text.vtu").write_text("no mesh")
    (part / "bad.toml").write_text("mesh part.inp\n")
    (part / "key.toml").write_text('mesh = "square.vtu"\nfrction = 0.3\n')
    (part / "type.toml").write_text('mesh = "square.vtu"\nby = "far"\n')
    (part / "none.toml").write_text("E = 1.0\n")
    assert main(line) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") < 4
    assert re.search(answer, said)


def test_it_is_a_command(part):
    line = [sys.executable, "-m", "contact", "square.vtu", "--check"]
    run = subprocess.run(line, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0
    assert "quadrilaterals" in run.stdout
