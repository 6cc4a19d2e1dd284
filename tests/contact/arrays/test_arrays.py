"""Pairs of numbers beside rational arithmetic, GMRES, work on ranges, threads of OpenBLAS."""

from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import sparse

from contact.arrays import ranges
from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.krylov import gmres
from contact.arrays.paired_rows import blocks_times, rows_times
from contact.arrays.pairs import Pairs, dot, two_product, two_sum

# Products of these stay in the range of numbers, with their errors.
SIZES = st.floats(1e-60, 1e60)
NUMBERS = st.one_of(
    st.just(0.0), st.builds(lambda size, sign: size * sign, SIZES, st.sampled_from((-1, 1)))
)
CLOSE = Fraction(1, 2**102)


@st.composite
def pairs(draw):
    """A number of up to 106 bits."""
    high = draw(NUMBERS)
    return Pairs(*two_sum(high, draw(st.floats(-1, 1)) * np.spacing(abs(high)) / 2))


def exact(x):
    return Fraction(float(x.high)) + Fraction(float(x.low)) if isinstance(x, Pairs) else Fraction(x)


def of_arrays(high, low=0.0):
    low = np.broadcast_to(np.asarray(low, dtype=float), np.shape(high))
    return Pairs(np.asarray(high, dtype=float), low.copy())


@given(NUMBERS, NUMBERS)
def test_sums_and_products_of_two_numbers_are_exact(a, b):
    s, e = two_sum(a, b)
    assert s == a + b
    assert exact(s) + exact(e) == exact(a) + exact(b)
    p, e = two_product(a, b)
    assert p == a * b
    assert exact(p) + exact(e) == exact(a) * exact(b)


@given(pairs(), pairs())
def test_operations_have_twice_the_digits(x, y):
    a, b = exact(x), exact(y)
    assert abs(exact(x + y) - (a + b)) <= CLOSE * abs(a + b)
    assert abs(exact(x - y) - (a - b)) <= CLOSE * abs(a - b)
    assert abs(exact(x * y) - a * b) <= CLOSE * abs(a * b)
    assert exact(-x) == -a
    assert exact(abs(x)) == abs(a)
    if b:
        assert abs(exact(x / y) - a / b) <= CLOSE * abs(a / b)


@given(pairs(), NUMBERS)
def test_numbers_on_either_side(x, number):
    a, b = exact(x), Fraction(number)
    number = np.float64(number)  # NumPy leaves the operation to the pair
    for found, expected in (
        (number + x, a + b),
        (number - x, b - a),
        (x - number, a - b),
        (number * x, a * b),
    ):
        assert isinstance(found, Pairs)
        assert abs(exact(found) - expected) <= CLOSE * abs(expected)


@given(pairs())
def test_roots(x):
    x = abs(x)
    root = exact(x.sqrt())
    assert abs(root**2 - exact(x)) <= 4 * CLOSE * exact(x)


@given(st.lists(st.tuples(NUMBERS, pairs()), max_size=40))
def test_sums_of_products(terms):
    a = np.array([a for a, _ in terms])
    x = Pairs(*(np.array([getattr(x, part) for _, x in terms]) for part in ("high", "low")))
    products = [Fraction(a) * exact(x) for a, x in terms]
    near = 1600 * CLOSE * sum(map(abs, products))
    assert abs(exact(dot(a, x)) - sum(products)) <= near
    values = [exact(x) for _, x in terms]
    assert abs(exact(x.sum()) - sum(values)) <= 1600 * CLOSE * sum(map(abs, values))


def test_a_sum_of_which_float64_keeps_nothing():
    a, x = np.array([1e16, 1.0, -1e16, 1e-3]), np.array([1.0, 1.0, 1.0, 1.0])
    assert dot(a, Pairs.of(x)).rounded == 1.001
    assert np.cumsum(a * x)[-1] != 1.001  # in order: a processor may add in another one


@pytest.mark.parametrize("seed", range(4))
def test_rows_of_a_sparse_matrix(seed):
    """Empty rows, rows of different lengths, terms that cancel down to 1e-30 of them."""
    rng = np.random.default_rng([22, seed])
    A = sparse.random_array((40, 30), density=0.2, rng=rng, data_sampler=rng.standard_normal)
    A = sparse.csr_array(A) * 10.0 ** rng.integers(-9, 9)
    A = sparse.vstack([A, sparse.csr_array((3, 30))]).tocsr()
    A = sparse.csr_array(A[rng.permutation(43)])
    x = of_arrays(rng.standard_normal(30), 1e-17 * rng.standard_normal(30))
    x = x if seed % 2 else Pairs.of(x.high)
    # The last column cancels what the others give, up to its rounding.
    last = -rows_times(A, x).rounded[:, None]
    A, x = sparse.hstack([A, last]).tocsr(), of_arrays(np.r_[x.high, 1.0], np.r_[x.low, 0.0])
    found, dense = rows_times(A, x), A.toarray()
    for i, row in enumerate(dense):
        terms = [Fraction(a) * exact(x[j]) for j, a in enumerate(row)]
        assert abs(exact(found[i]) - sum(terms)) <= 1000 * CLOSE * sum(map(abs, terms))
    assert np.abs(found.rounded).max() < 1e-15 * np.abs(dense).max()
    same = rows_times(dense, x)
    np.testing.assert_array_equal(same.high, found.high)


def test_matrices_of_cells():
    rng = np.random.default_rng(5)
    A, x = rng.standard_normal((70, 3, 5)), of_arrays(rng.standard_normal((70, 5)), 1e-18)
    found = blocks_times(A, x)
    for c in (0, 31, 69):
        for k in range(3):
            terms = [Fraction(A[c, k, j]) * exact(x[c, j]) for j in range(5)]
            assert abs(exact(found[c, k]) - sum(terms)) <= 100 * CLOSE * sum(map(abs, terms))


@pytest.mark.parametrize("unit", [1e-30, 1.0, 1e20])
@pytest.mark.parametrize("n", [12, 60])
def test_solutions_do_not_depend_on_units(unit, n):
    """As many products in any unit: nothing is compared with the size of the right-hand side."""
    rng = np.random.default_rng(n)
    A = np.eye(n) + 0.1 * rng.standard_normal((n, n))
    M = np.diag(rng.uniform(0.5, 2.0, n))
    b = rng.standard_normal(n)
    x, products = gmres(lambda v: A @ v, unit * b, lambda v: M @ v, 1e-12, 300)
    assert np.linalg.norm(A @ x / unit - b) <= 1.1e-12 * np.linalg.norm(b)
    assert products == gmres(lambda v: A @ v, b, lambda v: M @ v, 1e-12, 300)[1]
    assert products < 120


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


def threads():
    """Number of threads of each OpenBLAS in the process."""
    threadpoolctl = pytest.importorskip("threadpoolctl")
    controller = threadpoolctl.ThreadpoolController().select(internal_api="openblas")
    return [library["num_threads"] for library in controller.info()]


@pytest.fixture
def two_threads():
    """Start from two threads, whatever the environment says; needs OpenBLAS."""
    if not threads():
        pytest.skip("NumPy and SciPy use no OpenBLAS here")
    with pytest.importorskip("threadpoolctl").threadpool_limits(limits=2, user_api="blas"):
        yield threads()


def test_the_limit_on_threads_is_lifted_by_the_last_one_out(two_threads):
    """Nested, after an error, and not set for large matrices."""
    assert max(two_threads) == 2
    with one_blas_thread(100):
        with one_blas_thread(50):
            assert set(threads()) == {1}
        assert set(threads()) == {1}
    assert threads() == two_threads
    with pytest.raises(ZeroDivisionError), one_blas_thread(100):
        _ = 1 / 0
    assert threads() == two_threads
    with one_blas_thread(5000):
        assert threads() == two_threads


def test_every_thread_can_limit(two_threads):
    """One that was not the first to do so, too, and one that ends it for another."""
    with one_blas_thread(100):
        pass

    def inside():
        with one_blas_thread(100):
            return threads()

    with ThreadPoolExecutor(1) as pool:
        assert set(pool.submit(inside).result()) == {1}
    assert threads() == two_threads
