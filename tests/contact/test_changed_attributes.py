"""What is assigned after construction takes effect, or raises and says what to do."""

import numpy as np
import pytest
from families import half_disk
from skfem import ElementHex1, ElementQuad1, MeshQuad

from contact import (
    ContactProblem,
    CutBody,
    Cylinder,
    DynamicStepper,
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
)
from skfem_adini import ElementQuadAdini


def body(element=ElementQuadAdini, **material):
    mesh = MeshQuad().refined(2).with_defaults()
    material = {"E": 1.0, "nu": 0.3} | material
    made = ElasticBody.from_mesh(mesh, element(), **material)
    return made.fix("left", "x").load("top", (0.02, -0.1))


def disk(**material):
    return half_disk(**material).fix("top", "x").fix("top", "y", -0.05)


def problem(body, **options):
    place = body.arc() if isinstance(body, CutBody) else "bottom"
    height = -1.02 if isinstance(body, CutBody) else 0.0
    options = {"friction": 0.3} | options
    return ContactProblem(
        body, place, options.pop("obstacle", Plane((0, height), (0.1, 1))), **options
    )


CELLS = 16


CHANGES = [
    *(("E", 2.0), ("nu", 0.1), ("plane", "stress"), ("E", np.linspace(1, 2, CELLS))),
    *(("nu", np.linspace(0, 0.4, CELLS)), ("dilatation", "mean")),
]


def same(one, other):
    assert np.abs(one.u - other.u).max() <= 1e-12 * np.abs(other.u).max()
    assert one.system.law == other.system.law
    np.testing.assert_allclose(
        one.stress(), other.stress(), atol=1e-12 * np.abs(other.stress()).max()
    )


def bilinear(**material):
    return body(ElementQuad1, **material)


@pytest.mark.parametrize(
    ("make_body", "change"),
    [*((b, c) for b in (body, bilinear) for c in CHANGES[:5]), (bilinear, CHANGES[5]),
     (disk, CHANGES[1])],
)  # fmt: skip
def test_material_set_anew(make_body, change):
    """Before and after solving; the earlier result keeps its own."""
    name, value = change
    changed = make_body()
    ours = problem(changed)
    first = ours.solve()
    kept = first.kkt, first.von_mises(), first.system.body.stiffness @ first.u
    setattr(changed, name, value)
    second = ours.solve()
    same(second, problem(make_body(**{name: value})).solve())
    assert np.abs(second.u - first.u).max() > 1e-3 * np.abs(first.u).max()
    assert first.kkt == kept[0]
    np.testing.assert_array_equal(first.von_mises(), kept[1])
    np.testing.assert_array_equal(first.system.body.stiffness @ first.u, kept[2])


def test_material_set_anew_in_a_history():
    changed = body()
    stepper = LoadStepper(problem(changed)).load("top", (0.01, 0.0))
    stepper.run([1.0])
    changed.E = 3.0
    last = stepper.run([2.0]).results[-1]
    assert max(last.kkt.values()) < 1e-10
    np.testing.assert_array_equal(last.system.body.E, 3.0)


WRONG = {
    "E": (-1.0, np.nan, np.ones(3), 1j, None),
    "nu": (0.5, np.nan),
    "plane": ("paper", 3, np.array(["stress", "strain"])),
    "dilatation": ("b-bar", ["mean"]),
    "f": (np.zeros(3), 0.0, None, 1j),
    "friction": (-1.0, np.nan),
    "law": ("newton", None),
    "obstacle": (None, np.nan, Plane((0, 0), (0, -1))),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_refused_when_set(name):
    changed = body()
    ours = problem(changed)
    before = ours.solve()
    words = "obstacle: None|gap holds NaN|faces the plane" if name == "obstacle" else name
    for value in WRONG[name]:
        with pytest.raises(InputError, match=words):
            setattr(ours if hasattr(ours, name) else changed, name, value)
    same(ours.solve(), before)


def cube(make):
    mesh = make.box(ElementHex1, *([0.0, 0.5, 1.0],) * 3)
    return ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("left", "xy")


LOADED = {
    "Adini": lambda make: body(),
    "Q1": lambda make: body(ElementQuad1),
    "space": cube,
    "layers": lambda make: LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)], sides=("x", None)),
}


@pytest.mark.parametrize("solved", [False, True])
@pytest.mark.parametrize("name", LOADED)
def test_loads_and_supports_given_later(name, solved, make):
    """As in a problem made later; the first result keeps what it was solved for."""
    changed = LOADED[name](make)
    pull, push = np.eye(changed.dim)[[0, -1]] * [[0.02], [-0.1]]
    askew = Plane(0 * pull, 5 * pull - 10 * push)
    changed.load("top", pull + push)
    ours = ContactProblem(changed, "bottom", askew, friction=0.3)
    ours.condense()
    if solved:
        first = ours.solve()
        kept = first.kkt, first.balance()["support"]
    changed.fix("right", "x", 0.01).load("top", 0.5 * push)
    changed.body_force(0.2 * push)
    second, theirs = ours.solve(), ContactProblem(changed, "bottom", askew, friction=0.3).solve()
    assert np.abs(second.u - theirs.u).max() <= 1e-12 * np.abs(theirs.u).max()
    if solved:
        assert np.abs(second.u - first.u).max() > 1e-3
        assert first.kkt == kept[0]
        np.testing.assert_array_equal(first.balance()["support"], kept[1])


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


ANEW = {
    "friction": (0.1, lambda x: 0.1 + 0.1 * x[0], 0.0),
    "law": ("tresca",),
    "obstacle": (
        Parabola((0.5, 0.0), 2.0, 0.01),
        Rigid(Plane((0, 0), (0, 1)), displacement=(0.0, 0.01)),
        0.01,
    ),
}


@pytest.mark.parametrize("name", ANEW)
def test_problem_set_anew(name):
    ours = problem(body())
    ours.solve()
    for value in ANEW[name]:
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
    "dynamic": (
        lambda: DynamicStepper(problem(body()), 1.0, 0.1),
        ("problem", "dt", "scheme", "keep", "history"),
    ),
    "plane": (lambda: Plane((0, 0), (0, 1)), ("point", "normal")),
    "cylinder": (lambda: Cylinder((0, 0), 1.0), ("centre", "radius", "axis", "hollow")),
    "ball": (lambda: Sphere((0, 0), 1.0), ("centre", "radius", "hollow")),
    "parabola": (lambda: Parabola((0, 0), 1.0), ("apex", "radius", "offset")),
    "distance": (lambda: SignedDistance(lambda x: x[0]), ("function", "reach")),
    "surface mesh": (wedge, ("points", "facets", "hollow", "sheet", "normals")),
    "rigid": (lambda: Rigid(0.0), ("obstacle", "displacement", "force", "centre")),
    "result": (lambda: problem(body()).solve(), ("u", "mu", "t", "system", "motion")),
}


@pytest.mark.parametrize("kind", SETTLED)
def test_what_is_settled_says_so(kind):
    make_it, names = SETTLED[kind]
    made = make_it()
    for name in names:
        value = getattr(made, name)
        with pytest.raises(AttributeError, match=name):
            setattr(made, name, value)


@pytest.mark.parametrize("part", ["p", "t"])
def test_mesh_edited_in_place(part):
    changed = body(ElementQuad1)
    ours = problem(changed)
    ours.solve()
    mesh, fresh = changed.basis.mesh, body()
    fresh.basis.mesh.p[1] *= 2  # before its matrix is built
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
        "matrix": lambda: fresh.stiffness,
    }
    for call in calls.values():
        with pytest.raises(InputError, match="vertices or cells were changed"):
            call()


def test_planes(make):
    """None is strain, in stresses too; there is none in space."""
    one, other = (problem(body(plane=plane)).solve() for plane in (None, "strain"))
    np.testing.assert_array_equal(one.von_mises(), other.von_mises())
    mesh = make.box(ElementHex1, *([0.0, 0.5, 1.0],) * 3)
    solid = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3)
    assert solid.plane is None
    for plane in ("stress", "paper", 3):
        with pytest.raises(InputError, match="plane="):
            ElasticBody.from_mesh(mesh, E=1.0, nu=0.3, plane=plane)
        with pytest.raises(InputError, match="plane="):
            solid.plane = plane
