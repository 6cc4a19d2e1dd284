"""Segments of an interface against closed forms and against rays cast at every facet."""

import numpy as np
import pytest
from families import PLANE
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from skfem import ElementQuad1, ElementQuad2, ElementTriP2
from two_blocks import block, facing, ring, sides, turned

from contact import InputError
from contact.rows.mortar.facet_curves import (
    FacetCurves,
    _near_the_lines,
    _sides,
    interface_segments,
)
from contact.rows.outline import Outline


def curves(body, side):
    return FacetCurves.of(Outline(body, body.facets(side)))


def both(upper, lower):
    first, facets, second, others = sides(upper, lower)
    return FacetCurves.of(Outline(first, facets)), FacetCurves.of(Outline(second, others))


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


@settings(max_examples=40)
@given(
    st.integers(1, 12),
    st.integers(1, 12),
    st.floats(-0.99, 0.99),
    st.floats(-3.1, 3.1),
    st.sampled_from([1e-6, 1.0, 1e6]),
    st.sampled_from([0.0, 0.3, -0.05]),
)
def test_covered_length_of_blocks(n, m, shift, angle, size, gap):
    place = turned(angle, (2.0, -1.0))
    upper, lower = facing(ElementQuad1, n, m, shift=shift, gap=gap, place=place, size=size)
    for one, two in (both(upper, lower), both(upper, lower)[::-1]):
        q = one.cut(two, 3)
        # Rounding of places of size 3 against a length of 1 - |shift|, at least .01.
        assert abs(q.w.sum() - size * (1 - abs(shift))) < 1e-14 * size
        assert np.abs(q.gap - size * gap).max() < 1e-14 * size
        pieces = interface_segments(one, two)
        assert np.all(pieces.end > pieces.start)
        inside = np.diff(pieces.facet) == 0
        assert np.all(pieces.start[1:][inside] == pieces.end[:-1][inside])


def cylinders(element, n, m, curved, R=2.0, height=0.0):
    """A cylinder of radius 1 on one of radius R below it, arcs of 1.2 rad to either side."""
    arc = np.linspace(-1.2, 1.2, n + 1), np.linspace(-1.2, 1.2, m + 1)
    upper = ring(1.0, (0.0, 1.0 + height), -np.pi / 2)
    lower = ring(R, (0.0, -R), np.pi / 2)
    return (
        curves(block(element, [0.5, 1.0], arc[0], place=upper, curved=curved), "right"),
        curves(block(element, [0.5, 1.0], arc[1], place=lower, curved=curved), "right"),
    )


def rays(one, two, q):
    """Distance to the nearest facing facet on the ray of every point, by trial of all facets."""
    s = np.linspace(0.0, 1.0, 2)
    best = np.full(q.w.size, np.inf)
    for f in range(two.sign.size):
        at = np.full(2, f)
        outward = two.outward(at[:1], np.array([0.5]))[:, 0]
        a, b = two.at(at, s).T
        for k in range(q.w.size):
            if outward @ q.n[:, k] > -0.25:
                continue
            t, along = np.linalg.solve(np.array([q.n[:, k], a - b]).T, a - q.x[:, k])
            if -1e-12 <= along <= 1 + 1e-12 and abs(t) < abs(best[k]):
                best[k] = t
    return best


@pytest.mark.parametrize(("n", "m"), [(5, 5), (13, 4), (3, 17), (11, 30)])
def test_polygons_against_rays(n, m):
    pair = cylinders(ElementQuad1, n, m, False, height=0.1)
    for one, two in (pair, pair[::-1]):
        q = one.cut(two, 3)
        assert np.abs(cross(q.y - q.x, q.n)).max() < 1e-15
        assert np.abs(q.gap - rays(one, two, q)).max() < 1e-13


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuad2])
@pytest.mark.parametrize(("n", "m"), [(5, 7), (12, 3)])
def test_curved_facets_against_a_bracketing_solver(element, n, m):
    """Places lie on the curved facets of either side, found by Brent's method here."""
    pair = cylinders(element, n, m, True)
    for one, two in (pair, pair[::-1]):
        q = one.cut(two, 9)
        assert np.any(two.bulge)
        for k in range(0, q.w.size, 5):
            at, n_k, x = q.other[[k]], q.n[:, k], q.x[:, k]

            def off(s, at=at, n_k=n_k, x=x, two=two):
                return cross(two.at(at, np.array([s]))[:, 0] - x, n_k)

            s = brentq(off, -1e-9, 1 + 1e-9, xtol=1e-15)
            assert np.abs(two.at(at, np.array([s]))[:, 0] - q.y[:, k]).max() < 1e-14
        assert np.abs(q.x - one.at(q.facet, q.X[0])).max() == 0.0


@pytest.mark.parametrize(("curved", "order"), [(False, 2), (True, 3)])
def test_gap_of_cylinders_converges(curved, order):
    """Against the gap between the circles themselves, along the normals of the upper one."""
    R, error, counts = 2.0, [], [8, 16, 32]
    for n in counts:
        upper, lower = cylinders(ElementQuad2, n, int(1.37 * n), curved, R, 0.3)
        q = upper.cut(lower, 9)
        n_x = q.n * (np.abs(q.x[0]) < 0.5)
        centre = np.array([0.0, 1.3])[:, None] - np.array([0.0, -R])[:, None]
        # |centre + n (1 + g)| = R on the lower circle.
        b = np.sum(centre * n_x, axis=0)
        g = -b - np.sqrt(np.maximum(b**2 - centre[1] ** 2 + R**2, 0.0)) - 1.0
        here = (np.abs(q.x[0]) < 0.5) & (b**2 - centre[1] ** 2 + R**2 > 0)
        error.append(np.abs(q.gap - g)[here].max())
    rates = -np.polyfit(np.log(counts), np.log(error), 1)[0]
    assert abs(rates - order) < 0.5


def test_the_nearest_of_several_layers():
    """Shelves one below the other: rays meet the nearest, and the deeper one beside it."""
    upper = block(ElementQuad1, np.linspace(0, 1, 4), [0.1, 1.0])
    lower = block(ElementQuad1, [0.3, 0.8], [-1.0, 0.0])
    deeper = block(ElementQuad1, np.linspace(-1, 2, 6), [-3.0, -2.0])
    one = curves(upper, "bottom")
    near, far = curves(lower, "top"), curves(deeper, "top")
    two = FacetCurves(
        np.concatenate((far.ends, near.ends), axis=1),
        np.concatenate((far.bulge, near.bulge), axis=1),
        np.concatenate((far.sign, near.sign)),
        np.concatenate((far.normals, near.normals), axis=1),
    )
    q = one.cut(two, 3)
    on = (q.x[0] > 0.3) & (q.x[0] < 0.8)
    assert abs(q.w.sum() - 1.0) < 1e-15
    assert np.abs(q.gap - np.where(on, 0.1, 2.1)).max() < 1e-15
    assert abs(q.w[on].sum() - 0.5) < 1e-15


def test_a_facet_a_thousand_times_as_long():
    upper, lower = facing(ElementQuad1, 1000, 1)
    for one, two in (both(upper, lower), both(upper, lower)[::-1]):
        q = one.cut(two, 3)
        assert abs(q.w.sum() - 1.0) < 1e-13
        assert np.abs(q.x - q.y).max() < 1e-15


def test_displaced_places():
    """Moved nodes: the interface of a mesh that lies there."""
    upper, lower = facing(ElementTriP2, 4, 7)
    outline = Outline(upper, upper.facets("bottom"))
    there = Outline(lower, lower.facets("top"))
    moved = facing(ElementTriP2, 4, 7, place=lambda x: x + np.array([[0.13], [0.2]]))[0]
    shift = np.broadcast_to(np.array([0.13, 0.2])[:, None, None], (2, 4, 3))
    got = FacetCurves.of(outline, shift).cut(FacetCurves.of(there), 5)
    expected = curves(moved, "bottom").cut(FacetCurves.of(there), 5)
    for name in ("x", "y", "n", "w", "X", "Y"):
        assert np.abs(getattr(got, name) - getattr(expected, name)).max() < 1e-14
    assert np.array_equal(got.other, expected.other)


@pytest.mark.parametrize("element", PLANE)
def test_sides_that_do_not_face(element):
    upper, lower = facing(element, 3, 4)
    with pytest.raises(InputError, match=r"^others: the normals of the two boundaries point the"):
        interface_segments(curves(upper, "bottom"), curves(lower, "bottom"))
    with pytest.raises(InputError, match=r"^others: no facet lies opposite"):
        interface_segments(curves(upper, "bottom"), curves(lower, "right"))
    aside = facing(element, 3, 4, shift=5.0)[1]
    with pytest.raises(InputError, match=r"^others: no facet lies opposite"):
        interface_segments(curves(upper, "bottom"), curves(aside, "top"))
    far = facing(element, 3, 4, gap=10.0)[0]
    with pytest.raises(InputError, match=r"within 1[.]*[0-9]*; check the places"):
        interface_segments(curves(far, "bottom"), curves(lower, "top"))


@pytest.mark.parametrize("seed", range(6))
def test_the_tree_loses_no_pair(seed):
    """Against all pairs of two wavy sides, rough, graded and far from each other."""
    rng = np.random.default_rng(seed)
    wave, height = rng.uniform(1, 9, 2), rng.uniform(0, 0.3, 2)
    ticks = [np.unique(np.append(rng.uniform(0, 1, 70) ** p, [0.0, 1.0])) for p in (1, 3)]

    def wavy(k, lift):
        return lambda x: np.array([x[0], x[1] + height[k] * np.sin(wave[k] * x[0]) + lift])

    one = curves(block(ElementQuad1, ticks[0], [0, 2], place=wavy(0, seed % 3)), "bottom")
    two = curves(block(ElementQuad1, ticks[1], [-2, 0], place=wavy(1, 0.0)), "top")
    for first, second in ((one, two), (two, one)):
        shape = first.sign.size, second.sign.size
        facet, other = (k.ravel() for k in np.indices(shape))
        before, after = _sides(first, second, facet, other)
        connected = ~before.all(axis=0) & ~after.all(axis=0)
        found = np.zeros(shape, dtype=bool)
        found[_near_the_lines(first, second)] = True
        assert connected.any()
        assert np.all(found.ravel()[connected])
        assert found.sum() < 0.5 * found.size
