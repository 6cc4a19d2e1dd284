"""The quintic profile of a cell against exact arithmetic, also next to the ends of the cell."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cip.profiles import line_profiles

quintic = line_profiles.quintic.py_func
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
