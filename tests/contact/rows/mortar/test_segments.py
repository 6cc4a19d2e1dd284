"""Segments of an interface against closed forms and against rays cast at every facet."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from skfem import ElementQuad1, ElementQuad2, ElementTriP2
from two_blocks import block, facing, ring, sides, turned

from contact.rows.mortar.facet_curves import FacetCurves, interface_segments
from contact.rows.outline import Outline


def curves(body, side):
    return FacetCurves.of(Outline(body, body.facets(side)))


def both(upper, lower):
    first, facets, second, others = sides(upper, lower)
    return FacetCurves.of(Outline(first, facets)), FacetCurves.of(Outline(second, others))


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


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
    at = np.arange(two.sign.size)
    outward = two.outward(at, np.full(at.size, 0.5))
    a, b = (two.at(at, np.full(at.size, s)) for s in (0.0, 1.0))
    n, x = q.n[:, :, None], q.x[:, :, None]
    A = np.broadcast_arrays(n[0], (a - b)[0][None], n[1], (a - b)[1][None])
    t, along = np.linalg.solve(
        np.stack(A, -1).reshape(*A[0].shape, 2, 2), np.moveaxis(a[:, None] - x, 0, -1)[..., None]
    )[..., 0].transpose(2, 0, 1)
    met = (along >= -1e-8) & (along <= 1 + 1e-8) & (np.tensordot(q.n, outward, (0, 0)) <= -0.25)
    t = np.where(met, t, np.inf)
    return np.take_along_axis(t, np.abs(t).argmin(axis=1)[:, None], axis=1)[:, 0]


def wavy(seed):
    """Two sides of random waves, rough and graded, apart by up to .8 of their length."""
    rng = np.random.default_rng(seed)
    wave, height = rng.uniform(1, 9, 2), rng.uniform(0, 0.3, 2)
    ticks = [np.unique(np.append(rng.uniform(0, 1, 70) ** p, [0.0, 1.0])) for p in (1, 3)]

    def place(k, lift):
        return lambda x: np.array([x[0], x[1] + height[k] * np.sin(wave[k] * x[0]) + lift])

    one = block(ElementQuad1, ticks[0], [0, 2], place=place(0, 0.4 * (seed % 3)))
    two = block(ElementQuad1, ticks[1], [-2, 0], place=place(1, 0.0))
    return curves(one, "bottom"), curves(two, "top")


POLYGONS = [
    *(lambda n=n, m=m: cylinders(ElementQuad1, n, m, False, height=0.1) for n, m in
      ((5, 5), (13, 4), (3, 17), (11, 30))),
    *(lambda seed=seed: wavy(seed) for seed in range(5)),
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(POLYGONS)))
def test_polygons_against_rays(case):
    pair = POLYGONS[case]()
    for one, two in (pair, pair[::-1]):
        q = one.cut(two, 3)
        assert np.abs(cross(q.y - q.x, q.n)).max() < 1e-14
        assert np.abs(q.gap - rays(one, two, q)).max() < 1e-12


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
