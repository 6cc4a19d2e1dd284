"""Contact on a grid beside the dense solvers of the package, the matrix assembled from products."""

import numpy as np
import pytest
from dense_laws import forces_of

from contact import GridContact, HalfSpace, PeriodicLayers, Rigid, Status
from contact.spectral.grid_problem import GridProblem

CASES = [
    ((32,), 0.3, None, "coulomb"),
    ((31,), 0.2, 0.3, "coulomb"),
    ((32,), 0.45, 0.1, "tresca"),
    ((10, 8), 0.3, None, "coulomb"),
    ((9, 8), 0.3, 0.4, "coulomb"),
    ((8, 8), 0.1, 1.0, "coulomb"),
    ((8, 9), 0.3, 0.05, "tresca"),
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("by", ["displacement", "force"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("shape", "nu", "friction", "law"), CASES)
@pytest.mark.parametrize("seed", [0, 1])
def test_forces_are_those_of_the_dense_solver(shape, nu, friction, law, sign, by, seed):
    rng = np.random.default_rng(seed)
    dim = len(shape) + 1
    normal = sign * np.eye(dim)[-1]
    space = HalfSpace((1.0,) * len(shape), shape, 2.0, nu, normal=normal)
    heights = 0.02 * rng.uniform(0, 1, shape)
    if by == "force":
        drive = -normal * 0.01
        drive[:-1] = 0.4 * (friction or 0.0) * 0.01 * np.array([0.8, 0.6])[: dim - 1]
        ground = Rigid(heights, force=drive)
    else:
        ground = Rigid(heights, displacement=(0.003,) * (dim - 1) + (-sign * 0.008,))
    contact = GridContact(space, ground, friction or 0.0, law)
    result = contact.solve(tol=1e-10)
    cell = np.prod(space.spacing)
    g = friction if law == "coulomb" or friction is None else friction * cell
    wanted = forces_of(contact._case(None).problem(), g, law)
    assert np.any(wanted[0] > 0)
    assert result.forces == pytest.approx(wanted, abs=1e-10 * np.abs(wanted).max())
    assert result.pressure == pytest.approx(result.forces[0] / cell)
    if by == "force":
        on_body = result.resultant
        kept = drive if friction else np.append(on_body[:-1], drive[-1])
        assert on_body == pytest.approx(kept, abs=1e-10)
    else:
        assert result.motion == pytest.approx(ground.components(dim)[0][:dim])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("shape", [(24,), (6, 7)])
def test_history_equals_dense_steps(shape, law):
    """Pressed, dragged, dragged back: friction acts on the increments."""
    rng = np.random.default_rng(3)
    dim = len(shape) + 1
    space = HalfSpace((1.0,) * len(shape), shape, 1.0, 0.3)
    F = 0.5 if law == "coulomb" else 0.006 * rng.uniform(0.5, 1.0, shape)
    bound = F if law == "coulomb" else F * np.prod(space.spacing)
    heights = 0.02 * rng.uniform(0, 1, shape)
    moves = [(0.0, 0.005), (0.003, 0.007), (0.001, 0.007), (0.0005, 0.006)]
    obstacles = [
        Rigid(heights, displacement=(x,) + (0.0,) * (dim - 2) + (press,)) for x, press in moves
    ]
    results = GridContact(space, 0.0, F, law).history(obstacles)
    slip = np.zeros((dim - 1, *shape))
    for obstacle, result in zip(obstacles, results, strict=True):
        alone = GridContact(space, obstacle, F, law)._case(None).problem()
        v0 = alone.v0.copy()
        v0[1:] -= slip
        step = GridProblem(space, v0, alone.gap, alone.force)
        wanted = forces_of(step, bound, law)
        assert result.forces == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
        slip = (alone.v0 - alone.W(wanted))[1:]
        assert result.slip == pytest.approx(slip, abs=1e-10)
    one_go = GridContact(space, obstacles[-1], F, law).solve()
    assert np.abs(one_go.shear - results[-1].shear).max() > 0.01 * np.abs(one_go.shear).max()


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("shape", [(16,), (6, 8)])
def test_layers_on_a_half_space(shape, law):
    """A coating in millimetres and megapascals, pressed and dragged by forces."""
    rng, dim = np.random.default_rng(8), len(shape) + 1
    sides = (3.0, 4.0)[: dim - 1]
    block = PeriodicLayers(sides, [(0.2, 2, 4e5, 0.2)], shape, base=(2e5, 0.3))
    load = 50.0 * np.prod(sides)
    given = (0.3 if law == "coulomb" else 20.0) * rng.uniform(0.8, 1.0, shape)
    drag = 0.1 * load * np.array([0.8, 0.6])[: dim - 1]
    ground = Rigid(1e-3 * rng.uniform(0, 1, shape), force=(*drag, load))
    contact = GridContact(block, ground, given, law)
    result = contact.solve()
    bound = given if law == "coulomb" else given * result.cell
    wanted = forces_of(contact._case(None).problem(), bound, law)
    assert result.forces == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
    assert result.resultant == pytest.approx((*drag, load))
    assert {Status.STICK, Status.SLIP} <= set(result.status.ravel())


def test_what_sticks_keeps_its_place():
    """Between two steps stuck points move with the obstacle, slipping ones against their shear."""
    shape = (12, 12)
    space = HalfSpace((1.0, 1.0), shape, 1.0, 0.3)
    heights = 0.02 * np.random.default_rng(5).uniform(0, 1, shape)
    drags = [Rigid(heights, displacement=(x, 0.5 * x, 0.008)) for x in (0.0, 0.002, 0.004)]
    first, second, third = GridContact(space, 0.0, 0.6).history(drags)
    for before, after in ((first, second), (second, third)):
        moved = after.slip - before.slip
        stick, slip = after.status == Status.STICK, after.status == Status.SLIP
        assert np.any(stick)
        assert np.any(slip)
        assert np.abs(moved[:, stick]).max() < 1e-11
        t, d = after.shear[:, slip], moved[:, slip]
        assert np.all(np.sum(t * d, axis=0) <= 0)
        assert t[0] * d[1] == pytest.approx(t[1] * d[0], abs=1e-12)
        assert np.hypot(*t) == pytest.approx(0.6 * after.pressure[slip], rel=1e-8)
