"""Profiles of one cell, and the cell of a foot: exact arithmetic, bounds, ends, periods."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cip.profiles import line_profiles
from cip.profiles.catalogue import Limits
from cip.profiles.conservative_profiles import csl2

locate: Any = getattr(line_profiles.locate, "py_func", line_profiles.locate)
quintic, rational = line_profiles.quintic.py_func, line_profiles.rational.py_func
EPS = 2.0**-52
number = st.floats(-1, 1)
small = st.floats(0, 1e-3)


def exact(a, b, va, vb, wa, wb, s):
    """Value and three derivatives by powers of s, whose coefficients solve the six conditions."""
    d, p, q = b - a - va - wa, vb - va - 2 * wa, wb - wa
    powers = [a, va, wa, 10 * d - 4 * p + q, 7 * p - 15 * d - 2 * q, 6 * d - 3 * p + q]
    found = []
    for _ in range(4):
        found.append(sum(c * s**k for k, c in enumerate(powers)))
        powers = [k * c for k, c in enumerate(powers)][1:]
    return found


@given(
    data=st.tuples(*[number] * 6), s=st.one_of(small, small.map(lambda r: 1 - r), st.floats(0, 1))
)
def test_derivatives_keep_their_digits_at_both_ends(data, s):
    """There they are those of the data, however large the profile's coefficients are."""
    found = quintic(*data, s)
    expected = exact(*map(Fraction, data), Fraction(s))
    for order in (1, 2):
        bound = EPS * (16 + 2400 * s * (1 - s))
        assert abs(Fraction(found[order]) - expected[order]) <= bound
    assert float(expected[0]) == pytest.approx(found[0], abs=400 * EPS)
    assert float(expected[3]) == pytest.approx(found[3], abs=10000 * EPS)


@given(seed=st.integers(0, 10**6))
def test_rational_profile_with_means(seed):
    """It takes both end values and the mean, monotone in monotone cells however steep."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-1, 1, 2)
    inside = rng.uniform() < 0.7
    part = 10.0 ** rng.uniform(-14, 0)  # down to a jump at one end
    m = a + (b - a) * (part if rng.uniform() < 0.5 else 1 - part) if inside else a + b + 2.5

    def at(s):
        return csl2.py_func(a, b, m, s, Limits(3, 0.0, 0.0, 0.0))

    assert at(0.0)[0] == pytest.approx(a, abs=1e-14)
    assert at(0.0)[2] == 0.0
    assert at(1.0)[0] == pytest.approx(b, abs=1e-13)
    assert at(1.0)[2] == pytest.approx(m, abs=1e-14)
    if inside:
        s = np.sort(np.concatenate([rng.uniform(0, 1, 40), 1 - 10.0 ** rng.uniform(-12, 0, 40)]))
        values = np.array([at(x)[0] for x in s])
        assert np.all(np.diff(values) * np.sign(b - a) >= -1e-14)
    for s in rng.uniform(0.1, 0.9, 3) if part > 1e-3 else ():
        step = 1e-5
        value, slope, _ = at(s)
        assert (at(s + step)[2] - at(s - step)[2]) / (2 * step) == pytest.approx(value, abs=1e-4)
        assert (at(s + step)[0] - at(s - step)[0]) / (2 * step) == pytest.approx(
            slope, rel=1e-3, abs=1e-4
        )


def test_rational_profile_beside_a_jump():
    """Flat on one side, steep on the other: end values and slopes to rounding, no false extrema."""
    s = np.concatenate([[0.0], 10.0 ** np.arange(-16.0, -1), np.linspace(0.1, 0.9, 9)])
    s = np.sort(np.concatenate([s, 1 - s]))
    for flat in (1e-3, 1e-8, 1e-13):
        found = np.array([rational(1.0, 1.0, -flat, 1.0, x) for x in s])
        np.testing.assert_allclose(found[[0, -1], 0], 1.0, rtol=1e-15)
        np.testing.assert_allclose(found[[0, -1], 1], [-flat, 1.0], rtol=1e-12)
        # Convex: slopes increase, and no value lies below both end tangents.
        assert np.all(np.diff(found[:, 1]) >= -1e-13)
        assert np.all(found[:, 0] >= np.maximum(1 - flat * s, s) - 1e-15)
        mirrored = np.array([rational(1.0, 1.0, -1.0, flat, 1 - x) for x in s])
        np.testing.assert_allclose(mirrored[:, 0], found[:, 0], rtol=1e-14)


@given(
    n=st.integers(4, 10**6), i=st.floats(0, 1, exclude_max=True),
    cells=st.integers(-(10**9), 10**9), s=st.floats(0, 1, exclude_max=True),
)  # fmt: skip
@example(n=49, i=0.0, cells=-49, s=0.0)
@example(n=4, i=0.9, cells=1, s=0.0)
def test_feet_wrap_into_the_period(n, i, cells, s):
    """Whole periods, however many, do not change the cell."""
    node, d = int(i * n), cells + s
    k, r, place = locate(node, d, n, 1)
    assert k == (node + int(np.floor(d))) % n
    assert r == (k + 1) % n
    assert place == d - np.floor(d)


@given(n=st.integers(4, 100), d=st.floats(-300, 300))
@settings(max_examples=50)
def test_feet_stay_on_a_line_with_ends(n, d):
    k, r, place = locate(n // 2, d, n, 0)
    assert 0 <= k == r - 1 <= n - 2
    assert k + place == pytest.approx(min(max(n // 2 + d, 0), n - 1), abs=1e-9)
