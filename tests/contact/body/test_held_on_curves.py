"""Adini bodies held along curves of straight facets: of order two, as everywhere on polygons."""

import numpy as np
import pytest
from convergence import order
from rings import NU, ring
from scipy.sparse.linalg import spsolve
from skfem import ElementQuad2

from contact import ContactProblem, ElasticBody, InputError, LoadStepper, Plane
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

LAM, MU = NU / ((1 + NU) * (1 - 2 * NU)), 0.5 / (1 + NU)


def exact(x):
    """Zero on the inner circle: u_r = r - 1 / r."""
    field = np.zeros_like(x)
    field[:2] = x[:2] * (1 - 1 / np.sum(x[:2] ** 2, axis=0))
    return field


def pulled(body):
    """Stress of the exact field on the outer side."""

    def traction(x):
        r2 = np.sum(x[:2] ** 2, axis=0)
        radial = np.zeros_like(x)
        radial[:2] = x[:2] / np.sqrt(r2)
        return ((LAM + 2 * MU) * (1 + 1 / r2) + LAM * (1 - 1 / r2)) * radial

    return body.load("right", traction)


def error(body):
    """Relative error of the displacement in L2, and the energy."""
    P, u0 = body.constraint
    u = P @ spsolve((P.T @ body.stiffness @ P).tocsc(), P.T @ (body.f - body.stiffness @ u0)) + u0
    at = exact(np.array(body.basis.global_coordinates()))
    off = np.array(body.basis.interpolate(u)) - at
    dx = body.basis.dx
    return np.sqrt(np.sum(off**2 * dx) / np.sum(at**2 * dx)), 0.5 * body.f @ u


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHexAdini])
def test_a_ring_held_inside(element, make):
    n = [3, 5, 7] if element is ElementHexAdini else [4, 8, 16]
    found = [error(pulled(ring(make, element, k).fix("left", "xy"))) for k in n]
    facets = [error(pulled(ring(make, element, k).fix("left", "xy", smooth=False))) for k in n]
    assert order(n, [e for e, _ in found]) > 1.8
    assert found[-1][0] < 0.15 * facets[-1][0]
    depth = 0.3 if element is ElementHexAdini else 1.0
    # Half the work of the traction at r = 2, where u_r = 3 / 2 moves an arc of length pi.
    stress = (LAM + 2 * MU) * 1.25 + LAM * 0.75
    energy = 0.5 * stress * 1.5 * np.pi * depth
    assert order(n, [abs(w / energy - 1) for _, w in found]) > 1.5


def displaced(x):
    return 0.1 + 0 * x[0]


def test_numbers_are_held_along_the_curve_and_fields_on_the_facets(make):
    ways = {
        "number": (0.1, None),
        "smooth number": (0.1, True),
        "smooth field": (displaced, True),
        "field": (displaced, None),
        "number on facets": (0.1, False),
    }
    free = {}
    for name, (value, smooth) in ways.items():
        body = pulled(ring(make, ElementQuadAdini, 4))
        body._supports = []
        free[name] = body.fix("left", "xy", value, smooth=smooth).constraint[0].shape[1]
    assert free["number"] == free["smooth number"] == free["smooth field"]
    assert free["field"] == free["number on facets"] < free["number"]
    with pytest.raises(InputError, match="smooth"):
        ring(make, ElementQuadAdini, 4).fix("left", "xy", smooth="curve")


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHexAdini])
def test_rough_supports(element, make):
    """A side with noise on its coordinates holds what a straight one holds."""
    found = []
    noises = [0.0, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2]
    for noise in noises:
        ticks = [np.linspace(0, 1, 4)] * (3 if element is ElementHexAdini else 2)
        mesh = make.box(element, *ticks)
        p, rng = mesh.p.copy(), np.random.default_rng(2)
        p[0, p[0] == 0] += noise * rng.uniform(-1, 1, int((p[0] == 0).sum()))
        body = ElasticBody.from_mesh(make.remesh(mesh, p), element(), E=1.0, nu=NU)
        body.fix("left").load("right", np.eye(body.dim)[-1])
        P, _ = body.constraint
        found.append(P @ spsolve((P.T @ body.stiffness @ P).tocsc(), P.T @ body.f))
    size = np.abs(found[0]).max()
    for noise, u in zip(noises, found, strict=True):
        assert np.abs(u - found[0]).max() < (1e-9 + 30 * noise) * size


def test_contact_of_a_ring_held_inside(make):
    """Pressed in by a hole that is too small: the pressure is that of quadratic elements."""
    found = {}
    for element in (ElementQuadAdini, ElementQuad2):
        body = ring(make, element, 16).fix("left", "xy")
        found[element] = ContactProblem(body, "right", -0.01, 0.3).solve().pressure
    exact = 0.01 * ((LAM + 2 * MU) * 1.25 + LAM * 0.75) / 1.5
    for pressure in found.values():
        assert np.abs(pressure / exact - 1).max() < 0.02


@pytest.mark.parametrize("value", [0.1, displaced], ids=["number", "field"])
def test_a_moving_support_on_a_curve(value, make):
    """A motion is prescribed in the way in which the support holds."""

    def body():
        free = ring(make, ElementQuadAdini, 8)
        free._supports = []
        return free.fix("top", "x").load("right", (0.0, -0.01))

    moved = LoadStepper(ContactProblem(body().fix("left", "y"), "right", 5.0))
    moved.move("left", "y", value)
    at_once = ContactProblem(body().fix("left", "y", 0.1), "right", 5.0).solve()
    assert np.abs(moved.run([1.0])[-1].u - at_once.u).max() < 1e-9 * np.abs(at_once.u).max()


def ring_on_a_plane(make, element, whole, noise):
    """A ring held inside and pressed into a plane by .05; its right half, or all of it."""
    start, turns = -np.pi / 2, (4 if whole else 2)
    ticks = np.linspace(1, 2, 4), start + np.linspace(0, turns * np.pi / 2, 10 * turns + 1)
    mesh = make.box(element, *ticks)
    r, angle = mesh.p
    p = r * np.array([np.cos(angle), np.sin(angle)])
    p[1] += noise * np.sin(50 * p[1])
    first = np.arange(r.size)
    if whole:  # its ends are one
        end = np.flatnonzero(angle > angle.max() - 1e-9)
        first[end] = [np.flatnonzero((r == r[k]) & (angle < start + 1e-9))[0] for k in end]
    kept, place = np.unique(first, return_inverse=True)
    mesh = type(mesh)(p[:, kept], place[mesh.t]).with_boundaries(
        {
            "inner": lambda x: np.hypot(*x) < 1.1,
            "outer": lambda x: np.hypot(*x) > 1.9,
            **({} if whole else {"cut": lambda x: np.abs(x[0]) < 1e-9}),
        }
    )
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=NU).fix("inner")
    return body if whole else body.fix("cut", "x")


@pytest.mark.filterwarnings("ignore::contact.ContactWarning")  # both are the same coarse polygon
@pytest.mark.parametrize("noise", [0.0, 1e-7, 1e-3])
@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuad2])
def test_half_a_ring_on_a_plane(element, noise, make):
    """The whole ring says the same: force, friction and pressure."""
    found = []
    for whole in (True, False):
        body = ring_on_a_plane(make, element, whole, noise)
        result = ContactProblem(body, "outer", Plane((0.0, -1.95), (0.0, 1.0)), 0.4).solve()
        rows = result.system.rows
        shear = np.sum(rows.tangents[0, 0] * result.t[:, 0] * (rows.x_nominal[0] > 1e-9))
        found.append((result.resultant[1] / (1 + whole), shear, result.pressure.max()))
    # Adini's slope across the plane is free in the half.
    limit = 1e-9 if element is ElementQuad2 else 5e-3
    assert np.abs(np.divide(*found) - 1).max() < limit
