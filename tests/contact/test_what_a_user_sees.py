"""Elements, obstacles, laws, planes, dimensions and supports at random: what a user reads holds."""

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID
from posed_pairs import Pose
from skfem import ElementHex1, ElementTetP1, MeshHex, MeshQuad
from traction_of_the_body import mismatch

from contact import (
    ClosestPoint,
    ContactProblem,
    Cylinder,
    ElasticBody,
    Parabola,
    Plane,
    Rigid,
    SignedDistance,
    Sphere,
)
from skfem_adini import ElementQuadBFS

PLANAR = [*PLANE_AND_BFS[4:], *PLANE_AND_BFS[:4]]
OBSTACLES = ["plane", "round", "hollow", "parabola", "distance", "number", "callable"]


def draw(seed):
    """One problem in its first place, as a dict."""
    rng = np.random.default_rng([seed, 16])
    dim = 3 if rng.random() < 0.25 else 2
    law = rng.choice(["none", "coulomb", "tresca"])
    return {
        "dim": dim,
        "element": (SOLID if dim == 3 else PLANAR)[rng.integers(5 if dim == 3 else 6)],
        "obstacle": str(rng.choice(OBSTACLES)),
        "wrap": str(rng.choice(["", "", "closest", "rigid"])),
        "law": str(law),
        "friction": float(rng.choice([0.1, 0.4, 0.9])),
        "plane": str(rng.choice(["strain", "stress"])),
        "nu": float(rng.choice([0.0, 0.3, 0.45])),
        "graded": bool(rng.random() < 0.5),
        "push": float(rng.choice([0.01, 0.03, 0.06])),
        "drag": float(rng.choice([0.0, 0.02])),
        "tilt": float(rng.choice([0.0, 0.03])),
        "load": bool(rng.random() < 0.5),
        "weight": bool(rng.random() < 0.3),
        "rng": rng,
    }


def obstacle(case, place):
    """Touched by the bottom, x_last = 0, once it is pushed down."""
    dim, kind = case["dim"], case["obstacle"]
    up, middle = np.eye(dim)[-1], np.array([0.45, 0.4, 0.0] if dim == 3 else [0.45, 0.0])
    shape = Sphere if dim == 3 else Cylinder
    if kind == "plane":
        slope = up + 0.05 * np.eye(dim)[0]
        made = Plane(place(middle - 0.005 * up), place.Q @ slope)
    elif kind == "round":
        made = shape(place(middle - 2.0 * up), 2.0 * place.size)
    elif kind == "hollow":
        made = shape(place(middle + 3.0 * up), 3.005 * place.size, hollow=True)
    elif kind == "parabola":
        made = Parabola(place(middle), 2.0 * place.size, 0.005 * place.size)
    elif kind == "distance":
        centre = middle - 2.0 * up
        made = SignedDistance(
            lambda x: place.size * (np.linalg.norm(place.home(x) - centre[:, None], axis=0) - 2.0)
        )
    elif kind == "number":
        made = 0.01 * place.size
    else:
        made = lambda x: place.size * 0.3 * (place.home(x)[0] - 0.4) ** 2  # noqa: E731
    if case["wrap"] == "closest" and kind in ("plane", "round", "hollow", "distance"):
        made = ClosestPoint(made)
    if case["wrap"] == "rigid":
        made = Rigid(made, displacement=tuple(0.01 * place.size * (place.Q @ up)))
    return made


def solve(make, case, place, refined=1):
    dim, element = case["dim"], case["element"]
    n = refined * {2: 6, 3: 3}[dim]
    ticks = np.linspace(0, 1, n + 1) ** (1.4 if case["graded"] else 1.0)
    first = make.box(element, *(ticks,) * dim)
    mesh = make.remesh(first, place(first.p)) if first_place(place) else renumbered(first, place)
    plane = {"plane": case["plane"]} if dim == 2 else {}
    body = ElasticBody.from_mesh(mesh, element(), E=place.stress, nu=case["nu"], **plane)

    def moved(x, c):
        home = place.home(x)
        u = np.zeros_like(home)
        u[0], u[-1] = case["drag"], -case["push"] - case["tilt"] * home[0]
        return place.size * np.tensordot(place.Q[c], u, axes=1)

    for c in range(dim):
        body.fix("top", c, lambda x, c=c: moved(x, c))
    if case["load"]:
        pull = np.zeros(dim)
        pull[0], pull[-1] = -0.004, 0.002
        body.load("right", place.stress * (place.Q @ pull))
    if case["weight"]:
        body.body_force(place.stress / place.size * (place.Q @ (-0.003 * np.eye(dim)[-1])))
    friction, law = case["friction"], case["law"]
    if law == "none":
        friction, law = 0.0, "coulomb"
    elif law == "tresca":
        friction = friction * 0.02 * place.stress
    return ContactProblem(body, "bottom", obstacle(case, place), friction, law).solve()


def first_place(place):
    return np.array_equal(place.Q, np.eye(len(place.Q)))


def renumbered(mesh, place):
    """Vertices and cells in another order; quadrilaterals also begin at another corner."""
    rng, p = np.random.default_rng(3), np.empty_like(mesh.p)
    new = rng.permutation(mesh.p.shape[1])
    p[:, new] = place(mesh.p)
    t = new[mesh.t][:, rng.permutation(mesh.t.shape[1])]
    if isinstance(mesh, MeshQuad):
        for k in range(t.shape[1]):
            t[:, k] = np.roll(t[:, k], rng.integers(4))[:: rng.choice([-1, 1])]
    turned = type(mesh)(p, t, sort_t=not isinstance(mesh, MeshQuad | MeshHex))
    keys = {tuple(sorted(facet)): k for k, facet in enumerate(turned.facets.T)}
    facets = {
        name: np.array([keys[tuple(sorted(new[mesh.facets[:, k]]))] for k in numbers])
        for name, numbers in mesh.boundaries.items()
    }
    return turned.with_boundaries(facets)


def check(result, case):
    """What holds for every result."""
    system, dim = result.system, case["dim"]
    assert max(result.kkt.values()) < 1e-10
    unit = float(np.max(system.body.E)) * case["length"] ** (dim - 1)
    tiny = 1e-6 * unit
    balance = result.balance()
    left = np.abs(balance["load"] + balance["support"] + balance["contact"]).max()
    # Where a body moves rigidly no force but rounding is left to compare with.
    assert left < 1e-9 * max(*(np.abs(balance[k]).max() for k in balance if k != "residual"), tiny)
    length, top = np.abs(result.u).max(), max(result.pressure.max(), 1e-300)
    assert result.pressure.min() >= -1e-9 * top
    assert result.gap.min() >= -1e-9 * length  # nothing penetrates
    touching = result.pressure > 1e-6 * top
    assert np.abs(result.gap[touching]).max(initial=0.0) < 1e-8 * length
    assert np.all(result.pressure[result.gap > 1e-6 * length] <= 1e-8 * top)
    size = np.linalg.norm(result.shear, axis=1)
    if system.law is None:
        assert not size.any()
    else:
        bound = system.bound(result.mu) / system.rows.weights
        assert np.all(size <= bound + 1e-8 * max(top, bound.max()))
    # The traction integrates to the force, part by part.
    rows = system.rows
    traction = -result.pressure * rows.normals
    traction += np.einsum("mj,djm->dm", result.shear, rows.tangents)
    force = traction @ rows.weights
    scale = max(np.abs(result.resultant).max(), 1e-300)
    # A row of `ClosestPoint` sees directions that differ along its facets.
    near = 0.05 if case["wrap"] == "closest" and case["obstacle"] != "plane" else 1e-9
    assert np.abs(force - result.resultant).max() < near * scale
    # Weights sum to the boundary: a unit square or interval in its own unit of length.
    assert rows.weights.sum() == pytest.approx(case["length"] ** (dim - 1), rel=1e-10)


def stress_meets_pressure(make, result, case, place, refine):
    """Pressure and shear against the traction of the body, whose means reach from facet to facet.

    Facets across which most of the zone lies leave more than a tenth, and twice as many less. The
    mean normal stress just above the bottom differs from the mean pressure by the size of a cell.
    """
    normal = -place.Q[:, -1:]
    points = np.random.default_rng(0).uniform(0.02, 0.98, (case["dim"], 576))
    points[-1], finer = 0.02, result
    if case["nu"] > 0.4 and case["element"] in (ElementHex1, ElementTetP1):  # these lock
        points[-1], finer = 0.01, solve(make, case, place, 2)
    sigma = finer.stress(place(points))
    pushed = -np.einsum("il,ijk,jl->k", normal, sigma, normal).mean()
    mean = finer.contact_force / finer.system.rows.weights.sum()
    # One stress in cells of a third of the height says less.
    near = 0.3 if case["element"] is ElementTetP1 else 0.2
    near *= max(finer.pressure.max(), np.abs(sigma).max())
    assert abs(pushed - mean) < near or case["wrap"] == "closest"
    coarse = mismatch(result, "bottom", normal)
    if max(coarse) > 0.1 and refine:
        fine = mismatch(solve(make, case, place, 2), "bottom", normal)
        assert max(fine) < max(0.1, 0.85 * max(coarse))


def another(rng, dim, straight):
    """A random place: turned or mirrored, shifted, in other units."""
    Q = np.linalg.qr(rng.normal(size=(dim, dim)))[0]  # of either orientation
    if straight:  # quarter turns and mirrors
        Q = np.eye(dim)[rng.permutation(dim)] * rng.choice([-1.0, 1.0], dim)
    length = 10.0 ** rng.integers(-6, 4)
    shift = length * rng.uniform(-3, 3, dim)
    return Pose(Q, shift, length, 2.0 * 10.0 ** rng.integers(-3, 12))


def run(make, seed, thorough=True):
    case = draw(seed)
    rng, dim = case.pop("rng"), case["dim"]
    first = Pose(np.eye(dim), stress=2.0)
    reference = solve(make, case, first)
    check(reference, case | {"length": 1.0})
    if reference.contact_force > 1e-3:
        stress_meets_pressure(make, reference, case, first, thorough or dim == 2)
    place = another(rng, dim, case["element"] is ElementQuadBFS)
    result = solve(make, case, place)
    check(result, case | {"length": place.size})
    points = rng.uniform(0.02, 0.98, (dim, 30))
    theirs = place.size * np.tensordot(place.Q, reference.sample(points), axes=1)
    ours = result.sample(place(points))
    # Rounding of the geometry times the condition of the body.
    assert np.abs(ours - theirs).max() < 1e-7 * np.abs(theirs).max()
    unit = place.stress / 2.0 * place.size ** (dim - 1)
    force = unit * (place.Q @ reference.resultant)
    assert np.abs(result.resultant - force).max() < 1e-6 * max(np.abs(force).max(), 1e-6 * unit)


# On meshes refined twice a point may pass its neighbours: what is compared is linear all the same.
@pytest.mark.filterwarnings("ignore::contact.LargeMotionWarning")
@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", range(40))
def test_random_problem(seed, make):
    run(make, seed, thorough=False)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::contact.LargeMotionWarning")
@pytest.mark.parametrize("part", range(10))
def test_a_thousand_random_problems(part, make):
    for seed in range(100 * part, 100 * part + 100):
        run(make, 1000 + seed)
