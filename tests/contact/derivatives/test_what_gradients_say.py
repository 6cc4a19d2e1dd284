"""Histories, work, degenerate points, files, and what has no derivative."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from cases import Block, Stack
from skfem import ElementQuad1, ElementQuad2, MeshQuad
from test_gradients import cotangents, difference

from contact import (
    Anisotropic,
    ContactProblem,
    ContactResult,
    ContactWarning,
    Cylinder,
    ElasticBody,
    InputError,
    LayeredBlock,
    LoadStepper,
    Moved,
    NotConverged,
    Pair,
    Plane,
    Sphere,
)
from contact.condensation import condensed_contact
from contact.condensation.schur import ForwardCache
from contact.condensation.solved_body import SolvedBody
from contact.derivatives.adjoint import _certify
from contact.obstacles.rigid_motion import matrix_of

quiet = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
TIMES = np.linspace(0.02, 1.0, 50)


def dragged(law="coulomb", friction=0.3, E=2.0, amplitude=0.02, move=0.0):
    """Pressed on a ball, then dragged to and fro while one side is pulled."""
    block = Block(ElementQuad2, cells=4)
    mesh = block.mesh
    mesh = type(mesh)(mesh.doflocs + move, mesh.t, sort_t=False).with_boundaries(mesh.boundaries)
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=E, nu=0.3).fix("top", "xy")
    problem = ContactProblem(body, "bottom", Sphere((0.35, -0.74), 0.75), friction, law)
    stepper = LoadStepper(problem, halvings=0).move("top", "y", -0.04, lambda t: min(1.0, 4 * t))
    stepper.move("top", "x", lambda x: amplitude * (1 + 0.1 * x[0]), lambda t: np.sin(7 * t))
    return stepper.load("left", lambda x: np.array([0.02 * x[1], 0.0 * x[1]]))


@quiet
@pytest.mark.slow
@pytest.mark.parametrize(("law", "friction"), [("coulomb", 0.3), ("tresca", 0.02)])
def test_histories_of_fifty_steps(law, friction):
    stepper = dragged(law, friction)
    history = stepper.run(TIMES)
    rng, first = np.random.default_rng(0), history[0]
    parts = ("resultant", "pressure", "shear", "slip")
    given = {p: rng.standard_normal((50, *getattr(first, p).shape)) / 50 for p in parts}
    gradient = history.vjp(**given)
    assert not gradient.degenerate.any()
    status = np.concatenate([r.status for r in history])
    assert set(status) >= {1, 2}

    def value(**changed):
        results = dragged(law, **{"friction": friction, **changed}).run(TIMES)
        return sum(
            np.sum(w * getattr(r, p))
            for p, v in given.items()
            for w, r in zip(v, results, strict=True)
        )

    body = stepper.problem.body
    moved = body.support_motion("top", "x", lambda x: 1 + 0.1 * x[0])
    along = sum(
        s.support @ moved * np.sin(7 * t) for s, t in zip(gradient.steps, TIMES, strict=True)
    )
    V = 0.05 * rng.uniform(-1.0, 1.0, body.mesh.doflocs.shape)
    for found, change in (
        (gradient.friction.sum(), lambda s: {"friction": friction + s}),
        (gradient.E, lambda s: {"E": 2.0 + s}),
        (along, lambda s: {"amplitude": 0.02 + s}),
        (np.sum(gradient.vertices[0] * V), lambda s: {"move": s * V}),
    ):
        expected = difference(lambda s, c=change: value(**c(s)), 1e-6)
        assert abs(found - expected) < 1e-6 * abs(expected)
    backward = []
    stepper.vjp(
        TIMES,
        lambda k, result: {p: v[k] for p, v in given.items()},
        lambda k, step: backward.append((k, step.friction)),
    )
    assert [k for k, _ in backward] == list(range(49, -1, -1))
    total = sum(f for _, f in backward)
    np.testing.assert_allclose(total, gradient.friction, rtol=1e-9, atol=1e-12)


@quiet
def test_one_substitution(monkeypatch):
    """The gradient by everything but moduli and vertices: one forward elimination, no factor."""
    problem = Block(ElementQuad2)()
    result = problem.solve()
    counted = []
    found = ForwardCache._forward
    monkeypatch.setattr(ForwardCache, "_forward", lambda s, v: counted.append(v) or found(s, v))
    monkeypatch.setattr(condensed_contact, "choose_condensation", None)
    result.vjp(**cotangents(result))
    different = {v.tobytes() for v in counted}
    assert len(different) == 1


@quiet
def test_operators(monkeypatch):
    """The compliance as an operator gives the gradient of the dense one."""
    gradients = []
    for ways in (None, False):
        problem = Block(ElementQuad1, cells=3)()
        if ways is False:
            monkeypatch.setattr(
                condensed_contact,
                "choose_condensation",
                lambda *_: (lambda body, rows, solver, _: SolvedBody(body, rows, solver), False),
            )
        result = problem.solve()
        gradients.append(result.vjp(**cotangents(result)))
    one, other = gradients
    for name in ("load", "gap", "friction", "support"):
        a, b = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(b, a, rtol=1e-7, atol=1e-8 * np.abs(a).max())


@quiet
def test_a_turned_plane():
    """By a rotation about any point, of a plane, as `Moved` turns it."""
    block, plane, centre = Block(ElementQuad2), Plane((0.3, 0.005), (0.02, 1.0)), (0.1, -0.2)

    def solved(turn):
        moved = Moved(plane, (0.0, 0.0), float(turn), centre)
        return block(gap=moved).solve()

    result = solved(0.0)
    given = cotangents(result)
    numbers = block(gap=np.full(result.mu.size, -0.01))
    without_shape = numbers.solve().vjp(u=given["u"])
    with pytest.raises(InputError, match="no shape that moves"):
        without_shape.pose()
    problem = block(gap=Moved(plane, (0.0, 0.0), 0.0, centre))
    found = problem.solve().vjp(**given).pose(centre)[0, 2]
    expected = difference(
        lambda s: sum(np.sum(v * getattr(solved(s), p)) for p, v in given.items()), 1e-5
    )
    assert abs(found - expected) < 1e-6 * abs(expected)
    assert matrix_of(np.array([0.1]))[1, 0] > 0  # counter-clockwise


def test_a_tool_on_one_of_two_bodies_moves():
    """Its pose has a row, that of the pair of bodies is zero."""
    square = MeshQuad().refined(2).with_defaults()
    meshes = square.translated((0, 1)), square
    upper, lower = (ElasticBody.from_mesh(mesh, E=1.0, nu=0.3) for mesh in meshes)
    lower.fix("bottom", "xy")
    upper.fix("left", "x")

    def solved(y):
        tool = Moved(Cylinder((0.4, 2.98), 1.0), (0.0, float(y)))
        pairs = [Pair(upper, "bottom", lower, "top"), Pair(upper, "top", tool)]
        return ContactProblem([upper, lower], pairs).solve()

    result = solved(0.0)
    w = np.random.default_rng(0).standard_normal(result.u.size)
    found = result.vjp(u=w).pose()
    assert not found[0].any()
    expected = difference(lambda y: float(w @ solved(y).u), 1e-5)
    assert abs(found[1, 1] - expected) < 1e-6 * abs(expected)


def test_degenerate_points_are_flagged():
    """A gap that just closes: forces grow on one side only."""
    body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), ElementQuad1(), E=1, nu=0.0)
    gaps = np.full(5, 1.0)
    problem = ContactProblem(body.fix("top", "xy"), "bottom", gaps)
    problem.body.fix("top", "y", 0.0).load("right", (0.01, 0.0))
    free = problem.solve()
    problem.obstacle = np.where(np.arange(5) == 2, free.normal_displacement, 1.0)
    touching = problem.solve()
    with pytest.warns(ContactWarning, match="touch without force"):
        gradient = touching.vjp(pressure=np.ones(5))
    assert gradient.degenerate.tolist() == [False, False, True, False, False]


@quiet
def test_files_copies_and_lost_problems(tmp_path):
    problem = Block(ElementQuad1)()
    result = problem.solve()
    given = cotangents(result)
    there = result.vjp(**given)
    again = ContactResult.load(result.save(tmp_path / "r.npz"))
    alone = Block(ElementQuad1)().solve().vjp(**given)  # its problem lives no longer
    np.testing.assert_allclose(alone.vertices, there.vertices, rtol=1e-8, atol=1e-10)
    for other in (again, pickle.loads(pickle.dumps(result))):
        gradient = other.vjp(**given)
        np.testing.assert_allclose(gradient.gap, there.gap, rtol=1e-8, atol=1e-10)
        with pytest.raises(InputError, match="vertices: "):
            gradient.vertices  # noqa: B018
    problem.friction = 0.1  # the result remembers the problem as it was
    after = result.vjp(**given).vertices
    np.testing.assert_allclose(after, there.vertices, rtol=1e-8, atol=1e-10)
    pair = Stack()()
    stored = ContactResult.load(pair.solve().save(tmp_path / "p.npz"))
    with pytest.raises(InputError, match="give its problem"):
        stored.vjp(resultant=(0.0, 1.0))
    assert stored.vjp(resultant=(0.0, 1.0), problem=pair)[0].E != 0.0


def _heated():
    problem = Block(ElementQuad1)()
    problem.body.heat(1.0, 1e-4)
    problem = ContactProblem(problem.body, "bottom", 0.03)
    return problem.solve().vjp(resultant=(0.0, 1.0)).E


def _anisotropic():
    mesh = Block(ElementQuad1).mesh
    body = ElasticBody.from_mesh(
        mesh, ElementQuad1(), material=Anisotropic(np.diag([1.0, 1.0, 1.0, 0.4, 0.4, 0.4]))
    )
    problem = ContactProblem(body.fix("top", "xy", -0.02), "bottom", 0.0)
    return problem.solve().vjp(resultant=(0.0, 1.0)).E


def _layered():
    block = LayeredBlock(1.0, [(0.5, 4, 1.0, 0.3)], sides="x").load("top", (0.0, -0.1))
    return ContactProblem(block, "bottom", 0.01).solve().vjp(resultant=(0.0, 1.0)).E


def _tied():
    problem = Block(ElementQuad1)()
    problem.body.tie("top", "y")
    return problem.solve().vjp(resultant=(0.0, 1.0)).vertices


def _finite():
    stepper = LoadStepper(Stack()(), sliding="finite", largest_rotation=1.0)
    return stepper.run([1.0])[0].vjp(resultant=(0.0, 1.0))


def _halved():
    history = dragged().run(TIMES[:3])
    return type(history)(history.times[::2], history.results[::2]).vjp(resultant=np.ones((2, 2)))


def _of_two():
    return Stack()().solve().vjp(resultant=(0.0, 1.0)).E


@quiet
@pytest.mark.parametrize(
    ("made", "words"),
    [
        (_heated, "heated"),
        (_anisotropic, "anisotropic"),
        (_layered, "LayeredBlock has none"),
        (_tied, "equations between dofs"),
        (_finite, "finite sliding"),
        (_halved, "does not follow"),
        (_of_two, "several bodies"),
        (lambda: Block(ElementQuad1)().solve().vjp(pressure=np.ones(2)), "pressure: expected"),
        (lambda: Block(ElementQuad1)().solve().vjp(u=[np.nan]), "u: expected"),
        (lambda: dragged().run(TIMES[:2]).vjp(resultant=np.ones((3, 2))), "one a step"),
        (lambda: dragged().vjp(TIMES[:2], dict, dict, keep=-1), "keep"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_what_has_no_derivative(made, words):
    with pytest.raises(InputError, match=words):
        made()


@quiet
def test_forces_that_are_not_determined():
    """Two rows of one unknown: the certificate refuses a wrong adjoint."""
    with pytest.raises(NotConverged, match="leaves a residual"):
        _certify(1e-3, 1.0)
