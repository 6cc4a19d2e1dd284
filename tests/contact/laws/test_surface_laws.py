"""Adhesion, hardness and wear: closed forms, grids beside meshes, certificates, units, files."""

import numpy as np
import pytest
from maugis import NU, STAR, WORK, E, K, pull_off
from scipy.optimize import brentq
from skfem import ElementQuad1, ElementQuad2, ElementTriP2, MeshQuad

from contact import (
    Adhesion,
    ContactProblem,
    ContactResult,
    ContactWarning,
    Cylinder,
    ElasticBody,
    GridContact,
    GridResult,
    HalfSpace,
    Infeasible,
    InputError,
    JumpWarning,
    LoadHistory,
    LoadStepper,
    NoEquilibrium,
    NotConverged,
    Parabola,
    PeriodicLayers,
    Rigid,
    Status,
    Wear,
    cross_check,
    recheck,
    uniqueness,
)
from skfem_adini import ElementQuadAdini


def block(element=ElementQuad1, n=3, modulus=1.0, nu=0.0, length=1.0):
    mesh = MeshQuad().refined(n).scaled(length).with_defaults()
    return ElasticBody.from_mesh(mesh, element(), E=modulus, nu=nu)


def rising(depths, gap=0.0, motion=None, **laws):
    """Steps of a rigid obstacle that rises against a block by the depths."""
    body = laws.pop("body", None) or block(nu=0.3).fix("top", "xy")
    stepper = LoadStepper(ContactProblem(body, "bottom", gap, **laws))
    stepper.obstacle(lambda t: Rigid(gap, displacement=(0.0, depths[int(t)])), motion=motion)
    return stepper


# --- adhesion


def sphere(lam, h, low, high, far, ramp):
    """A half space, meshed finely between two radii, under an adhesive paraboloid."""
    inner = low - np.cumsum(h * 1.2 ** np.arange(100))
    inner = inner[inner > 2 * h][::-1]
    count = int(np.log(far / h) / np.log(1.25))
    outer = np.cumsum(h * 1.25 ** np.arange(count))
    across = np.r_[0.0, inner, np.arange(low, high, h), high + outer]
    mesh = MeshQuad.init_tensor(across, np.r_[0.0, outer]).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=E, nu=NU, plane="axisymmetric")
    law = Adhesion(lam * K / 2, WORK, ramp=ramp)
    stepper = LoadStepper(ContactProblem(body.fix("top", "y"), "bottom", 0.0, adhesion=law))
    return stepper.obstacle(lambda t: Rigid(Parabola((0.0, 0.0), 1.0), displacement=(0.0, -t)))


@pytest.mark.turns(4)
@pytest.mark.parametrize(
    ("lam", "settings", "retreats"),
    [
        pytest.param(0.03, (0.3, 0.3, 7.5, 300.0, 0.1), (-0.05, 0.05, 0.15, 0.2), id="DMT"),
        pytest.param(1.0, (0.025, 0.7, 1.8, 80.0, 0.2), (0.4, 0.45, 0.5, 0.55), id="between"),
        pytest.param(4.0, (0.012, 0.98, 1.42, 60.0, None), (0.3, 0.44, 0.48), id="JKR"),
    ],
)  # fmt: skip
def test_pull_off_of_a_sphere(lam, settings, retreats):
    history = sphere(lam, *settings).run(retreats)
    forces = np.array([r.contact_force for r in history.results]) / (np.pi * WORK)
    least = forces.argmin()
    assert 0 < least < len(forces) - (lam > 0.1)
    assert forces.min() == pytest.approx(pull_off(lam), rel=0.01)
    assert lam == 1.0 or forces.min() == pytest.approx(-1.5 if lam > 1 else -2.0, rel=0.015)


def on_grid(lam, length, points, approaches, ramp):
    """A quarter of a periodic half space."""
    layer = [(4 * length / points, 4, E, NU)]
    ground = PeriodicLayers((length,) * 2, layer, (points,) * 2, sides=("x", "y"), base=(E, NU))
    ball = Parabola((0.0, 0.0, 0.0), 1.0)
    steps = [Rigid(ball, displacement=(0.0, 0.0, d)) for d in approaches]
    law = Adhesion(lam * K / 2, WORK, ramp=ramp)
    results = GridContact(ground, steps[0], adhesion=law).history(steps)
    return np.array([4 * r.forces[0].sum() for r in results]) / (np.pi * WORK)


@pytest.mark.turns(3)
@pytest.mark.parametrize(
    ("lam", "settings"),
    [
        pytest.param(0.03, (24.0, 96, (-0.05, -0.15, -0.2, -0.25), 0.1), id="DMT"),
        pytest.param(1.0, (5.0, 80, (0.0, -0.1, -0.2, -0.3), 0.2), id="between"),
        pytest.param(4.0, (6.5, 288, (-0.2, -0.26, -0.31), None), id="JKR"),
    ],
)  # fmt: skip
def test_pull_off_on_a_grid(lam, settings):
    forces = on_grid(lam, *settings)
    assert 0 < forces.argmin() < forces.size - 1
    assert forces.min() == pytest.approx(pull_off(lam), rel=0.01)
    assert lam == 1.0 or forces.min() == pytest.approx(-1.5 if lam > 1 else -2.0, rel=0.015)


@pytest.mark.parametrize(("length", "modulus"), [(1.0, 1.0), (1e-3, 2e11)])
@pytest.mark.parametrize("element", [ElementQuad1, ElementTriP2, ElementQuadAdini])
def test_column_under_tension(element, length, modulus):
    """E (D - g) / L = sigma(g): opens gradually where it is stiffer than the law, else at once."""
    mesh = MeshQuad().refined(2).scaled(length).with_defaults()
    mesh = mesh.to_meshtri().with_defaults() if element is ElementTriP2 else mesh
    body = ElasticBody.from_mesh(mesh, element(), E=modulus, nu=0.0).fix("top", "y")
    body.fix("left", "x")

    def stepper(h):
        law = Adhesion(0.1 * modulus, 0.1 * h * modulus * length, "exponential")
        problem = ContactProblem(body, "bottom", 0.0, adhesion=law)
        return LoadStepper(problem).move("top", "y", length)

    stiff = stepper(0.2)
    for d in np.linspace(0.04, 0.4, 8):
        result = stiff.step(float(d))
        g = brentq(lambda g: d - g - 0.1 * np.exp(-g / 0.2), 0.0, d) if d > 0.1 else 0.0  # noqa: B023
        assert np.abs(result.gap / length - g).max() < 1e-10
        assert np.abs(result.pressure / modulus + (d - g)).max() < 1e-10
        assert np.all((result.status == Status.OPEN) == (d > 0.1))
        assert not result.jump
        assert max(recheck(result).values()) < 1e-10
    soft = stepper(0.05)
    for d in (0.01, 0.04, 0.07, 0.095):
        assert np.abs(soft.step(d).gap).max() < 1e-10 * length
    with pytest.warns(JumpWarning, match="pulled off"):
        assert soft.step(0.3).jump == "pull-off"


def test_no_equilibrium_beyond_pull_off():
    body = block().fix("left", "x").load("top", (0.0, 1.0))
    law = Adhesion(0.02, 1e-4)
    assert np.all(np.abs(
        ContactProblem(body.under(0.019 * body.f, 0 * body.f), "bottom", 0.0, adhesion=law)
        .solve().pressure + 0.019) < 1e-10)  # fmt: skip
    with pytest.raises(NoEquilibrium, match="pulled off"):
        ContactProblem(body.under(0.021 * body.f, 0 * body.f), "bottom", 0.0, adhesion=law).solve()
    ground, ball = HalfSpace((1.0, 1.0), (32, 32), 1.0, 0.3), Parabola((0.5, 0.5, 0.0), 2.0)
    pulled = Rigid(ball, force=(None, None, -1.0))
    with pytest.raises(NotConverged):
        GridContact(ground, pulled, adhesion=Adhesion(0.01, 1e-5)).solve()


def test_a_body_held_by_adhesion_alone():
    """Free across the plane, its load turns from pressing to pulling, up to the tension."""
    body = block().fix("left", "x")
    law = Adhesion(0.02, 1e-4, "exponential")
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, adhesion=law), halvings=2)
    stepper.load("top", (0.0, 1.0), lambda t: t)
    for t in (-0.01, 0.005, 0.015, 0.0195):
        result = stepper.step(t)
        assert np.abs(result.pressure + t).max() < 1e-10
        assert np.abs(result.gap).max() < 1e-10
    with pytest.raises(NoEquilibrium):
        stepper.step(0.0205)


def test_force_and_motion_give_the_same():
    """A grid held by its force, and at the motion of that solution; the jump into contact."""
    ground, ball = HalfSpace((1.0, 1.0), (48, 48), 1.0, 0.3), Parabola((0.5, 0.5, 0.0), 2.0)
    law = Adhesion(0.02, 2e-5)
    driven = [Rigid(ball, force=(None, None, p)) for p in (2e-4, 0.0, -5e-5)]
    by_force = GridContact(ground, driven[0], adhesion=law).history(driven)
    at_once = GridContact(ground, driven[2], adhesion=law).solve()
    assert at_once.forces[0].sum() == pytest.approx(-5e-5)
    assert by_force[-1].forces[0].sum() == pytest.approx(-5e-5)
    steps = [Rigid(ball, displacement=tuple(np.r_[0.0, 0.0, r.motion[2]])) for r in by_force]
    by_motion = GridContact(ground, steps[0], adhesion=law).history(steps)
    for one, other in zip(by_force, by_motion, strict=True):
        assert np.abs(one.pressure - other.pressure).max() < 1e-9
    far, near = (Rigid(ball, displacement=(0.0, 0.0, d)) for d in (-0.01, 0.002))
    with pytest.warns(JumpWarning, match="jumped into"):
        assert GridContact(ground, far, adhesion=law).history([far, near])[-1].jump == "contact"


# --- hardness


@pytest.mark.parametrize(("length", "modulus"), [(1.0, 1.0), (1e-3, 2e11)])
def test_indentation_and_reloading(length, modulus):
    depths = np.array([0.02, 0.05, 0.02, 0.0, 0.02, 0.05, 0.06]) * length
    stepper = rising(
        depths, Parabola((0.5 * length, 0.0), 0.5 * length), hardness=0.05 * modulus,
        body=block(n=5, modulus=modulus, nu=0.3, length=length).fix("top", "xy"),
    )  # fmt: skip
    results = stepper.run(np.arange(7.0)).results
    loaded, open_, reloaded, most, beyond = (results[k] for k in (1, 3, 4, 5, 6))
    p = np.array([r.pressure.max() for r in results]) / modulus
    assert p[1] == pytest.approx(0.05, rel=1e-9)
    capped = loaded.pressure > 0.05 * modulus * (1 - 1e-9)
    assert capped.sum() > 5
    assert np.array_equal(loaded.indentation > 1e-12 * length, capped)
    assert np.abs(loaded.indentation[capped] + loaded.gap[capped]).max() < length  # gaps closed
    assert np.array_equal(open_.indentation, loaded.indentation)
    assert not open_.pressure.any()
    assert np.abs(reloaded.pressure - results[2].pressure).max() < 1e-9 * modulus  # elastic
    assert np.abs(most.pressure - loaded.pressure).max() < 1e-9 * modulus
    assert np.abs(most.indentation - loaded.indentation).max() < 1e-9 * length
    assert beyond.indentation.max() > 1.2 * most.indentation.max()


@pytest.mark.turns(2)
def test_fully_plastic_area_and_its_bounds():
    """A wave of Westergaard with a hardness: area of the elastic wave and F / H from below."""
    n, height, H = 512, 1e-2, 0.02
    x = np.arange(n) / n
    wave, ground = height * (1 - np.cos(2 * np.pi * x)), HalfSpace(1.0, n, E=1.0, nu=0.3)
    full = np.pi * ground.contact_modulus * height
    previous = 0.0
    for p in (1e-3, 4e-3, 1e-2, 1.6e-2, 1.96e-2):
        result = GridContact(ground, Rigid(wave, force=(None, p)), hardness=H).solve()
        elastic = 2 / np.pi * np.arcsin(np.sqrt(p / full))
        assert result.pressure.max() <= H * (1 + 1e-12)
        assert result.area >= max(elastic, p / H) - 1.5 / n
        assert result.area > previous
        previous = result.area
    wide = Rigid(30 * wave, force=(None, 1.2e-2))  # elastic share vanishes: A = F / H
    assert GridContact(ground, wide, hardness=H).solve().area == pytest.approx(0.6, abs=2.5 / n)
    with pytest.raises(Infeasible, match="hardness"):
        GridContact(ground, Rigid(wave, force=(None, 1.01 * H)), hardness=H).solve()
    body = block().fix("left", "x").load("top", (0.0, -0.021))
    with pytest.raises(NotConverged, match="hardness"):
        ContactProblem(body, "bottom", lambda x: 0.01 * x[0], hardness=H).solve()


# --- wear


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_worn_volume(friction):
    """k F s of a block that is dragged, for both sides and from grids; the shares of the sides."""
    body = block().fix("left", "x").fix("right", "x").load("top", (0.0, -0.1))
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, friction, wear=Wear(1e-3, 4e-3)))
    stepper.obstacle(lambda t: Rigid(0.0, displacement=(t, 0.0)))
    last = stepper.run([1.0, 2.5]).results[-1]
    slips = np.array([np.abs(r.slip_increment[:, 0]) for r in stepper.history.results])
    forces = np.array([r.mu for r in stepper.history.results])
    assert last.worn_volume == pytest.approx(np.array([1e-3, 4e-3]) * (slips * forces).sum())
    if not friction:
        assert last.worn_volume == pytest.approx(np.array([1, 4]) * 1e-3 * 0.1 * 2.5, rel=1e-10)
    n = 32
    steps = [Rigid(np.zeros((n, n)), force=(None, None, 0.1), displacement=(t, 0, None))
             for t in (1.0, 2.5)]  # fmt: skip
    grid = GridContact(HalfSpace((1.0, 1.0), (n, n), 1.0, 0.3), steps[0], friction, wear=1e-3)
    worn = grid.history(steps)[-1].worn_volume
    assert worn == pytest.approx([2.5e-4, 0.0], rel=1e-10)


@pytest.mark.turns(2)
@pytest.mark.parametrize("by", ["place", "pressure"])
def test_worn_profile_of_a_pin(by, tmp_path):
    """Springs of stiffness C between a parabola and a stiff block: Archard's law point by point.

    k constant, exact as ds -> 0: w = c (1 - exp(-k C s)); k = b p: w = c (1 - 1 / (1 + b C C c s)).
    """
    C, k, delta = 2.0, 0.05, 0.02
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 17), np.linspace(0, 0.1, 3)).with_defaults()
    body = ElasticBody.from_mesh(mesh, E=1e7, nu=0.0).fix("top", "xy").fix("left", "x")

    def gap(x):
        return 0.03 * x[0] ** 2

    law = Wear(k) if by == "place" else Wear(lambda p: 30 * k * p, by="pressure")
    problem = ContactProblem(body, "bottom", gap, overclosure=C, wear=law)
    c = np.maximum(delta - problem.rows.gap, 0.0)
    errors = []
    for count in (10, 20, 40):
        stepper = LoadStepper(problem)
        stepper.obstacle(lambda t: Rigid(gap, displacement=(0.0, delta)), motion=lambda t: (t, 0.0))
        last = stepper.run(np.linspace(0, 5, count + 1)[1:]).results[-1]
        s, implicit = 5.0 / count, c.copy()
        for _ in range(count):  # p = C (left - k p s), or with k = b p
            B = 30 * k * s * C * C
            implicit = (
                implicit / (1 + k * C * s) if by == "place"
                else (np.sqrt(1 + 4 * B * implicit) - 1) / (2 * B)
            )  # fmt: skip
        assert np.abs(last.worn[0] - (c - implicit)).max() < 1e-6 * delta  # the block yields
        exact = c * (-np.expm1(-k * C * 5) if by == "place" else 1 - 1 / (1 + 150 * k * C * C * c))
        errors.append(np.abs(last.worn[0] - exact).max())
    again = ContactResult.load(last.save(tmp_path / "pin"))
    assert np.abs(again.worn - last.worn).max() < 1e-12 * delta
    order = np.log2(errors[0] / errors[2]) / 2
    assert 0.85 < order < 1.15


def test_deep_wear_is_warned_of():
    body = block().fix("left", "x").fix("right", "x").load("top", (0.0, -0.1))
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, wear=1.0))
    stepper.obstacle(lambda t: Rigid(0.0, displacement=(t, 0.0)))
    with pytest.warns(ContactWarning, match="worn depth"):
        stepper.step(1.0)


# --- all of them


def random_laws(seed):
    """Laws of the surface, and the approach and slide of the obstacle in each step."""
    rng = np.random.default_rng(seed)
    laws, friction = {}, (0.0, 0.3)[seed % 2]
    if seed % 3 != 1:
        form = ("exponential", "dugdale")[seed % 2]
        laws["adhesion"] = Adhesion(*rng.uniform((0.002, 2e-5), (0.01, 1e-4)), form, 0.3)
    if seed % 3 != 0:
        laws["hardness"] = rng.uniform(0.02, 0.08)
    if seed % 5 > 1:
        laws["wear"] = Wear(rng.uniform(0.01, 0.1), 0.02)
    return friction, laws, rng.uniform((-0.01, 0.0), (0.01, 0.04), (4, 2)).cumsum(axis=0) * 0.5


def check_law(p, gap, left, laws, tol=1e-9):
    """Tension, contact and cap by formulas; what is indented and worn now has closed the gap."""
    law, H = laws.get("adhesion"), laws.get("hardness", np.inf)
    g = np.maximum(gap + left, 0.0)
    sigma = 0.0 * p
    if law is not None:
        x = g / law.range
        sigma = law.tension * (np.exp(-x) if law.law == "exponential"
                               else np.clip((1.3 - x) / 0.6, 0.0, 1.0))  # fmt: skip
    size = np.abs(p).max()
    assert np.all(p <= H * (1 + tol))
    assert np.abs(np.minimum(p + sigma, 1e3 * g * size)).max() <= 1e-7 * size
    assert np.all((gap + left)[np.isfinite(gap)] >= -tol)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
def test_grids_beside_meshes(seed, tmp_path):
    friction, laws, path = random_laws(seed)
    layers = PeriodicLayers(
        1.0, [(0.1, 2, 3.0, 0.2), (0.4, 4, 1.0, 0.3)], 16, sides=("periodic", "x")[seed % 4 == 3],
        motion=(0.0, -0.01),
    )  # fmt: skip
    tool = Cylinder((0.5 if seed % 4 < 3 else 0.1, -0.3), 0.3)
    steps = [Rigid(tool, displacement=tuple(d)) for d in path]
    grids = GridContact(layers, steps[0], friction, **laws).history(steps)
    stepper = LoadStepper(ContactProblem(layers.elastic(), "bottom", tool, friction, **laws))
    stepper.obstacle(lambda t: steps[int(t)])
    meshes = stepper.run(np.arange(4.0), path=tmp_path / "run").results
    at = np.rint(meshes[0].x_nominal[0] * 16).astype(int)
    inside = at < layers.shape[0]
    at, size = at[inside], max(np.abs(r.pressure).max() for r in meshes)
    indented, worn = 0.0, 0.0
    for grid, mesh in zip(grids, meshes, strict=True):
        assert np.abs(grid.pressure[at] - mesh.pressure[inside]).max() < 1e-9 * size
        assert np.abs(grid.indentation[at] - mesh.indentation[inside]).max() < 1e-10
        assert np.abs(grid.worn[:, at] - mesh.worn[:, inside]).max() < 1e-10
        assert grid.jump == mesh.jump
        new = mesh.indentation + mesh.worn.sum(axis=0) - indented - worn
        check_law(mesh.pressure, mesh.gap, new, laws)
        indented, worn = mesh.indentation, mesh.worn.sum(axis=0)
        if "wear" in laws:
            slip = np.abs(mesh.slip_increment[:, 0])
            grown = laws["wear"].coefficient * np.maximum(mesh.pressure, 0) * slip
            assert np.abs(mesh.worn[0] - grown).max() >= 0.0
    assert max(grids[-1].kkt.values()) < 1e-10
    # Files: of the history, of one result of each; a history goes on from a stored one.
    again = LoadHistory.load(tmp_path / "run").results[-1]
    for name in ("pressure", "indentation", "worn"):
        assert np.array_equal(getattr(again, name), getattr(meshes[-1], name))
    one = ContactResult.load(meshes[1].save(tmp_path / "mesh"))
    assert np.array_equal(one.worn, meshes[1].worn)
    (tmp_path / "run" / "step_00004.npz").unlink()
    other = LoadStepper(ContactProblem(layers.elastic(), "bottom", tool, friction, **laws))
    resumed = other.obstacle(lambda t: steps[int(t)]).resume(tmp_path / "run").results[-1]
    assert np.abs(resumed.pressure - meshes[-1].pressure).max() < 1e-9 * size
    stored = GridResult.load(grids[2].save(tmp_path / "grid"))
    last = GridContact(layers, steps[3], friction, **laws).solve(after=stored)
    assert np.abs(last.pressure - grids[3].pressure).max() < 1e-9 * size
    changed = LoadStepper(
        ContactProblem(layers.elastic(), "bottom", tool, friction, **(laws | {"wear": 0.7}))
    )
    with pytest.raises(InputError, match="another problem"):
        changed.obstacle(lambda t: steps[int(t)]).resume(tmp_path / "run")


def solved(**laws):
    problem = ContactProblem(block().fix("top", "xy", -0.01), "bottom", 0.0, **laws)
    return problem, problem.solve()


BAD = [
    (lambda: Adhesion(0.0, 1.0), "tension"),
    (lambda: Adhesion(1.0, np.nan), "work"),
    (lambda: Adhesion(1.0, 1.0, "jkr"), "law"),
    (lambda: Adhesion(1.0, 1.0, ramp=1.0), "ramp"),
    (lambda: Wear(1.0, by="time"), "by"),
    (lambda: solved(adhesion=1.0), "adhesion"),
    (lambda: solved(hardness=0.0), "hardness"),
    (lambda: solved(hardness=lambda x: np.nan * x[0]), "hardness"),
    (lambda: solved(wear=-1.0), "wear"),
    (lambda: solved(wear=np.ones(3)), "wear"),
    (lambda: solved(wear=Wear(lambda p: -p, by="pressure")), "wear"),
    (lambda: solved(hardness=1.0, overclosure=1.0), "overclosure"),
    (lambda: solved(wear=1.0)[0].solve("qp:osqp"), "compliant surfaces"),
    (lambda: cross_check(*solved(wear=1.0)), "adhesion, hardness and wear"),
    (lambda: uniqueness(*solved(hardness=1.0)), "uniqueness"),
    (lambda: GridContact(HalfSpace(1.0, 8, 1.0, 0.3), 0.0, hardness=np.ones(3)), "hardness"),
    (lambda: GridContact(HalfSpace(1.0, 8, 1.0, 0.3), 0.0, adhesion="glue"), "adhesion"),
]


@pytest.mark.parametrize(("make", "word"), BAD)
def test_bad_input(make, word):
    with pytest.raises(InputError, match=word):
        make()


def test_modulus_of_closed_forms():
    assert pytest.approx(1.0, rel=1e-12) == STAR
