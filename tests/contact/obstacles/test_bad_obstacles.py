"""What obstacles refuse, by name, and where they cannot be meant: refused, or warned of."""

import warnings

import numpy as np
import pytest
import pyvista
from skfem import ElementHex1, MeshQuad, MeshTri, MeshTri2
from surfaces import ball, brick, ring

from contact import (
    ClosestPoint,
    Cone,
    ContactProblem,
    ContactWarning,
    Cylinder,
    ElasticBody,
    GridContact,
    HalfSpace,
    InputError,
    LayeredBlock,
    LoadStepper,
    Moved,
    Parabola,
    Plane,
    Rigid,
    Rough,
    SignedDistance,
    Sphere,
    SurfaceMesh,
    self_affine,
)
from contact.obstacles.shapes import evaluate_gap

X, N = np.array([[0.0, 1.0], [1.0, 1.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]])
UP = (0.0, 1.0)
SHAPES = [
    (Plane((0, 0), (0, 0)), "normal"),
    (Plane((0, np.nan), UP), "point"),
    (Plane((0, 0, 0), (0, 0, 1)), "dimension 3"),
    (Cylinder((0, 0), -1.0), "radius"),
    (Cylinder((0, 0), 1.0, hollow=1.0), "hollow="),
    (Parabola((0, 0), 0.0), "radius"),
    (Cone((0.0, 0.0), (0.0, 0.0), 1.0), "axis"),
    (Cone((0.0, 0.0), UP, 0.0), "half_angle"),
    (Cone((0.0, 0.0, 0.0), UP, 1.0), "dimension 3"),
    (SignedDistance(lambda x: x[0] * np.nan), "NaN"),
    (SignedDistance(lambda x: 1.0), "must return"),
    (np.nan, "NaN"),
    (-np.inf, "minus infinity"),
    (lambda x: np.zeros(7), "shape"),
]


@pytest.mark.parametrize(("obstacle", "words"), SHAPES)
def test_shapes(obstacle, words):
    with pytest.raises(InputError, match=words):
        evaluate_gap(obstacle, X, N)


@pytest.mark.parametrize("obstacle", [Parabola((0, 0), 1.0), 0.1, lambda x: x[0], None])
def test_no_closest_point(obstacle):
    with pytest.raises(InputError, match="distance"):
        ClosestPoint(obstacle)


@pytest.mark.parametrize(
    ("rigid", "words"),
    [
        (Rigid(0.0, displacement=(0, 0), force=(0, 1)), "both"),
        (Rigid(0.0, displacement=(0,)), "displacement"),
        (Rigid(0.0, force=(0, 1, 2)), "force"),
        (Rigid(0.0, force=(1j, 1)), "force"),
        (Rigid(0.0, moment=(1, 2)), "moment"),
        (Rigid(0.0, rotation=np.nan), "rotation"),
        (Rigid(0.0, moment=1.0, rotation=0.1), "both"),
        (Rigid(0.0, centre=(0, 0, 0)), "centre"),
        (Rigid(np.nan), "NaN"),
        (Plane, "is a class"),
    ],
)
def test_motions(rigid, words, make):
    with pytest.raises(InputError, match=words):
        ContactProblem(make.block(3), "bottom", rigid)


WHEEL, BALL, STILL = Cylinder((0.0, 1.0), 1.0), Sphere((0, 0, 0), 1.0), (0.0, 0.0)


@pytest.mark.parametrize(
    ("shape", "motion"),
    [
        *((shape, (STILL,)) for shape in (0.1, lambda x: x[0], Parabola(STILL, 1.0), Rigid(WHEEL))),
        *((WHEEL, (displacement,)) for displacement in (0.1, (0.0, np.inf))),
        *((WHEEL, (STILL, *turn)) for turn in (((1, 2, 3),), (np.nan,), (0.1, (1, 2, 3)))),
        (BALL, ((0.0, 0.0, 0.0), 0.1)),
    ],
)
def test_what_cannot_be_moved(shape, motion):
    with pytest.raises(InputError):
        Moved(shape, *motion)


FLAT = np.zeros(8)
HEIGHTS = [
    (np.full((8, 8), np.nan), (1, 1), {}, "heights"),
    (np.zeros((8, 3)), (1, 1), {}, "heights"),
    (np.zeros((8, 8, 8)), (1, 1, 1), {}, "heights"),
    (np.zeros((8, 8)), (1, -1), {}, "lengths"),
    (FLAT, 1.0, {"normal": (0, 0, 1)}, "normal"),
    (FLAT, 1.0, {"point": (0, 0, 1)}, "point"),
    (FLAT, 1.0, {"interpolation": "spline"}, "interpolation"),
    (FLAT, 1.0, {"periodic": 1}, "periodic"),
]


@pytest.mark.parametrize(("heights", "lengths", "settings", "words"), HEIGHTS)
def test_heights(heights, lengths, settings, words):
    with pytest.raises(InputError, match=f"^{words}"):
        Rough(heights, lengths, **settings)


def test_of_another_dimension():
    with pytest.raises(InputError, match="dimension"):
        Rough(np.zeros(8), 1.0)(np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]]))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"n": 3}, "n="),
        ({"n": 8.5}, "n="),
        ({"hurst": 1.2}, "hurst"),
        ({"rms": -1.0}, "rms"),
        ({"cutoffs": (4, 2)}, "cutoffs"),
        ({"cutoffs": (1, 16)}, "cutoffs"),
        ({"seed": "one"}, "seed"),
        ({"rolloff": 0.0}, "rolloff"),
        ({"lengths": (1.0,)}, "lengths"),
        ({"lengths": (1.0, 4.0), "cutoffs": (1, 8)}, "cutoffs"),
    ],
)
def test_self_affine_surfaces(settings, words):
    given = {"n": 32, "hurst": 0.8, "rms": 1.0, "cutoffs": (1, 8), "seed": 0}
    with pytest.raises(InputError, match=f"^{words}"):
        self_affine(**(given | settings))


points = np.array([[i * 0.25, j * 0.5, 0.3 * i - j**2] for i in range(5) for j in range(7)])
COMMAS = "its commas may be decimal marks or part the numbers"
FILES = [
    ("map.xyz", points[:-1], "do not fill a grid"),
    ("map.xyz", np.vstack([points[:-1], points[:1]]), "do not fill a grid"),
    ("map.xyz", points[:, :2], "three numbers a line"),
    ("map.xyz", np.where([1, 0, 0], points**3, points), "not equally far apart"),
    ("map.xyz", np.where(points == points[3, 2], np.nan, points), "NaN or infinite"),
    ("map.npy", np.eye(5) * 1j, "expected real numbers"),
    ("map.npy", np.full((5, 5), "1.0"), "expected real numbers"),
    ("map.npy", b"", "not readable as"),
    ("map.png", b"\x89PNG\r\n\x1a\n\0\0", "not readable as"),
    ("map.txt", "0,5\n1,2", COMMAS),
    ("map.txt", "1,5, 2,5\n1,0, 2,0", COMMAS),
    ("map.txt", "1.5;2,5\n1;2", COMMAS),
    ("map.txt", "heights of nothing", "^path"),
    ("map.txt", "# empty\n", "^path"),
    ("map.npy", None, "^path"),
    ("map.xlsx", None, "^path"),
]


@pytest.mark.parametrize(("name", "content", "words"), FILES)
def test_files_of_heights(tmp_path, name, content, words):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif isinstance(content, str):
        path.write_text(content)
    elif content is not None:
        (np.save if path.suffix == ".npy" else np.savetxt)(path, content)
    with pytest.raises(InputError, match=words):
        Rough.from_file(path, (1.0, 3.0), periodic=False)


def test_files_of_surfaces(tmp_path):
    for scale in (0.0, -1.0, np.nan, np.inf, "mm", None, [1.0, 2.0]):
        with pytest.raises(InputError, match="scale"):
            SurfaceMesh.from_file(tmp_path / "ball.stl", scale)
    (tmp_path / "empty.obj").write_text("")
    pyvista.PolyData(np.eye(3), lines=[4, 0, 1, 2, 0]).save(tmp_path / "curve.vtp")
    for name, words in (
        ("ball.stl", r"path=.*no such file"),
        ("ball.step", r"path=.*read from \.stl, \.ply"),
        ("empty.obj", r"path=.*no faces and no lines"),
        ("curve.vtp", r"path=.*constant z"),
    ):
        with pytest.raises(InputError, match=words):
            SurfaceMesh.from_file(tmp_path / name)
    for read in (lambda: SurfaceMesh.from_file(3), lambda: Rough.from_file(3, (1, 1))):
        with pytest.raises(InputError, match=r"^path=3"):
            read()


POINTS, FACETS = brick((0, 0, 0), (1, 1, 1))
TURNED = FACETS.copy()
TURNED[:, 0] = TURNED[::-1, 0]
SQUARE, SIDES = brick((0, 0), (1, 1))


def two(shift, turned=False, size=1.0):
    """A box beside, or in, another one."""
    second = FACETS[::-1] if turned else FACETS
    points = np.hstack((POINTS, size * POINTS + np.reshape(shift, (3, 1))))
    return points, np.hstack((FACETS, second + POINTS.shape[1]))


SURFACES = {
    "no points": (np.zeros((3, 0)), FACETS, "facets: facet 0 has the points"),
    "rows for columns": (POINTS.T, FACETS, r"points: expected shape.*transpose"),
    "four coordinates": (np.zeros((4, 5)), FACETS, r"points: expected shape"),
    "words": ("ball", FACETS, "points"),
    "NaN": (np.where(POINTS == 1, np.nan, POINTS), FACETS, "points: point 1 is not finite"),
    "facets as rows": (POINTS, FACETS.T, r"facets: expected shape \(3, nfacets\).*transpose"),
    "no facets": (POINTS, np.zeros((3, 0), int), "facets: expected shape"),
    "facets of real numbers": (POINTS, FACETS + 0.5, "facets: expected whole numbers"),
    "facets of nothing": (POINTS, None, "facets"),
    "point out of range": (POINTS, FACETS + 1, "facets: facet .* there are 8"),
    "point twice": (POINTS, np.c_[FACETS, [1, 1, 2]], "facets: facet 12 names a point twice"),
    "one place": (np.ones((3, 8)), FACETS, "points: all of them are one point"),
    "no area": (
        np.c_[POINTS, [0.5, 0.5, 0.0], [0.7, 0.7, 0.0]],
        np.c_[FACETS, [0, 8, 9]],
        r"facets: 1 have no area, the first at \(0.4, 0.4, 0\)",
    ),
    "open": (POINTS, FACETS[:, 1:], "facets: the surface is open at 3 edges.*sheet=True"),
    "open outline": (SQUARE, SIDES[:, 1:], "facets: the surface is open at 2 ends.*sheet=True"),
    "turned": (POINTS, TURNED, r"facets: at 3 edges the two triangles are turned differently"),
    "turned outline": (SQUARE, np.c_[SIDES[::-1, :1], SIDES[:, 1:]], "facets: at 2 ends the two"),
    "double": (POINTS, np.c_[FACETS, FACETS[:, :1]], "facets: 3 edges belong to more than two"),
    "fork": (
        np.c_[SQUARE, [3.0, 3.0]],
        np.c_[SIDES, [0, 4]],
        "facets: 1 ends belong to more than two segments",
    ),
    "touching edges": (*two((1.0, 1.0, 0.0)), "facets: 1 edges belong to more than two"),
    "island turned": (
        *two((3.0, 0.0, 0.0), True),
        "inside no other part, but is turned like a hole",
    ),
    "cavity not turned": (*two((0.3, 0.3, 0.3), size=0.3), "inside another part, but is turned"),
}


@pytest.mark.parametrize("case", SURFACES)
def test_surfaces(case):
    points, facets, message = SURFACES[case]
    with pytest.raises(InputError, match=message):
        SurfaceMesh(points, facets)


def test_what_is_no_mistake():
    """A cavity, boxes apart, boxes that touch at a corner, an island within a cavity."""
    for good in (
        two((0.3, 0.3, 0.3), True, 0.3),
        two((3.0, 0.0, 0.0)),
        two((1.0, 1.0, 1.0)),
        ring(3),
        ball(1),
    ):
        SurfaceMesh(*good)
    rings = [ring(20, r) for r in (3.0, 2.0, 1.0)]
    outlines = [f[:: -1 if k == 1 else 1] + 20 * k for k, (_, f) in enumerate(rings)]
    nested = SurfaceMesh(np.hstack([p for p, _ in rings]), np.hstack(outlines))
    inside = nested.distance(np.array([[0.0, 1.5, 2.5, 4.0], [0.0] * 4]))[0] < 0
    assert inside.tolist() == [True, False, True, False]


def test_places_of_surfaces():
    cube = SurfaceMesh(POINTS, FACETS)
    for ask in (
        cube.closest,
        cube.distance,
        lambda x: cube(x, x),
        lambda x: ClosestPoint(cube)(x, x),
    ):
        with pytest.raises(InputError, match="dimension 3 against a body of 2"):
            ask(np.zeros((2, 4)))
    with pytest.raises(InputError, match="x: expected finite"):
        cube.closest(np.full((3, 1), np.nan))
    for name in ("hollow", "sheet"):
        with pytest.raises(InputError, match=f"{name}="):
            SurfaceMesh(POINTS, FACETS, **{name: 1.0})
    for wrong in ((0.0, 1.0), (0.0, 1.0, np.inf)):
        with pytest.raises(InputError, match="displacement="):
            cube.translated(wrong)
    with pytest.raises(InputError, match="centre"):
        ClosestPoint(Sphere((0.0, 0.0), 1.0)).direction(np.zeros((2, 1)))


def test_what_was_given_is_kept():
    points = POINTS.copy()
    cube = SurfaceMesh(points, FACETS)
    points += 1
    assert np.array_equal(cube.points, POINTS)
    normal = np.array([0.0, 1.0])
    plane = Plane([0.0, 0.0], normal)
    normal[1] = -1.0
    assert plane == FLOOR
    with pytest.raises(ValueError, match="read-only"):
        cube.points += 1
    assert repr(cube) == "SurfaceMesh(8 points, 12 triangles)"


# What lies under a mask is no number: masked values are refused, in lists and tuples too.
HIDDEN = np.ma.masked_array([0.5, 1.0], [True, False])
PAIRS = [HIDDEN, list(HIDDEN), (np.ma.masked, 1.0), [np.ma.masked_array(0.5, True), 1.0]]
ROWS = [HIDDEN, np.array([0.0, 1.0])]
FLOOR = Plane((0.0, 0.0), (0.0, 1.0))


@pytest.mark.parametrize("pair", PAIRS, ids=["array", "list", "tuple", "of arrays"])
@pytest.mark.parametrize(
    "made",
    [
        lambda v: Plane(v, (0.0, 1.0)),
        lambda v: Plane((0.0, 1.0), v),
        lambda v: Cylinder(v, 1.0),
        lambda v: Sphere((*v, 0.0), 1.0),
        lambda v: Cone(v, (0.0, -1.0), 0.5),
        lambda v: Parabola(v, 1.0),
        lambda v: Moved(FLOOR, v),
        lambda v: Rigid(FLOOR, v).components(2),
        lambda v: Rough([*v, 0.0, 0.0, 0.0], 1.0),
    ],
)
def test_masked_coordinates(made, pair):
    with pytest.raises(InputError, match=r"masked|finite"):
        made(pair)


@pytest.mark.parametrize(
    "made",
    [
        lambda: Sphere((0.0, 0.0, 0.0), np.ma.masked),
        lambda: Cone((0.0, 0.0), (0.0, 1.0), np.ma.masked),
        lambda: Rough([np.ma.masked_array(np.ones(4), [1, 0, 0, 0]), *np.ones((3, 4))], (1, 1)),
        lambda: SurfaceMesh(ROWS, [[0, 1], [1, 0]]),
        lambda: GridContact(HalfSpace((1.0, 1.0), (2, 2), 1.0, 0.3), ROWS).solve(),
    ],
)
def test_masked_numbers_and_heights(made):
    with pytest.raises(InputError, match="masked"):
        made()


def square():
    mesh = MeshQuad().refined(2).with_defaults()
    return ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("top", "xy")


def shaft():
    """A disk with curved sides."""
    mesh = MeshTri2.init_circle(3)
    mesh = mesh.with_boundaries({"rim": mesh.boundary_facets()})
    return ElasticBody.from_mesh(mesh, E=1.0, nu=0.3)


def quarter():
    mesh = MeshTri.init_tensor(np.linspace(1, 2, 5), np.linspace(0, 2, 9)).with_defaults()
    r, angle = mesh.p
    bent = MeshTri(np.array([r * np.cos(angle), r * np.sin(angle)]), mesh.t)
    bent = bent.with_boundaries({"rim": mesh.boundaries["left"]})
    return ElasticBody.from_mesh(bent, E=1.0, nu=0.3)


BODIES = {
    "plane": lambda make: square(),
    "layers": lambda make: LayeredBlock(1.0, [(1.0, 4, 1.0, 0.3)], top="xy"),
    "space": lambda make: make.dome(ElementHex1, 2).body,
}


@pytest.mark.parametrize("wrap", [lambda o: o, ClosestPoint, lambda o: Rigid(o, force=None)])
@pytest.mark.parametrize("name", BODIES)
def test_plane_with_its_normal_the_wrong_way(name, wrap, make):
    """The message holds the normal that is right; with it the body touches."""
    body = BODIES[name](make)
    down = np.zeros(body.dim)
    down[-1] = -2.0
    with pytest.raises(InputError, match="faces the plane") as caught:
        ContactProblem(body, "bottom", wrap(Plane(-0.01 * np.abs(down), down)))
    right = tuple((0.0 - down).tolist())
    assert f"towards the body: normal={right}" in str(caught.value)
    ContactProblem(body, "bottom", wrap(Plane(0.005 * down, -down)))


def test_one_plane_of_several_and_one_turned_in_a_load_history():
    planes = [Plane((0, -0.1), (0, 1)), Plane((1.1, 0), (1, 0))]
    with pytest.raises(InputError, match=r"normal=\(-1"):
        ContactProblem(square(), ["bottom", "right"], planes)
    stepper = LoadStepper(ContactProblem(square(), "bottom", Plane((0, 0), (0, 1))))
    stepper.obstacle(lambda t: Plane((0, 0), (0, 1 - 2 * t)))
    stepper.run([0.1])
    with pytest.raises(InputError, match="faces the plane"):
        stepper.run([1.0])


def disk(centre, radius):
    return SignedDistance(lambda x: np.hypot(x[0] - centre[0], x[1] - centre[1]) - radius)


FAR, OVER, WITHIN = "nothing can touch", "overlaps it by more than 1", "its surface from within"
WARNED = [
    (square, Cylinder((5.0, -2.0), 1.0), FAR),
    (square, Sphere((5.0, -2.0), 1.0), FAR),
    (square, Cylinder((0.5, 3.0), 1.0), FAR),  # behind
    (square, Cylinder((9.0, 0.0), 2.0, hollow=True), FAR),  # a bore around another place
    (square, disk((5.0, -2.0), 1.0), FAR),
    (square, SignedDistance(lambda x: x[1] + 2, reach=1.0), FAR),
    (square, lambda x: np.full(x.shape[1:], np.inf), FAR),
    (square, -2.0, OVER),
    (square, lambda x: -2 - x[0], OVER),
    (square, Plane((0, 2), (0, 1)), OVER),
    (square, Parabola((0.5, 0), 1.0, offset=-3.0), OVER),
    (quarter, Cylinder((0, 0), 0.9, hollow=True), "hollow=False"),
    (shaft, Cylinder((0.0, 0.0), 1.02), r"Cylinder\(\.\.\., hollow=True\)"),
    *(
        (shaft, wrap(kind((0.0, 0.0), radius)), WITHIN)
        for radius in (1.0 + 1e-6, 1.01, 1.5)
        for kind in (Cylinder, Sphere, disk)
        for wrap in (lambda o: o, ClosestPoint)
    ),
]


@pytest.mark.parametrize(("body", "obstacle", "words"), WARNED)
def test_warned_of(body, obstacle, words):
    with pytest.warns(ContactWarning, match=words) as caught:
        problem = ContactProblem(body(), "bottom" if body is square else "rim", obstacle)
    assert caught[0].filename == __file__
    if words is FAR:
        assert problem.solve().contact_force == 0.0


MEANT = {
    "above": Plane((0, -0.1), (0.3, 1)),
    "overlap": Plane((0, 0.3), (0, 1)),
    "roller beside": Cylinder((1.2, -0.5), 0.5),
    "roller overlapping": Cylinder((0.5, -0.8), 1.1),
    "far below": Cylinder((0.5, -50.0), 1.0),
    "closest, beside": ClosestPoint(Cylinder((3.0, -0.5), 0.5)),
    "number": np.inf,
}


@pytest.mark.parametrize("name", MEANT)
def test_no_warning_where_it_may_be_meant(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ContactProblem(square(), "bottom", MEANT[name])
        ContactProblem(square(), ["bottom", "right"], MEANT[name])
        bore = Cylinder((0.0, 0.0), 0.99, hollow=True)
        if name == "above":
            assert ContactProblem(shaft(), "rim", bore, friction=0.1).solve().pressure.min() > 0
