"""Malformed input: each gives its own error, which names what is wrong."""

import dataclasses

import numpy as np
import pytest
from hot_bodies import blocks, floor, two_bodies
from pressed_pairs import stack
from skfem import (
    Basis,
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementQuadP,
    ElementTetP2,
    ElementTriP2,
    ElementVector,
    FacetBasis,
    MeshHex,
    MeshLine,
    MeshQuad,
    MeshTet,
    MeshTri,
)
from two_blocks import block, facing

from contact import (
    ContactError,
    ContactProblem,
    ContactResult,
    ContactWarning,
    DynamicStepper,
    ElasticBody,
    Infeasible,
    InputError,
    LayeredBlock,
    LoadStepper,
    NotConverged,
    Pair,
    Plane,
    Rigid,
    ThermalContact,
    Tie,
    Unbounded,
    cross_check,
    uniqueness,
)
from skfem_adini import ElementQuadAdini

NAN, INF = np.nan, np.inf
MATERIAL = {"E": 1.0, "nu": 0.3}
FLOOR = Plane((0, 0, 0), (0, 0, 1))


def problem(make, obstacle=None, friction=0.0, boundary="bottom", **options):
    obstacle = make.foundation[2] if obstacle is None else obstacle
    return ContactProblem(make.block(4), boundary, obstacle, friction, **options)


def held_beside(*support):
    body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), **MATERIAL).fix(*support)
    stamp = Rigid(Plane((0, 0), (0, 1)), force=(None, 0.01))
    return ContactProblem(body, "bottom", stamp)


def in_time(make, density=1.0, dt=0.1, **options):
    return DynamicStepper(problem(make), density, dt, **options)


def body(element=ElementQuad1, mesh=None, **material):
    return ElasticBody.from_mesh(mesh or MeshQuad(), element(), **(MATERIAL | material))


def basis(mesh, element, *components, kind=Basis):
    return ElasticBody(kind(mesh, ElementVector(element, *components)), **MATERIAL)


def cube(make, element=ElementHex1):
    return body(element, make.box(element, *([0.0, 0.5, 1.0],) * 3))


def on_floor(make, obstacle=FLOOR, friction=0.3):
    return ContactProblem(cube(make).fix("top"), "bottom", obstacle, friction)


def p2_block(make):
    return make.block(4, ElementQuad2)


def square(*corners):
    return MeshQuad(np.array(corners, dtype=float).T, np.arange(4)[:, None])


BENT = square((0, 0), (1, 0), (0.2, 0.2), (0, 1))


def swapped(mesh):
    """Two vertices have changed places: cells fold over."""
    p = mesh.p.copy()
    p[:, [0, 1]] = p[:, [1, 0]]
    return type(mesh)(p, mesh.t)


def with_nan():
    mesh = MeshQuad().refined(1)
    p = mesh.p.copy()
    p[0, 0] = NAN
    return type(mesh)(p, mesh.t)


def far():
    return MeshQuad().with_boundaries({"far": lambda x: x[0] > 9})


def result(make):
    return make.solved(n=4)[1]


def dome(make):
    """A problem in space, and its result."""
    problem = make.dome(ElementHex1, 2)
    return problem, problem.solve()


def micrometre(make):
    """Pushed by 1e-7 of the size of the body into the obstacle."""
    small = body(mesh=make.box(ElementQuad1, *(np.linspace(0, 1e-6, 5),) * 2))
    return ContactProblem(small.fix("bottom", "y", -1e-13), "bottom", 0.0)


def held_below(make, value):
    held = make.block(4, sides=()).fix("bottom", "y", value)
    return ContactProblem(held, "bottom", make.foundation[2])


def spoilt(make, name):
    """A result whose forces are no numbers."""
    array = np.full_like(getattr(result(make), name), NAN)
    return dataclasses.replace(result(make), **{name: array})


def loaded(body, traction, obstacle=FLOOR, friction=0.0):
    return ContactProblem(body.load("top", traction), "bottom", obstacle, friction).solve()


def two_steps(problem):
    return problem.solve("fixed_point", max_iterations=2)


def layers():
    return LayeredBlock(1.0, [(0.5, 8, 1.0, 0.3)], sides="x")


# What is called with the builders, and a word of the InputError.
INPUT = [
    # obstacle
    (lambda m: problem(m, lambda x: np.where(x[0] > 0.5, NAN, 1.0)), "gap holds NaN"),
    (lambda m: problem(m, np.zeros(3)), "3 gaps given"),
    (lambda m: problem(m, np.full(10, NAN)), "gap holds NaN"),
    (lambda m: problem(m, lambda x: 1j * x[0]), "real numbers"),
    (lambda m: problem(m, m.foundation[3]), "dimension 3"),
    (lambda m: on_floor(m, m.foundation[2]), "dimension 2"),
    (lambda m: ContactProblem(m.block(4), "bottom", None, 0.3), "obstacle: None"),
    (lambda m: ContactProblem(m.block(4), "bottom", None, 0.0, "tresca"), "obstacle: None"),
    # friction
    (lambda m: problem(m, friction=-0.1), "friction"),
    (lambda m: problem(m, friction=NAN), "friction"),
    (lambda m: problem(m, friction=lambda x: x[0] - 0.5), "friction"),
    (lambda m: problem(m, friction=np.ones(3)), "10 values"),
    (lambda m: on_floor(m, friction=np.ones((9, 2))), "9 values"),
    (lambda m: problem(m, friction=None), "friction"),
    # boundary
    (lambda m: problem(m, boundary="floor"), "'floor' is unknown"),
    (lambda m: ContactProblem(body(), "bottom", 0.0), "mesh names none"),
    (lambda m: problem(m, boundary=[]), "has no facets"),
    (lambda m: ContactProblem(body(mesh=far()), "far", 0.0), "has no facets"),
    (lambda m: problem(m, boundary=np.flatnonzero(m.block(4).mesh.f2t[1] >= 0)), "inside the body"),
    (lambda m: problem(m, boundary=[10**6]), "must lie in"),
    (lambda m: problem(m, boundary=np.array([True, False])), "whole facet numbers"),
    (lambda m: problem(m, boundary=None), "boundary=None"),
    (lambda m: ContactProblem(m.block(4).fix("bottom"), "bottom", 0.0).solve(), "is prescribed"),
    # mesh and element
    (lambda m: body(ElementQuadAdini, MeshTri()), "MeshTri1"),
    (lambda m: body(ElementQuad1, MeshHex()), "MeshHex1"),
    (lambda m: ElasticBody.from_mesh(MeshLine(), **MATERIAL), "no default for MeshLine1"),
    (lambda m: body(ElementQuad1, BENT), "convex"),
    (lambda m: body(ElementQuad2, square((0, 0), (1, 0), (0, 1), (1, 1))), "folded"),
    (lambda m: basis(swapped(MeshHex()), ElementHex1()), "folded"),
    (lambda m: body(ElementHex1, swapped(MeshHex())), "folded"),
    (lambda m: body(mesh=with_nan()), "not finite"),
    (lambda m: ElasticBody(Basis(MeshQuad(), ElementQuad1()), **MATERIAL), "ElementVector"),
    (lambda m: basis(MeshQuad(), ElementQuad1(), kind=FacetBasis), "basis: expected"),
    (lambda m: ElasticBody(MeshQuad(), **MATERIAL), "basis"),
    (lambda m: basis(MeshQuad(), ElementQuad1(), 3), "3 displacement components"),
    (lambda m: basis(MeshTet(), ElementTetP2(), 2), "2 displacement components"),
    (
        lambda m: ContactProblem(
            body(lambda: ElementQuadP(3), MeshQuad().with_defaults()), "bottom", 0.0
        ),
        "no contact functional",
    ),
    # material
    (lambda m: body(E=-np.ones(1)), "E="),
    (lambda m: body(E=np.ones(3)), "E: expected"),
    (lambda m: body(nu=np.zeros((4, 4))), "nu: expected"),
    # loads
    (lambda m: m.block(4).load("top", (1.0,)), "2 components"),
    (lambda m: m.block(4).load("top", lambda x: np.zeros((2, 7))), "does not fit"),
    (lambda m: m.block(4).load("top", (NAN, 0)), "not finite"),
    (lambda m: m.block(4).load("top", lambda x: x * NAN), "not finite"),
    (lambda m: m.block(4).load("roof", (0, 1)), "'roof' is unknown"),
    (lambda m: m.block(4).body_force((1, 2, 3)), "2 components"),
    # supports
    (lambda m: m.block(4).fix("roof"), "'roof' is unknown"),
    (lambda m: m.block(4).fix("top", "xw"), "components='xw'"),
    (lambda m: m.block(4).fix("top", 2), "components=2"),
    (lambda m: ContactProblem(m.block(4), "bottom", m.block(4)), r"give body\.surface"),
    (lambda m: m.block(4).fix("top", ""), "components=''"),
    (lambda m: m.block(4).fix("top", (0, 0)), r"components=\(0, 0\): names one twice"),
    (lambda m: m.block(4).fix("top", "y", NAN), "value=nan"),
    (lambda m: m.block(4).fix("top", "y", (1, 2)), "value="),
    (lambda m: m.block(4).fix("top", "y", lambda x: x[0] * NAN).constraint, "NaN"),
    (lambda m: p2_block(m).fix("top", "y", lambda x: x[0] * NAN).constraint, "finite"),
    (lambda m: m.block(4).fix("top", "y", lambda x: np.zeros(3)).constraint, "shape"),
    (lambda m: m.block(4).fix("top", "x", 0.1).constraint, "must agree"),
    (lambda m: p2_block(m).fix("top", "x", 0.1).constraint, "differ where they meet"),
    (lambda m: layers().periodic("top"), r"^periodic: a LayeredBlock takes no equations"),
    (lambda m: layers().tie("top"), r"^tie: a LayeredBlock takes no equations"),
    (lambda m: layers().constrain("top"), r"^constrain: a LayeredBlock takes no equations"),
    # problem and method
    (lambda m: ContactProblem("body", "bottom", 0.0), "body"),
    (lambda m: problem(m, friction=0.3, law="newton"), "law='newton'"),
    (lambda m: problem(m, friction=0.3, law=None), "law=None is contact without friction"),
    (lambda m: problem(m, functional="magic"), "functional='magic'"),
    (
        lambda m: ContactProblem(m.block(4, ElementQuad1), "bottom", 0.0, functional="bernstein"),
        "ElementQuad1 offers",
    ),
    (lambda m: problem(m, solver="abacus").solve(), "solver='abacus'"),
    (lambda m: problem(m).solve("bicycle"), "method='bicycle'"),
    (lambda m: problem(m).solve(None), "method=None"),
    (lambda m: problem(m).solve("tresca_loop"), "frictionless problem takes"),
    (lambda m: problem(m, friction=0.1, law="tresca").solve("tresca_loop"), "tresca problem takes"),
    (lambda m: problem(m).solve("qp:abacus"), "qpsolvers offers"),
    (lambda m: m.dome(ElementHex1, 2).solve("qp:osqp"), "no QP"),
    (lambda m: problem(m, friction=0.3).solve(eps=1e-3), "eps"),
    (lambda m: problem(m, friction=0.3).solve("fixed_point", eps=NAN), "eps=nan"),
    (lambda m: problem(m).solve(tol=-1.0), "tol=-1"),
    (lambda m: problem(m).solve(tol=1e3), "tol=1000"),
    (lambda m: problem(m).solve(max_iterations=0), "max_iterations=0"),
    (lambda m: m.dome(ElementHex1, 2).solve(start=result(m)), "start"),
    (lambda m: on_floor(m).solve(after=m.dome(ElementHex1, 3).solve()), "after"),
    (lambda m: held_beside("bottom", "y").solve(), "Rigid: supports hold, along its normal, every"),
    # results and their checks
    (lambda m: result(m).sample([[5.0], [5.0]]), "outside"),
    (lambda m: result(m).sample([[NAN], [0.0]]), "points"),
    (lambda m: spoilt(m, "mu").boundary_to_pyvista(), "mu"),
    (lambda m: spoilt(m, "t").boundary_to_pyvista(), "t"),
    (lambda m: cross_check(m.solved(n=4)[0], result(m), "abacus"), "qpsolvers offers"),
    (lambda m: cross_check(*dome(m)), "3-D"),
    (lambda m: cross_check(*dome(m), "osqp"), "clarabel"),
    (lambda m: cross_check(None, result(m)), "problem: expected a ContactProblem"),
    (lambda m: cross_check(result(m), m.solved(n=4)[0]), "problem: expected a ContactProblem"),
    (lambda m: cross_check(m.solved(n=4)[0], None), "result: expected a ContactResult"),
    (lambda m: cross_check(m.problem(5), result(m)), "result: has"),
    (lambda m: uniqueness(m.problem(5), result(m)), "contact points"),
    (lambda m: uniqueness(m.solved(n=4)[0], result(m), starts=-1), "starts"),
    (lambda m: uniqueness(m.solved(n=4)[0], result(m), starts=True), "starts"),
    (lambda m: uniqueness(m.solved(n=4)[0], result(m), seed="0"), "seed"),
    (lambda m: uniqueness(m.solved(n=4)[0], {}), "result: expected a ContactResult, got dict"),
    (lambda m: uniqueness(result(m), m.solved(n=4)[0]), "problem: .* got ContactResult"),
    (lambda m: ContactResult.load("no/such/file.npz"), "does not exist"),
    (lambda m: ElasticBody.from_mesh("no/such/file.msh", **MATERIAL), "does not exist"),
    # histories
    (lambda m: m.dragged(n=2).run([]), "times"),
    (lambda m: m.dragged(n=2).run([1.0, 0.5]), "increase"),
    (lambda m: m.dragged(n=2).step(INF), "time="),
    (lambda m: m.dragged(n=2).load("top", (0, 1), 3.0), "factor"),
    (lambda m: m.dragged(n=2).load("top", (0, 1), lambda t: NAN).run([1.0]), "factor"),
    (lambda m: m.dragged(n=2).load("nowhere", (0, 1)), "nowhere"),
    (lambda m: LoadStepper(on_floor(m)).load("top", (0, 1)), "3 components"),
    (lambda m: m.dragged(n=2).move("left", "x"), "not fixed"),
    (lambda m: m.dragged(n=2).move("top", "x", NAN), "value"),
    (lambda m: m.dragged(n=2).obstacle(0.3), "obstacle"),
    (lambda m: m.dragged(n=2).obstacle(lambda t: NAN).run([1.0]), "NaN"),
    (lambda m: LoadStepper(m.dragged(n=2)), "problem"),
    (lambda m: LoadStepper(problem(m), halvings=-1), "halvings"),
    (lambda m: LoadStepper(problem(m), method="no"), "method"),
    (lambda m: m.dragged(n=2).history.to_pvd("x.pvd"), "no finished step"),
    # steps in time
    (lambda m: DynamicStepper(m.block(4), 1.0, 0.1), "problem"),
    (lambda m: DynamicStepper(problem(m, overclosure=1.0), 1.0, 0.1), "overclosure"),
    (lambda m: in_time(m, density=0.0), "density"),
    (lambda m: in_time(m, density=NAN), "density"),
    (lambda m: in_time(m, density=[1.0, 2.0, 3.0]), "one value for each"),
    (lambda m: in_time(m, dt=0.0), "dt"),
    (lambda m: in_time(m, dt=-1.0), "dt"),
    (lambda m: in_time(m, dt=NAN), "dt"),
    (lambda m: in_time(m, scheme="newmark"), "scheme"),
    (lambda m: in_time(m, mass="none"), "mass"),
    (lambda m: in_time(m, mass="lumped"), "lumped"),
    (lambda m: in_time(m, damping=(0.1,)), "damping"),
    (lambda m: in_time(m, damping=(0.0, -0.1)), "damping"),
    (lambda m: in_time(m, keep=0), "keep"),
    (lambda m: in_time(m, start=INF), "start"),
    (lambda m: in_time(m, velocity=(0.0, NAN)), "velocity"),
    (lambda m: in_time(m, velocity=(0.0, 1.0, 2.0)), "velocity"),
    (lambda m: in_time(m, displacement=lambda x: x * NAN), "displacement"),
    (lambda m: in_time(m, method="fast"), "method"),
    (lambda m: in_time(m).run(0), "steps"),
    (lambda m: in_time(m).history.to_pvd("x.pvd"), "no finished step"),
    (lambda m: problem(m).solve(after=3), "after"),
]
OTHERS = [
    (lambda m: held_below(m, -0.1).solve(), Infeasible, "beyond its gap"),
    (lambda m: micrometre(m).solve(), Infeasible, "beyond its gap"),
    (lambda m: loaded(m.block(4, sides=()), (0, 0), INF), Unbounded, "translation along y"),
    (lambda m: loaded(cube(m), (0, 0, 1.0)), Unbounded, "the body is not held: a translation"),
    (lambda m: loaded(cube(m), (0.5, 0, -1.0), FLOOR, 0.3), Unbounded, "not held: a translation"),
    (lambda m: problem(m, friction=0.3).solve(tol=1e-25), NotConverged, "e-2"),
    (lambda m: held_beside("left").solve(), NotConverged, "supports may hold contact points"),
    (lambda m: two_steps(problem(m, friction=0.9)), NotConverged, "after 2 steps"),
]


@pytest.mark.parametrize(
    ("call", "error", "word"),
    [*((call, InputError, word) for call, word in INPUT), *OTHERS],
    ids=[word for *_, word in (*INPUT, *OTHERS)],
)
def test_malformed(call, error, word, make):
    with pytest.raises(error, match=word) as caught:
        call(make)
    assert type(caught.value) is error
    assert isinstance(caught.value, ContactError)
    assert error is not InputError or isinstance(caught.value, ValueError)
    if error is NotConverged and "after" in word:
        assert [line.phase for line in caught.value.history].count("fixed point") == 2


def two(**more):
    upper, lower = facing(ElementQuad1, 4, 6, **more)
    lower.fix("bottom", "xy")
    upper.fix("left", "x").load("top", (0.0, -0.05))
    return upper.named("upper"), lower.named("lower")


def tied(one, other, kind, **place):
    upper, lower = two(**place)
    return ContactProblem([upper, lower], [kind(upper, one, lower, other)])


def ring():
    return two(plane="axisymmetric")[0]


# Of two bodies, whose pair is given: what is called, and words of the InputError.
PAIRS = [
    (lambda a, b, p: ContactProblem([a, b], []), "no Pair"),
    (lambda a, b, p: ContactProblem([a, b], "bottom", 0.0), "list of Pair"),
    (
        lambda a, b, p: ContactProblem([a, b, block(ElementQuad2, [0, 1], [0, 1])], [p]),
        "belongs to no pair",
    ),
    (lambda a, b, p: ContactProblem([a], [p]), "is not one of"),
    (lambda a, b, p: ContactProblem([a, a], [p]), "given twice"),
    (lambda a, b, p: ContactProblem([a, b], [p, p]), "two pairs"),
    (lambda a, b, p: ContactProblem([a, b], [p], 0.0), "obstacle: give it to the pairs"),
    (lambda a, b, p: ContactProblem(a, "bottom", a.surface("bottom")), "both sides"),
    (
        lambda a, b, p: ContactProblem([a], [Pair(a, "bottom", a, "bottom")]),
        r"^boundary: facet 1 of 'upper' .*to both sides of one$",
    ),
    (lambda a, b, p: ContactProblem(ring(), "bottom", b.surface("top")), "axisymmetric"),
    (lambda a, b, p: Pair(a, "bottom", b), "name the boundary"),
    (lambda a, b, p: Pair(a, "bottom", Plane((0, 0), (0, 1)), clearance=0.1), "clearance"),
    (lambda a, b, p: Pair(a, "bottom", b, "top", multipliers="both"), "multipliers"),
    (lambda a, b, p: Pair("upper", "bottom", b, "top"), "expected a body"),
    (lambda a, b, p: ContactProblem(a, "top", b.surface("top")), "point the same way"),
    (lambda a, b, p: ContactProblem(a, "bottom", b.surface("nowhere")), "nowhere"),
    (lambda a, b, p: setattr(ContactProblem([a, b], [p]), "obstacle", 0.0), "obstacle"),
    (lambda a, b, p: Pair(a, "bottom", b, "tpo"), "^other of 'lower': boundary 'tpo' is unknown"),
    (
        lambda a, b, p: ContactProblem([a, b], [Pair(a, "botom", b, "top")]),
        r"^boundary 'botom'.*the Pair of 'upper' and 'lower'",
    ),
]


@pytest.mark.parametrize(("call", "word"), PAIRS, ids=[word for _, word in PAIRS])
def test_bodies_and_pairs_that_do_not_fit(call, word):
    upper, lower = two()
    with pytest.raises(InputError, match=word):
        call(upper, lower, Pair(upper, "bottom", lower, "top"))


# Of heat: what is called, and words of the InputError.
HEAT = [
    (lambda: ThermalContact(None, 1.0, 1.0), r"^problem: expected a ContactProblem"),
    (lambda: floor(conductivity=-1.0), r"^conductivity: expected positive"),
    (lambda: floor(conductivity=np.array([[1.0, 2], [2, 1]])), r"^conductivity: a tensor"),
    (lambda: floor(conductivity=[1.0, 2.0]), r"^conductivity: .* list of 1, one a"),
    (lambda: floor(conductivity=NAN), r"^conductivity: expected a finite number"),
    (lambda: floor(conductance=-1.0), r"^conductance=-1.0: must not be negative"),
    (
        lambda: floor(conductance=lambda p, g: -p).fix("top", 1.0).solve(),
        r"^conductance: expected a function \(p, g\)",
    ),
    (lambda: floor(partition=1.5), r"^partition: expected parts"),
    (lambda: floor(method="midpoint"), r"^method='midpoint'"),
    (lambda: floor(tol=0.0), r"^tol=0.0"),
    (lambda: floor(friction_heat=-1.0), r"^friction_heat: must not be below 0"),
    (lambda: floor().run([0.0, 1.0]), r"^capacity: steps in time need"),
    (lambda: floor(capacity=-1.0).run([0.0, 1.0]), r"^capacity: expected density"),
    (lambda: floor(capacity=1.0).run([1.0, 0.0]), r"^times: must increase"),
    (lambda: floor(capacity=1.0).run([1.0]), r"^times: at least two"),
    (lambda: floor().fix("nowhere", 1.0), "nowhere"),
    (lambda: floor().fix("top", NAN), r"^temperature: expected a finite number"),
    (lambda: floor().convection("top", -1.0, 0.0), r"^coefficient: must not be below"),
    (lambda: floor().convection("top", 1.0, np.inf), r"^ambient: expected a finite"),
    (lambda: floor().inflow("top", "much"), r"^flux="),
    (lambda: floor().source(lambda x: NAN * x[0]), r"^power: expected a finite"),
    (lambda: floor().fix("top", 1.0, 2.0), r"^factor=2.0: expected a function of time"),
    (lambda: two_bodies().fix("top", 1.0), r"^body: there are several"),
    (
        lambda: floor().fix("top", 1.0).solve(start=two_bodies().solve()),
        r"^start, initial: a result of other bodies",
    ),
    (
        lambda: ThermalContact(blocks()[2], 1.0, 1.0, obstacle_temperature=1.0),
        r"^obstacle_temperature: None where",
    ),
    (lambda: floor(ElementQuad2, functional="gauss"), r"^functional='gauss': its contact"),
    (lambda: floor().fix("top", 1.0).solve().sample([0.5]), r"^points: expected finite numbers"),
    (lambda: floor(expansion=np.ones(5)).fix("top", 1.0).solve(), r"^expansion: expected a number"),
    (lambda: heated(layers()), "not in a LayeredBlock"),
    (
        lambda: heated(body(mesh=MeshQuad().with_defaults()).periodic("left", "right")),
        "temperature of a periodic body",
    ),
]


def heated(body):
    return ThermalContact(ContactProblem(body, "bottom", 0.0), 1.0, 1.0)


@pytest.mark.parametrize(("call", "word"), HEAT, ids=[word for _, word in HEAT])
def test_heat_that_makes_no_sense(call, word):
    with pytest.raises(InputError, match=word):
        call()


@pytest.mark.parametrize("kind", [Pair, Tie])
@pytest.mark.parametrize(
    ("sides", "place", "said"),
    [
        (("top", "bottom"), {}, "no facet lies opposite.*of 'upper' and 'lower'"),
        (("left", "right"), {}, "no facet lies opposite.*of 'upper' and 'lower'"),
        (("top", "top"), {}, "the normals of the two boundaries point the same way"),
        *(
            (("bottom", "top"), place, "no facet lies opposite")
            for place in ({"gap": 10.0}, {"shift": 1.0}, {"shift": 5.0}, {"gap": -1.5})
        ),
    ],
)
def test_sides_that_do_not_face_each_other(kind, sides, place, said):
    with pytest.raises(InputError, match=rf"^opposite: {said}"):
        tied(*sides, kind, **place)


def test_plane_stress_on_plane_strain_is_warned_of():
    upper, _ = two(plane="stress")
    _, lower = two()
    pair = Pair(upper, "bottom", lower, "top")
    with pytest.warns(ContactWarning, match=r"^bodies: 'upper' in plane stress, 'lower' in plane"):
        solved = ContactProblem([upper, lower], [pair]).solve()
    assert abs(solved.resultant[1] - 0.05) < 1e-12
    with pytest.warns(ContactWarning, match=r"^bodies: 'upper' in plane stress"):
        ContactProblem(upper, "bottom", lower.surface("top"))


def test_bodies_of_a_result_are_chosen_by_number_and_interfaces_shown_in_one_line():
    pressed = stack()
    solved = pressed.solve()
    assert np.array_equal(solved[np.int64(1)].u, solved[1].u)
    for call in (solved.stress, solved.von_mises, lambda: solved.sample([[0.5], [0.5]])):
        with pytest.raises(InputError, match="choose one"):
            call()
    for wrong in (3, -1, "middle", block(ElementQuad2, [0, 1], [0, 1]), None, True):
        with pytest.raises(InputError, match="is not one of 'top block', body 1"):
            solved[wrong]
    assert repr(pressed.boundaries) == f"Interfaces(3 pairs, {pressed.rows.gap.size} points)"


def test_the_body_of_a_result_is_chosen_as_one_of_several():
    alone = block(ElementQuad2, [0, 1], [0, 1]).fix("top", None, -0.01).named("alone")
    solved = ContactProblem(alone, "bottom", 0.0).solve()
    for right in (0, np.int64(0), "alone", alone):
        assert np.array_equal(solved[right].u, solved.u)
    for wrong in (1, -1, "other", block(ElementQuad2, [0, 1], [0, 1]), None, False):
        with pytest.raises(InputError, match="is not one of 'alone'"):
            solved[wrong]


@pytest.mark.parametrize("load", [(0.1, -0.2), (0.0, 0.2)])
def test_a_body_that_is_not_held_is_named(load):
    upper, lower = facing(ElementQuad2, 3, 4)
    upper.named("upper").load("top", load)
    pressed = ContactProblem(upper, "bottom", lower.fix("bottom", "xy").surface("top"))
    with pytest.raises(Unbounded, match=r"translation along .* of 'upper'"):
        pressed.solve()


@pytest.mark.parametrize("element", [ElementQuad1, ElementQuadAdini], ids=lambda e: e.__name__)
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_a_stiff_body_that_contact_holds_is_refused_with_the_reason(element, size):
    """It moves as a rigid one, and its reactions drown in the rounding of its displacements."""
    stiff, _ = facing(element, 4, 6, E=1e10, size=size)
    _, lower = facing(element, 4, 6, E=1.0, size=size)
    lower.fix("bottom", "xy")
    stiff.fix("left", "x").load("top", (0.0, -0.01))
    pair = Pair(stiff, "bottom", lower, "top", friction=0.3)
    with pytest.raises(NotConverged, match=r"stiffest body is \de\+(09|10) times as stiff"):
        ContactProblem([stiff, lower], [pair]).solve()


GMSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
1 1 "bottom"
2 2 "body"
$EndPhysicalNames
$Entities
0 1 1 0
1 0 0 0 1 0 0 1 1 0
1 0 0 0 1 1 0 1 2 0
$EndEntities
$Nodes
1 4 1 4
2 1 0 4
1
2
3
4
0 0 0
1 0 0
1 1 0
0 1 0
$EndNodes
$Elements
2 3 1 3
1 1 1 1
1 1 2
2 1 2 2
2 1 2 3
3 1 3 4
$EndElements
"""


def test_a_sound_mesh_file_and_its_beginnings(tmp_path):
    path = tmp_path / "square.msh"
    path.write_text(GMSH)
    loaded = ElasticBody.from_mesh(path, **MATERIAL)
    assert loaded.mesh.nelements == 2
    assert loaded.facets("bottom").size == 1
    assert isinstance(loaded.element, ElementTriP2)
    for length in range(0, GMSH.index("\n$EndElements"), 9):
        path.write_text(GMSH[:length])
        with pytest.raises(InputError, match=r"square\.msh cannot be read: it ends early, at \$"):
            ElasticBody.from_mesh(path, E=1.0, nu=0.3)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("noise.msh", b"\x00\x01\x02 no mesh"),
        ("text.msh", b"hello\n"),
        ("empty.vtu", b""),
        ("mesh.xyzzy", b"1 2 3"),
        ("text.vtk", b"# vtk DataFile Version 3.0\nbroken"),
        # Triangles in space that are not flat.
        ("bent.msh", GMSH.replace("1 1 0\n0 1 0\n$End", "1 1 5\n0 1 0\n$End").encode()),
    ],
)
def test_not_a_mesh_file(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match="." if "bent" in name else name.replace(".", r"\.")):
        ElasticBody.from_mesh(tmp_path / name, E=1.0, nu=0.3)
