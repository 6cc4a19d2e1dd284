"""The certificate in pairs of numbers is that of float64, of every family and wherever it lies."""

from dataclasses import replace

import numpy as np
import pytest
from certified_cases import CASES, in_pairs, layered, square
from pressed_pairs import pair
from skfem import ElementQuad1, ElementQuad2

from contact import (
    ContactProblem,
    ContactResult,
    DistributedBody,
    GridContact,
    HalfSpace,
    InputError,
    LoadStepper,
    NotConverged,
    Rigid,
    recheck,
)
from contact.checks.paired_bodies import paired_body
from skfem_adini import ElementQuadAdini
from tests.contact.condensation.device_cases import CASES as HELD
from tests.contact.condensation.device_cases import Elsewhere


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


def test_a_body_far_from_its_place(make):
    """A translation of a million times the deformation costs digits of u, and no others."""
    near, far = (
        ContactProblem(
            square(make, 4).fix("left", "x", shift).load("top", (0.1, -0.1)), "bottom", 0.0
        ).solve(tol=1e-6)
        for shift in (0.0, 1e3)
    )
    assert recheck(near)["equilibrium"] < 1e-15
    assert recheck(far, 1e-6)["equilibrium"] < 1e-15


def test_a_body_turned_until_it_touches(make):
    """Its forces are rounding of the motion, relative to which they are balanced."""

    def move(x):
        return np.array([-0.01 * x[1], 0.01 * x[0] - 0.03])

    for element in (ElementQuad1, ElementQuad2, ElementQuadAdini):
        body = square(make, 3, element)
        for c in range(2):
            body.fix("top", c, lambda x, c=c: move(x)[c])
        result = ContactProblem(body, "bottom", lambda x: -move(x)[1], 0.6).solve()
        assert np.abs(result.pressure).max() < 1e-11
        assert recheck(result)["balance"] < 1e-10


def test_the_host_computes_what_a_device_has_solved(make):
    """Vectors of the body lie elsewhere; none of them is used."""

    class There(Elsewhere):
        xp = type("There", (), {"__getattr__": lambda _, name: getattr(np, name)})()

    problem = make.problem(4)
    result = problem.solve()
    body = result.system.body
    before = recheck(result)
    kept = body.compute_with(There())
    assert body.vectors is kept
    assert paired_body(body).host.vectors.arrays.xp is np
    assert body.vectors is kept
    assert recheck(result) == before
    block = layered("x").solve()
    before = recheck(block)
    block.system.body.compute_with(There())
    assert paired_body(block.system.body).host.arrays.xp is np
    assert recheck(block) == before


@pytest.mark.gpu
@pytest.mark.parametrize("case", ["Adini", "Hex1", "floating Quad1", "pair of Hex1", "cut"])
def test_results_of_a_device(case, make):
    pose, element = HELD[case]
    problem = pose(make, element)
    problem.condense(device="cuda")
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
