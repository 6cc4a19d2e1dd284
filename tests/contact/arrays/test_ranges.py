"""Work on ranges: all of it, in its order, by one thread or by several."""

import numpy as np
import pytest
from scipy import sparse

from contact.arrays import ranges


@pytest.mark.parametrize("entries", [1, 40, 10**9])
@pytest.mark.parametrize("n", [1, 5, 203])
def test_diagonal_is_that_of_scipy(monkeypatch, entries, n):
    monkeypatch.setattr(ranges, "LIMITS", ranges.LIMITS._replace(entries=entries))
    monkeypatch.setattr(ranges, "cores", lambda: 3)
    matrix = sparse.random_array((n, n), density=0.3, rng=np.random.default_rng(n), format="csr")
    matrix = sparse.csr_array(matrix + sparse.diags_array((np.arange(n) % 3).astype(float)))
    np.testing.assert_array_equal(ranges.diagonal(matrix), matrix.diagonal())


@pytest.mark.parametrize("cores", [1, 3])
@pytest.mark.parametrize("count", [0, 1, 7, 8, 23])
def test_ranges_cover_all_in_order(monkeypatch, cores, count):
    monkeypatch.setattr(ranges, "cores", lambda: cores)
    found = ranges.in_ranges(lambda some: list(range(count))[some], count, 7)
    assert [number for part in found for number in part] == list(range(count))
    assert all(0 < len(part) <= 7 for part in found)


def test_an_error_of_a_range_is_raised(monkeypatch):
    monkeypatch.setattr(ranges, "cores", lambda: 3)

    def work(some):
        if some.start == 14:
            raise ZeroDivisionError
        return some.start

    with pytest.raises(ZeroDivisionError):
        ranges.in_ranges(work, 23, 7)


def test_ranges_of_ranges_do_not_wait_for_each_other(monkeypatch):
    monkeypatch.setattr(ranges, "cores", lambda: 3)

    def work(some):
        return sum(ranges.in_ranges(lambda part: part.start, 23, 7))

    assert ranges.in_ranges(work, 100, 2) == [42] * 50
