"""Axisymmetric contact beside closed forms, three dimensions, other units and another solver."""

import numpy as np
import pytest
from convergence import order
from families import PLANE, PLANE_AND_BFS
from skfem import ElementQuad2, ElementTriP1, ElementTriP2

from contact import ContactProblem, ElasticBody, InputError, LoadStepper, Rigid, Sphere, cross_check
from skfem_adini import ElementQuadAdini

E, NU = 3.0, 0.3


def disc(make, element, r=None, z=None, plane="axisymmetric", E=E, nu=NU):
    """A section in the plane of r and z, by default of radius and height one."""
    ticks = (np.linspace(0, 1, 9) if t is None else t for t in (r, z))
    return ElasticBody.from_mesh(make.box(element, *ticks), element(), E=E, nu=nu, plane=plane)


# Pressures of linear triangles with parallel diagonals are of first order, in any plane.
@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", PLANE_AND_BFS[1:])
def test_ring_on_a_shaft(element, make):
    """A ring shrunk on a rigid shaft, in the plane of r and z: Lame's pressure within 1e-3."""
    d, cells, errors = 1e-3, (8, 16, 32), []
    p = d * E / (1 + NU) * (4.0 - 1.0) / (4.0 + 1 - 2 * NU)
    for n in cells:
        body = disc(make, element, np.linspace(1, 2, n + 1), np.linspace(0, 1, n // 2 + 1))
        body.fix(["bottom", "top"], "y")
        result = ContactProblem(body, "left", -d).solve()
        errors.append(np.abs(result.pressure / p - 1).max())
    assert errors[-1] < 1e-3
    assert order(cells, errors) > 1.8
    assert result.contact_force == pytest.approx(p * 2 * np.pi, rel=1e-3)
    assert result.resultant == pytest.approx([0.0, 0.0], abs=1e-12 * p)
    assert cross_check(ContactProblem(body, "left", -d), result).verdict == "agrees"


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2, ElementQuadAdini])
@pytest.mark.parametrize(("length", "force"), [(1.0, 1.0), (1e-3, 1e6)], ids=["one", "other"])
def test_hot_shaft(element, length, force, make):
    """A heated shaft in a cold ring: Lame's pressure, and his stresses between the radii."""
    c, b, heat = length, 2 * length, 1e-3
    modulus = E * force / length**2
    star, p_unit = modulus / (1 - NU**2), (b**2 + c**2) / (b**2 - c**2) + 1
    p = star * (1 + NU) * heat / p_unit
    shaft, ring = (
        disc(make, element, length * r, length * np.linspace(0, 0.25, n), E=modulus)
        for r, n in ((np.linspace(0, 1, 17), 5), (np.linspace(1, 2, 23), 7))
    )
    for body in (shaft, ring):
        body.fix(["bottom", "top"], "y")
    shaft.heat(1.0, heat)
    problem = ContactProblem(shaft, "right", ring.surface("left"), friction=0.2)
    result = problem.solve()
    assert np.abs(result.pressure / p - 1).max() < 1e-3
    r = length * np.linspace(1.05, 1.95, 31)
    stress = result[ring].stress(np.array([r, 0.1 * length + 0 * r]))
    lame = p * c**2 / (b**2 - c**2)
    rest = stress[0, 0] - lame * (1 - b**2 / r**2), stress[2, 2] - lame * (1 + b**2 / r**2)
    assert np.abs(rest).max() < 1e-3 * np.abs(stress[2, 2]).max()
    assert np.abs(result[shaft].stress()[2, 2] + p).max() < 2e-3 * p
    assert max(result.kkt.values()) < 1e-10


@pytest.mark.parametrize("element", PLANE)
def test_endless_ring(element, make):
    """A period of an endless ring under pressure widens as Lame's; its ends may not touch."""
    p, r = 0.01, np.linspace(1.05, 1.95, 10)
    body = disc(make, element, np.linspace(1, 2, 17), np.linspace(0, 0.25, 5))
    body.periodic("bottom", "top").fix("right", "y").load("left", (p, 0.0))
    result = ContactProblem(body, "right", 1.0).solve()
    exact = (1 + NU) / E * p / 3.0 * ((1 - 2 * NU) * r + 4.0 / r)
    found = result.sample(np.array([r, 0.1 + 0 * r]))[0]
    assert found == pytest.approx(exact, rel=2e-3)
    with pytest.raises(InputError, match="pressures are not determined"):
        ContactProblem(body, "left", -0.05).solve()


@pytest.mark.parametrize("element", PLANE)
def test_stiff_lid(element, make):
    """A lid that is tied along the axis: its load reaches the floor, whose resultant it is."""
    body = disc(make, element)
    body.fix("top", "x").tie("top", "y").load("top", lambda x: np.array([0 * x[0], -x[0]]))
    result = ContactProblem(body, "bottom", 0.0, friction=0.2).solve()
    assert result.contact_force == pytest.approx(2 * np.pi / 3, rel=1e-10)
    lid = result.sample(np.array([[0.1, 0.5, 0.9], [1.0, 1.0, 1.0]]))
    assert np.ptp(lid[1]) < 1e-12 * np.abs(lid[1]).max()
    assert np.abs(lid[0]).max() < 1e-12 * np.abs(lid[1]).max()


def test_obstacle_under_a_force(make):
    """A driven sphere moves along the axis until the contact force is the one given."""
    body = disc(make, ElementQuad2).fix("top", "xy")
    sphere = Sphere((0.0, -3.0), 3.0)
    problem = ContactProblem(body, "bottom", Rigid(sphere, force=(None, 0.02)), friction=0.1)
    result = problem.solve()
    assert np.any(result.status == 2)
    assert cross_check(problem, result).verdict == "agrees"
    assert result.balance()["support"][1] == pytest.approx(-result.resultant[1], rel=1e-11)
    assert result.resultant == pytest.approx([0.0, 0.02], rel=1e-9)
    held = Rigid(sphere, displacement=(None, float(result.motion[1])))
    again = ContactProblem(body, "bottom", held, friction=0.1).solve()
    assert again.resultant[1] == pytest.approx(0.02, rel=1e-8)
    for motion in (
        {"displacement": (0.1, 0.0)},
        {"force": (0.1, None)},
        {"rotation": 0.1},
        {"moment": 0.1},
    ):
        with pytest.raises(InputError, match=r"Rigid.*axis y"):
            ContactProblem(body, "bottom", Rigid(sphere, **motion))


def test_data_for_pictures(make):
    """VTK has the hoop stress, and cell means are those of volumes."""
    body = disc(make, ElementQuadAdini, np.linspace(1, 2, 9), np.linspace(0, 1, 3))
    body.fix(["bottom", "top"], "y").load("left", (0.2, 0.0))
    result = ContactProblem(body, "right", 1.0).solve()
    grid = result.to_pyvista()
    r = body.mesh.p[0, body.mesh.t]
    inner, outer = r.min(axis=0), r.max(axis=0)
    A = 0.2 / 3.0  # hoop A (1 + 4 / r^2), its mean over the volume between two radii
    mean = A * (1 + 8 * np.log(outer / inner) / (outer**2 - inner**2))
    assert grid.cell_data["stress_hoop"] == pytest.approx(mean, rel=1e-4)
    assert result.cell_stress()[2, 2] == pytest.approx(mean, rel=1e-4)
    assert result.summary().count("axisymmetric") == 1


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", [ElementTriP1, ElementQuad2, ElementQuadAdini])
def test_sliding_discs(element, make):
    """Steps of finite sliding keep the areas of the places before any displacement."""
    upper, lower = (
        disc(make, element, np.linspace(0, size, n + 1), np.array([z, z + 0.5, z + 1.0]))
        for n, z, size in ((6, 0.0, 1.0), (9, -1.0, 1.4))
    )
    lower.fix("bottom", "xy")
    upper.load("top", (0.0, -0.3))
    stepper = LoadStepper(ContactProblem(upper, "bottom", lower.surface("top")), sliding="finite")
    result = stepper.run([1.0]).results[-1]
    assert result.system.rows.weights.sum() == pytest.approx(np.pi, rel=1e-6)
    assert result.resultants[0] == pytest.approx([0.0, 0.3 * np.pi], rel=1e-8)
