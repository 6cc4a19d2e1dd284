"""Ways to solve crossed with laws and bodies: what does not go together says so in words."""

import numpy as np
import pytest
from skfem import MeshQuad

from contact import (
    Adhesion,
    ContactProblem,
    DynamicStepper,
    ElasticBody,
    InputError,
    LoadStepper,
    NeoHooke,
    NonlinearBody,
    NonlinearStepper,
    Plane,
    PressureOverclosure,
    Rigid,
    ThermalContact,
    cross_check,
    recheck,
    uniqueness,
)

PLANE = Plane((0.0, 0.0), (0.0, 1.0))
SURFACES = {
    "adhesion": {"adhesion": Adhesion(0.02, 1e-4)},
    "hardness": {"hardness": 0.005},
    "wear": {"wear": 1e-3},
}
SOFT = {"overclosure": PressureOverclosure([0.0, 0.1], [0.0, 0.01])}


def problem(obstacle=PLANE, **more):
    body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    return ContactProblem(body.fix("top"), "bottom", obstacle, friction=0.3, **more)


def rubber(obstacle=PLANE, **more):
    mesh = MeshQuad().refined(1).with_defaults()
    body = NonlinearBody.from_mesh(mesh, stress=NeoHooke(mu=1.0, lam=2.0)).fix("top")
    return ContactProblem(body, "bottom", obstacle, friction=0.3, **more)


def pressed(given, **more):
    return LoadStepper(given, **more).move("top", "y", -0.01)


def dynamic(given):
    return DynamicStepper(given, density=1.0, dt=0.05).move("top", "y", -0.01)


def thermal(given):
    return ThermalContact(given, 1.0, 1.0, obstacle_temperature=0.0).fix("top", 1.0)


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize(
    ("way", "words"),
    [
        (dynamic, "dynamics takes no adhesion"),
        (thermal, "thermal contact takes no adhesion"),
        (lambda p: thermal(pressed(p)), "thermal contact takes no adhesion"),
        (lambda p: pressed(p).run([1.0])[-1].vjp(resultant=(0.0, 1.0)), "have no gradients"),
        (lambda p: cross_check(p, p.solve()), "no part of the quadratic program"),
        (lambda p: uniqueness(p, p.solve()), "known without adhesion"),
        (lambda p: p.solve(method="fixed_point"), "takes no"),
        (lambda p: p.solve(method="qp:osqp"), "takes no"),
    ],
)
def test_laws_of_surfaces_are_refused_where_they_are_not_known(surface, way, words):
    with pytest.raises(InputError, match=words):
        way(problem(**SURFACES[surface]))


@pytest.mark.parametrize("surface", SURFACES)
def test_laws_of_surfaces_are_laws_of_rubber_nowhere(surface):
    with pytest.raises(InputError, match="large strain takes no adhesion"):
        NonlinearStepper(rubber(**SURFACES[surface]))


@pytest.mark.parametrize(
    "way",
    [
        lambda p: p.solve(),
        lambda p: p.condense(),
        lambda p: pressed(p).run([1.0]),
        lambda p: pressed(p, sliding="finite").run([1.0]),
        lambda p: dynamic(p).run(1),
        lambda p: thermal(p).solve(),
    ],
)
def test_rubber_is_solved_by_its_own_stepper_only(way):
    with pytest.raises(InputError, match=r"NonlinearStepper|not a NonlinearBody"):
        way(rubber())


def test_results_of_rubber_are_no_results_of_small_strain():
    history = NonlinearStepper(rubber()).move("top", "y", -0.1).run([1.0])
    for way in (
        lambda r: cross_check(rubber(), r),
        recheck,
        lambda r: problem().solve(after=r),
        lambda r: problem().solve(start=r),
    ):
        with pytest.raises(InputError, match="expected a ContactResult"):
            way(history[-1])
    with pytest.raises(InputError, match="small displacements"):
        NonlinearStepper(rubber(Rigid(PLANE, force=(None, 0.1)))).run([1.0])


def test_gradients_of_steps_that_are_no_static_problems():
    with pytest.raises(InputError, match="with inertia"):
        dynamic(problem()).run(2)[-1].result.vjp(resultant=(0.0, 1.0))
    with pytest.raises(InputError, match="hard contact"):
        dynamic(problem(**SOFT))


def test_what_goes_together_has_its_certificates():
    """Compliant surfaces under a tool that moves far, and their gradients."""
    result = pressed(problem(**SOFT), sliding="finite").run([0.5, 1.0])[-1]
    assert max(result.kkt.values()) < 1e-10
    small = pressed(problem(**SOFT)).run([0.5, 1.0])[-1]
    assert np.abs(small.resultant - result.resultant).max() < 2e-2 * small.resultant[1]
    gradient = small.vjp(resultant=(0.0, 1.0))
    assert gradient.E > 0
