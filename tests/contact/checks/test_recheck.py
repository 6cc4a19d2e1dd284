"""The certificate in pairs of numbers: that of float64, exact, and what it finds of forgeries."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from certified_cases import CASES, in_pairs, square
from exact_residuals import exact_block_forces, exact_residuals, exact_strained_forces
from pressed_pairs import pair
from skfem import ElementQuad1, ElementQuad2, ElementTriP1

from contact import (
    ContactProblem,
    ContactResult,
    DistributedBody,
    DynamicStepper,
    ElasticBody,
    GridContact,
    HalfSpace,
    InputError,
    LayeredBlock,
    LoadStepper,
    MissingDependency,
    NotConverged,
    Rigid,
    Status,
    recheck,
)
from contact.checks.paired_bodies import paired_body
from skfem_adini import ElementQuadAdini
from tests.contact.condensation.device_cases import CASES as HELD


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", CASES)
def test_every_family(case, make):
    """Of a solution, and of states that violate every law, whose residuals have all digits."""
    result = CASES[case](make).solve()
    found = recheck(result)
    assert list(found) == list(result.kkt)
    for name, value in result.kkt.items():
        assert abs(found[name] - value) < 1e-11, name
    rng = np.random.default_rng(22)
    size = np.abs(result.u).max(), np.abs(result.mu).max(), np.abs(result.mu).max()
    state = (result.u, result.mu, result.t)
    u, mu, t = (v + s * rng.standard_normal(v.shape) for v, s in zip(state, size, strict=True))
    motion = None if result.motion is None else result.motion + size[0]
    wrong = replace(result, u=u, mu=mu, t=t, motion=motion)
    found = in_pairs(wrong)
    for name, value in wrong.kkt.items():
        assert abs(found[name] - value) < 1e-9 * max(1.0, value), name
    with pytest.raises(NotConverged, match="equilibrium"):
        recheck(wrong)


def test_from_a_file_and_along_a_history(make, tmp_path):
    problem = ContactProblem(square(make, 4).fix("top", "xy"), "bottom", 0.0, 0.3)
    stepper = LoadStepper(problem).move("top", "y", -0.05, lambda t: min(1.0, 4 * t))
    history = stepper.move("top", "x", 0.08, lambda t: np.sin(6 * t)).run(np.linspace(0.2, 1, 5))
    for result in history.results:
        found = recheck(result)
        assert all(abs(found[name] - value) < 1e-12 for name, value in result.kkt.items())
    assert history.results[-1].system.slip_from is not None
    last = history.results[-1]
    assert recheck(ContactResult.load(last.save(tmp_path / "last"))) == recheck(last)


def test_in_flight_and_on_impact(make):
    """The loads of a step with inertia cancel where nothing touches: their terms are the scale."""
    problem = ContactProblem(square(make, 4), "bottom", 0.05)
    for step in DynamicStepper(problem, density=1.0, dt=0.1, velocity=(0.02, -0.2)).run(6):
        found = recheck(step.result)
        for name, value in step.result.kkt.items():
            assert abs(found[name] - value) < 1e-12, (step.number, name)


def test_a_body_far_from_its_place_or_turned_until_it_touches(make):
    """A translation costs digits of u alone; forces that are rounding of a motion are balanced."""
    for shift, tol in ((0.0, 1e-10), (1e3, 1e-6)):
        body = square(make, 4).fix("left", "x", shift).load("top", (0.1, -0.1))
        result = ContactProblem(body, "bottom", 0.0).solve(tol=1e-6)
        assert recheck(result, tol)["equilibrium"] < 1e-15

    def move(x):
        return np.array([-0.01 * x[1], 0.01 * x[0] - 0.03])

    for element in (ElementQuad1, ElementQuad2, ElementQuadAdini):
        body = square(make, 3, element)
        for c in range(2):
            body.fix("top", c, lambda x, c=c: move(x)[c])
        result = ContactProblem(body, "bottom", lambda x: -move(x)[1], 0.6).solve()
        assert np.abs(result.pressure).max() < 1e-11
        assert recheck(result)["balance"] < 1e-10
        # No rounding is added: what is left is less than that of one number among the forces.
        solved = make.solved(n=8, element=element)[1]
        assert recheck(solved)["equilibrium"] < 4 * np.finfo(float).eps


@pytest.mark.gpu
@pytest.mark.parametrize("case", ["Adini", "Hex1", "floating Quad1", "pair of Hex1", "cut"])
def test_results_of_a_device(case, make):
    pose, element = HELD[case]
    problem = pose(make, element)
    try:
        problem.condense(device="cuda")
    except MissingDependency:
        pytest.skip("cuDSS is not there")
    result = problem.solve()
    assert max(recheck(result).values()) < 1e-10


def test_what_cannot_be_rechecked_is_named(make):
    result = pair().solve()
    with pytest.raises(InputError, match="result: expected a ContactResult, got BodyResult"):
        recheck(result["upper"])
    ground = Rigid(np.zeros((8, 8)), force=(0.0, 0.0, 0.1))
    grid = GridContact(HalfSpace((1.0, 1.0), (8, 8), E=1.0, nu=0.3), ground)
    with pytest.raises(InputError, match=r"result: .* got GridResult"):
        recheck(grid.solve())
    body = make.block(4, ElementQuad1)
    spread = DistributedBody(body.mesh, ElementQuad1(), contact="bottom", E=2.0, nu=0.3)
    spread.fix("top", "xy", -0.01)
    with pytest.raises(InputError, match="a DistributedBody, of which no process has all forces"):
        recheck(ContactProblem(spread, "bottom", 0.0).solve())
    wrong = replace(result, u=np.full_like(result.u, np.nan))
    with pytest.raises(InputError, match="NaN"):
        recheck(wrong)


def at_bound(result):
    """A sticking point is said to slide: its friction reaches the bound."""
    point = np.flatnonzero(result.status == Status.STICK)[0]
    assert np.abs(result.slip[point]) < 1e-12
    t = result.t.copy()
    t[point] = np.sign(t[point]) * result.system.bound(result.mu)[point]
    return {"t": t}


def moved(array, index, by):
    array = array.copy()
    array[index] += by
    return array


FORGED = {
    "a multiplier": (lambda r: {"mu": moved(r.mu, r.mu.argmax(), 1e-8)}, "equilibrium"),
    "a displacement": (lambda r: {"u": moved(r.u, free_dof(r), 1e-7)}, "equilibrium"),
    "a held displacement": (lambda r: {"u": moved(r.u, held_dof(r), 1e-7)}, "support"),
    "closed to open": (lambda r: {"mu": np.where(r.mu == r.mu.max(), 0.0, r.mu)}, "balance"),
    "stick to slip": (at_bound, "equilibrium"),
    "beyond the cone": (lambda r: {"t": moved(r.t, r.t.argmax(), r.mu.max())}, "cone"),
    "against the slip": (lambda r: {"t": -r.t}, "slip"),
    "tension": (lambda r: {"mu": moved(r.mu, r.mu.argmin(), -2 * r.mu.max())}, "sign"),
    "a force without contact": (
        lambda r: {"mu": moved(r.mu, r.gap.argmax(), r.mu.max())}, "complementarity"),
    "a gap": (lambda r: {"system": of_rows(r, gap=r.system.rows.gap - 1e-3)}, "penetration"),
    "a load": (
        lambda r: {"system": replace(r.system, load=moved(r.applied, free_dof(r), 1e-6))},
        "equilibrium",
    ),
    "a coefficient": (
        lambda r: {"system": replace(r.system, friction=0.5 * r.system.friction)}, "cone"),
}  # fmt: skip


def of_rows(result, **changed):
    return replace(result.system, rows=replace(result.system.rows, **changed))


def free_dof(result):
    P = result.system.body.constraint[0]
    return np.flatnonzero(np.diff(P.indptr))[-1]


def held_dof(result):
    P = result.system.body.constraint[0]
    return np.flatnonzero(np.diff(P.indptr) == 0)[0]


@pytest.fixture(scope="module")
def lifted(make):
    """Points that are open, stick and slip."""
    body = square(make, 8).fix("top", "y", -0.02).fix("top", "x", 0.005)
    problem = ContactProblem(body, "bottom", lambda x: 0.06 * np.maximum(x[0] - 0.6, 0), 0.2)
    result = problem.solve()
    assert set(result.status) == {0, 1, 2}
    return result


@pytest.mark.parametrize("forged", FORGED)
def test_what_was_tampered_with_is_named(forged, lifted):
    change, name = FORGED[forged]
    recheck(lifted)
    with pytest.raises(NotConverged, match=f"fails its certificate.* {name} ") as caught:
        recheck(replace(lifted, **change(lifted)))
    assert caught.value.history == lifted.history


def test_tolerance(lifted):
    largest = max(recheck(lifted).values())
    with pytest.raises(NotConverged, match=f"at tolerance {largest / 2:.1e}"):
        recheck(lifted, largest / 2)
    wrong = replace(lifted, mu=lifted.mu * (1 + 1e-7))
    assert recheck(wrong, 1e-5)["equilibrium"] > 1e-10
    assert recheck(replace(wrong, tol=1e-5)) == recheck(wrong, 1e-5)
    loose = replace(wrong, tol=None, method="fixed_point")  # which is held to 1e-6
    assert recheck(loose) == recheck(wrong, 1e-5)
    for tol in (0.0, -1e-9, 1.0, np.nan, "small", [1e-9, 1e-8]):
        with pytest.raises(InputError, match="tol"):
            recheck(lifted, tol)


def test_friction_has_the_slack_of_its_method(lifted):
    wrong = replace(lifted, t=lifted.t * (1 + 1e-9), tol=1e-5)
    recheck(wrong)
    over = recheck(wrong)["cone"]
    assert 1e-10 < over < 1e-8
    tight = replace(wrong, t=lifted.t * (1 + 1e-3), tol=1e-2, slack=0.0)
    assert recheck(tight)["cone"] > 1e-5
    with pytest.raises(NotConverged, match="cone"):
        recheck(replace(tight, tol=1e-6))
    with pytest.raises(NotConverged) as caught:
        recheck(replace(tight, tol=1e-6, slack=1e-2))
    assert "cone" not in str(caught.value)


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuadAdini], ids=lambda e: e.__name__)
def test_residuals_are_those_of_the_stored_numbers(element, make):
    """Against rational arithmetic, down to 1e-17, where those of float64 are their rounding."""
    result = make.solved(n=3, element=element)[1]
    exact, found, rounded = exact_residuals(result), recheck(result), result.kkt
    for name, value in exact.items():
        assert abs(found[name] - value) <= 1e-9 * value, name
    assert abs(rounded["equilibrium"] - exact["equilibrium"]) > 1e-3 * exact["equilibrium"]
    rng = np.random.default_rng(3)
    state = {"u": result.u, "mu": result.mu, "t": result.t}
    for size in (1e-13, 1e-8):  # of what violates the laws
        noise = {name: 1 + size * rng.standard_normal(v.shape) for name, v in state.items()}
        wrong = replace(result, **{name: v * noise[name] for name, v in state.items()})
        exact, found = exact_residuals(wrong), in_pairs(wrong)
        for name, value in exact.items():
            assert abs(found[name] - value) <= 1e-9 * value, name
            assert value > 0 or name in ("sign", "cone", "support") or size == 1e-13, name


@pytest.mark.parametrize("element", [ElementTriP1, ElementQuad1], ids=lambda e: e.__name__)
def test_forces_of_strains_are_exact(element, make):
    """Of cells a million times as long as wide, against rational arithmetic."""
    x, y = np.linspace(0, 1, 3), 1e6 * np.linspace(0, 0.5, 3)
    body = ElasticBody.from_mesh(make.box(element, x, y), element(), E=2.0, nu=0.3)
    rng = np.random.default_rng(6)
    u = rng.standard_normal(body.ndofs) * 10.0 ** rng.integers(-3, 4, body.ndofs)
    exact, found = exact_strained_forces(body, u), paired_body(body).internal(u).rounded
    size = max(abs(f) for f in exact)
    np.testing.assert_allclose(found, exact.astype(float), rtol=1e-15, atol=1e-28 * float(size))
    # Without them: the sums of float64 lose six digits of what its sums of moduli have.
    assert np.abs(body.internal(u) - exact.astype(float)).max() > 1e-18 * float(size)


def test_forces_of_a_block_are_exact():
    """Of its element matrices, against rational arithmetic."""
    block = LayeredBlock(1.0, [(0.25, 1, 1.0, 0.4), (0.5, 2, 10.0, 0.3)], columns=3)
    rng = np.random.default_rng(7)
    u = rng.standard_normal(block.ndofs) * 10.0 ** rng.integers(-3, 4, block.ndofs)
    exact, found = exact_block_forces(block, u), paired_body(block).internal(u)
    size = max(abs(f) for f in exact)
    for force, high, low in zip(exact, found.high, found.low, strict=True):
        assert abs(force - Fraction(high) - Fraction(low)) <= size / 2**98
