"""What is assigned after construction takes effect, or raises and says what to do."""

import copy

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementTriP2, MeshQuad

from contact import (
    ContactProblem,
    CutBody,
    Cylinder,
    ElasticBody,
    InputError,
    LayeredBlock,
    LoadStepper,
    Parabola,
    Plane,
    Rigid,
    SignedDistance,
    Sphere,
    SurfaceMesh,
    uniqueness,
)
from skfem_adini import ElementQuadAdini


def body(element=ElementQuadAdini, **material):
    mesh = MeshQuad().refined(2).with_defaults()
    material = {"E": 1.0, "nu": 0.3} | material
    made = ElasticBody.from_mesh(mesh, element(), **material)
    return made.fix("left", "x").load("top", (0.02, -0.1))


def disk(**material):
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 12), np.linspace(-1.1, 0, 7))
    level_set = lambda x: x[0] ** 2 + x[1] ** 2 - 1  # noqa: E731
    made = CutBody(mesh.with_defaults(), level_set, **({"E": 1.0, "nu": 0.3} | material))
    return made.fix("top", "x").fix("top", "y", -0.05)


def problem(body, **options):
    place = body.arc() if isinstance(body, CutBody) else "bottom"
    height = -1.02 if isinstance(body, CutBody) else 0.0
    options = {"friction": 0.3} | options
    return ContactProblem(
        body, place, options.pop("obstacle", Plane((0, height), (0.1, 1))), **options
    )


CELLS = 16
CHANGES = {
    "E": 2.0,
    "nu": 0.1,
    "plane": "stress",
    "E of each cell": np.linspace(1, 2, CELLS),
    "nu of each cell": np.linspace(0, 0.4, CELLS),
}


def same(one, other):
    assert np.abs(one.u - other.u).max() <= 1e-12 * np.abs(other.u).max()
    assert one.system.law == other.system.law
    np.testing.assert_allclose(
        one.stress(), other.stress(), atol=1e-12 * np.abs(other.stress()).max()
    )


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuad1])
@pytest.mark.parametrize("change", CHANGES)
def test_material_set_anew(change, element):
    """Before and after solving; the earlier result keeps its own."""
    name, value = change.split()[0], CHANGES[change]
    changed = body(element)
    ours = problem(changed)
    first = ours.solve()
    kept = first.kkt, first.von_mises(), first.system.body.stiffness @ first.u
    setattr(changed, name, value)
    theirs = problem(body(element, **{name: value})).solve()
    second = ours.solve()
    same(second, theirs)
    assert np.abs(second.u - first.u).max() > 1e-3 * np.abs(first.u).max()
    assert first.kkt == kept[0]
    np.testing.assert_array_equal(first.von_mises(), kept[1])
    np.testing.assert_array_equal(first.system.body.stiffness @ first.u, kept[2])


def test_dilatation_set_anew():
    changed = body(ElementQuad1, nu=0.45)
    ours = problem(changed)
    ours.solve()
    changed.dilatation = "mean"
    same(ours.solve(), problem(body(ElementQuad1, nu=0.45, dilatation="mean")).solve())


def test_material_of_a_cut_body_set_anew():
    changed = disk()
    ours = problem(changed)
    ours.solve()
    changed.nu = 0.1
    same(ours.solve(), problem(disk(nu=0.1)).solve())


def test_material_set_anew_in_a_history():
    changed = body()
    stepper = LoadStepper(problem(changed)).load("top", (0.01, 0.0))
    stepper.run([1.0])
    changed.E = 3.0
    last = stepper.run([2.0]).results[-1]
    assert max(last.kkt.values()) < 1e-10
    np.testing.assert_array_equal(last.system.body.E, 3.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("E", -1.0),
        ("E", np.nan),
        ("E", np.ones(3)),
        ("E", 1j),
        ("E", None),
        ("nu", 0.5),
        ("nu", np.nan),
        ("plane", "paper"),
        ("plane", 3),
        ("plane", np.array(["stress", "strain"])),
        ("dilatation", "b-bar"),
        ("dilatation", ["mean"]),
        ("f", np.zeros(3)),
        ("f", 0.0),
        ("f", None),
        ("f", 1j),
    ],
)
def test_material_and_load_are_checked_when_set(name, value):
    """And what was there stays."""
    changed = body()
    before = problem(changed).solve()
    with pytest.raises(InputError, match=name):
        setattr(changed, name, value)
    same(problem(changed).solve(), before)


def test_arrays_of_the_material_are_kept_as_given():
    E = np.ones(CELLS)
    ours = body(E=E)
    E[:] = 7.0
    np.testing.assert_array_equal(ours.E, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        ours.E[0] = 2.0
    with pytest.raises(ValueError, match="read-only"):
        problem(ours).friction[0] = 2.0


def test_load_set_and_edited():
    """A result keeps the load that it was solved for."""
    changed = body()
    ours = problem(changed)
    first = ours.solve()
    kept = first.kkt, first.balance()["load"]
    changed.f *= 2.0
    changed.f[:] *= 1.5
    twice = ours.solve()
    np.testing.assert_allclose(twice.balance()["load"], 3 * kept[1], rtol=1e-13)
    np.testing.assert_array_equal(first.balance()["load"], kept[1])
    assert first.kkt == kept[0]
    changed.f[3] = np.nan
    with pytest.raises(InputError, match="f: "):
        ours.solve()


def test_loads_after_condensing():
    changed = body()
    ours = problem(changed)
    ours.condense()
    changed.load("right", (-0.01, 0.0)).body_force((0.0, -0.02))
    theirs = body().load("right", (-0.01, 0.0)).body_force((0.0, -0.02))
    same(ours.solve(), problem(theirs).solve())


PROBLEM = {
    "friction": 0.1,
    "friction of each point": lambda x: 0.1 + 0.1 * x[0],
    "no friction": 0.0,
    "law": "tresca",
    "obstacle": Parabola((0.5, 0.0), 2.0, 0.01),
    "obstacle that moves": Rigid(Plane((0, 0), (0, 1)), displacement=(0.0, 0.01)),
    "obstacle, a number": 0.01,
}


@pytest.mark.parametrize("change", PROBLEM)
def test_problem_set_anew(change):
    name = next(word.rstrip(",") for word in change.split() if word != "no")
    value = PROBLEM[change]
    ours = problem(body())
    ours.solve()
    setattr(ours, name, value)
    same(ours.solve(), problem(body(), **{name: value}).solve())


def test_friction_begins_and_ends():
    ours = problem(body(), friction=0.0)
    assert ours.law is None
    ours.friction = 0.2
    assert ours.law == "coulomb"
    same(ours.solve(), problem(body(), friction=0.2).solve())
    factored = ours.condense()
    ours.friction = 0.3
    assert ours.condense() is factored  # friction plays no part in it


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [
        ("friction", -1.0, "friction"),
        ("friction", np.nan, "friction"),
        ("law", "newton", "law="),
        ("law", None, "law=None"),
        ("obstacle", None, "obstacle: None"),
        ("obstacle", np.nan, "gap holds NaN"),
        ("obstacle", Plane((0, 0), (0, -1)), "faces the plane"),
    ],
)
def test_problem_is_checked_when_set(name, value, word):
    """And stays what it was."""
    ours = problem(body())
    before = ours.solve()
    with pytest.raises(InputError, match=word):
        setattr(ours, name, value)
    same(ours.solve(), before)


def wedge():
    return SurfaceMesh([[0.0, -1.0, 1.0], [-1.0, -3.0, -3.0]], [[0, 1, 2], [1, 2, 0]])


SETTLED = {
    "body": (body, ("basis", "dim", "element", "lam", "mu", "mesh")),
    "problem": (
        lambda: problem(body()),
        ("body", "boundary", "functional", "solver", "rows", "boundaries", "motion", "system"),
    ),
    "layers": (
        lambda: LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)]),
        ("layers", "lengths", "sides", "top", "columns", "plane", "width", "height"),
    ),
    "cut body": (disk, ("domain", "level_set", "threshold", "basis")),
    "stepper": (lambda: LoadStepper(problem(body())), ("problem",)),
    "plane": (lambda: Plane((0, 0), (0, 1)), ("point", "normal")),
    "cylinder": (lambda: Cylinder((0, 0), 1.0), ("centre", "radius", "axis", "hollow")),
    "ball": (lambda: Sphere((0, 0), 1.0), ("centre", "radius", "hollow")),
    "parabola": (lambda: Parabola((0, 0), 1.0), ("apex", "radius", "offset")),
    "distance": (lambda: SignedDistance(lambda x: x[0]), ("function", "reach")),
    "surface mesh": (wedge, ("points", "facets", "hollow", "sheet", "normals")),
    "rigid": (lambda: Rigid(0.0), ("obstacle", "displacement", "force", "centre")),
    "result": (lambda: problem(body()).solve(), ("u", "mu", "t", "system", "motion")),
}


@pytest.mark.parametrize(("kind", "name"), [(k, n) for k, v in SETTLED.items() for n in v[1]])
def test_what_is_settled_says_so(kind, name):
    made = SETTLED[kind][0]()
    value = getattr(made, name)
    with pytest.raises(AttributeError, match=name):
        setattr(made, name, value)


@pytest.mark.parametrize("part", ["p", "t"])
def test_mesh_edited_in_place(part):
    changed = body(ElementTriP2) if part == "x" else body(ElementQuad1)
    ours = problem(changed)
    ours.solve()
    mesh = changed.basis.mesh
    if part == "p":
        mesh.p[:, mesh.p[1] == 1.0] *= 1.2
    else:
        mesh.t[:, 0] = mesh.t[::-1, 0]
    calls = {
        "solve": ours.solve,
        "problem": lambda: problem(changed),
        "load": lambda: changed.load("top", (0, 1)),
        "force": lambda: changed.body_force((0, 1)),
        "stepper": lambda: LoadStepper(ours).run([1.0]),
    }
    for call in calls.values():
        with pytest.raises(InputError, match="vertices or cells were changed"):
            call()


def test_mesh_edited_before_the_matrix_is_built():
    changed = body()
    changed.basis.mesh.p[1] *= 2
    with pytest.raises(InputError, match="were changed"):
        _ = changed.stiffness


def test_uniqueness_of_another_material():
    changed = body()
    ours = problem(changed)
    result = ours.solve()
    changed.E = 5.0
    with pytest.raises(InputError, match="result: "):
        uniqueness(ours, result)


def test_copies_part_company():
    one = body()
    other = copy.copy(one)
    other.E = 4.0
    assert float(one.E) == 1.0
    same(problem(one).solve(), problem(body()).solve())
    same(problem(other).solve(), problem(body(E=4.0)).solve())


@pytest.mark.parametrize("plane", ["stress", "paper", 3])
def test_no_plane_in_space(plane, make):
    ticks = np.linspace(0, 1, 3)
    mesh = make.box(ElementHex1, ticks, ticks, ticks)
    with pytest.raises(InputError, match="plane="):
        ElasticBody.from_mesh(mesh, E=1.0, nu=0.3, plane=plane)
    solid = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3)
    assert solid.plane is None
    with pytest.raises(InputError, match="plane="):
        solid.plane = plane


def test_no_word_for_the_plane_is_strain():
    """In stresses, too."""
    one, other = (problem(body(plane=plane)).solve() for plane in (None, "strain"))
    np.testing.assert_array_equal(one.von_mises(), other.von_mises())
