"""Arguments of every wrong kind end in an error of this package that names them, or are right."""

import re
import warnings

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import LinearOperator

from gpu import (
    GpuError,
    InputError,
    QPFactor,
    batch_solve_qp,
    care,
    dare,
    dlqr,
    eigs,
    eigsh,
    hamiltonian_inverse,
    lqe,
    lqr,
    solve_qp,
    svds,
)

I, ONES, ROW = np.eye(3), np.ones(3), np.ones((1, 3))
SPECTRUM = np.diag([1.0, 2.0, 3.0])
CALLS = {
    "solve_qp": (
        solve_qp,
        {"P": I, "q": ONES, "G": I, "h": ONES, "A": ROW, "b": [1.0], "lb": -5 * ONES,
         "ub": 5 * ONES, "h_low": -ONES, "start": None, "tol": 1e-9, "host_below": 0,
         "polish": "digits", "time_limit": 60.0, "max_steps": 100},
    ),
    "batch_solve_qp": (
        batch_solve_qp,
        {"P": I, "q": [ONES, ONES], "G": I, "h": [ONES, ONES], "A": ROW, "b": [[1.0], [1.0]],
         "lb": -5 * ONES, "ub": 5 * ONES, "h_low": [-ONES, -ONES], "tol": 1e-9,
         "warm_start": True, "host_below": 0},
    ),
    "QPFactor": (QPFactor, {"P": I, "semidefinite": True}),
    "eigs": (
        eigs,
        {"A": SPECTRUM, "k": 2, "M": I, "sigma": None, "which": "LM", "v0": ONES, "ncv": None,
         "maxiter": None, "tol": 0.0, "return_eigenvectors": True, "restart": "krylov-schur"},
    ),
    "svds": (
        svds,
        {"A": SPECTRUM, "k": 2, "ncv": None, "tol": 0.0, "which": "LM", "v0": ONES,
         "maxiter": None, "return_singular_vectors": True},
    ),
    "lqr": (
        lqr,
        {"A": -I, "B": ONES, "Q": I, "R": 1.0, "N": None, "E": I, "method": "auto",
         "factored": False, "inverse": None, "unstable": "warn"},
    ),
    "care": (care, {"a": -I, "b": ROW.T, "q": I, "r": np.eye(1), "e": I, "s": None}),
    "dare": (dare, {"a": -I, "b": I, "q": I, "r": I, "e": I, "s": None}),
    "dlqr": (dlqr, {"A": -I, "B": ONES, "Q": I, "R": 1.0, "N": None, "E": I}),
    "eigsh": (
        eigsh,
        {"A": SPECTRUM, "k": 2, "M": I, "sigma": None, "which": "LM", "v0": ONES, "ncv": None,
         "maxiter": None, "tol": 0.0, "return_eigenvectors": True},
    ),
    "lqe": (
        lqe,
        {"A": -I, "G": I, "C": ROW, "W": I, "V": 1.0, "N": None, "E": None, "method": "auto",
         "factored": False},
    ),
    "hamiltonian_inverse": (
        hamiltonian_inverse,
        {"A": -I, "B": ROW.T, "Q": I, "R": 1.0, "E": None, "inverse": None, "scale": 1.0},
    ),
}  # fmt: skip
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    WRONG = {
        "word": "abc", "bytes": b"ab", "mapping": {}, "object": object(), "words": ["a", "b", "c"],
        "set": {1, 2}, "function": lambda x: x, "NaN": np.nan,
        "complex": 1j * I, "complex vector": 1j * ONES, "NaNs": np.nan * I, "infinite": np.inf * I,
        "NaN vector": np.nan * ONES, "masked": np.ma.masked_array(I, mask=I > 0),
        "masked vector": np.ma.masked_array(ONES, mask=[1, 0, 0]), "three axes": np.ones((3, 3, 3)),
        "objects": np.array([1, 2, None], dtype=object), "dates": np.ones(3, "datetime64[D]"),
        "fields": np.zeros(3, [("a", float)]), "sparse NaN": sparse.csr_array(np.nan * I),
        "sparse complex": sparse.csr_array(1j * I), "sparse vector": sparse.coo_array(ONES),
    }  # fmt: skip
OTHERS = {
    "huge": 10**400, "nothing": None, "empty list": [], "empty": np.zeros((0, 0)),
    "no axes": np.array(2.0),
    "true": True, "minus one": -1, "generator": (i for i in range(3)), "four": np.ones(4),
    "integers": np.eye(3, dtype=int), "float32": np.eye(3, dtype=np.float32),
    "float16": np.eye(3, dtype=np.float16), "longdouble": np.eye(3, dtype=np.longdouble),
    "unmasked": np.ma.masked_array(I), "two by three": np.ones((2, 3)),
    "four by four": np.eye(4), "sparse": sparse.coo_array(I), "negative": -I,
    "triangle": np.triu(np.ones((3, 3))), "indefinite": np.diag([1.0, -1.0, 0.0]),
    "zero": np.zeros((3, 3)), "operator": LinearOperator((3, 3), lambda x: x, dtype=float),
}  # fmt: skip
ARGUMENTS = [(call, name) for call, (_, given) in CALLS.items() for name in given]
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    OTHERS["matrix"] = np.matrix(I)
# These may be complex, and functions; the last is not looked at where A is no function.
COMPLEX = {("eigs", "A"), ("eigs", "M"), ("eigs", "sigma"), ("svds", "A"), ("svds", "v0")}
COMPLEX |= {("eigsh", "A"), ("eigsh", "M")}
COMPLEX |= {(call, name) for call in ("care", "dare") for name in "abqres"}


@pytest.mark.filterwarnings("ignore:the gain of method")
@pytest.mark.parametrize(("call", "name"), ARGUMENTS)
def test_no_raw_error(call, name):
    function, given = CALLS[call]
    for kind, value in (WRONG | OTHERS).items():
        try:
            function(**(given | {name: value}))
        except GpuError:
            continue
        except Exception as error:
            pytest.fail(f"{kind}: {type(error).__name__}: {error}")
        complex_and_so = (call, name) in COMPLEX and ("complex" in kind or kind == "function")
        assert kind not in WRONG or complex_and_so, f"{kind} was accepted"


@pytest.mark.parametrize(("call", "name"), ARGUMENTS)
def test_masked_entries_are_not_taken_for_numbers(call, name):
    """9.97e36 may lie under a mask."""
    function, given = CALLS[call]
    masked = np.ma.masked_array(I, mask=I > 0)
    for value in (masked, list(masked), tuple(masked), [[np.ma.masked, 0.0, 0.0], *I[1:]]):
        with pytest.raises(InputError, match=rf"(?i)^{re.escape(name)}"):
            function(**(given | {name: value}))


@pytest.mark.parametrize("dtype", [int, np.float32, np.longdouble, bool])
def test_other_real_numbers_mean_the_same(dtype):
    P, q = np.diag([2, 1, 1]).astype(dtype), np.array([1, 0, 1], dtype)
    known = solve_qp(P.astype(float), q.astype(float), lb=-0.5)
    np.testing.assert_array_equal(solve_qp(P, q, lb=-0.5).x, known.x)
    np.testing.assert_array_equal(eigs(P, 2)[0], eigs(P.astype(float), 2)[0])
    A = np.diag([1, 0, 1]).astype(dtype)
    np.testing.assert_array_equal(
        lqr(A, np.eye(3, dtype=dtype), P, 1.0).K, lqr(A.astype(float), I, P.astype(float), 1.0).K
    )
