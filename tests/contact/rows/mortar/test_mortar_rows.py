"""Rows of two bodies: rigid motions, sums of forces and moments, matching meshes, symmetry."""

import numpy as np
import pytest
from families import PLANE, PLANE_AND_BFS
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import ElementQuad1, ElementQuad2, ElementTriP1, ElementTriP2
from two_blocks import block, facing, ring, sides, turned

from contact import ElasticBody, InputError
from contact.body.rigid_modes import rigid_field, rigid_modes
from contact.rows.discretise import contact_rows
from contact.rows.mortar.mortar_rows import mortar_rows
from skfem_adini import ElementQuadAdini, ElementQuadBFS

KINDS = [None, "standard", "hat"]


def cylinders(element, n, m, curved=False, size=1.0):
    """Arcs of radii 1 and 2 that touch in the origin."""
    arcs = np.linspace(-0.5, 0.6, n + 1), np.linspace(-0.4, 0.3, m + 1)
    upper, lower = ring(1.0, (0, 1), -np.pi / 2), ring(2.0, (0, -2), np.pi / 2)
    more = {"curved": curved, "size": size}
    one = block(element, [0.5, 1.0], arcs[0], place=upper, **more)
    two = block(element, [0.5, 1.0], arcs[1], place=lower, **more)
    return one, one.facets("right"), two, two.facets("right")


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


@pytest.mark.turns(4)
@settings(max_examples=60)
@given(
    st.sampled_from(PLANE),
    st.sampled_from(PLANE),
    st.sampled_from(KINDS),
    st.integers(1, 10),
    st.integers(1, 10),
    st.floats(-0.97, 0.97),
    st.floats(-3.0, 3.0),
    st.sampled_from([1e-6, 1.0, 1e6]),
    st.sampled_from([0.0, 0.2]),
)
def test_flat_interfaces(one, two, kind, n, m, shift, angle, size, gap):
    upper, lower = facing(one, n, m, two, shift, gap, place=turned(angle), size=size)
    for pair in (sides(upper, lower), sides(upper, lower, "lower")):
        check_balance(mortar_rows(*pair, kind), pair, size, gap == 0)


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


def check_balance(found, pair, size, touching):
    """Common rigid motions change nothing; forces, and moments of normal forces, cancel."""
    first, _, second, _ = pair
    rows, rng = found.rows, np.random.default_rng(5)
    motions = rigid_field(first, np.zeros(2)), rigid_field(second, np.zeros(2))
    assert motions[0].shape[1] == 3
    for own, other, forces in (
        (rows.G, found.other_G, rng.uniform(0, 1, rows.G.shape[0])),
        (rows.T, found.other_T, rng.standard_normal(rows.T.shape[0])),
    ):
        for k in range(3):
            moved = own @ motions[0][:, k] + other @ motions[1][:, k]
            normal = own is rows.G
            if k < 2 or normal or touching:
                # Dual functions over a barely covered facet oscillate, so that rounding is that of
                # the sum of moduli.
                largest = [np.abs(motion[:, k]).max() for motion in motions]
                terms = abs(own).sum(axis=1) * largest[0] + abs(other).sum(axis=1) * largest[1]
                assert np.abs(moved).max() <= 1e-14 * rows.G.shape[1] * terms.max()
                total = forces @ own @ motions[0][:, k] + forces @ other @ motions[1][:, k]
                assert abs(total) <= 1e-14 * rows.G.shape[1] * (np.abs(forces) @ terms)
    assert np.abs(np.linalg.norm(rows.normals, axis=0) - 1).max() < 1e-14
    assert np.abs(np.linalg.norm(rows.tangents[:, 0], axis=0) - 1).max() < 1e-14
    assert np.abs(np.sum(rows.normals * rows.tangents[:, 0], axis=0)).max() < 1e-14
    if touching:
        assert np.abs(rows.gap).max() < 1e-12 * size


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_linear_functions_and_places(element, kind):
    """A displacement grad . x along the normal has its values at the nominal places."""
    upper, lower = facing(element, 6, 9, place=lambda x: np.array([2 * x[0] + 3, x[1]]))
    found = mortar_rows(*sides(upper, lower), kind)
    rows = found.rows
    field = np.array([0.7, 0.2, -0.4])

    def values(body):
        dofs = body.scalar_dofs
        u = np.zeros(2 * dofs.N)
        x = body.mesh.p
        u[2 * dofs.nodal_dofs[0] + 1] = field[0] + field[1] * x[0] + field[2] * x[1]
        for c, nodal in enumerate(dofs.nodal_dofs[1:3]):
            u[2 * nodal + 1] = field[1 + c]
        for table in (dofs.facet_dofs, dofs.interior_dofs):
            for k in table:
                at = body.basis.doflocs[:, 2 * k]
                u[2 * k + 1] = field[0] + field[1] * at[0] + field[2] * at[1]
        return u

    G, other = rows.G @ values(upper), found.other_G @ values(lower)
    assert np.abs(G + other).max() < 1e-13
    if kind != "standard":
        expected = -(field[0] + field[1] * rows.x_nominal[0] + field[2] * rows.x_nominal[1])
        assert np.abs(G - expected).max() < 1e-12
        # Pressures are reported at the centroids: a linear one has the right resultant and moment.
        moment = rows.weights @ rows.x[0]
        assert abs(moment - 2 * 4.0) < 1e-12
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
    for wrong in (np.zeros(w.size + 1), float("nan"), lambda x: x, "wide", lambda x: x[0] * np.inf):
        with pytest.raises(InputError, match=r"^clearance"):
            mortar_rows(*pair, clearance=wrong)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("element", [*PLANE, "bent"])
def test_planes_of_symmetry(element, kind):
    """Both bodies held along x at x = 0: the slip at that end is fixed, whatever the meshes."""
    if element == "bent":
        pair = cylinders(ElementQuad2, 7, 5)
        pair = [*pair]
        arcs = np.linspace(0.0, 0.5, 8), np.linspace(0.0, 0.4, 6)
        upper = block(ElementQuad2, [0.5, 1.0], arcs[0], place=ring(1.0, (0, 1), -np.pi / 2))
        lower = block(ElementQuad2, [0.5, 1.0], -arcs[1][::-1], place=ring(2.0, (0, -2), np.pi / 2))
        upper.fix("bottom", "x")
        lower.fix("top", "x")
        pair = upper, upper.facets("right"), lower, lower.facets("right")
    else:
        upper, lower = facing(element, 7, 5)
        upper.fix("left", "x")
        lower.fix("left", "x")
        pair = sides(upper, lower)
    for here in (pair, [*pair[2:], *pair[:2]]):
        found = mortar_rows(*here, kind)
        at = np.flatnonzero(np.abs(found.rows.x_nominal[0]) < 1e-12)
        assert at.size == 1
        left = np.abs((found.rows.T @ here[0].constraint[0])[at].toarray()).max()
        right = np.abs((found.other_T @ here[2].constraint[0])[at].toarray()).max()
        assert left == right == 0.0
        assert np.abs(found.rows.normals[0, at]).max() == 0.0
        # All other points are free to slip.
        rest = np.setdiff1d(np.arange(found.rows.gap.size), at)
        free = np.abs((found.rows.T @ here[0].constraint[0])[rest]).max(axis=1).toarray()
        assert free.min() > 0.01


def test_one_body_held_alone_can_slip():
    """The upper end is fixed, the lower body moves along: friction acts there."""
    upper, lower = facing(ElementQuad1, 4, 7)
    upper.fix("left", "x")
    found = mortar_rows(*sides(upper, lower))
    assert np.abs(found.other_T[[0]] @ lower.constraint[0]).max() > 0.1


@pytest.mark.parametrize("element", [ElementQuad1, ElementTriP2, ElementQuadAdini])
def test_a_body_against_itself(element):
    """The lips of a slot in one body are two sides like any others."""
    xs, ys = np.linspace(0, 2, 9), np.array([0.0, 1.0, 1.1, 2.0])
    whole = block(element, xs, ys)
    keep = ~np.all(
        (np.abs(whole.mesh.p[:, whole.mesh.t].mean(axis=1) - [[1.5], [1.05]]) < [[0.5], [0.05]])[
            None
        ],
        axis=(0, 1),
    )
    mesh = whole.mesh.restrict(np.flatnonzero(keep))
    body = type(whole).from_mesh(mesh, element(), E=1.0, nu=0.3)
    x = mesh.p[:, mesh.facets].mean(axis=1)
    upper = np.flatnonzero((np.abs(x[1] - 1.1) < 1e-9) & (x[0] > 1) & (mesh.f2t[1] < 0))
    lower = np.flatnonzero((np.abs(x[1] - 1.0) < 1e-9) & (x[0] > 1) & (mesh.f2t[1] < 0))
    found = mortar_rows(body, upper, body, lower)
    assert np.abs(found.rows.gap - 0.1).max() < 1e-14
    total = found.rows.G + found.other_G
    assert np.abs(total @ rigid_modes(body)).max() < 1e-12
    with pytest.raises(InputError, match=r"^others: facet \d+ belongs to both sides"):
        mortar_rows(body, upper, body, np.append(lower, upper[0]))


@pytest.mark.parametrize("element", PLANE)
def test_the_tip_of_a_slit(element):
    """Where both lips have the same dofs the rows of one minus the other are zero to the bit."""
    whole = block(element, np.linspace(0, 2, 9), [-1.0, -0.3, 0.0, 0.4, 1.0]).mesh
    p, t = whole.p, whole.t.copy()
    lip = np.flatnonzero((p[1] == 0.0) & (p[0] > 1.0))
    above = p[1, t].mean(axis=0) > 0
    twin = np.arange(p.shape[1])
    twin[lip] = p.shape[1] + np.arange(lip.size)
    t[:, above] = twin[t[:, above]]
    mesh = type(whole)(np.hstack((p, p[:, lip])), t, sort_t=False)
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    x = mesh.p[:, mesh.facets].mean(axis=1)
    lips = np.flatnonzero((np.abs(x[1]) < 1e-12) & (x[0] > 1) & (mesh.f2t[1] < 0))
    up = above[mesh.f2t[0, lips]]
    found = mortar_rows(body, lips[up], body, lips[~up])
    total = abs(found.rows.G + found.other_G).max(axis=1).toarray().ravel()
    slip = abs(found.rows.T + found.other_T).max(axis=1).toarray().ravel()
    # An Adini element has its value and its slopes there: two coefficients of the trace.
    tip = 2 if element is ElementQuadAdini else 1
    # Points run along the interface; the tip is its left end.
    assert np.all(total[:tip] == 0.0)
    assert np.all(slip[:tip] == 0.0)
    assert total[tip:].min() > 0.1


def test_bad_input():
    upper, lower = facing(ElementTriP1, 3, 4)
    first, facets, second, others = sides(upper, lower)
    with pytest.raises(InputError, match=r"^functional='gauss': two bodies offer"):
        mortar_rows(first, facets, second, others, "gauss")
    with pytest.raises(InputError, match=r"^facets: empty"):
        mortar_rows(first, facets[:0], second, others)
    with pytest.raises(InputError, match=r"^others: empty"):
        mortar_rows(first, facets, second, others[:0])
