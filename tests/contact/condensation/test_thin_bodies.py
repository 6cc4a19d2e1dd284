"""Slender cells: thin bodies held by contact alone, and the balance of all forces of tall ones."""

import numpy as np
import pytest
from families import PLANE_AND_BFS
from skfem import ElementHex1

from contact import ContactProblem, ElasticBody, InputError, NotConverged


def plate(make, element, ratio, length=1.0, E=2.0, friction=0.4, solver="auto"):
    """A strip of 16 x 2 cells, their ratio given, on a rough floor, pressed and pushed."""
    x, y = np.linspace(0, length, 17), np.linspace(0, length / 8 / ratio, 3)
    body = ElasticBody.from_mesh(make.box(element, x, y), element(), E=E, nu=0.3)
    body.load("top", lambda x: E * np.array([0.05 + 0 * x[0], -1.0 - 0.5 * x[0] / length]))
    return ContactProblem(body, "bottom", 0.0, friction, solver=solver)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("solver", ["auto", "superlu"])
@pytest.mark.parametrize("ratio", [25, 250, 1000])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_thin_body_on_a_floor(element, ratio, solver, make):
    result = plate(make, element, ratio, solver=solver).solve()
    assert max(result.kkt.values()) < 1e-10
    # The load: its mean, exactly, and its share at both ends.
    assert abs(result.contact_force / 2.5 - 1.0) < 1e-11
    assert abs(result.resultant[0] / -0.1 - 1.0) < 1e-9
    np.testing.assert_allclose(
        result.mu @ result.x_nominal[0] / result.contact_force, 0.5 + 1 / 30, rtol=1e-3 + 2 / ratio
    )


@pytest.mark.parametrize(("length", "E"), [(1e-6, 1e12), (1e3, 1e-3)])
@pytest.mark.parametrize("element", PLANE_AND_BFS[1::2])
def test_thin_body_in_other_units(element, length, E, make):
    here = plate(make, element, 250).solve()
    there = plate(make, element, 250, length, E).solve()
    np.testing.assert_allclose(there.mu / (E * length), here.mu / 2.0, atol=1e-9)
    values = here.system.body.basis.nodal_dofs[:2]
    np.testing.assert_allclose(there.u[values] / length, here.u[values], atol=1e-9)


def test_thin_plate_in_space(make):
    ticks = np.linspace(0, 1, 5)
    mesh = make.box(ElementHex1, ticks, ticks, np.array([0, 0.5, 1.0]) / 4 / 250)
    body = ElasticBody.from_mesh(mesh, ElementHex1(), E=2.0, nu=0.3).load("top", (0.1, 0.05, -1.0))
    result = ContactProblem(body, "bottom", 0.0, 0.4).solve()
    assert abs(result.contact_force - 1.0) < 1e-11


@pytest.mark.sampled(2)
@pytest.mark.parametrize("held", ["pushed down", "loaded", "loose"])
@pytest.mark.parametrize("ratio", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_no_load_is_missing_in_what_is_certified(element, ratio, held, make):
    """Cells a million times as high as wide hold few digits: an answer is right, or refused."""
    x, y = np.linspace(0, 1, 5), np.linspace(0, 0.5 * ratio, 3)
    body = ElasticBody.from_mesh(make.box(element, x, y), element(), E=2.0, nu=0.3)
    body.load("top", (0.0, -1.0))
    if held != "loose":
        body.fix("left", "x")
    if held == "pushed down":
        body.fix("top", "y", -1e-3 * ratio)
    problem = ContactProblem(body, "bottom", 0.0, 0.4 if held == "loose" else 0.0)
    result = refusal = None
    try:
        result = problem.solve()
    except (NotConverged, InputError) as error:
        refusal = str(error)
    if result is None:
        assert "slender" in refusal
        assert held == "loose"
        assert ratio > 1e4
        return
    assert result.kkt["balance"] < 1e-10
    assert np.abs(result.balance()["residual"]).max() < 1e-9
    if held != "pushed down":
        assert abs(result.contact_force - 1.0) < 1e-9
