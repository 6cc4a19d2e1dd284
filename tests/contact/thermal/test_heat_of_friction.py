"""Heat of friction: the work of the slip, its parts, and what it does to the pressure."""

import numpy as np
import pytest
from families import box
from hot_bodies import blocks
from skfem import ElementHex1, ElementQuad1, ElementQuad2

from contact import ContactProblem, ElasticBody, InputError, LoadStepper, ThermalContact
from skfem_adini import ElementQuadAdini

F = 0.3


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuadAdini, ElementHex1])
def test_heat_is_the_work_of_friction_step_by_step(make, element):
    """F p times the slip, and in full slip the force that drags times the way."""
    stepper = make.dragged(element, 3, friction=F)
    model = ThermalContact(stepper, 1.0, 0.0, capacity=2.0, expansion=1e-3)
    times = np.array([0.0, 0.3, 0.35, 0.4, 0.48, 0.52])
    results = model.run(times)
    for dt, before, now in zip(np.diff(times), results[:-1], results[1:], strict=True):
        rows, u = now.contact.system.rows, now.contact.u - before.contact.u
        way = np.linalg.norm((rows.T @ u).reshape(now.contact.t.shape), axis=1)
        work = F * now.contact.mu * way
        assert now.power * dt == pytest.approx(work, rel=1e-8, abs=1e-12 * work.max())
        heat = now.balance()
        assert heat["friction"] * dt == pytest.approx(work.sum(), rel=1e-8)
        assert heat["stored"] == pytest.approx(heat["friction"], rel=1e-10)
        assert heat["error"] < 1e-12
    assert now.power.sum() > 0
    # All points slid in both last steps: the support has done nothing but this work.
    way = 0.08 * (np.sin(3 * 0.52) - np.sin(3 * 0.48))
    if element is not ElementHex1:  # whose faces slip to the sides as well
        assert now.power.sum() * dt == pytest.approx(abs(now.contact.resultant[0]) * way, rel=1e-3)


@pytest.mark.parametrize("part", [None, 0.0, 0.8])
def test_steady_sliding_parts_its_heat(part):
    """Both parts flow to the ends, or back through the joint: two slabs with a source between."""
    upper, lower, problem = blocks()
    model = ThermalContact(problem, [2.0, 1.0], 5.0, friction_heat=F * 4.0, partition=part)
    result = model.fix("top", 0.0, body=upper).fix("bottom", 0.0, body=lower).solve()
    power, share = F * 4.0 * 0.02, 0.5 if part is None else part
    # Heat balances of both faces: 2 a + 5 (a - b) = share power, b - 5 (a - b) = the rest.
    a, b = np.linalg.solve([[7.0, -5.0], [-5.0, 6.0]], [share * power, (1 - share) * power])
    at = np.array([[0.3], [0.0]])
    assert result.sample(at, upper) == pytest.approx(a, rel=1e-9)
    assert result.sample(at, lower) == pytest.approx(b, rel=1e-9)
    assert result.friction_flux == pytest.approx(power, rel=1e-9)
    assert result.balance(upper)["friction"] == pytest.approx(share * power, abs=1e-12)
    assert result.balance()["error"] < 1e-12


def test_a_braked_wheel_cools_when_it_stands():
    """Its heat at constant pressure follows the factor of the speed: a ramp of one second."""
    _, _, problem = blocks()
    model = ThermalContact(
        problem, 1.0, 100.0, capacity=1.0, friction_heat=1.5,
        friction_factor=lambda t: max(1.0 - t, 0.0), method="crank-nicolson",
    )  # fmt: skip
    times = np.linspace(0, 2, 21)
    results = model.run(times)
    power = np.array([one.balance()["friction"] for one in results])
    assert power == pytest.approx(1.5 * 0.02 * np.maximum(1 - times, 0), abs=1e-12)
    assert results[10].T.max() > results[-1].T.max() > 0


def test_hot_spots_take_the_pressure():
    """Where the floor rubs more the block grows, and is pressed more."""
    mesh = box(ElementQuad2, np.linspace(0, 1, 9), np.linspace(0, 0.5, 5))
    block = ElasticBody.from_mesh(mesh, ElementQuad2(), E=1.0, nu=0.3)
    block.fix("left", "x").load("top", (0.0, -0.02))
    forces = []
    for alpha in (0.0, 1e-3):
        model = ThermalContact(
            ContactProblem(block, "bottom", 0.0), 1.0, 0.0, expansion=alpha,
            friction_heat=lambda x: np.where(x[0] > 0.5, 10.0, 0.0),
        )  # fmt: skip
        result = model.fix("top", 0.0).solve()
        right = result.contact.x[0] > 0.5
        forces.append(result.contact.mu[right].sum())
        assert result.balance()["error"] < 1e-12
    assert forces[0] == pytest.approx(0.01, rel=0.1)
    assert forces[1] > forces[0]


def test_a_history_goes_on_from_its_last_result(make):
    def model():
        return ThermalContact(make.dragged(ElementQuad1, 3), 1.0, 0.0, capacity=1.0, expansion=1e-3)

    whole = model().run([0.0, 0.2, 0.3, 0.4])
    first = model().run([0.0, 0.2])
    again = model().run([0.2, 0.3, 0.4], initial=first[-1])
    assert np.allclose(again[-1].T, whole[-1].T, rtol=1e-9, atol=0)
    assert np.allclose(again[-1].power, whole[-1].power, rtol=1e-8, atol=1e-14)
    begun = make.dragged(ElementQuad1, 3)
    begun.step(0.1)
    for wrong in (begun, LoadStepper(blocks(F)[2], sliding="finite")):
        with pytest.raises(InputError, match=r"^problem: a LoadStepper of small sliding"):
            ThermalContact(wrong, 1.0, 0.0)
