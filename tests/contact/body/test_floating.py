"""Bodies held by contact alone, and the rigid motions that nothing resists."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTriP2, MeshQuad

from contact import ContactProblem, ElasticBody, InputError, Plane, Sphere, Status, Unbounded
from contact.body.rigid_modes import rigid_modes
from skfem_adini import ElementQuadAdini

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
def test_floor_and_wall_without_friction(element, loose, make):
    """In a corner the resultant is minus the load, each side carrying its component."""
    body = loose(element).body_force((-0.3, -1.0))
    result = checked(ContactProblem(body, ["left", "bottom"], 0.0).solve(), make)
    # Rounding.
    assert np.abs(result.resultant - [0.3, 1.0]).max() < 1e-12


@pytest.mark.parametrize("element", [ElementTetP1, ElementHex1])
def test_cube_on_a_ball(element, loose, make):
    """Two sides guide the cube down; the ball below carries it at its middle."""
    body = loose(element).fix("left", "x").fix("front", "y").body_force((0, 0, -1.0))
    result = ContactProblem(body, "bottom", Sphere((0.5, 0.5, -3.0), 3.0)).solve()
    checked(result, make)
    assert abs(result.contact_force - 1.0) < 0.05  # the normals are vertical there
    assert abs(result.resultant[2] - 1.0) < 1e-11


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
    body = loose(element).body_force(-np.eye(make_dim(element))[-1])
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


def make_dim(element):
    return 3 if element in (ElementTetP1, ElementHex1) else 2


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


@pytest.mark.filterwarnings("ignore:displacements reach")
def test_one_sided_block_on_a_far_floor(make):
    """However far the floor, contact in the end holds the (linear) rotation."""
    near = make.solved(n=6, sides=("left",), friction=0.0)[1]
    body = make.block(6, sides=("left",))
    far = checked(ContactProblem(body, "bottom", 3.0).solve(), make)
    assert far.contact_force < near.contact_force
    assert far.contact_force > 0.3


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("element", ELEMENTS)
def test_lifting_off_is_named(element, friction, loose):
    body = loose(element).body_force(np.eye(make_dim(element))[-1])
    body.fix("left", "x")
    if body.dim == 3:
        body.fix("front", "y")
    direction = "xyz"[body.dim - 1]
    with pytest.raises(Unbounded, match=f"translation along {direction}"):
        ContactProblem(body, "bottom", 0.01, friction).solve()


@pytest.mark.parametrize("method", ["newton", "pdas", "tresca_loop", "fixed_point", "qp:osqp"])
def test_sliding_beyond_friction(method, loose):
    """A side load of .5 on friction .3: there is no equilibrium, and none is returned."""
    body = loose(ElementQuadAdini).body_force((0.5, -1.0))
    with pytest.raises(Unbounded, match="not held"):
        ContactProblem(body, "bottom", 0.01, 0.3).solve(method, max_iterations=50)


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHex1])
@pytest.mark.parametrize("method", ["newton", "pdas"])
def test_sliding_beyond_a_given_bound(method, element, loose):
    body = loose(element)
    body.body_force(0.2 * np.eye(body.dim)[0] - np.eye(body.dim)[-1])
    problem = ContactProblem(body, "bottom", 0.0, 0.05, "tresca")
    with pytest.raises(Unbounded, match="not held"):
        problem.solve(method)


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
    # Rounding.
    assert abs(result.mu[right].sum() - 0.1) < 1e-12
    assert abs(result.mu[~right].sum() - (0.0 if supported else 0.1)) < 1e-12


@pytest.mark.parametrize("solver", ["superlu", "auto"])
def test_piece_out_of_touch(solver):
    """The second piece is neither fixed nor on the contact boundary."""
    body = two_blocks(ElementQuad1).fix("top1", "xy")
    with pytest.raises((InputError, Unbounded), match=r"neither fixed nor connected|not held"):
        ContactProblem(body, "bottom1", 0.0, solver=solver).solve()


@pytest.mark.parametrize("element", ELEMENTS)
def test_rigid_modes_carry_no_energy(element, loose):
    body = loose(element)
    modes = rigid_modes(body)
    assert modes.shape[1] == np.linalg.matrix_rank(modes) == body.dim * (body.dim + 1) // 2
    # Rounding.
    assert np.abs(body.stiffness @ modes).max() < 1e-13 * np.abs(body.stiffness.data).max() * 10
