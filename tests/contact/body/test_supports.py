"""Supports on curves and rough sides, bodies held by contact alone, motions without resistance."""

import numpy as np
import pytest
from convergence import order
from fields import without_contact
from rings import NU, ring
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTriP2, MeshQuad

from contact import ContactProblem, ElasticBody, InputError, LoadStepper, Plane, Status, Unbounded
from contact.body.rigid_modes import rigid_modes
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
    u = without_contact(body)
    at = exact(np.array(body.basis.global_coordinates()))
    off = np.array(body.basis.interpolate(u)) - at
    dx = body.basis.dx
    return np.sqrt(np.sum(off**2 * dx) / np.sum(at**2 * dx)), 0.5 * body.f @ u


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHexAdini])
def test_a_ring_held_inside(element, make):
    n = [3, 5, 7] if element is ElementHexAdini else [4, 8, 16]
    found = [error(pulled(ring(make, element, k).fix("left", "xy"))) for k in n]
    facets = error(pulled(ring(make, element, n[-1]).fix("left", "xy", smooth=False)))
    assert order(n, [e for e, _ in found]) > 1.8
    assert found[-1][0] < 0.15 * facets[0]
    depth = 0.3 if element is ElementHexAdini else 1.0
    # Half the work of the traction at r = 2, where u_r = 3 / 2 moves an arc of length pi.
    stress = (LAM + 2 * MU) * 1.25 + LAM * 0.75
    energy = 0.5 * stress * 1.5 * np.pi * depth
    assert order(n, [abs(w / energy - 1) for _, w in found]) > 1.5


def displaced(x):
    return 0.1 + 0 * x[0]


def free_ring(make, n):
    body = ring(make, ElementQuadAdini, n)
    body._supports = []
    return body


def test_numbers_are_held_along_the_curve_and_fields_on_the_facets(make):
    free = [
        free_ring(make, 4).fix("left", "xy", value, smooth=smooth).constraint[0].shape[1]
        for value, smooth in (
            (0.1, None), (0.1, True), (displaced, True), (displaced, None), (0.1, False)
        )
    ]  # fmt: skip
    assert free[0] == free[1] == free[2] > free[3] == free[4]
    with pytest.raises(InputError, match="smooth"):
        free_ring(make, 4).fix("left", "xy", smooth="curve")


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHexAdini])
def test_rough_supports(element, make):
    """A side with noise on its coordinates holds what a straight one holds."""
    found = []
    noises = [0.0, 1e-9, 1e-6, 1e-4, 1e-2]
    for noise in noises:
        mesh = make.box(element, *[np.linspace(0, 1, 4)] * element().dim)
        p, rng = mesh.p.copy(), np.random.default_rng(2)
        p[0, p[0] == 0] += noise * rng.uniform(-1, 1, int((p[0] == 0).sum()))
        body = ElasticBody.from_mesh(make.remesh(mesh, p), element(), E=1.0, nu=NU)
        found.append(without_contact(body.fix("left").load("right", np.eye(body.dim)[-1])))
    size = np.abs(found[0]).max()
    for noise, u in zip(noises, found, strict=True):
        assert np.abs(u - found[0]).max() < (1e-9 + 30 * noise) * size


@pytest.mark.parametrize("value", [0.1, displaced], ids=["number", "field"])
def test_a_moving_support_on_a_curve(value, make):
    """A motion is prescribed in the way in which the support holds."""
    still, there = (
        free_ring(make, 8).fix("top", "x").load("right", (0.0, -0.01)).fix("left", "y", value)
        for value in (0.0, 0.1)
    )
    moved = LoadStepper(ContactProblem(still, "right", 5.0)).move("left", "y", value)
    at_once = ContactProblem(there, "right", 5.0).solve()
    assert np.abs(moved.run([1.0])[-1].u - at_once.u).max() < 1e-9 * np.abs(at_once.u).max()


ELEMENTS = [ElementQuadAdini, ElementTriP2, ElementQuad1, ElementTetP1, ElementHex1]
PLANAR = ELEMENTS[:3]


@pytest.fixture
def loose(make):
    """A unit square or cube without any support."""

    def build(element, n=5):
        dim = element().dim
        ticks = np.linspace(0, 1, n + 1 if dim == 2 else 4)
        return ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=2.0, nu=0.3)

    return build


def checked(result, make):
    """Newton's tolerance of 1e-12 on forces of order one."""
    assert max(result.kkt.values()) < 1e-10
    assert make.law_error(result) < 1e-10
    assert np.abs(result.balance()["residual"]).max() < 1e-11
    return result


@pytest.mark.sampled(3)
@pytest.mark.parametrize("method", ["newton", "pdas", "tresca_loop", "fixed_point"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_friction_alone_holds_the_body(element, method, loose, make):
    """A block on a rough floor, without support, under its weight and a side load of .1."""
    body = loose(element)
    load = np.eye(body.dim)[0] * 0.1 - np.eye(body.dim)[-1]
    body.body_force(load)
    floor = Plane(-0.01 * np.eye(body.dim)[-1], np.eye(body.dim)[-1])
    options = {"eps": 1e-3, "tol": 1e-4} if method == "fixed_point" else {}
    result = ContactProblem(body, "bottom", floor, 0.4).solve(method, **options)
    if method != "fixed_point":
        checked(result, make)
    # Balance of forces, to the tolerance of the loosest method.
    assert np.abs(result.resultant + load).max() < 1e-6
    assert Status.STICK in result.status


@pytest.mark.parametrize("element", PLANAR)
def test_moment_is_carried(element, loose, make):
    """The centre of pressure lies below the load's: friction at the floor has no moment there."""
    body = loose(element, 8).load("top", lambda x: np.array([0 * x[0], -2 * x[0]]))
    result = checked(ContactProblem(body, "bottom", 0.0, 0.4).solve(), make)
    # Resultant 1 at x = 2/3; balance to Newton's tolerance. The rows of a rotation about the
    # origin are -x_nominal: there the multipliers have their arms.
    assert abs(result.mu.sum() - 1.0) < 1e-11
    assert abs(result.mu @ result.x_nominal[0] - 2 / 3) < 1e-10


@pytest.mark.parametrize("element", ELEMENTS)
def test_frictionless_translation_is_named(element, loose):
    """Nothing along x resists on a smooth floor, whether or not something pushes."""
    body = loose(element)
    body.body_force(-np.eye(body.dim)[-1])
    if body.dim == 3:
        body.fix("front", "y")
    with pytest.raises(Unbounded, match="translation along x meets no resistance") as caught:
        ContactProblem(body, "bottom", 0.0).solve()
    mode = caught.value.mode
    assert mode.shape == (body.basis.N,)
    assert np.abs(mode).max() == 1.0
    values = mode[body.basis.nodal_dofs[:2]]
    # Rounding of an orthogonalisation.
    assert np.abs(np.abs(values[0]) - 1.0).max() < 1e-9
    assert np.abs(values[1]).max() < 1e-9


@pytest.mark.filterwarnings("ignore:.*nothing can touch")
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_one_sided_block_out_of_reach(friction, make):
    """u_x = 0 on top, u_y = 0 on the left alone: the rotation about (0, 1) is free."""
    body = make.block(6, sides=("left",))
    away = lambda x: np.full(x.shape[1:], np.inf)  # noqa: E731
    with pytest.raises(Unbounded, match=r"rotation about \(0, 1\)") as caught:
        ContactProblem(body, "bottom", away, friction).solve()
    mode = caught.value.mode
    x, y = body.mesh.p
    turn = mode[0::6][np.argmax(1 - y)] / np.max(1 - y)
    # Rounding of an orthogonalisation.
    assert np.abs(mode[0::6] - turn * (1 - y)).max() < 1e-9
    assert np.abs(mode[1::6] - turn * x).max() < 1e-9
    # It is a rigid motion that the supports allow: no force resists.
    assert np.abs(body.stiffness @ mode).max() < 1e-9


def test_given_friction_without_contact_leaves_the_normal_free(loose):
    body = loose(ElementQuadAdini).load("top", (0.02, 0.0))
    with pytest.raises(Unbounded, match="translation along y"):
        ContactProblem(body, "bottom", None, 0.05, "tresca").solve()


def two_blocks(element):
    """Two squares side by side that do not touch."""
    ticks = np.linspace(0, 1, 4)
    both = MeshQuad.init_tensor(ticks, ticks) + MeshQuad.init_tensor(ticks + 2, ticks)
    mesh = both.with_boundaries(
        {
            "bottom": lambda x: x[1] < 1e-9,
            "bottom1": lambda x: (x[1] < 1e-9) & (x[0] < 1.5),
            "top": lambda x: x[1] > 1 - 1e-9,
            "top1": lambda x: (x[1] > 1 - 1e-9) & (x[0] < 1.5),
        }
    )
    return ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3)


@pytest.mark.parametrize("supported", [True, False], ids=["one-held", "none-held"])
@pytest.mark.parametrize("element", [ElementQuad1, ElementQuadAdini])
def test_two_pieces(element, supported, make):
    """Every piece has its rigid motions; a rough floor carries each piece's own load."""
    body = two_blocks(element).load("top", (0.0, -0.1))
    if supported:
        body.fix("top1", "xy")
    assert rigid_modes(body).shape[1] == 6
    result = checked(ContactProblem(body, "bottom", 0.0, 0.3).solve(), make)
    right = result.x[0] > 1.5
    assert abs(result.mu[right].sum() - 0.1) < 1e-12
    assert abs(result.mu[~right].sum() - (0.0 if supported else 0.1)) < 1e-12


@pytest.mark.parametrize("solver", ["superlu", "auto"])
def test_piece_out_of_touch(solver):
    body = two_blocks(ElementQuad1).fix("top1", "xy")
    with pytest.raises((InputError, Unbounded), match=r"neither fixed nor connected|not held"):
        ContactProblem(body, "bottom1", 0.0, solver=solver).solve()
