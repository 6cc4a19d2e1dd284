"""Cells that are taken, refused or spoken of; quadrature; second-order meshes; equal elements."""

import logging
import pickle

import numpy as np
import pytest
import skfem
from skfem import Basis, ElementVector, FacetBasis, MeshHex, MeshHex2, MeshQuad, MeshQuad2
from skfem.element import ElementQuadBFS as ScikitFemBFS
from skfem.helpers import ddot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

import skfem_adini
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadAdiniWeighted, ElementQuadBFS

ADINI, BRICK, BFS = ElementQuadAdini(), ElementHexAdini(), ElementQuadBFS()
BENDING = skfem.BilinearForm(lambda u, v, _: ddot(u.hess, v.hess))


def moved(mesh, by):
    """Move every vertex by up to so much of the side of a cell."""
    side = mesh.nelements ** (-1 / mesh.dim())
    step = by * side * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape)
    return type(mesh)(mesh.p + step, mesh.t)


# The quadrature that scikit-fem chooses by `maxdeg`, against one of a much higher degree.


def difference(form, mesh, element, high):
    exact = form.assemble(Basis(mesh, element, intorder=high))
    return abs(form.assemble(Basis(mesh, element)) - exact).max() / abs(exact).max()


@pytest.mark.parametrize(
    ("element", "mesh", "high"),
    [
        (ADINI, MeshQuad().refined(2), 14),
        (BRICK, MeshHex().refined(1), 12),
        (BFS, MeshQuad.init_tensor([0, 0.2, 1.0, 1.3], [0, 0.7, 1.0]), 16),
    ],
)
def test_quadrature_is_exact_on_affine_cells(element, mesh, high):
    shear = np.eye(mesh.dim()) + 0.3 * np.eye(mesh.dim(), k=1)
    if element is not BFS:
        mesh = type(mesh)(shear @ mesh.p, mesh.t)
    for form in (laplace, mass, BENDING):
        assert difference(form, mesh, element, high) < 1e-13


@pytest.mark.parametrize(
    ("mesh", "element", "by", "high", "stiffness", "bending"),
    [
        (MeshQuad().refined(2), ADINI, 0.08, (20, 30), 1e-8, 2e-8),
        (MeshQuad().refined(2), ADINI, 0.2, (20, 30), 1e-6, 5e-5),
        (MeshQuad().refined(2), ADINI, 0.32, (20, 30), 3e-5, 2e-2),
        (MeshHex().refined(1), BRICK, 0.04, (14, 16), 5e-10, None),
        (MeshHex().refined(1), BRICK, 0.2, (14, 16), 3e-7, None),
    ],
)
def test_quadrature_on_twisted_cells(mesh, element, by, high, stiffness, bending):
    """Limits twice the measured differences; with degree 6 they were 60 to 400 times as large."""
    mesh = moved(mesh, by)
    assert difference(mass, mesh, element, high[0]) < 1e-14
    assert difference(laplace, mesh, element, high[1]) < stiffness
    if bending:
        assert difference(BENDING, mesh, element, high[1]) < bending


# The message in the log on cells that are not parallelograms.


def trapezoid():
    """A new mesh, of which nothing has been said yet."""
    return MeshQuad(np.array([[0.0, 2, 1, 0], [0, 0, 1, 1]]), np.array([[0, 1, 2, 3]]).T)


def frustum():
    x, y, z = MeshHex().p
    return MeshHex(np.array([x * (1 - z / 2), y * (1 - z / 2), z]), MeshHex().t)


@pytest.fixture
def logged(caplog):
    """Return a function that gives what is logged when a basis is made."""

    def messages(mesh, element):
        caplog.clear()
        Basis(mesh, element, intorder=1)
        assert {record.levelno for record in caplog.records} <= {logging.WARNING}
        assert {record.name.split(".")[0] for record in caplog.records} <= {"skfem_adini"}
        return caplog.messages

    return messages


def test_silent_on_parallel_sides(parallel_cells, logged):
    assert not logged(parallel_cells, ADINI if parallel_cells.dim() == 2 else BRICK)


def test_once_for_each_mesh(logged):
    """However many bases and elements it gets; a mesh made later is spoken of again."""
    elements = [ADINI, ElementVector(ADINI), ADINI * ADINI, skfem.ElementDG(ADINI)]
    for first in elements * 2:
        mesh = trapezoid()
        assert len(logged(mesh, first)) == 1
        for element in elements:
            assert not logged(mesh, element)


def test_assembly_speaks_of_the_mesh_once_and_facets_and_probes_do_not(caplog):
    """Assembly evaluates a few cells at a time, as meshes of their own."""
    mesh = moved(MeshQuad().refined(3), 0.08)
    for _ in range(2):
        skfem_adini.assemble(laplace, mesh, ADINI)
    basis = Basis(mesh, ADINI)
    assert len(caplog.messages) == 1
    caplog.clear()
    basis.probes(np.array([[0.2, 0.3], [0.4, 0.5]]))
    basis.interpolator(basis.zeros())(np.array([[0.2], [0.4]]))
    FacetBasis(trapezoid(), ADINI)
    assert not caplog.messages


@pytest.mark.parametrize(
    ("make", "element", "word"),
    [(trapezoid, ADINI, "quadrilateral"), (frustum, BRICK, "hexahedral")],
)
def test_says_what_is_lost_and_twist_falls_with_uniform_refinement(make, element, word, logged):
    messages = [logged(make().refined(k), element) for k in range(4)]
    assert [len(m) for m in messages] == [1] * 4
    assert "from 4 to 2 in L2 and from 3 to 1 in H1" in messages[0][0]
    assert f"uniform refinement of a coarse {word} mesh" in messages[0][0]
    twists = [float(m[0].split()[8]) for m in messages]
    if element is ADINI:
        assert "twist t = 0.5" in messages[0][0]
        assert twists == pytest.approx([1 / 2, 1 / 3, 1 / 5, 1 / 9], rel=0.05)
    assert twists[2] / twists[3] == pytest.approx(2, abs=0.3)


def test_silent_when_negligible(logged):
    p = MeshQuad().p.copy()
    p[0, 2] += 5e-4
    assert not logged(MeshQuad(p, MeshQuad().t), ADINI)


# Cells that are refused.


def turned_top(angle):
    """Turn the face z = 1; the section at z has the area |1 - z + z e^(i angle)|^2."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = MeshHex().p - 0.5
    p = np.where(z > 0, np.array([c * x - s * y, s * x + c * y, z]), np.array([x, y, z]))
    return MeshHex(p, MeshHex().t)


def test_far_from_a_parallelepiped_but_valid(logged):
    """At 3.0 only the eight parts of each edge show that the Jacobian keeps its sign."""
    for angle in (1.0, 3.0):
        assert len(logged(turned_top(angle), BRICK)) == 1


def brick(vertex, place):
    p = MeshHex().p.copy()
    p[:, vertex] = place
    return MeshHex(p, MeshHex().t, validate=False)


def quad(*corners):
    return MeshQuad(np.array(corners, float).T, np.array([[0, 1, 2, 3]]).T, validate=False)


FLAT = [[1.0], [1.0], [0.0]]
SIGN = r"1 of 1 cells.*Jacobian of one sign"
RECTANGLE = r"1 of 1 cells are no rectangles.*turn the coordinates"
REFUSED = {
    "pushed through the opposite corner": (brick(7, (-0.2, -0.2, -0.2)), BRICK, SIGN),
    "in the plane of its neighbours": (brick(0, (0.5, 0.5, 0.0)), BRICK, SIGN),
    "two vertices in one place": (brick(0, (1.0, 0, 0)), BRICK, SIGN),
    "NaN brick": (brick(3, (np.nan, 0, 0)), BRICK, SIGN),
    "flat brick": (MeshHex(MeshHex().p * FLAT, MeshHex().t, validate=False), BRICK, SIGN),
    "order of another code": (MeshHex(MeshHex().p, np.roll(MeshHex().t, 1, 0)), BRICK, SIGN),
    # All corners are sound, the middle is flat.
    "top turned by half a turn": (turned_top(np.pi), BRICK, SIGN),
    "turned": (quad((0, 0), (1, 0.001), (0.999, 1.001), (-0.001, 1)), BFS, RECTANGLE),
    "sheared": (quad((0, 0), (1, 0), (1.5, 1), (0.5, 1)), BFS, RECTANGLE),
    "trapezoid": (quad((0, 0), (2, 0), (1, 1), (0, 1)), BFS, RECTANGLE),
    "diamond": (quad((0, 0), (1, 1), (0, 2), (-1, 1)), BFS, RECTANGLE),
    "degenerate": (quad((0, 0), (1, 0), (1, 0), (0, 0)), BFS, "cells are no"),
    "concave": (quad((0, 0), (1, 0), (0.2, 0.2), (0, 1)), ADINI, "convex"),
    "crossed": (quad((0, 0), (1, 0), (0, 1), (1, 1)), ADINI, "convex"),
    "flat": (quad((0, 0), (1, 0), (2, 0), (3, 0)), ADINI, "convex"),
    "three corners": (quad((0, 0), (1, 0), (1, 1), (1, 1)), ADINI, "convex"),
    "straight corner": (quad((0, 0), (1, 0), (2, 0), (0, 1)), ADINI, "convex"),
    "NaN": (quad((0, 0), (1, 0), (1, np.nan), (0, 1)), ADINI, "convex"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_bad_cells_are_refused(name):
    mesh, element, message = REFUSED[name]
    with pytest.raises(skfem_adini.InputError, match=message):
        element.gbasis(mesh._mapping(), np.full((mesh.dim(), 1), 0.5), 0)


# Meshes of second order whose cells are straight give what those of first order give.

PAIRS = {
    "quad": (moved(MeshQuad().refined(2), 0.2), MeshQuad2, ADINI),
    "rectangle": (MeshQuad().refined(2), MeshQuad2, BFS),
    "far rectangle": (MeshQuad().refined(2).translated((30.0, -20.0)), MeshQuad2, ADINI),
    "small": (MeshQuad().refined(2).scaled((1e-6, 1e-6)), MeshQuad2, ADINI),
    "vector": (MeshQuad().refined(2), MeshQuad2, ElementVector(ADINI)),
    "brick": (moved(MeshHex().refined(1), 0.1), MeshHex2, BRICK),
}


def agree(a, b):
    return abs(a - b).max() <= 1e-8 * abs(a).max()


@pytest.mark.parametrize("name", PAIRS)
def test_second_order_meshes(name):
    first, second, element = PAIRS[name]
    bases = [Basis(m.with_defaults(), element) for m in (first, second.from_mesh(first))]
    if name == "vector":
        assert agree(*(linear_elasticity(1.0, 1.0).assemble(basis) for basis in bases))
        return
    assert agree(*(laplace.assemble(basis) for basis in bases))
    assert agree(*(mass.assemble(FacetBasis(basis.mesh, basis.elem)) for basis in bases))
    assert agree(*(skfem_adini.assemble(mass, basis.mesh, basis.elem) for basis in bases))
    # Vertices come first, in the order of the first-order mesh.
    np.testing.assert_array_equal(bases[0].nodal_dofs, bases[1].nodal_dofs)
    x = np.random.default_rng(0).standard_normal(bases[0].N)
    some = [basis.mesh.boundary_facets()[:3] for basis in bases]
    np.testing.assert_array_equal(*some)
    calls = (
        lambda basis, _: skfem_adini.nodal_gradient(basis, x),
        lambda basis, _: skfem_adini.near_null_space(basis).modes,
        lambda basis, facets: skfem_adini.essential_constraints(basis, facets, lambda x: x[0])[1],
        lambda basis, facets: skfem_adini.project_trace(basis, facets, lambda x: x[0] ** 2),
        lambda basis, _: np.asarray(skfem_adini.to_pyvista(basis, x).points),
        lambda basis, _: np.asarray(skfem_adini.to_pyvista(basis, x).point_data["u"]),
    )
    for call in calls:
        assert agree(*(call(basis, facets) for basis, facets in zip(bases, some, strict=True)))
    fixed = [
        skfem_adini.essential_dofs(b, f, clamp_normal=True)
        for b, f in zip(bases, some, strict=True)
    ]
    np.testing.assert_array_equal(*fixed)


@pytest.mark.parametrize(
    ("kind", "element", "node"),
    [(MeshQuad2, ADINI, 25), (MeshQuad2, ADINI, -1), (MeshHex2, BRICK, -1)],
)
def test_curved_cells_are_refused(kind, element, node):
    mesh = (MeshQuad() if kind is MeshQuad2 else MeshHex()).refined(2 if kind is MeshQuad2 else 0)
    mesh = kind.from_mesh(mesh)
    for by in (1e-7, 1e-3, np.nan):
        p = mesh.doflocs.copy()
        p[1, node] += by
        message = rf"cells of the {kind.__name__} are curved.*straight-sided"
        with pytest.raises(skfem_adini.InputError, match=message):
            Basis(kind(p, mesh.t), element)


# Elements made alike are equal, name what they were made with, and survive pickling.

KINDS = [ElementQuadAdini, ElementQuadBFS, ElementHexAdini]


@pytest.mark.parametrize("kind", KINDS)
def test_equality_is_that_of_class_and_derivatives(kind):
    one, same, other = kind(derivatives=2), kind(), kind(derivatives=3)
    assert one == same
    assert hash(one) == hash(same)
    assert len({one, same, other}) == 2
    assert one != other
    assert all(one != e() for e in [*KINDS, ScikitFemBFS, skfem.ElementQuad1] if e is not kind)
    assert repr(one) == f"{kind.__name__}(derivatives=2)"
    copy = pickle.loads(pickle.dumps(other))
    assert copy == other
    assert copy.derivatives == 3
    mesh = MeshHex() if kind is ElementHexAdini else MeshQuad()
    assert Basis(mesh, ElementVector(one)).elem.elem == same

    class Mine(kind):
        pass

    assert Mine() != one
    assert one != Mine()
    assert repr(Mine()) == "Mine(derivatives=2)"


def weight(x):
    return 1 - x[0] ** 2 - x[1] ** 2


def slope(x):
    return -2 * x


def test_elements_of_curved_domains_are_named_and_compared_by_their_functions():
    one, same = (ElementQuadAdiniWeighted(weight, slope) for _ in range(2))
    assert one == same
    assert hash(one) == hash(same)
    assert one != ElementQuadAdiniWeighted(weight, slope, degree=4)
    assert one != ElementQuadAdiniWeighted(weight, lambda x: slope(x))
    assert one != ElementQuadAdini(derivatives=1)
    functions = "weight=weight, gradient=slope, hessian=NoneType"
    assert repr(one) == f"ElementQuadAdiniWeighted({functions}, derivatives=1, degree=2)"
    mesh = MeshQuad().refined(3)
    cut = skfem_adini.ElementQuadAdiniCut(
        mesh, lambda x: (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - 0.411**2
    )
    assert repr(cut) == f"ElementQuadAdiniCut(64 cells, {cut.inside.sum()} vertices inside)"
