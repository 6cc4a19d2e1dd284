"""Results of layered blocks and of cut bodies: files, pictures and stresses as of other bodies."""

import json

import numpy as np
import pytest
from skfem import MeshQuad

from contact import (
    ContactProblem,
    ContactResult,
    CutBody,
    Cylinder,
    ElasticBody,
    InputError,
    LayeredBlock,
    LoadHistory,
    LoadStepper,
    Plane,
    Rigid,
)
from contact.output.archive import read_arrays, write_arrays
from contact.plot import plot_cells, plot_field
from skfem_adini import LevelSet, Polygon, to_pyvista

FIELDS = ("u", "mu", "t", "pressure", "shear", "gap", "slip", "status", "reactions", "x")
LAYERS = [(0.25, 3, 1.0, 0.4), (0.75, 4, 10.0, 0.3)]
BAR = Cylinder((0.4, -1.0), 1.0)


def layered(plane="strain", path=None):
    """Two layers, pressed and tilted on a bar, pulled at a side, under their own weight."""
    sides = "x" if path else ("x", None)
    block = LayeredBlock(1.0, LAYERS, sides, columns=6, plane=plane, path=path).named("layers")
    block.fix("top", "y", lambda x: -0.02 - 0.01 * x[0] * (path is None))
    block.body_force((0.0, -0.01))
    return block if path else block.load("right", (0.1, 0.0))


def on_a_layer():
    """A block on a body with a mesh."""
    mesh = MeshQuad.init_tensor(np.linspace(-0.5, 1.5, 5), np.linspace(-1, 0, 3)).with_defaults()
    below = ElasticBody.from_mesh(mesh, E=2.0, nu=0.3).fix("bottom").named("below")
    return ContactProblem(layered(), "bottom", below.surface("top"), friction=0.2)


def cut(shape="disk", **more):
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 10), np.linspace(-1.1, 0, 6))
    mesh = mesh.with_defaults()
    low = -1.0 if shape != "polygon" else -0.75
    inside = {
        "disk": lambda: lambda x: x[0] ** 2 + x[1] ** 2 - 1,
        "polygon": lambda: Polygon([[-0.9, -0.5, 0.6, 0.9], [0.0, -0.75, -0.75, 0.0]]),
        "corner": lambda: (
            LevelSet(lambda x: x[0] ** 2 + x[1] ** 2 - 1) & LevelSet(lambda x: x[0] - x[1] - 1.1)
        ),
    }[shape]()
    body = CutBody(mesh, inside, E=np.linspace(1, 2, mesh.nelements), nu=0.3, **more).named("cut")
    body.fix("top", "x").fix("top", "y", lambda x: -0.05 - 0.01 * x[0])
    return ContactProblem(body, body.arc(), Plane((0.0, low - 0.02), (0.05, 1.0)), friction=0.3)


PROBLEMS = {
    "layers": lambda: ContactProblem(layered(), "bottom", BAR, friction=0.3),
    "plane stress": lambda: ContactProblem(layered("stress"), "bottom", BAR),
    "mirrored": lambda: ContactProblem(layered(path="fourier"), "bottom", BAR, friction=0.3),
    "tool": lambda: ContactProblem(
        layered(), "bottom", Rigid(BAR, force=(None, 0.05), displacement=(0.01, None))
    ),
    "several": on_a_layer,
    "disk": cut,
    "polygon": lambda: cut("polygon"),
    "corner": lambda: cut("corner", q=4, threshold=0.4),
}


@pytest.fixture(scope="module", params=PROBLEMS)
def solved(request):
    return PROBLEMS[request.param]().solve()


def test_nothing_is_lost(solved, tmp_path):
    again = ContactResult.load(solved.save(tmp_path / "result"))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(again, name), getattr(solved, name), name)
    assert again.kkt == solved.kkt
    assert again.summary() == solved.summary()
    bodies, others = again.solid.bodies, solved.solid.bodies
    assert [type(b) for b in bodies] == [type(b) for b in others]
    assert [b.name for b in bodies] == [b.name for b in others]
    for name, value in solved.balance().items():
        np.testing.assert_array_equal(again.balance()[name], value)
    twice = ContactResult.load(again.save(tmp_path / "again.npz"))
    assert twice.kkt == solved.kkt


def test_pictures_and_stresses_are_the_same(solved, tmp_path):
    again = ContactResult.load(solved.save(tmp_path / "result"))
    for body in range(len(solved.solid.bodies)):
        ours, theirs = solved[body], again[body]
        np.testing.assert_array_equal(ours.stress(), theirs.stress())
        grid, other = ours.to_pyvista(), theirs.to_pyvista()
        assert grid.n_cells == other.n_cells
        np.testing.assert_allclose(grid.points, other.points, atol=1e-14)
        for name in grid.point_data:
            np.testing.assert_allclose(grid[name], other[name], rtol=1e-9, atol=1e-13)
    assert again.plot() is not None


@pytest.mark.parametrize("name", ["layers", "plane stress", "mirrored"])
def test_a_block_is_drawn_as_its_mesh(name):
    """`elastic` is the same body with a mesh: another way to the same stresses."""
    block = PROBLEMS[name]().body
    result = ContactProblem(block, "bottom", BAR, friction=0.3).solve()
    meshed = ContactProblem(block.elastic(), "bottom", BAR, friction=0.3).solve()
    size = np.abs(meshed.stress()).max()
    for fields in ("stress", "von_mises", "nodal_stress", "cell_stress"):
        ours, theirs = getattr(result, fields)(), getattr(meshed, fields)()
        assert np.abs(ours - theirs).max() < 1e-9 * size
    middle = block.meshed().basis.global_coordinates()
    points = np.asarray(middle).reshape(2, -1)
    whole = result.stress().reshape(2, 2, -1)
    assert np.abs(whole - result.stress(points)).max() < 1e-12 * size
    grid, other = result.to_pyvista(), meshed.to_pyvista()
    np.testing.assert_array_equal(grid.points, other.points)
    for key in grid.point_data:
        assert np.abs(grid[key] - other[key]).max() < 1e-9 * np.abs(other[key]).max()
    assert len(plot_field(result, 1).collections) == len(plot_field(meshed, 1).collections)
    assert plot_cells(result).collections


@pytest.mark.parametrize("name", ["layers", "disk"])
def test_a_history_is_kept_and_goes_on(name, tmp_path):
    problem = PROBLEMS[name]()

    def stepper():
        return LoadStepper(problem).move("top", "y", -0.05, np.sin)

    whole = stepper().run([0.5, 1.0, 1.5])
    stepper().run([0.5, 1.0], path=tmp_path / "run")
    read = LoadHistory.load(tmp_path / "run")
    for ours, theirs in zip(read, whole, strict=False):
        np.testing.assert_array_equal(ours.u, theirs.u)
    assert len(read) == 2
    read.to_pvd(tmp_path / "run.pvd")
    assert (tmp_path / "run_0001.vtu").exists()


def changed(result, tmp_path, change):
    path = result.save(tmp_path / "whole.npz")
    arrays, _ = read_arrays(path)
    change(arrays)
    return write_arrays(tmp_path / "changed.npz", arrays)


def in_words(change):
    def apply(arrays):
        about = json.loads(str(arrays["about"]))
        change(about)
        arrays["about"] = np.array(json.dumps(about))

    return apply


WRONG = {
    "stiffer layer": ("layers", in_words(lambda a: a["block"]["layers"][0].__setitem__(2, 2.0))),
    "more columns": ("layers", in_words(lambda a: a["block"].update(columns=10**12))),
    "no support": ("layers", in_words(lambda a: a["block"]["supports"].pop())),
    "another side": ("layers", in_words(lambda a: a["block"]["supports"][0].__setitem__(0, "x"))),
    "wider": ("layers", in_words(lambda a: a["block"].update(lengths=[1.1, 1.0]))),
    "displacement": ("layers", lambda a: a["u"].__imul__(1.01)),
    "weights": ("disk", lambda a: a["cut/weights"].__imul__(1.01)),
    "negative weight": ("disk", lambda a: a["cut/weights"].__imul__(-1.0)),
    "cell": ("disk", lambda a: a["cut/cells"].__setitem__(-1, 10**9)),
    "place": ("disk", lambda a: a["cut/points"].__iadd__(5.0)),
    "lattice": ("disk", lambda a: a.update({"cut/level": np.zeros((2, 5, 5))})),
    "normals": ("disk", lambda a: a["cut/normals"].__imul__(2.0)),
    "corners": ("disk", lambda a: a["cut/lower"].__isub__(0.1)),
    "material": ("disk", lambda a: a["E"].__imul__(1.1)),
}


@pytest.mark.parametrize("what", WRONG)
def test_another_problem_is_refused(what, tmp_path):
    name, change = WRONG[what]
    path = changed(PROBLEMS[name]().solve(), tmp_path, change)
    with pytest.raises(InputError):
        ContactResult.load(path)


def test_between_the_lattice_pictures_of_a_loaded_cut_body_are_near():
    """Clipped areas differ by the error of linear cells, which vanishes like their size squared."""
    result = cut().solve()
    body = result.body
    stored = body.stored()
    again = CutBody.from_stored(body.mesh, stored, body.E, body.nu, body.plane, body.threshold)
    area = [b.clipped(grid(b, 7)).area for b in (body, again)]
    assert area[1] == pytest.approx(area[0], rel=2e-3)
    assert area[1] == pytest.approx(body.domain.area, rel=4e-3)


def grid(body, subdivide):
    return to_pyvista(body.basis, {"u": np.zeros(body.basis.N)}, subdivide=subdivide)
