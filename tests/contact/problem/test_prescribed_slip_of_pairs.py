"""Friction of two bodies, rings and shafts where supports of either side prescribe the slip."""

import numpy as np
import pytest
from skfem import ElementQuad1, ElementQuad2, MeshQuad

from contact import ContactProblem, ElasticBody, Pair, Rigid, Status, cross_check, recheck
from skfem_adini import ElementQuadAdini

F = 0.3


def slab(n, low, high, element=None, **given):
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, n + 1), np.linspace(low, high, 4))
    return ElasticBody.from_mesh(mesh.with_defaults(), element, E=1.0, nu=0.3, **given)


@pytest.mark.parametrize("multipliers", ["first", "second"])
@pytest.mark.parametrize("element", [ElementQuad1(), ElementQuad2(), ElementQuadAdini()])
@pytest.mark.parametrize("held", ["upper", "lower", "both"])
def test_two_slabs(held, element, multipliers) -> None:
    """One pushed over the other at its end; held at the whole interface on one side or both."""
    upper, lower = slab(5, 0, 1, element), slab(4, -1, 0, element)
    upper.fix("top", "y", -0.05).fix("left", "x", 0.1)
    lower.fix("bottom", "xy").fix("left", "x")
    if held in ("upper", "both"):
        upper.fix("bottom", "x", 0.1)
    if held in ("lower", "both"):
        lower.fix("top", "x")
    pair = Pair(upper, "bottom", lower, "top", friction=F, multipliers=multipliers)
    problem = ContactProblem([upper, lower], [pair])
    result = problem.solve()
    assert np.all(result.status == Status.SLIP)
    total = result.contact_force
    for body, sign in ((upper, 1.0), (lower, -1.0)):
        part = result[body]
        np.testing.assert_allclose(part.resultant, [-sign * F * total, sign * total], rtol=1e-9)
        np.testing.assert_allclose(body.total(part.reactions), -part.resultant, atol=1e-12)
    assert max(result.kkt.values()) < 1e-10
    assert max(recheck(result).values()) < 1e-10
    assert cross_check(problem, result).verdict == "agrees"


def test_two_slabs_held_at_rest_are_undetermined_at_their_ends() -> None:
    upper, lower = slab(4, 0, 1), slab(4, -1, 0)
    upper.fix("top", "y", -0.05).fix("left", "x", 0.1)
    lower.fix("bottom", "y").fix("left", "x", 0.1)
    result = ContactProblem(
        [upper, lower], [Pair(upper, "bottom", lower, "top", friction=F)]
    ).solve()
    corner = result.x_nominal[0] < 1e-9
    assert np.all(result.status[corner] == Status.UNDETERMINED)
    assert not np.any(result.shear[corner])


@pytest.mark.parametrize("element", [ElementQuad1(), ElementQuad2(), ElementQuadAdini()])
@pytest.mark.parametrize("n", [4, 8])
def test_a_shaft_pressed_into_a_hub(element, n) -> None:
    """The force that presses is F times the normal force, all along the hub."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 2, n + 1)).with_defaults()
    shaft = ElasticBody.from_mesh(mesh, element, E=1.0, nu=0.3, plane="axisymmetric")
    shaft.fix("bottom", "y", 0.1)
    result = ContactProblem(shaft, "right", -0.01, F).solve()
    assert np.all(result.status == Status.SLIP)
    assert result.resultant[1] == pytest.approx(-F * result.contact_force, rel=1e-10)
    np.testing.assert_allclose(shaft.total(result.reactions)[1], -result.resultant[1], atol=1e-12)


def test_on_the_axis_symmetry_decides() -> None:
    """A point on the axis does not slip and bears no shear: nothing is left open there."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 4)).with_defaults()
    body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3, plane="axisymmetric").fix("top", "xy")
    result = ContactProblem(body, "bottom", Rigid(0.0, displacement=(0.0, 0.05)), F).solve()
    axis = result.x_nominal[0] < 1e-9
    assert np.all(result.status[axis] == Status.STICK)
    assert not np.any(result.shear[axis])
