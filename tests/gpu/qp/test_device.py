"""The same answers on a device as on the host, and results that live where the inputs live."""

import importlib.util

import numpy as np
import pytest

from gpu import Infeasible, InputError, QPFactor, Unbounded, solve_qp
from gpu.arrays.dense import gram, lower_solve
from gpu.arrays.device_triangle import DeviceTriangle

pytestmark = pytest.mark.gpu
if importlib.util.find_spec("cupy") is None:
    pytest.skip("CuPy is not installed", allow_module_level=True)
import cupy  # noqa: E402

if not cupy.cuda.is_available():
    pytest.skip("no CUDA device", allow_module_level=True)


def problem(seed, n=120, m=10, l=60, singular=False):
    rng = np.random.default_rng(seed)
    M = rng.standard_normal((n, n // 2 if singular else n))
    P = M @ M.T / n + (0.0 if singular else 0.1) * np.eye(n)
    A, G, x = rng.standard_normal((m, n)), rng.standard_normal((l, n)), rng.standard_normal(n)
    lb, ub = x - rng.exponential(1.0, n), x + rng.exponential(1.0, n)
    h, low = G @ x + rng.random(l), G @ x - rng.random(l)
    P = (P + P.T) / 2
    return (P, rng.standard_normal(n), G, h, A, A @ x, lb, ub), low


def moved(arguments):
    return tuple(None if a is None else cupy.asarray(a) for a in arguments)


@pytest.mark.parametrize("singular", [False, True], ids=["definite", "singular"])
@pytest.mark.parametrize("seed", range(4))
def test_same_answer_on_both_sides(seed, singular):
    arguments, low = problem(seed, singular=singular)
    host = solve_qp(*arguments, h_low=low)
    device = solve_qp(*moved(arguments), h_low=cupy.asarray(low))
    for name in ("x", "y", "z", "z_box", "active", "active_rows"):
        assert isinstance(getattr(device, name), cupy.ndarray), name
    P, q = arguments[:2]

    def objective(x):
        return x @ P @ x / 2 + q @ x

    assert device.kkt.worst <= 1e-9
    np.testing.assert_allclose(objective(device.x.get()), objective(host.x), rtol=1e-9)
    if not singular:
        np.testing.assert_allclose(device.x.get(), host.x, atol=1e-9)
        np.testing.assert_allclose(device.z.get(), host.z, atol=1e-8)


def test_bounds_only_and_warm_start():
    (P, q, *_, lb, ub), _ = problem(5)
    host = solve_qp(P, q, lb=lb, ub=ub)
    factor = QPFactor(cupy.asarray(P))
    device = solve_qp(factor, cupy.asarray(q), lb=cupy.asarray(lb), ub=cupy.asarray(ub))
    np.testing.assert_allclose(device.x.get(), host.x, atol=1e-12)
    np.testing.assert_array_equal(device.active.get(), host.active)
    again = solve_qp(
        factor, cupy.asarray(q), lb=cupy.asarray(lb), ub=cupy.asarray(ub), start=device
    )
    assert again.iterations == 1


def test_small_problems_on_the_host():
    arguments, low = problem(6)
    device = solve_qp(*moved(arguments), h_low=cupy.asarray(low), host_below=1000)
    assert isinstance(device.x, cupy.ndarray)
    np.testing.assert_array_equal(device.x.get(), solve_qp(*arguments, h_low=low).x)


def test_certificates_on_the_device():
    eye = cupy.eye(3)
    rows = cupy.asarray([[1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]])
    with pytest.raises(Infeasible) as caught:
        solve_qp(eye, cupy.zeros(3), rows, cupy.asarray([-1.0, -1.0]))
    z = caught.value.certificate.get()
    np.testing.assert_allclose(rows.get().T @ z, 0.0, atol=1e-12)
    assert z.max() <= 0.0
    assert -z.sum() < 0.0 or z @ [-1.0, -1.0] > 0.0
    with pytest.raises(Unbounded) as ray:
        solve_qp(0.0 * eye, cupy.asarray([1.0, 0.0, 0.0]), lb=cupy.asarray([-np.inf, 0.0, 0.0]))
    assert float(ray.value.ray[0]) < 0.0


def test_mixed_arrays_are_refused():
    with pytest.raises(InputError, match="mixed"):
        solve_qp(cupy.eye(2), np.ones(2))


@pytest.mark.parametrize("place", [(0, 0), (1, 0), (998, 33), (32, 999), (999, 999)])
@pytest.mark.parametrize("value", [0.5, np.nan, np.inf])
def test_one_wrong_entry_of_a_device_matrix_is_found(place, value):
    P = cupy.eye(1000)
    QPFactor(P)
    P[place] += value
    if place[0] == place[1] and value == 0.5:
        QPFactor(P)
        return
    with pytest.raises(InputError, match=r"symmetric|finite"):
        QPFactor(P)


@pytest.mark.parametrize("columns", [1, 2, 16, 17, 300])
def test_triangular_solves_and_gram_matrices(columns):
    rng = np.random.default_rng(columns)
    L = np.tril(rng.standard_normal((5000, 5000))) / 500.0 + np.eye(5000)
    r = rng.standard_normal((5000, columns))
    u = lower_solve(cupy.asarray(np.ascontiguousarray(L.T)).T, cupy.asarray(r))
    np.testing.assert_allclose(L @ u.get(), r, atol=1e-10)
    Y = cupy.ascontiguousarray(u.T)
    M = gram(Y)
    assert bool((M == M.T).all())
    np.testing.assert_allclose(M.get(), u.get().T @ u.get(), rtol=1e-11, atol=1e-10)


@pytest.mark.parametrize("n", [1, 31, 200, 1024, 1500, 2500])
@pytest.mark.parametrize("columns", [None, 1, 70])
@pytest.mark.parametrize("transposed", [False, True])
def test_triangular_systems_by_products(n, columns, transposed):
    rng = np.random.default_rng(n)
    L = np.tril(rng.standard_normal((n, n)) / np.sqrt(n)) + 2.0 * np.eye(n)
    u = rng.standard_normal(n if columns is None else (n, columns))
    # What is above the diagonal is not read.
    stored = cupy.asarray(np.asfortranarray(L + np.triu(np.full((n, n), np.nan), 1)))
    stored = cupy.asfortranarray(stored)
    right = (L.T if transposed else L) @ u
    found = DeviceTriangle(stored).solve(cupy.asarray(right), transposed=transposed)
    np.testing.assert_allclose(found.get(), u, atol=1e-11)
