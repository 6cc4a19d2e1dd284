"""Cells up to a million times as long as wide, and fine meshes: digits that displacements hold."""

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import (
    Basis,
    ElementHex1,
    ElementQuad1,
    ElementTetP2,
    ElementTriP2,
    ElementVector,
    MeshQuad,
)

from contact import (
    ContactProblem,
    ContactResult,
    ElasticBody,
    InputError,
    NotConverged,
    Plane,
    Rigid,
    Unbounded,
)
from contact.problem import solve_system
from contact.problem.stiffness_form import StiffnessForm
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

MODULUS = 2.0 / (1 - 0.3**2)  # of plane strain, E = 2


def held(make, element, ratio, wide, pushed, E=2.0):
    """A column or a plate between a wall at its left and the floor: uniform uniaxial stress."""
    x, y = np.linspace(0, 1, 5), np.linspace(0, 0.5, 3) * (1 / ratio if wide else ratio)
    body = ElasticBody.from_mesh(make.box(element, x, y), element(), E=E, nu=0.3)
    body.fix("left", "x").load("top", (0.0, -0.5 * E))
    if pushed:
        body.fix("top", "y", -0.5 / MODULUS * 2 * y[-1])
    return ContactProblem(body, "bottom", 0.0)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("pushed", [True, False], ids=["pushed", "loaded"])
@pytest.mark.parametrize("wide", [True, False], ids=["plate", "column"])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_uniaxial_stress(element, wide, pushed, make):
    ratio = 1e6
    result = held(make, element, ratio, wide, pushed).solve()
    body = result.system.body
    x, y = body.mesh.p
    u_x, u_y = result.u[body.basis.nodal_dofs[:2]]
    assert max(result.kkt.values()) < 1e-10
    assert np.abs(result.balance()["residual"]).max() < 1e-10
    assert abs(result.contact_force - 1.0) < 1e-10
    np.testing.assert_allclose(u_y, -y / MODULUS, atol=1e-12 * y.max())
    np.testing.assert_allclose(u_x, 0.3 / 0.7 / MODULUS * x, atol=1e-12)
    # Rounding of u_y, seen as shear by cells r times as high as wide and in the pressure of
    # each point, though not in their sum, by the square of r.
    np.testing.assert_allclose(result.pressure, 1.0, atol=1e-12 if wide else 1e-15 * ratio**2)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("ratio", "solver"),
    [(25, "superlu"), (250, "auto"), (1000, "superlu"), (1e4, "auto"), (1e6, "auto")],
)
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_plate_held_by_contact_alone(element, ratio, solver, make):
    """A strip of 16 x 2 cells on a rough floor, pressed and pushed."""
    x, y = np.linspace(0, 1, 17), np.linspace(0, 1 / 8 / ratio, 3)
    body = ElasticBody.from_mesh(make.box(element, x, y), element(), E=2.0, nu=0.3)
    body.load("top", lambda x: np.array([0.1 + 0 * x[0], -2.0 - x[0]]))
    result = ContactProblem(body, "bottom", 0.0, 0.4, solver=solver).solve()
    few = ratio < 1e4  # fewer digits, by a product with the matrix
    assert max(result.kkt.values()) < (1e-10 if few else 1e-12)
    # The load: its mean, exactly, and its share at both ends.
    assert abs(result.contact_force / 2.5 - 1.0) < (1e-11 if few else 1e-12)
    assert abs(result.resultant[0] / -0.1 - 1.0) < (1e-9 if few else 1e-12)
    tol = 1e-3 * few + 2 / ratio
    np.testing.assert_allclose(result.centre_of_pressure[0, 0], 0.5 + 1 / 30, rtol=tol)


@pytest.mark.sampled(4)
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
    result = refusal = None
    try:
        result = ContactProblem(body, "bottom", 0.0, 0.4 if held == "loose" else 0.0).solve()
    except (NotConverged, InputError) as error:
        refusal = str(error)
    if result is None:
        assert "slender" in refusal
        assert (held, ratio) == ("loose", 1e6)
        return
    assert result.kkt["balance"] < 1e-10
    assert np.abs(result.balance()["residual"]).max() < 1e-9
    if held != "pushed down":
        assert abs(result.contact_force - 1.0) < 1e-9


def test_what_bends_by_rounding_is_refused(make):
    """A column whose bending resists by 1e-24 of its other stiffness: u_x was 1e4 widths."""
    x, y = np.linspace(0, 1, 5), np.linspace(0, 0.5e6, 3)
    body = ElasticBody.from_mesh(make.box(ElementQuadBFS, x, y), ElementQuadBFS(), E=2.0, nu=0.3)
    with pytest.raises(NotConverged, match=r"too slender.*squarer"):
        ContactProblem(body.load("top", (0.0, -1.0)), "bottom", 0.0, 0.4).solve()


def test_stiffness_form_from_rest_moves_a_driven_obstacle(make):
    body = ElasticBody.from_mesh(
        make.box(ElementQuad1, *[np.linspace(0, 1, 4)] * 2), ElementQuad1(), E=1.0, nu=0.3
    )
    obstacle = Rigid(Plane((0.0, 0.0), (0.0, 1.0)), force=(None, 0.01))
    problem = ContactProblem(body.fix("top"), "bottom", obstacle, 0.3)
    form = StiffnessForm(problem.condense(), problem.system)
    (u, mu, t), motion = form.solve(None, 1e-12, lambda line: None)
    assert max(problem.system.kkt(u, mu, t, motion).values()) < 1e-12
    assert np.abs(motion - problem.solve().motion).max() < 1e-12


def bent(length, push, along, tall, E=1.0):
    """Six by four cells, none of them slender: bent by its top, or hung at its left."""
    x, y = (1.0, length) if tall else (length, 1.0)
    mesh = MeshQuad.init_tensor(np.linspace(0, x, 7), np.linspace(0, y, 5))
    ends = {"bottom": (1, 0.0), "top": (1, y), "left": (0, 0.0), "right": (0, x)}
    mesh = mesh.with_boundaries(
        {n: lambda p, a=a, at=at: p[a] == at for n, (a, at) in ends.items()}
    )
    body = ElasticBody.from_mesh(mesh, E=E, nu=0.45)
    if tall:
        body.fix("top", "y", -push).fix("top", "x", along)
        return ContactProblem(
            body, "bottom", lambda p: 0.01 * np.sin(3 * p[0] + 1) ** 2, friction=1.0
        )
    body.fix("left", "x").load("top", (0.0, -push * E)).load("right", (along * E, 0.0))
    return ContactProblem(body, "bottom", lambda p: 0.05 + 0.01 * np.sin(3 * p[0] / x + 1) ** 2)


@settings(max_examples=20, deadline=None)
@given(
    st.floats(40.0, 160.0),
    st.floats(0.002, 0.03),
    st.floats(-0.03, 0.03),
    st.booleans(),
    st.sampled_from([1.0, 2e11]),
)
def test_slender_bodies_of_cells_that_are_not(length, push, along, tall, E):
    """The reactions are those of bending, far below the rounding of a product with the matrix."""
    problem = bent(length, push * (1 if tall else 1e-4), along * (1 if tall else 1e-2), tall, E)
    try:
        result = problem.solve()
    except Unbounded:
        return
    assert max(result.kkt.values()) <= 1e-10
    left = result.balance()
    size = max(np.abs(left[name]).max() for name in ("load", "support", "contact"))
    assert np.abs(left["load"] + left["support"] + left["contact"]).max() <= 1e-8 * size


def test_a_result_that_needed_strains_is_read_again(tmp_path, monkeypatch):
    failed = [0]
    real = solve_system.certify

    def once(*given):
        failed[0] += 1
        if failed[0] == 1:
            raise NotConverged("the balance")
        return real(*given)

    monkeypatch.setattr(solve_system, "certify", once)
    monkeypatch.setattr(solve_system, "solved_stiffly", stiffly := Stiffly())
    result = bent(100.0, 0.01, 0.02, True).solve()
    assert stiffly.calls == [False, True]
    again = ContactResult.load(result.save(tmp_path / "bent.npz"))
    np.testing.assert_array_equal(again.u, result.u)
    assert max(again.kkt.values()) < 2e-10
    assert again.system.body.slender
    assert again.kkt == result.kkt


class Stiffly:
    """The second attempt, which fails unless forces come from strains."""

    def __init__(self):
        self.calls, self.real = [], solve_system.solved_stiffly

    def __call__(self, system, *given):
        self.calls.append(system.body.slender)
        if not system.body.slender:
            raise NotConverged("the balance")
        return self.real(system, *given)


UNITS = [(1e-6, 1e12), (1e3, 1e-3)]
MORE = [(1.0, 1e9), (1e-6, 1e-3), (1e-6, 1e9), (1e-3, 1e6), (1e3, 1e12)]
SHAPES = ["held plate", "loose plate", "held column", "loose column"]


def fields(make, element, shape, ratio, length=1.0, E=1.0):
    """Displacement over length and tractions over E, of 4 x 3 or 2 x 2 x 2 slender cells."""
    dim = 3 if element in SOLID else 2
    n, m = (4, 3) if dim == 2 else (2, 2)
    long, short = np.linspace(0, 1, n + 1), np.linspace(0, m / n / ratio, m + 1)
    plate, held = "plate" in shape, "held" in shape
    ticks = [*(dim - 1) * [long if plate else short], short if plate else long]
    body = ElasticBody.from_mesh(
        make.box(element, *(length * t for t in ticks)), element(), E=E, nu=0.3
    )
    if held:
        body.fix("left", "x")
        if dim == 3:
            body.fix("front", "y")
    pushed = 0.02 * (plate and not held)
    load = E / ratio**2 * np.array([pushed, 0.5 * pushed, -0.1])  # it bends by less than its length
    body.load("top", load[[0, 2] if dim == 2 else [0, 1, 2]])
    result = ContactProblem(body, "bottom", 0.0, 0.3).solve()
    values = body.basis.nodal_dofs[:dim]
    return result.u[values] / length, result.pressure / E, result.shear / E


def same(make, element, shape, ratio, units):
    here = fields(make, element, shape, ratio)
    # Places are rounded by machine precision of the length, the strains of cells by that times
    # their ratio; a loose column bends by what its friction at the foot leaves open, and a held
    # solid plate slips where the pressure alone says how far.
    limit = 1e-15 * ratio**2 + 1e-9
    for length, E in units:
        there = fields(make, element, shape, ratio, length, E)
        for ours, theirs, allowed in zip(there, here, (1e-5, limit, 1e3 * limit), strict=True):
            size = np.abs(theirs).max()
            assert np.abs(ours - theirs).max() <= allowed * size, (length, E)


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    ("element", "shape"),
    [
        *((one, shape) for one in PLANE_AND_BFS for shape in SHAPES if shape != "held column"),
        *((one, "loose plate") for one in (ElementHex1, ElementHexAdini, ElementTetP2)),
    ],
)
def test_units(element, shape, make):
    """Micrometres and terapascals: one answer for all."""
    same(make, element, shape, 1e4, UNITS[:1])


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [4e2, 1e4, 1e6])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("element", PLANE_AND_BFS + SOLID)
def test_units_of_every_shape(element, shape, ratio, make):
    if ratio > 1e4 and (shape == "loose column" or element in SOLID):
        pytest.skip("what bends by the fourth power of the ratio is refused from there on")
    same(make, element, shape, ratio, UNITS if element in SOLID else UNITS + MORE)


def test_rules_with_negative_weights(make):
    """Their roots were NaN: the strains of a cell are taken at points of another rule."""
    x, y = np.linspace(0, 1, 5), np.linspace(0, 0.75, 4) / 1e4
    found = []
    for order in (3, 4):
        basis = Basis(make.box(ElementTriP2, x, y), ElementVector(ElementTriP2()), intorder=order)
        body = ElasticBody(basis, E=1.0, nu=0.3).fix("left", "x").load("top", (0.0, -0.1))
        found.append(ContactProblem(body, "bottom", 0.0, 0.3).solve().u)
        assert (order == 3) == bool(np.any(basis.W < 0))
    np.testing.assert_allclose(*found, rtol=0, atol=1e-12 * np.abs(found[1]).max())


FINE = 64  # a power of two: all cells have the same rounding, and the sum of it is n^2 precisions
TOL = 2e-13  # less than the sum of the forces that rounding leaves there


def posed(length=1.0, E=2.0, solver="auto", n=FINE):
    """A square of Adini cells, pressed on a bowl and dragged by its upper side."""
    x = np.linspace(0.0, length, n + 1)
    mesh = MeshQuad.init_tensor(x, x).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=E, nu=0.3)
    body.fix("top", "y", -0.05 * length).fix("top", "x", lambda x: 0.02 * length + 0.01 * x[0])

    def bowl(x):
        return 0.2 * (x[0] / length - 0.45) ** 2 * length

    return ContactProblem(body, "bottom", bowl, 0.9, solver=solver)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("length", "E"), [(1.0, 2.0), (2.0**-20, 2.0**38), (2.0**13, 2.0**-10)])
def test_the_balance_holds_in_every_unit(monkeypatch, length, E):
    problem = posed(length, E, n=2 * FINE)  # whatever order of sums a version has
    fine = problem.solve(tol=TOL)
    monkeypatch.setattr(solve_system, "RESERVE", np.inf)
    coarse = problem.solve()
    assert coarse.kkt["balance"] > TOL
    assert fine.kkt["balance"] < 0.1 * TOL
    # The condition amplifies what rounding left there, by as much as the version's order of sums.
    assert np.abs(fine.mu - coarse.mu).max() < 1e-10 * coarse.mu.max()
    assert np.abs(fine.u - coarse.u).max() < 1e-10 * np.abs(coarse.u).max()
