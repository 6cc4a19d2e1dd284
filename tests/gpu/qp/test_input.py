"""Malformed, unsupported and infeasible input, each with its own error and a message."""

import importlib.util
import re
import subprocess
import sys

import numpy as np
import pytest
import scipy.sparse

import gpu
from gpu import (
    GpuError,
    Infeasible,
    InputError,
    MissingDependency,
    NotConverged,
    QPFactor,
    Unbounded,
    solve_qp,
)

I2 = np.eye(2)
Q = np.array([1.0, -1.0])
ROW = {"A": [[1.0, 1.0]], "b": [1.0]}
NAN, INF = np.nan, np.inf

BAD = {
    "P not square": (np.ones((2, 3)), Q, {}, "P has shape"),
    "P one-dimensional": (np.ones(2), Q, {}, "P has 1 dim"),
    "P empty": (np.zeros((0, 0)), [], {}, "not empty"),
    "P NaN": ([[1.0, NAN], [NAN, 1.0]], Q, {}, r"P\[0, 1\] is nan"),
    "P infinite": ([[INF, 0.0], [0.0, 1.0]], Q, {}, "finite"),
    "P not symmetric": ([[2.0, 1.0], [0.0, 2.0]], Q, {}, "not symmetric"),
    "P indefinite": ([[1.0, 2.0], [2.0, 1.0]], Q, {}, "not positive semidefinite"),
    "P indefinite off the solution": ([[1.0, 2.0], [2.0, 1.0]], [9, 9], {"lb": 0.0}, "definite"),
    "P sparse indefinite": (
        scipy.sparse.csr_array([[1.0, 2.0], [2.0, 1.0]]),
        Q,
        {},
        "not positive semidefinite",
    ),
    "P hollow": ([[0.0, 1.0], [1.0, 0.0]], Q, {}, "not positive semidefinite"),
    "P negative diagonal": (np.diag([1.0, -1.0]), Q, {}, r"P\[1, 1\] = -1"),
    "P text": ([["a", "b"], ["c", "d"]], Q, {}, "real numbers"),
    "P complex": (I2 * 1j, Q, {}, "real numbers"),
    "P ragged": ([[1.0], [1.0, 2.0]], Q, {}, "real numbers"),
    "q length": (I2, np.ones(3), {}, "q has shape"),
    "G without h": (I2, Q, {"G": I2}, "without h"),
    "h without G": (I2, Q, {"h": Q}, "without G"),
    "h_low without G": (I2, Q, {"h_low": Q}, "without G"),
    "G columns": (I2, Q, {"G": np.ones((1, 3)), "h": 1.0}, "2 columns"),
    "G NaN": (I2, Q, {"G": [[NAN, 0.0]], "h": 1.0}, r"G\[0, 0\] is nan"),
    "h length": (I2, Q, {"G": I2, "h": np.ones(3)}, "h has shape"),
    "h NaN": (I2, Q, {"G": I2, "h": [0.0, NAN]}, r"h\[1\] is nan"),
    "h = -inf": (I2, Q, {"G": I2, "h": [0.0, -INF]}, r"h\[1\] is -inf"),
    "h_low = inf": (I2, Q, {"G": I2, "h_low": [0.0, INF]}, r"h_low\[1\] is inf"),
    "q matrix": (I2, np.ones((2, 1)), {}, "q has shape"),
    "q NaN": (I2, [1.0, NAN], {}, r"q\[1\] is nan"),
    "lb length": (I2, Q, {"lb": np.zeros(3)}, "lb has shape"),
    "lb NaN": (I2, Q, {"lb": [0.0, NAN]}, r"lb\[1\] is nan"),
    "lb scalar NaN": (I2, Q, {"lb": NAN}, "lb"),
    "lb = +inf": (I2, Q, {"lb": [0.0, INF]}, r"lb\[1\] is inf"),
    "ub = -inf": (I2, Q, {"ub": -INF}, r"ub\[0\] is -inf"),
    "A without b": (I2, Q, {"A": ROW["A"]}, "together"),
    "b without A": (I2, Q, {"b": [1.0]}, "together"),
    "A columns": (I2, Q, {"A": np.ones((1, 3)), "b": [1.0]}, "2 columns"),
    "A one-dimensional": (I2, Q, {"A": np.ones(2), "b": [1.0]}, "A has 1 dim"),
    "A infinite": (I2, Q, {"A": [[INF, 1.0]], "b": [1.0]}, r"A\[0, 0\] is inf"),
    "b length": (I2, Q, {"A": ROW["A"], "b": [1.0, 2.0]}, "b has shape"),
    "b NaN": (I2, Q, {"A": ROW["A"], "b": [NAN]}, "b"),
    "tol zero": (I2, Q, {"tol": 0.0}, "tol"),
    "tol NaN": (I2, Q, {"tol": NAN}, "tol"),
    "start length": (I2, Q, {"start": np.zeros(3)}, "start has shape"),
    "start NaN": (I2, Q, {"start": [0.0, NAN]}, "start"),
    "start states": (I2, Q, {"start": np.array([2, 0], np.int8)}, "-1, 0, 1"),
    "start of another problem": (I2, Q, {"start": solve_qp(np.eye(3), np.ones(3))}, "3 variables"),
    "start without its rows": (I2, Q, {"start": solve_qp(I2, Q, **ROW)}, "1 equality rows"),
}


@pytest.mark.parametrize(("P", "q", "options", "message"), BAD.values(), ids=BAD)
def test_malformed(P, q, options, message):
    with pytest.raises(InputError, match=message) as caught:
        solve_qp(P, q, **options)
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, GpuError)


def test_device_arrays_need_cupy():
    class Device:
        __cuda_array_interface__ = {"shape": (2,)}  # noqa: RUF012

    if importlib.util.find_spec("cupy"):
        pytest.skip("CuPy is installed")
    with pytest.raises(MissingDependency, match=r"cupy|CuPy"):
        solve_qp(I2, Q, lb=Device())


@pytest.mark.parametrize("P", [np.zeros((2, 2)), np.ones((2, 2))], ids=["zero", "singular"])
def test_semidefinite_and_unbounded(P):
    with pytest.raises(Unbounded) as caught:
        solve_qp(P, Q)
    ray = caught.value.ray
    assert Q @ ray < 0
    np.testing.assert_allclose(P @ ray, 0.0, atol=1e-12)


@pytest.mark.parametrize(("name", "value"), [("h", -1e200), ("h_low", 3e20), ("lb", 1e21)])
def test_numbers_that_count_as_infinite_are_shown_as_given(name, value):
    given = {"G": [[1.0, 0.0]], name: value} if name.startswith("h") else {name: value}
    with pytest.raises(InputError, match=re.escape(f"{name}[0] is {value}: ") + ".*from 1e.20 on"):
        solve_qp(np.eye(2), [0.0, 1.0], **given)


def test_empty_row():
    with pytest.raises(Infeasible, match=r"h_low\[1\] = 2.0 is above h\[1\] = 1.0"):
        solve_qp(I2, Q, G=I2, h=1.0, h_low=[0.0, 2.0])


def test_empty_box():
    with pytest.raises(Infeasible, match=r"lb\[1\] = 2.0 is above ub\[1\] = 1.0") as caught:
        solve_qp(I2, Q, lb=[0.0, 2.0], ub=1.0, **ROW)
    np.testing.assert_array_equal(caught.value.certificate, [0.0])


@pytest.mark.parametrize(
    ("A", "b", "lb", "ub"),
    [
        ([[1.0, 1.0]], [3.0], 0.0, 1.0),
        ([[1.0, 1.0]], [-1e-6], 0.0, np.inf),
        ([[1.0, -1.0], [2.0, -2.0]], [1.0, 1.0], -np.inf, np.inf),
        ([[0.0, 0.0]], [1.0], -np.inf, np.inf),
        ([[1.0, 0.0], [1.0, 1.0]], [0.5, 0.1], 0.0, np.inf),
        ([[1e9, 1e9]], [3e9], 0.0, 1.0),
    ],
)
def test_infeasible_rows_come_with_a_separating_vector(A, b, lb, ub):
    with pytest.raises(Infeasible) as caught:
        solve_qp(I2, Q, A=A, b=b, lb=lb, ub=ub)
    y = caught.value.certificate
    c = np.transpose(A) @ y
    c[np.abs(c) < 1e-12 * np.abs(y).max() * np.abs(A).max()] = 0.0
    corner = np.where(c > 0, ub, np.where(c < 0, lb, 0.0))
    assert c @ corner < y @ np.array(b)


def test_consistent_zero_and_repeated_rows_are_accepted():
    result = solve_qp(I2, Q, A=[[1.0, 1.0], [0.0, 0.0], [2.0, 2.0]], b=[1.0, 0.0, 2.0])
    np.testing.assert_allclose(result.x, [-0.5, 1.5], atol=1e-14)


def test_more_rows_than_free_variables():
    result = solve_qp(np.eye(3), np.ones(3), A=np.eye(3)[:2], b=[1.0, 0.0], lb=0.0, ub=1.0)
    np.testing.assert_allclose(result.x, [1.0, 0.0, 0.0], atol=1e-15)


def test_asymmetry_of_rounding_is_accepted():
    P = np.array([[2.0, 1.0], [1.0 + 1e-13, 2.0]])
    np.testing.assert_allclose(solve_qp(P, Q).x, [-1.0, 1.0], rtol=1e-12)


def test_what_is_not_reached_is_not_returned():
    # Hilbert's matrix: definite, but no x in double precision satisfies the equations to 1e-17.
    n = 6
    P = 1.0 / (np.arange(n)[:, None] + np.arange(n) + 1.0)
    assert solve_qp(P, np.ones(n)).kkt.worst < 1e-15
    with pytest.raises(NotConverged, match="tol = 1e-18"):
        solve_qp(P, np.ones(n), tol=1e-18)


def test_input_is_left_alone():
    P, q, lb, active = 2 * I2, Q.copy(), np.zeros(2), np.zeros(2, np.int8)
    solve_qp(P, q, lb=lb, start=active)
    np.testing.assert_array_equal(P, 2 * I2)
    np.testing.assert_array_equal(q, Q)
    np.testing.assert_array_equal(active, 0)
    factor = QPFactor(P)
    P[0, 0] = 100.0
    np.testing.assert_array_equal(solve_qp(factor, q).x, [-0.5, 0.5])


def test_residuals_are_recomputed_from_the_problem():
    lb = np.zeros(2)
    result = solve_qp(I2, Q, lb=lb, **ROW)
    assert result.residuals(I2, Q, lb=lb, **ROW) == result.kkt
    assert result.kkt.worst < 1e-15
    assert result.residuals(I2, Q + 1.0, lb=lb, **ROW).stationarity > 0.1
    assert result.residuals(I2, Q, lb=lb, A=ROW["A"], b=[2.0]).primal > 0.1
    assert result.residuals(I2, Q, lb=lb + 0.5, **ROW).primal > 0.1
    bounded = solve_qp(I2, -Q, lb=lb)
    assert bounded.kkt.sign == 0.0
    assert bounded.residuals(I2, -Q).sign > 0.1
    assert bounded.residuals(I2, -Q, lb=lb - 1.0).complementarity > 0.1


def test_import_needs_numpy_and_scipy_only():
    code = (
        "import sys, gpu; print({m.split('.')[0] for m in sys.modules} & "
        "{'cupy', 'numba', 'qpsolvers', 'skfem', 'osqp', 'matplotlib', 'pyvista'})"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_public_names():
    assert set(gpu.__all__) <= set(dir(gpu))
