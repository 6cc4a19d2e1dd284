"""Bodies, problems, results and histories go to other processes and come back the same."""

import copy
import multiprocessing
import pickle

import numpy as np
import pytest
from certified_cases import CASES, COATED
from pressed_pairs import pair
from skfem import ElementHex1, MeshQuad

import contact.errors
import gpu.errors
from contact import (
    ClosestPoint,
    ContactProblem,
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
)
from skfem_adini import ElementQuadAdini


def sent(thing):
    return pickle.loads(pickle.dumps(thing))


def slope(x):
    return 0.01 + 0.01 * x[0]


NAMES = ["ElementQuadAdini", "ElementQuad2", "ElementTriP2", "ElementHex1", "layers", "driven"]
NAMES += [
    "heated",
    "anisotropic",
    "periodic",
    "waves in space",
    "held: cut",
    "several: Adini",
    "several: stack",
    "several: slit",
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("copied", [sent, copy.deepcopy, copy.copy])
@pytest.mark.parametrize("name", NAMES)
def test_problems_and_results(name, copied, make):
    """Bit for bit, the certificate too; a factorisation is made anew and gives the same."""
    problem = CASES[name](make)
    result, other = problem.solve(), copied(problem)
    again, bodies = copied(result), result.solid.bodies
    assert again.kkt == result.kkt
    for field in ("u", "mu", "t", "pressure", "slip", "status", "resultants"):
        assert np.array_equal(getattr(again, field), getattr(result, field)), field
    for k, body in enumerate(bodies):
        assert again.solid.bodies[k].name == other.body.bodies[k].name == body.name
        assert np.array_equal(again[k].stress(), result[k].stress())
        support = result[k].balance()["support"]
        for one in (again[k], copied(result[k])):
            assert np.array_equal(one.balance()["support"], support)
    for ours, theirs in zip(problem.pairs, other.pairs, strict=True):
        k = next(k for k, body in enumerate(problem.body.bodies) if ours.body is body)
        assert theirs.body is other.body.bodies[k]
        if ours.two_bodies:
            assert any(theirs.opposite.body is body for body in other.body.bodies)
    # The same arithmetic on the same numbers.
    assert np.abs(other.solve().u - result.u).max() <= 1e-13 * np.abs(result.u).max()


def test_copies_are_independent(make):
    body = make.block(4)
    for copied in (sent, copy.deepcopy, copy.copy):
        other, before = copied(body), body.f.copy()
        other.load("top", (0.0, -1.0)).fix("bottom", "x")
        assert np.array_equal(body.f, before)
        assert len(body._supports) + 1 == len(other._supports)
        assert other.constraint[0].shape[1] < body.constraint[0].shape[1]
    problem = pair()
    before = problem.solve()
    for copied in (sent, copy.deepcopy):
        other = copied(problem)
        other.body.bodies[0].load("top", (0.0, -0.2))
        other.body.bodies[1].fix("left", "x")
        assert other.solve().contact_force > 2 * before.contact_force
    assert np.array_equal(problem.solve().u, before.u)


def test_basis_is_sent_once_and_without_its_tables(make):
    """Steps of a history share matrices, rows and Basis; tables are made anew."""
    several = LoadStepper(pair()).load("top", (0.05, 0.0), np.sin, body="upper")
    several.run([0.5])
    ahead = sent(several).step(1.5)
    assert np.abs(ahead.u - several.step(1.5).u).max() <= 1e-13 * np.abs(ahead.u).max()
    loaded = sent(several.history)
    assert loaded[0].solid.bodies[1].basis is loaded[1].solid.bodies[1].basis
    stepper = LoadStepper(make.problem(8, friction=0.3)).load("top", (0.0, -0.1))
    history = stepper.run([1.0, 2.0, 3.0, 4.0])
    one, four = (len(pickle.dumps(history[:n])) for n in (1, 4))
    step = sum(array.nbytes for array in (history[0].u, history[0].system.load))
    assert four - one < 3 * 5 * step
    loaded = sent(history)
    assert np.array_equal(loaded.times, history.times)
    assert [r.kkt for r in loaded] == [r.kkt for r in history]
    assert loaded[0].system.body.basis is loaded[3].system.body.basis
    assert loaded[0].system.rows.G is loaded[3].system.rows.G
    tables = sum(np.asarray(field[0]).nbytes for field in history[0].system.body.basis.basis)
    assert one < tables


def test_what_stays_behind_is_told(make):
    """A function that cannot be imported is lost; the numbers that it gave are not."""
    problem = sent(make.dome(ElementHex1, 3))
    with pytest.raises(InputError, match=r"dome.*stayed in the process.*module"):
        problem.body.fix("bottom", "x").constraint  # noqa: B018
    with pytest.raises(InputError, match="stayed in the process"):
        problem.obstacle = problem.obstacle
    problem = make.problem(4)
    stepper = LoadStepper(problem).load("top", (0.0, -0.1), lambda t: t)
    with pytest.raises(InputError, match=r"lambda.*stayed in the process"):
        sent(stepper).run([1.0])
    assert len(sent(LoadStepper(problem).load("top", (0.0, -0.1), np.sin)).run([1.0])) == 1
    block = sent(LayeredBlock(1.0, COATED).fix("top", "y", lambda x: -0.01 * x[0]))
    with pytest.raises(InputError, match="stayed in the process"):
        block.fix("left", "y").prescribed  # noqa: B018


OBSTACLES = [
    Plane((0.0, -0.01), (0.0, 1.0)),
    Cylinder((0.0, -2.0), 1.5),
    Sphere((0.0, -2.0), 1.5),
    Parabola((0.0, 0.0), 3.0),
    SignedDistance(slope),
    SurfaceMesh([[0.0, -1.0, 1.0], [-0.1, -3.0, -3.0]], [[0, 1, 2], [1, 2, 0]]),
    ClosestPoint(Plane((0.0, -1.0), (3.0, 4.0))),
]


@pytest.mark.parametrize("obstacle", OBSTACLES, ids=lambda o: type(o).__name__)
def test_obstacles(obstacle):
    x, n = np.array([[0.1, 0.2], [0.05, 0.02]]), np.array([[0.0, 0.0], [-1.0, -1.0]])
    for copied in (sent, copy.deepcopy, copy.copy):
        assert np.array_equal(copied(obstacle)(x, n), obstacle(x, n))
        rigid = Rigid(obstacle, displacement=(0.0, 0.1))
        assert repr(copied(rigid)) == repr(rigid)


@pytest.mark.parametrize(
    "error",
    [
        contact.errors.Unbounded("loose", np.arange(3.0)),
        contact.errors.NotConverged("slow", (1, 2)),
        gpu.errors.Infeasible("no point", np.arange(3.0)),
        gpu.errors.Unbounded("no bound", np.arange(3.0)),
        gpu.errors.NotConverged("slow", eigenvalues=np.arange(2.0)),
    ],
    ids=lambda error: f"{type(error).__module__}.{type(error).__name__}",
)
def test_errors(error):
    """One that cannot be made anew ends a pool of workers, or hangs it."""
    for again in (sent(error), copy.copy(error)):
        assert type(again) is type(error)
        assert str(again) == str(error) == error.args[0]
        assert repr(vars(again)) == repr(vars(error))


def solved(body):
    """Runs in a process that has imported this file, and nothing else."""
    return ContactProblem(body, "bottom", slope, 0.3).solve()


@pytest.mark.turns(4)
def test_worker_that_is_spawned():
    mesh = MeshQuad().refined(2).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=1.0, nu=0.3)
    body.fix("top", "x").fix("top", "y", -0.03)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        try:
            result = pool.apply_async(solved, (body,)).get(timeout=120)
        except AttributeError:
            pytest.skip("this file cannot be imported by name here")
    here = solved(body)
    assert np.abs(result.u - here.u).max() <= 1e-13 * np.abs(here.u).max()
    assert max(result.kkt.values()) < 1e-10
