"""Bodies, problems, results and histories go to other processes and come back the same."""

import copy
import multiprocessing
import pickle

import numpy as np
import pytest
from pressed_pairs import pair, slit, stack
from skfem import ElementHex1, ElementQuad2, ElementTriP2, MeshQuad

import contact.errors
import gpu.errors
from contact import (
    ClosestPoint,
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
)
from skfem_adini import ElementQuadAdini


def sent(thing):
    return pickle.loads(pickle.dumps(thing))


def slope(x):
    return 0.01 + 0.01 * x[0]


def layered():
    block = LayeredBlock(1.0, [(0.25, 4, 1.0, 0.4), (0.75, 12, 10.0, 0.3)], sides="x")
    block.fix("top", "y", lambda x: -0.02 - 0.01 * x[0])
    return ContactProblem(block, "bottom", 0.01, 0.3)


def cut():
    mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 12), np.linspace(-1.1, 0, 7))
    disk = CutBody(mesh.with_defaults(), lambda x: x[0] ** 2 + x[1] ** 2 - 1, E=1.0, nu=0.3)
    disk.fix("top", "x").fix("top", "y", lambda x: -0.05 + 0 * x[0])
    return ContactProblem(disk, disk.arc(), Plane((0.0, -1.02), (0.0, 1.0)), 0.2)


def stamped(make):
    """A free obstacle on a body of which no displacement is a function."""
    body = make.block(4, sides=()).fix("top", "y").fix("left", "x")
    stamp = Rigid(0.0, force=(None, 0.1), moment=0.0, centre=(0.5, 0.0))
    return ContactProblem(body, "bottom", stamp, 0.3)


PROBLEMS = {
    "Adini": lambda make: make.problem(4, friction=0.3),
    "Q2": lambda make: make.problem(4, friction=0.3, element=ElementQuad2),
    "TriP2": lambda make: make.problem(4, friction=0.3, element=ElementTriP2),
    "Hex1, functions": lambda make: make.dome(ElementHex1, 3),
    "layers": lambda make: layered(),
    "cut": lambda make: cut(),
    "Rigid": stamped,
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("copied", [sent, copy.deepcopy, copy.copy])
@pytest.mark.parametrize("name", PROBLEMS)
def test_problems_and_results(name, copied, make):
    """Bit for bit, the certificate too; a factorisation is made anew and gives the same."""
    problem = PROBLEMS[name](make)
    result = problem.solve()
    again = copied(result)
    assert again.kkt == result.kkt
    for field in ("u", "mu", "t", "pressure", "slip", "status", "resultant"):
        assert np.array_equal(getattr(again, field), getattr(result, field)), field
    assert np.array_equal(again.balance()["support"], result.balance()["support"])
    points = result.x_nominal
    if name != "cut":  # the arc lies outside of some cells
        assert np.array_equal(again.sample(points), result.sample(points))
    # The same arithmetic on the same numbers.
    assert np.abs(copied(problem).solve().u - result.u).max() <= 1e-13 * np.abs(result.u).max()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("copied", [sent, copy.deepcopy, copy.copy])
@pytest.mark.parametrize("make_pairs", [pair, stack, slit])
def test_several_bodies(make_pairs, copied):
    """Bodies, and the pairs that name them, stay together; each body has its result."""
    problem = make_pairs()
    result, other = problem.solve(), copied(problem)
    for one, again in ((problem, other), (result.system, copied(result).system)):
        assert [b.name for b in again.body.bodies] == [b.name for b in one.body.bodies]
    for ours, theirs in zip(problem.pairs, other.pairs, strict=True):
        k = next(k for k, body in enumerate(problem.body.bodies) if ours.body is body)
        assert theirs.body is other.body.bodies[k]
        if ours.two_bodies:
            assert any(theirs.opposite.body is body for body in other.body.bodies)
    assert np.abs(other.solve().u - result.u).max() <= 1e-13 * np.abs(result.u).max()
    again = copied(result)
    assert again.kkt == result.kkt
    for k in range(len(problem.body.bodies)):
        assert np.array_equal(again[k].nodal_stress(), result[k].nodal_stress())
        assert np.array_equal(again[k].resultant, result[k].resultant)
    fewer = copied(result[0])
    assert np.array_equal(fewer.balance()["support"], result[0].balance()["support"])


@pytest.mark.parametrize("copied", [sent, copy.deepcopy])
def test_copies_of_several_bodies_are_independent(copied):
    problem = pair()
    before, other = problem.solve(), copied(problem)
    other.body.bodies[0].load("top", (0.0, -0.2))
    other.body.bodies[1].fix("left", "x")
    assert other.solve().contact_force > 2 * before.contact_force
    assert np.array_equal(problem.solve().u, before.u)


def test_history_of_several_bodies():
    stepper = LoadStepper(pair()).load("top", (0.05, 0.0), np.sin, body="upper")
    history = stepper.run([0.5, 1.0])
    loaded = sent(history)
    assert [r.kkt for r in loaded] == [r.kkt for r in history]
    assert loaded[0].solid.bodies[1].basis is loaded[1].solid.bodies[1].basis
    ahead = sent(stepper).step(1.5)
    assert np.abs(ahead.u - stepper.step(1.5).u).max() <= 1e-13 * np.abs(ahead.u).max()


def test_copies_are_independent(make):
    """Loads and supports of one do not reach the other."""
    body = make.block(4)
    for copied in (sent, copy.deepcopy, copy.copy):
        other, before = copied(body), body.f.copy()
        other.load("top", (0.0, -1.0)).fix("bottom", "x")
        assert np.array_equal(body.f, before)
        assert len(body._supports) + 1 == len(other._supports)
        assert other.constraint[0].shape[1] < body.constraint[0].shape[1]


def test_basis_is_sent_once_and_without_its_tables(make):
    """Steps of a history share matrices, rows and Basis; tables are made anew."""
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
    block = sent(layered().body)
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
    """A body goes there, a result comes back."""
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
