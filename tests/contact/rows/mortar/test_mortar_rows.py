"""Rows of two bodies: balance, coverage, matching meshes, symmetry, patch tests, ties, rings."""

import numpy as np
import pytest
from families import PLANE, PLANE_AND_BFS, SOLID
from fields import linear_dofs
from hypothesis import given, settings
from hypothesis import strategies as st
from posed_pairs import traction
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    Functional,
    LinearForm,
    MeshHex,
)
from solid_boxes import box, rows
from solid_boxes import pair as boxes
from two_blocks import block, facing, ring, sides, turned

from contact import ContactProblem, ElasticBody, InputError, Tie
from contact.body.rigid_modes import rigid_field
from contact.rows.discretise import contact_rows
from contact.rows.mortar.mortar_rows import mortar_rows
from skfem_adini import ElementHexAdini, ElementQuadBFS
from tests.contact.rows.cases import whole_ring

pytestmark = [
    pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning"),
    pytest.mark.filterwarnings("ignore:the cells are not parallelepipeds"),
]

KINDS = [None, "standard", "hat"]
kinds = pytest.mark.parametrize("kind", KINDS)


def cylinders(element, n, m, curved=False, size=1.0):
    """Arcs of radii 1 and 2 that touch in the origin."""
    arcs = np.linspace(-0.5, 0.6, n + 1), np.linspace(-0.4, 0.3, m + 1)
    upper, lower = ring(1.0, (0, 1), -np.pi / 2), ring(2.0, (0, -2), np.pi / 2)
    more = {"curved": curved, "size": size}
    one = block(element, [0.5, 1.0], arcs[0], place=upper, **more)
    two = block(element, [0.5, 1.0], arcs[1], place=lower, **more)
    return one, one.facets("right"), two, two.facets("right")


def check_balance(found, pair, size, touching):
    """Common rigid motions change nothing; forces, and moments of normal forces, cancel."""
    first, _, second, _ = pair
    rows, rng, dim = found.rows, np.random.default_rng(5), pair[0].dim
    motions = rigid_field(first, np.zeros(dim)), rigid_field(second, np.zeros(dim))
    assert motions[0].shape[1] == dim * (dim + 1) // 2
    for own, other, forces in (
        (rows.G, found.other_G, rng.uniform(0, 1, rows.G.shape[0])),
        (rows.T, found.other_T, rng.standard_normal(rows.T.shape[0])),
    ):
        for k in range(motions[0].shape[1]):
            if not (k < dim or own is rows.G or touching):
                continue
            one, two = motions[0][:, k], motions[1][:, k]
            # Dual functions over a barely covered facet oscillate, so that rounding is that of the
            # sum of moduli.
            terms = abs(own).sum(axis=1) * np.abs(one).max()
            terms += abs(other).sum(axis=1) * np.abs(two).max()
            rounding = 1e-14 * rows.G.shape[1]
            assert np.abs(own @ one + other @ two).max() <= rounding * terms.max()
            assert abs(forces @ own @ one + forces @ other @ two) <= rounding * (
                np.abs(forces) @ terms
            )
    frame = np.concatenate([rows.normals[:, None], rows.tangents], axis=1)
    assert np.abs(np.einsum("dim,djm->mij", frame, frame) - np.eye(dim)).max() < 1e-14
    if touching:
        assert np.abs(rows.gap).max() < 1e-12 * size


@pytest.mark.parametrize("kind", [None, "hat"])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_matching_meshes_have_the_rows_of_each_body(element, kind):
    """On straight facets G is today's functional of u_s - u_m."""
    xs = np.array([0.0, 0.1, 0.35, 0.5, 0.77, 1.0])
    place = None if element is ElementQuadBFS else turned(0.3)
    upper = block(element, xs, [0.0, 0.5, 1.0], place=place)
    lower = block(element, xs, [-1.0, -0.5, 0.0], place=place)
    found = mortar_rows(*sides(upper, lower), kind)
    if kind == "hat" and element not in (ElementTriP1, ElementQuad1):
        assert found.rows.weights.size == xs.size
        return
    own, other = (
        contact_rows(b, b.facets(s), 0.0, None) for b, s in ((upper, "bottom"), (lower, "top"))
    )
    for name in ("weights", "x", "x_nominal", "normals", "tangents", "gap"):
        assert np.abs(getattr(found.rows, name) - getattr(own, name)).max() < 1e-14
    assert abs(found.rows.G - own.G).max() < 1e-12
    assert abs(found.rows.T - own.T).max() < 1e-12
    # Along the normal of the upper body the lower one moves by -(its own normal displacement).
    assert abs(found.other_G - other.G).max() < 1e-12
    assert abs(found.other_T - other.T).max() < 1e-12


@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("element", PLANE)
def test_curved_interfaces(element, kind, curved, size):
    # Linear functions are not among those of linear elements on facets of second order.
    curved = curved and element in (ElementTriP2, ElementQuad2)
    for n, m in ((10, 7), (2, 9)):
        pair = cylinders(element, n, m, curved, size)
        for here in (pair, pair[2:] + pair[:2]):
            check_balance(mortar_rows(*here, kind), here, size, False)


def saddle(x):
    return np.array([x[0], x[1], x[2] + 0.3 * (x[0] - 0.5) ** 2 + 0.2 * (x[1] - 0.4) ** 2 * x[0]])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", SOLID)
@pytest.mark.parametrize("gap", [0.0, 1e-3, 0.1])
@kinds
def test_interfaces_in_space(element, kind, gap):
    """Forces act along the lines from x to y, which are the averaged normals."""
    place = None if element is ElementHexAdini else saddle
    upper = box(element, (3, 2, 1), (0.2, 0.1, 1 + gap), place=place)
    lower = box(element, (4, 5, 1), place=place)
    found = rows(upper, lower, functional=kind)
    check_balance(found, (upper, None, lower, None), 1.0, False)
    q = found.quadrature
    force = q.n * (found.P.T @ np.random.default_rng(0).random(found.rows.gap.size))
    moment = np.cross(q.y - q.x, force, axis=0).sum(axis=1)
    assert np.abs(moment).max() <= 1e-14 * np.abs(force).sum()
    assert abs(found.rows.weights.sum() - q.w.sum()) <= 1e-13


@kinds
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_linear_functions_and_places(element, kind):
    """A displacement grad . x along the normal has its values at the nominal places."""
    upper, lower = facing(element, 6, 9, place=lambda x: np.array([2 * x[0] + 3, x[1]]))
    found = mortar_rows(*sides(upper, lower), kind)
    rows, constant, gradient = found.rows, 0.7, np.array([0.2, -0.4])
    u, v = (linear_dofs(b, [[0, 0], gradient], shift=[0, constant]) for b in (upper, lower))
    assert np.abs(rows.G @ u + found.other_G @ v).max() < 1e-13
    if kind != "standard":
        assert np.abs(rows.G @ u + constant + gradient @ rows.x_nominal).max() < 1e-12
        # Pressures are reported at the centroids: a linear one has the right resultant and moment.
        assert abs(rows.weights @ rows.x[0] - 2 * 4.0) < 1e-12
    assert np.all(np.diff(rows.x_nominal[0]) * np.sign(np.diff(rows.x_nominal[0])[0]) > 0)


@pytest.mark.parametrize("element", PLANE)
def test_measured_gap_and_clearance(element):
    """A wedge against a flat side: closed form; a given clearance takes its place."""
    upper = block(
        element,
        np.linspace(0, 1, 5),
        [0, 1],
        place=lambda x: np.array([x[0], x[1] + 0.1 * x[0] + 0.2]),
    )
    lower = block(element, np.linspace(-1, 2, 8), [-1, 0])
    pair = sides(upper, lower, "lower")
    found = mortar_rows(*pair)
    # Along the normals of the flat lower side, above [0, 1].
    expected = 0.2 + 0.1 * found.quadrature.x[0]
    assert np.abs(found.quadrature.gap - expected).max() < 1e-14
    w = found.rows.weights
    assert abs(w @ found.rows.gap - 0.25) < 1e-14
    assert np.abs(mortar_rows(*pair, clearance=0.3).rows.gap - 0.3).max() == 0
    straight = mortar_rows(*pair, clearance=lambda x: 0.2 + 0.1 * x[0]).rows.gap
    assert np.abs(straight - found.rows.gap).max() < 1e-13
    given = np.arange(float(w.size))
    assert np.array_equal(mortar_rows(*pair, clearance=given).rows.gap, given)


@kinds
@pytest.mark.parametrize("element", [*PLANE, "bent"])
def test_planes_of_symmetry(element, kind):
    """Both bodies held along x at x = 0: the slip at that end is fixed, whatever the meshes."""
    if element == "bent":
        place = ring(1.0, (0, 1), -np.pi / 2), ring(2.0, (0, -2), np.pi / 2)
        arcs = np.linspace(0.0, 0.5, 8), np.linspace(-0.4, 0.0, 6)
        upper, lower = (
            block(ElementQuad2, [0.5, 1.0], a, place=p) for a, p in zip(arcs, place, strict=True)
        )
        upper.fix("bottom", "x"), lower.fix("top", "x")
        pair = upper, upper.facets("right"), lower, lower.facets("right")
    else:
        upper, lower = facing(element, 7, 5)
        upper.fix("left", "x"), lower.fix("left", "x")
        pair = sides(upper, lower)
    for here in (pair, [*pair[2:], *pair[:2]]):
        found = mortar_rows(*here, kind)
        at = np.flatnonzero(np.abs(found.rows.x_nominal[0]) < 1e-12)
        assert at.size == 1
        slip = found.rows.T @ here[0].constraint[0]
        assert np.abs(slip[at].toarray()).max() == 0.0
        assert np.abs((found.other_T @ here[2].constraint[0])[at].toarray()).max() == 0.0
        assert np.abs(found.rows.normals[0, at]).max() == 0.0
        # All other points are free to slip.
        rest = np.setdiff1d(np.arange(found.rows.gap.size), at)
        assert np.abs(slip[rest]).max(axis=1).toarray().min() > 0.01


def test_one_body_held_alone_can_slip():
    """The upper end is fixed, the lower body moves along: friction acts there."""
    upper, lower = facing(ElementQuad1, 4, 7)
    upper.fix("left", "x")
    found = mortar_rows(*sides(upper, lower))
    assert np.abs(found.other_T[[0]] @ lower.constraint[0]).max() > 0.1


FLAT, SPACE = facing(ElementTriP1, 3, 4), boxes(ElementHex1)


def of(one, first, two, second):
    return one, one.facets(first), two, two.facets(second)


def without(k):
    """The sides of FLAT, the facets at k left out."""
    return [v[:0] if i == k else v for i, v in enumerate(sides(*FLAT))]


ASIDE = facing(ElementTriP1, 3, 4, shift=5.0)[1], box(ElementHex1, (2, 2, 1), (5.0, 0.0, 0.0))
HIGH = facing(ElementTriP1, 3, 4, gap=10.0)[0]
SAME_WAY = "^others: the normals of the two boundaries point the same way"


@pytest.mark.parametrize(
    ("pair", "options", "words"),
    [
        (of(FLAT[0], "bottom", FLAT[1], "bottom"), {}, SAME_WAY),
        (of(SPACE[0], "top", SPACE[1], "top"), {}, SAME_WAY),
        (of(FLAT[0], "bottom", FLAT[0], "bottom"), {}, r"^others: facet \d+ belongs to both sides"),
        (of(SPACE[0], "bottom", SPACE[0], "bottom"), {}, "both sides"),
        (of(FLAT[0], "bottom", FLAT[1], "right"), {}, "^others: no facet lies opposite"),
        (of(FLAT[0], "bottom", ASIDE[0], "top"), {}, "^others: no facet lies opposite"),
        (of(SPACE[0], "bottom", ASIDE[1], "top"), {}, "no facet lies opposite"),
        (of(HIGH, "bottom", FLAT[1], "top"), {}, r"within 1[.]*[0-9]*; check the places"),
        (without(1), {}, "^facets: empty"),
        (without(3), {}, "^others: empty"),
        (sides(*FLAT), {"functional": "gauss"}, "^functional='gauss': two bodies offer"),
        *(
            (sides(*FLAT), {"clearance": wrong}, "^clearance")
            for wrong in (np.zeros(99), np.nan, lambda x: x, "wide", lambda x: x[0] * np.inf)
        ),
    ],
)
def test_refused(pair, options, words):
    with pytest.raises(InputError, match=words):
        mortar_rows(*pair, **options)


@settings(max_examples=20)
@given(
    st.sampled_from(PLANE_AND_BFS),
    st.sampled_from(PLANE),
    st.sampled_from(KINDS),
    st.sampled_from(["upper", "lower"]),
    st.integers(1, 10),
    st.integers(1, 10),
    st.floats(-0.95, 0.95) | st.just(0.0),
    st.floats(-3.0, 3.0),
    st.sampled_from([1e-6, 1.0, 1e6]),
    st.sampled_from([0.0, 0.2]),
)
def test_flat_interfaces(one, two, kind, multipliers, n, m, shift, angle, size, gap):
    if one is ElementQuadBFS:
        two, angle = one, 0.0
    upper, lower = facing(one, n, m, two, shift, gap, place=turned(angle), size=size)
    pair = sides(upper, lower, multipliers)
    check_balance(mortar_rows(*pair, kind), pair, size, gap == 0)


elements = pytest.mark.parametrize(
    "element", [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2], ids=lambda e: e.__name__
)


@elements
def test_uniform_pressure_on_quadrilaterals_that_are_no_parallelograms(element):
    """Nodal forces of either body against the load of its own traction, by another rule."""

    def bent(seed):
        def place(x):
            inner = np.prod(x[:2] * (1 - x[:2]), axis=0)
            turn = np.sin(7 * x[0] + 5 * x[1] + seed), np.cos(6 * x[1] - 4 * x[0] + seed)
            return x + np.array([0.3 * inner * turn[0], 0.3 * inner * turn[1], 0 * x[0]])

        return place

    upper = box(element, (3, 2, 1), (0, 0, 1), place=bent(1))
    lower = box(element, (4, 5, 1), place=bent(2))
    found = rows(upper, lower)
    for body, name, sign, G in (
        (upper, "bottom", -1, found.rows.G),
        (lower, "top", 1, found.other_G),
    ):
        basis = body.basis.boundary(body.facets(name), intorder=16)
        load = LinearForm(lambda v, w: v[2]).assemble(basis)
        force = G.T @ found.rows.weights
        assert np.abs(force - sign * load).max() <= 1e-11 * np.abs(load).max()


@pytest.mark.sampled(4)
@elements
@pytest.mark.parametrize("digits", range(1, 14, 2))
def test_narrow_parts_carry_their_share_of_a_uniform_pressure(element, digits):
    """Multiplier functions sum to one where a strip of 1e-13 of a facet is covered, too."""
    shift = 1 / 3 - 10.0**-digits, 0.5 - 3 * 10.0**-digits
    found = rows(*boxes(element, shift=shift))
    q, area = found.quadrature, (1 - shift[0]) * (1 - shift[1])
    assert abs(q.w.sum() - area) <= 1e-13
    assert np.all(found.rows.weights > 0)
    share = (found.P.T @ found.rows.weights) / q.w
    np.testing.assert_allclose(share, 1.0, atol=1e-11)


def tilted(x):
    a, b = 0.4, 0.3
    one = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    two = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return one @ two @ x


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", SOLID)
@pytest.mark.parametrize("place", [None, tilted], ids=["flat", "tilted"])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_integrals_over_covered_parts(element, place, unit):
    found = rows(*boxes(element, shift=(0.3, -0.2), unit=unit, place=place))
    q, area = found.quadrature, unit**2 * 0.7 * 0.8
    assert abs(q.w.sum() - area) <= 1e-12 * area
    assert abs(found.rows.weights.sum() - area) <= 1e-12 * area
    assert np.abs(q.x - q.y).max() <= 1e-12 * unit  # the two sides are in one plane
    assert np.abs(found.rows.gap).max() <= 1e-12 * unit
    assert np.abs(np.asarray(found.P.sum(axis=1)) - 1).max() <= 1e-11
    if place is None:  # products of the traces' degrees
        a, b = q.x[0] / unit, q.x[1] / unit
        exact = (1.0**3 - 0.3**3) / 3 * 0.8**2 / 2 * unit**2
        assert abs(q.w @ (a**2 * b) - exact) <= 1e-12 * exact


@pytest.mark.sampled(5)
@elements
@pytest.mark.parametrize("gap", [0.0, 0.02])
def test_cells_of_second_order_are_covered_up_to_their_edges(element, gap):
    """Two patches of concentric spheres: covered area, gap, and resultant of a pressure."""

    def ball(radius):
        def place(x):
            a, b = 0.8 * (x[0] - 0.5), 0.8 * (x[1] - 0.5)
            n = np.array([np.tan(a), np.tan(b), np.ones_like(a)])
            return (radius + 0.5 * x[2]) * n / np.linalg.norm(n, axis=0)

        return place

    upper = box(element, (6, 5, 1), place=ball(1 + gap), curved=True)
    lower = box(element, (8, 9, 1), (0, 0, -1), place=ball(1.0), curved=True)
    found = rows(upper, lower)
    basis = upper.basis.boundary(upper.facets("bottom"), intorder=10)
    area = Functional(lambda w: np.ones_like(w.x[0])).assemble(basis)
    resultant = Functional(lambda w: w.n[2]).assemble(basis)
    # What is left are the rims, of second order, which do not lie on top of each other.
    assert abs(found.quadrature.w.sum() - area) <= 5e-5 * area
    assert np.abs(found.rows.gap - gap).max() <= 5e-5
    q = found.quadrature
    assert abs(q.w @ q.n[2] - resultant) <= 1e-3 * abs(resultant)  # hats of normals


def test_only_the_nearest_of_two_layers_takes_part():
    """Two shelves, one below the other: the upper one hides the lower one, all or in part."""
    for width in (1.0, 0.55):
        near = MeshHex.init_tensor(np.linspace(0, width, 5), np.linspace(0, 1, 5), [0.4, 0.6])
        far = MeshHex.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 1, 4), [0.0, 0.2])
        mesh = (near + far).with_boundaries(
            {"top": lambda x: (np.abs(x[2] - 0.2) < 1e-9) | (np.abs(x[2] - 0.6) < 1e-9)}
        )
        upper = box(ElementHex1, (3, 3, 1), (0, 0, 0.6))
        found = rows(upper, ElasticBody.from_mesh(mesh, ElementHex1(), E=1.0, nu=0.3))
        q = found.quadrature
        assert abs(q.w.sum() - 1) <= 1e-12
        np.testing.assert_allclose(q.gap, np.where(q.x[0] < width, 0.0, 0.4), atol=1e-14)
        if width == 1.0:
            assert np.abs(found.rows.gap).max() <= 1e-14


GRADIENT = np.array([[0.3, -0.2], [0.5, 0.1]])


@pytest.mark.sampled(3)
@pytest.mark.parametrize("ends", [("left", "right"), (), ("left",)], ids=["held", "free", "one"])
@pytest.mark.parametrize("multipliers", ["upper", "lower"])
@pytest.mark.parametrize(("n", "m"), [(7, 10), (3, 14), (14, 3)])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_ties_pass_a_linear_displacement(element, n, m, multipliers, ends):
    """And its traction, whatever the supports at the ends of the interface hold."""
    upper, lower = facing(element, n, m)
    lam, mu = float(np.max(upper.lam)), float(np.max(upper.mu))
    stress = lam * np.trace(GRADIENT) * np.eye(2) + mu * (GRADIENT + GRADIENT.T)
    for body, far in ((upper, "top"), (lower, "bottom")):
        for c in range(2):
            body.fix([far, *ends], c, lambda x, c=c: np.tensordot(GRADIENT[c], x, 1))
        for side, n_x in {"left": -1.0, "right": 1.0}.items():
            if side not in ends:
                body.load(side, stress[:, 0] * n_x)
    side = "first" if multipliers == "upper" else "second"
    tie = Tie(upper, "bottom", lower, "top", functional="standard", multipliers=side)
    result = ContactProblem([upper, lower], [tie]).solve()
    for body in (upper, lower):
        off = result[body].u - linear_dofs(body, GRADIENT)
        assert np.abs(off[body.are_values]).max() < 1e-11
    assert np.abs(traction(result) - stress @ result.system.rows.normals).max() < 1e-8


@pytest.mark.parametrize("element", PLANE)
@pytest.mark.parametrize(("n", "m"), [(8, 8), (8, 31), (40, 13), (37, 37)])
def test_closed_interfaces(element, n, m):
    """All of either polygon is covered once; gaps are between the sagittas of the polygons."""
    inner = whole_ring(element, n, [0.5, 0.75, 1.0], 0.0)
    outer = whole_ring(element, m, [1.0, 1.5, 2.0], 0.1)
    pair = inner, inner.facets("rim"), outer, outer.facets("bore")
    for count, here in ((n, pair), (m, pair[2:] + pair[:2])):
        found = mortar_rows(*here)
        length = 2 * count * np.sin(np.pi / count)
        assert abs(found.rows.weights.sum() - length) < 1e-13 * length
        assert found.rows.gap.size == count
        assert np.abs(found.rows.weights - length / count).max() < 1e-13
        # The points run round: neighbours are neighbours.
        step = np.linalg.norm(np.diff(found.rows.x_nominal, axis=1), axis=0)
        assert np.abs(step - length / count).max() < 1e-12
        sagittas = 1.0 / np.cos(np.pi / np.array([n, m])) - 1.0
        assert np.abs(found.quadrature.gap).max() < 1.01 * sagittas.max()
