"""A saved result comes back bit for bit, problem, bodies and pairs included, or not at all."""

import json

import numpy as np
import pytest
from families import PLANE, STRAIGHT
from pressed_pairs import PROBLEMS, pair
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTriP2, MeshQuad, MeshTri

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
    Orthotropic,
    Plane,
    Rigid,
)
from contact.plot import plot_cells, plot_field
from contact.result.stored_result import problem_arrays
from skfem_adini import ElementQuadAdini, LevelSet, Polygon, to_pyvista
from skfem_adini.ground.archives import read_arrays, write_arrays

LAYERS = [(0.25, 3, 1.0, 0.4), (0.75, 4, 10.0, 0.3)]
BAR = Cylinder((0.4, -1.0), 1.0)
MESH, PERIODIC = MeshQuad().refined(2).with_defaults(), (ElementQuad1, ElementQuadAdini)
TURNED = np.linspace(0, 1, MESH.nelements)
WOOD = Orthotropic((11.0, 2.0, 1.0), (0.35, 0.3, 0.4), (0.9, 0.7, 0.3), rotation=TURNED)


def layered_disk():
    """A material of each cell, a prescribed displacement, facets without a name."""
    mesh = MeshTri.init_circle(2).with_boundaries({"top": lambda x: x[1] > 0.5})
    E = np.random.default_rng(0).uniform(1, 2, mesh.nelements)
    body = ElasticBody.from_mesh(mesh, ElementTriP2(), E=E, nu=0.2, plane="stress")
    body.fix("top", "y", -0.05).fix("top", "x")
    below = mesh.facets_satisfying(lambda x: x[1] < -0.3, boundaries_only=True)
    return ContactProblem(body, below, lambda x: 1.0 + x[1], 0.2)


def grown(element=ElementQuadAdini, heat=None, **more):
    """Pressed and bent; material, plane or dilatation of its own."""
    more = {"E": 1.0, "nu": 0.3} | more if "material" not in more else more
    body = ElasticBody.from_mesh(MESH, element(), **more).fix("top", "xy", lambda x: -0.02 * x[0])
    return ContactProblem(body.heat(*heat) if heat else body, "bottom", 0.0, 0.2)


def on_axis(element):
    mesh = STRAIGHT[element]().refined(2).with_defaults()
    ring = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3, plane="axisymmetric")
    ring.load("top", (0.0, -0.2)).load("right", (-0.1, 0.0))
    return ContactProblem(ring, "bottom", 0.0, 0.2)


def periodic(element):
    body = ElasticBody.from_mesh(MESH.translated((-0.5, 0.0)), element(), E=1.0, nu=0.3)
    body.periodic("right", "left").fix("top", "x").load("top", (0.0, -0.01)).tie("top", rigid=True)
    gap = lambda x: 0.01 * (1 - np.cos(2 * np.pi * x[0]))  # noqa: E731
    return ContactProblem(body, "bottom", gap, 0.2)


def block(plane="strain", path=None):
    """Two layers, pressed and tilted on a bar, pulled at a side, under their own weight."""
    sides = "x" if path else ("x", None)
    block = LayeredBlock(1.0, LAYERS, sides, columns=6, plane=plane, path=path).named("layers")
    block.fix("top", "y", lambda x: -0.02 - 0.01 * x[0] * (path is None))
    block.body_force((0.0, -0.01))
    return block if path else block.load("right", (0.1, 0.0))


def on_bar(*args, friction=0.3):
    return ContactProblem(block(*args), "bottom", BAR, friction=friction)


def on_a_body():
    mesh = MeshQuad.init_tensor(np.linspace(-0.5, 1.5, 5), np.linspace(-1, 0, 3)).with_defaults()
    below = ElasticBody.from_mesh(mesh, E=2.0, nu=0.3).fix("bottom").named("below")
    return ContactProblem(block(), "bottom", below.surface("top"), friction=0.2)


def circle(x):
    return x[0] ** 2 + x[1] ** 2 - 1


def cut(inside=circle, low=-1.02, **more):
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 10), np.linspace(-1.1, 0, 6))
    E = np.linspace(1, 2, mesh.nelements)
    body = CutBody(mesh.with_defaults(), inside, E=E, nu=0.3, **more).named("cut")
    body.fix("top", "x").fix("top", "y", lambda x: -0.05 - 0.01 * x[0])
    return ContactProblem(body, body.arc(), Plane((0.0, low), (0.05, 1.0)), friction=0.3)


TOOL = Rigid(BAR, force=(None, 0.05), displacement=(0.01, None))
POLYGON = Polygon([[-0.9, -0.5, 0.6, 0.9], [0.0, -0.75, -0.75, 0.0]])
CORNER = LevelSet(circle) & LevelSet(lambda x: x[0] - x[1] - 1.1)
CASES = {
    "Adini": lambda m: m.problem(),
    "Adini, gauss": lambda m: m.problem(law="tresca", friction=0.05, functional="gauss"),
    "P2": lambda m: m.problem(element=ElementTriP2, friction=0.4),
    "layered disk": lambda m: layered_disk(),
    "held by contact": lambda m: m.problem(friction=0.0, sides=("left",)),
    "bricks": lambda m: m.dome(ElementHex1),
    "tetrahedra": lambda m: m.dome(ElementTetP1),
    "no obstacle": lambda m: ContactProblem(m.block(6), "bottom", None, 0.03, "tresca"),
    **{f"several: {name}": lambda m, p=p: p() for name, p in PROBLEMS.items()},
    "anisotropic": lambda m: grown(material=WOOD, plane="stress"),
    "heated": lambda m: grown(heat=(lambda x: np.sin(x[0]), 0.1)),
    "mean dilatation": lambda m: grown(ElementQuad1, nu=0.4999, dilatation="mean"),
    **{f"ring of {e.__name__}": lambda m, e=e: on_axis(e) for e in PLANE},
    **{f"periodic {e.__name__}": lambda m, e=e: periodic(e) for e in PERIODIC},
    "layers": lambda m: on_bar(),
    "layers, plane stress": lambda m: on_bar("stress", friction=0.0),
    "layers, mirrored": lambda m: on_bar("strain", "fourier"),
    "layers, tool": lambda m: ContactProblem(block(), "bottom", TOOL),
    "layers on a body": lambda m: on_a_body(),
    "cut disk": lambda m: cut(),
    "cut polygon": lambda m: cut(POLYGON, -0.77),
    "cut corner": lambda m: cut(CORNER, q=4, threshold=0.4),
}
FIELDS = [
    "u",
    "mu",
    "t",
    "x",
    "x_nominal",
    "pressure",
    "shear",
    "gap",
    "status",
    "slip",
    "resultants",
    "part",
    "reactions",
]
ROWS = ["owner", "axes", "normals", "tangents", "gap", "functional", "weights"]


# The disk has few facets, and the warning of their sagitta is right.
@pytest.mark.filterwarnings("ignore:the pressures are")
@pytest.mark.parametrize("name", CASES)
def test_round_trip(name, tmp_path, make):
    result = CASES[name](make).solve()
    loaded = ContactResult.load(result.save(tmp_path / "result"))
    pairs = [(loaded, result), (loaded.system, result.system)]
    pairs.append((loaded.system.rows, result.system.rows))
    for (ours, theirs), fields in zip(pairs, (FIELDS, ("load", "friction"), ROWS), strict=True):
        for field in fields:
            found = getattr(ours, field, None), getattr(theirs, field, None)
            np.testing.assert_array_equal(*found, err_msg=field)
    # The volume of a ring is summed in another order.
    kkt = pytest.approx(result.kkt, abs=1e-14) if "ring" in name else result.kkt
    assert (loaded.kkt, loaded.method) == (kkt, result.method)
    # NaN in the history is not equal to itself.
    assert repr(loaded.history) == repr(result.history)
    assert loaded.system.law == result.system.law
    assert loaded.summary() == result.summary()
    np.testing.assert_array_equal(loaded.zone, result.zone)
    assert len(loaded.solid.bodies) == len(result.solid.bodies)
    for k, body in enumerate(result.solid.bodies):
        one, other = loaded[k], result[k]
        again = loaded.solid.bodies[k]
        assert (again.name, type(again), repr(again)) == (body.name, type(body), repr(body))
        for field in ("stress", "von_mises", "nodal_stress", "cell_stress"):
            np.testing.assert_array_equal(getattr(one, field)(), getattr(other, field)())
        for part, force in other.balance().items():
            np.testing.assert_array_equal(one.balance()[part], force)
        if not isinstance(body, LayeredBlock):
            assert set(again.mesh.boundaries) == set(body.mesh.boundaries)
            for side, facets in body.mesh.boundaries.items():
                np.testing.assert_array_equal(np.sort(again.mesh.boundaries[side]), np.sort(facets))
        grid, drawn = other.to_pyvista(), one.to_pyvista()
        np.testing.assert_allclose(drawn.points, grid.points, atol=1e-14)
        for field in grid.point_data:
            np.testing.assert_allclose(drawn[field], grid[field], rtol=1e-9, atol=1e-13)
    assert ContactResult.load(loaded.save(tmp_path / "again.npz")).kkt == kkt


def test_bodies_are_found_by_name_and_number(tmp_path, make):
    loaded = ContactResult.load(pair().solve().save(tmp_path / "result.npz"))
    assert np.array_equal(loaded["upper"].u, loaded[0].u)
    assert np.array_equal(loaded["lower"].u, loaded[1].u)
    assert loaded["lower"].u.size != loaded["upper"].u.size
    with pytest.raises(InputError, match=r"body: 'middle' is not one of 'upper', 'lower'"):
        loaded["middle"]
    with pytest.raises(InputError, match=r"2 bodies; choose one"):
        loaded.stress()
    problem = make.problem(4)
    problem.body.named("block")
    loaded = ContactResult.load(problem.solve().save(tmp_path / "named.npz"))
    assert np.array_equal(loaded["block"].u, loaded.u)


def test_overwriting_is_atomic(tmp_path, make, monkeypatch):
    _, result = make.solved()
    path = result.save(tmp_path / "result.npz")
    before = path.read_bytes()

    def fail(*args, **arrays):
        args[0].write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="disk full"):
        result.save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_truncated_and_damaged_files(tmp_path, make):
    """A flipped byte is seen by the archive's checksums, or was no data."""
    _, result = make.solved(n=4)
    path = result.save(tmp_path / "result.npz")
    content = path.read_bytes()
    for share in (0.0, 0.01, 0.3, 0.7, 0.999):
        path.write_bytes(content[: int(share * len(content))])
        with pytest.raises(InputError, match=r"result\.npz"):
            ContactResult.load(path)
    for place in np.linspace(0.05, 0.9, 8):
        damaged = bytearray(content)
        damaged[int(place * len(content))] ^= 0xFF
        path.write_bytes(damaged)
        try:
            loaded = ContactResult.load(path)
        except InputError:
            continue
        assert np.array_equal(loaded.u, result.u)
        assert loaded.kkt == result.kkt


@pytest.mark.parametrize(
    "about", [None, '{"format": 99}', "hello", '{"format": 1}'], ids=["none", "99", "text", "1"]
)
def test_foreign_archive(about, tmp_path):
    np.savez(tmp_path / "other.npz", **({"about": about} if about else {"x": np.zeros(3)}))
    with pytest.raises(InputError, match=r"other\.npz"):
        ContactResult.load(tmp_path / "other.npz")


def test_file_of_one_body_is_as_before(make):
    """Format 3, read by earlier versions, which refuse 4; checksums depend on every name."""
    _, result = make.solved()
    arrays = problem_arrays(result.system)
    about = json.loads(str(arrays["about"]))
    assert about["format"] == 3
    assert list(about) == [
        *("format", "mesh", "element", "plane", "dilatation"),
        *("functional", "boundaries", "subdomains"),
    ]
    rows = {name.split("/")[1] for name in arrays if name.startswith("rows/")}
    assert rows == {"G", "T", "weights", "x", "x_nominal", "normals", "tangents", "part"}
    about = json.loads(str(problem_arrays(pair().system)["about"]))
    assert about["format"] == 4
    assert [body["name"] for body in about["bodies"]] == ["upper", "lower"]


def in_words(change):
    def apply(arrays):
        about = json.loads(str(arrays["about"]))
        change(about)
        arrays["about"] = np.array(json.dumps(about))

    return apply


def times(name, factor):
    return lambda a: a.update({name: factor * a[name]})


# The problem itself shows that the arrays do not belong together.
WRONG = {
    "owner": ("several: Adini", lambda a: a.update({"rows/owner": 1 - a["rows/owner"]})),
    "no such owner": ("several: Adini", lambda a: a.update({"rows/owner": a["rows/owner"] + 2})),
    "axes": ("several: Adini", lambda a: a.update({"rows/axes": a["rows/axes"][:, ::-1].copy()})),
    "no axes": ("several: Adini", lambda a: a.pop("rows/axes")),
    "shorter axes": ("several: Adini", times("rows/axes", 0.9)),
    "no mesh": ("several: Adini", lambda a: a.pop("body/1/p")),
    "load": ("several: Adini", times("load", 2)),
    "shorter load": ("several: Adini", lambda a: a.update(load=a["load"][:-1])),
    "material of one": ("several: Adini", times("body/1/E", 1.01)),
    "stiffer layer": ("layers", in_words(lambda a: a["block"]["layers"][0].__setitem__(2, 2.0))),
    "more columns": ("layers", in_words(lambda a: a["block"].update(columns=10**12))),
    "no support": ("layers", in_words(lambda a: a["block"]["supports"].pop())),
    "another side": ("layers", in_words(lambda a: a["block"]["supports"][0].__setitem__(0, "x"))),
    "wider": ("layers", in_words(lambda a: a["block"].update(lengths=[1.1, 1.0]))),
    "displacement": ("layers", times("u", 1.01)),
    "weights": ("cut disk", times("cut/weights", 1.01)),
    "negative weight": ("cut disk", times("cut/weights", -1.0)),
    "cell": ("cut disk", lambda a: a["cut/cells"].__setitem__(-1, 10**9)),
    "place": ("cut disk", lambda a: a["cut/points"].__iadd__(5.0)),
    "lattice": ("cut disk", lambda a: a.update({"cut/level": np.zeros((2, 5, 5))})),
    "normals": ("cut disk", times("cut/normals", 2.0)),
    "corners": ("cut disk", lambda a: a["cut/lower"].__isub__(0.1)),
    "material": ("cut disk", times("E", 1.1)),
}


@pytest.fixture(scope="module")
def written(make, tmp_path_factory):
    """Arrays of a result, solved once."""
    known = {}

    def arrays(name):
        if name not in known:
            path = tmp_path_factory.mktemp("whole") / "result.npz"
            known[name] = CASES[name](make).solve().save(path)
        return read_arrays(known[name])

    return arrays


@pytest.mark.parametrize("what", WRONG)
def test_contradictions_are_refused(what, written, tmp_path):
    name, change = WRONG[what]
    arrays, _ = written(name)
    change(arrays)
    path = write_arrays(tmp_path / "result.npz", arrays)
    with pytest.raises(InputError, match=r"result file .*result\.npz"):
        ContactResult.load(path)


def moving(problem):
    return LoadStepper(problem).move("top", "y", -0.05, np.sin)


def pushed(E=2.0):
    moved = LoadStepper(pair(E=E)).load("top", (0.05, 0.0), np.sin, body="upper")
    return moved.load("right", (-0.02, 0.0), body=1)


STEPPERS = {"several": pushed, "layers": lambda: moving(on_bar()), "cut": lambda: moving(cut())}


@pytest.mark.parametrize("name", STEPPERS)
def test_history_in_a_folder(name, tmp_path):
    history = STEPPERS[name]().run([0.5, 1.0, 1.5], path=tmp_path / "run")
    read = LoadHistory.load(tmp_path / "run")
    assert [r.kkt for r in read] == [r.kkt for r in history]
    for ours, theirs in zip(read, history, strict=True):
        np.testing.assert_array_equal(ours.u, theirs.u)
    if name != "layers":
        assert read[0].solid.bodies[-1].basis is read[2].solid.bodies[-1].basis
    read.to_pvd(tmp_path / "run.pvd")
    assert list(tmp_path.glob("run_0001*.vt[um]"))
    (tmp_path / "run" / "step_00003.npz").unlink()
    resumed = STEPPERS[name]().resume(tmp_path / "run")
    # The start is one from the file: the same to rounding of the solution.
    assert np.abs(resumed[-1].u - history[-1].u).max() <= 1e-12 * np.abs(history[-1].u).max()
    if name == "several":
        with pytest.raises(InputError, match="history of another problem"):
            pushed(E=2.5).resume(tmp_path / "run")


def test_heat_of_one_of_two_bodies(tmp_path):
    """Stresses are those of the body's own thermal strain; the other body has none."""
    problem = pair()
    problem.body.bodies[1].heat(3e-3, 10.0)
    result = problem.solve()
    loaded = ContactResult.load(result.save(tmp_path / "warm.npz"))
    assert loaded[0].body.thermal is None
    assert np.array_equal(loaded[1].body.thermal, result[1].body.thermal)
    assert np.array_equal(loaded["lower"].stress(), result["lower"].stress())
    assert np.abs(result["lower"].stress() - pair().solve()["lower"].stress()).max() > 1e-3


@pytest.mark.parametrize("args", [(), ("stress",), ("strain", "fourier")], ids=str)
def test_a_block_is_drawn_as_its_mesh(args):
    """`elastic` is the same body with a mesh: another way to the same stresses."""
    problem = on_bar(*args)
    layers, result = problem.body, problem.solve()
    meshed = ContactProblem(layers.elastic(), "bottom", BAR, friction=0.3).solve()
    size = np.abs(meshed.stress()).max()
    for fields in ("stress", "von_mises", "nodal_stress", "cell_stress"):
        ours, theirs = getattr(result, fields)(), getattr(meshed, fields)()
        assert np.abs(ours - theirs).max() < 1e-9 * size
    middle = layers.meshed().basis.global_coordinates()
    points = np.asarray(middle).reshape(2, -1)
    whole = result.stress().reshape(2, 2, -1)
    assert np.abs(whole - result.stress(points)).max() < 1e-12 * size
    grid, other = result.to_pyvista(), meshed.to_pyvista()
    np.testing.assert_array_equal(grid.points, other.points)
    for key in grid.point_data:
        assert np.abs(grid[key] - other[key]).max() < 1e-9 * np.abs(other[key]).max()
    assert len(plot_field(result, 1).collections) == len(plot_field(meshed, 1).collections)
    assert plot_cells(result).collections


def test_between_the_lattice_pictures_of_a_loaded_cut_body_are_near():
    """Clipped areas differ by the error of linear cells, which vanishes like their size squared."""
    body = cut().solve().body
    stored = body.stored()
    again = CutBody.from_stored(body.mesh, stored, body.E, body.nu, body.plane, body.threshold)
    zero = {"u": np.zeros(body.basis.N)}
    area = [b.clipped(to_pyvista(b.basis, zero, subdivide=7)).area for b in (body, again)]
    assert area[1] == pytest.approx(area[0], rel=2e-3)
    assert area[1] == pytest.approx(body.domain.area, rel=4e-3)
