"""Uniform strains: closed forms, patch tests, and forms against stresses."""

import numpy as np
import pytest
from rubber_blocks import alone, cube, pressed, sides_in_space, stretched
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve
from skfem import (
    BilinearForm,
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    LinearForm,
    MeshQuad,
    MeshTri,
)
from skfem.helpers import ddot, det, grad, inv, transpose

from contact import (
    ContactProblem,
    ElasticBody,
    MooneyRivlin,
    NeoHooke,
    NonlinearBody,
    NonlinearStepper,
    Ogden,
    Pair,
    Plasticity,
    SaintVenant,
    Tie,
)
from skfem_adini import ElementQuadAdini, ElementQuadBFS

ELEMENTS = [ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2, ElementHex1, ElementTetP2]
LAWS = [SaintVenant(2.0, 0.3), NeoHooke(1.0, 9.0), MooneyRivlin(0.3, 0.2, 10.0)]
LAWS.append(Ogden((0.9, 0.05), (1.3, 4.0), 10.0))
NAMES = {"ids": lambda one: getattr(one, "__name__", type(one).__name__)}


def principal(law, stretches):
    """Principal nominal stresses, of the energy by complex steps."""
    found = []
    for c in range(3):
        F = np.diag(stretches).astype(complex)
        F[c, c] += 1e-30j
        found.append(np.imag(law.energy(F)) / 1e-30)
    return np.array(found)


def free_side(law, known, free):
    """Stretches where the directions `free` carry no stress, all alike."""

    def stress(s):
        return principal(law, [s if k in free else known[k] for k in range(3)])[free[0]]

    s = brentq(stress, 0.4, 1.6, xtol=1e-15)
    return [s if k in free else known[k] for k in range(3)]


@pytest.mark.parametrize("law", LAWS, **NAMES)
@pytest.mark.parametrize("element", [*ELEMENTS, ElementQuadAdini, ElementQuadBFS], **NAMES)
def test_uniaxial_stretch(law, element):
    body = cube(element, law, n=1)
    in_plane = body.dim == 2
    stretches = free_side(law, (1.3, None, 1.0), (1,) if in_plane else (1, 2))
    result = stretched(body, 1.3, None, None)
    F = result.problem.body.deformation_gradient(result.u)
    assert np.abs(F - np.diag(stretches)[..., None, None]).max() <= 1e-12
    right = "right" if in_plane else sides_in_space(body)[0][1]
    expected = principal(law, stretches)[0]
    assert abs(result.reaction(right)[0] - expected) <= 1e-12 * max(expected, 1.0)


@pytest.mark.parametrize("law", LAWS, **NAMES)
def test_uniaxial_stretch_in_plane_stress(law):
    stretches = free_side(law, (1.3, None, None), (1, 2))
    body = cube(ElementQuad2, law, plane="stress")
    result = stretched(body, 1.3, None)
    F = body.deformation_gradient(result.u)
    assert np.abs(F[1, 1] - stretches[1]).max() <= 1e-12
    expected = principal(law, stretches)[0]
    assert abs(result.reaction("right")[0] - expected) <= 1e-12 * max(expected, 1.0)
    cauchy = expected / stretches[1] / stretches[2]
    assert np.abs(body.cauchy_stress(result.u, {})[0, 0] - cauchy).max() <= 1e-12 * cauchy
    assert len(result.history) <= 5  # quadratic: the thickness is in the tangent


def test_plastic_plane_stress_is_that_of_a_thin_plate_in_space():
    """One cell of each, stretched and sheared by more than the yield strain."""
    law = Plasticity(100.0, 0.3, 1.0, 10.0)
    plate = cube(ElementHex1, law, n=1)
    flat = cube(ElementQuad1, law, n=1, plane="stress")
    (left, right), (bottom, _), (front, _) = sides_in_space(plate)
    for body, ends in ((plate, (left, right, bottom)), (flat, ("left", "right", "bottom"))):
        body.fix(ends[0], "x").fix(ends[1], "x", 0.05).fix(ends[2], "y")
    plate.fix(front, "z")
    results = [alone(body, tol=1e-12).run([1.0]).results[-1] for body in (plate, flat)]
    alpha = [result.states[0]["alpha"].mean() for result in results]
    assert alpha[0] > 0.02
    assert abs(alpha[1] - alpha[0]) <= 1e-12
    pull = results[0].reaction(right)[0], results[1].reaction("right")[0]
    assert abs(pull[1] - pull[0]) <= 1e-12


@pytest.mark.parametrize("law", LAWS, **NAMES)
def test_equibiaxial_stretch(law):
    stretches = free_side(law, (1.25, 1.25, None), (2,))
    body = cube(ElementHex1, law)
    result = stretched(body, 1.25, 1.25, None)
    found = [result.reaction(sides_in_space(body)[c][1])[c] for c in (0, 1)]
    assert np.allclose(found, principal(law, stretches)[:2], rtol=1e-12)


@pytest.mark.parametrize("law", LAWS[1:3], **NAMES)
def test_simple_shear(law):
    body = cube(ElementQuad2, law).fix(["left", "right", "top", "bottom"], "y")
    body.fix(["left", "right", "top", "bottom"], "x", lambda x: 0.5 * x[1])
    result = alone(body).run([1.0]).results[-1]
    sigma = body.cauchy_stress(result.u, {})
    assert np.abs(sigma[0, 1] - 0.5).max() <= 1e-12  # mu gamma, or 2 (c1 + c2) gamma


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad1, ElementHex1], **NAMES)
def test_pressed_block_stays_uniform(element, friction):
    body = cube(element, NeoHooke(1.0, 3.0), n=3)
    for c, (low, high) in enumerate(
        sides_in_space(body)[:2] if body.dim == 3 else [("left", "right")]
    ):
        body.fix(low, c).fix(high, c)
    result = pressed(body, friction, 0.4).run([0.5, 1.0]).results[-1]
    F = body.deformation_gradient(result.u)
    assert np.ptp(F.reshape(9, -1), axis=1).max() <= 1e-11
    expected = principal(
        NeoHooke(1.0, 3.0), [1.0] * (body.dim - 1) + [0.6] + [1.0] * (3 - body.dim)
    )
    pressure = -expected[body.dim - 1]  # the area does not change
    assert np.abs(result.pressure - pressure).max() <= 1e-11 * pressure


@pytest.mark.parametrize("kind", ["pair", "tie"])
@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementTriP2], **NAMES)
def test_patch_of_two_meshes_that_do_not_match(element, kind):
    make = MeshTri if element is ElementTriP2 else MeshQuad
    law, named = NeoHooke(1.0, 3.0), []
    for n, low in ((7, 0.0), (4, -1.0)):
        mesh = make.init_tensor(np.linspace(0, 1, n + 1), np.linspace(low, low + 1, 3))
        named.append(NonlinearBody.from_mesh(mesh.with_defaults(), element(), stress=law))
    upper, lower = named
    upper.fix("left", "x").fix("top", "y").named("upper")
    lower.fix("left", "x").fix("bottom", "y").named("lower")
    link = Tie if kind == "tie" else Pair
    problem = ContactProblem([upper, lower], [link(upper, "bottom", lower, "top")])
    result = (
        NonlinearStepper(problem).move("top", "y", -0.6, body="upper").run([0.5, 1]).results[-1]
    )
    for body in (upper, lower):
        one, u = result.of_body(body)
        F = one.deformation_gradient(u)
        assert np.ptp(F.reshape(9, -1), axis=1).max() <= 1e-11
        assert abs(F[1, 1, 0, 0] - 0.7) <= 1e-11
    force = (result.resultants + result.tie_resultants)[0, 1]
    assert np.abs(force + result.reaction("top", "upper")[1]) <= 1e-11


def rubber(F):
    return F - transpose(inv(F)) * (1.0 - 9.0 * np.log(det(F)))


def in_space(H):
    F = np.zeros((3, 3, *H.shape[2:]), dtype=H.dtype)
    F[:2, :2] = H
    F[range(3), range(3)] += 1.0
    return F


@LinearForm
def internal(v, w):
    return ddot(rubber(in_space(w["u"].grad))[:2, :2], grad(v))


@BilinearForm
def tangent(du, v, w):
    F = in_space(w["u"].grad)
    G, H = inv(F), in_space(grad(du))
    H[range(3), range(3)] -= 1.0
    back = np.einsum("ij...,jk...,kl...->il...", G, H, G)
    P = H + (1.0 - 9.0 * np.log(det(F))) * transpose(back)
    P = P + 9.0 * np.einsum("ij...,ji...->...", G, H) * transpose(G)
    return ddot(P[:2, :2], grad(v))


@pytest.mark.parametrize("way", ["complex", "given", "central"])
def test_forms_and_stress_give_the_same_body(way, caplog):
    mesh = MeshQuad().refined(2).with_defaults()

    @LinearForm
    def unsafe(v, w):
        H = w["u"].grad
        return ddot(rubber(in_space(np.real(H)))[:2, :2], grad(v))

    form = unsafe if way == "central" else internal
    bodies = [
        NonlinearBody.from_mesh(mesh, stress=NeoHooke(1.0, 9.0)),
        NonlinearBody.from_forms(mesh, internal=form, tangent=tangent if way == "given" else None),
    ]
    caplog.set_level("INFO", "contact")
    u = [pressed(body, 0.2).run([0.5, 1.0]).results[-1].u for body in bodies]
    assert np.abs(u[0] - u[1]).max() <= 1e-9
    said = {
        "complex": "complex steps: differs",
        "given": "given form",
        "central": "central differences, for",
    }
    assert said[way] in caplog.text


def test_a_state_by_forms_is_that_of_the_stress():
    law = Plasticity(100.0, 0.3, 1.0, 10.0)
    mesh = MeshQuad().refined(2).with_defaults()

    @LinearForm
    def work(v, w):
        P, _ = law(in_space(w["u"].grad), w, w["dt"])
        return ddot(P[:2, :2], grad(v))

    def update(w):
        return law(in_space(w["u"].grad), w, w["dt"])[1]

    bodies = [
        NonlinearBody.from_mesh(mesh, stress=law),
        NonlinearBody.from_forms(mesh, internal=work, state=law.state, update=update),
    ]
    found = [pressed(body, 0.2, 0.05).run([0.5, 1.0]).results[-1] for body in bodies]
    assert np.abs(found[0].u - found[1].u).max() <= 1e-9
    alpha = [one.states[0]["alpha"] for one in found]
    assert alpha[0].max() > 0.01
    assert np.abs(alpha[0] - alpha[1]).max() <= 1e-9


def test_saint_venant_of_small_strains_is_the_linear_body():
    mesh = MeshQuad().refined(3).with_defaults()
    linear = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("left").load("top", (0.0, -1e-5))
    S, f, P = linear.stiffness, linear.f, linear.constraint[0]
    u = P @ spsolve((P.T @ S @ P).tocsc(), P.T @ f)
    body = NonlinearBody.from_mesh(mesh, stress=SaintVenant(1.0, 0.3)).fix("left")
    found = alone(body.load("top", (0.0, -1e-5))).run([1.0]).results[-1].u
    assert np.abs(u - found).max() <= 1e-3 * np.abs(u).max()


def test_a_ring_and_a_cylinder_in_space_agree():
    """A full cylinder, stretched along its axis: uniform, whatever the section."""
    law = NeoHooke(1.0, 9.0)
    mesh = MeshQuad().refined(2).with_defaults()
    body = NonlinearBody.from_mesh(mesh, stress=law, plane="axisymmetric")
    body.fix("bottom", "y").fix("top", "y")
    result = alone(body).move("top", "y", 0.4).run([0.5, 1.0]).results[-1]
    stretches = free_side(law, (None, 1.4, None), (0, 2))
    F = body.deformation_gradient(result.u)
    assert np.abs(F - np.diag(stretches)[..., None, None]).max() <= 1e-11
    expected = np.pi * principal(law, stretches)[1]
    assert abs(result.reaction("top")[1] - expected) <= 1e-11 * expected
