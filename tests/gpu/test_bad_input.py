"""Malformed, unsupported and infeasible input, each with its own error and a message."""

import importlib.util
import re
import subprocess
import sys

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import LinearOperator

import gpu
from gpu import (
    GpuError,
    InputError,
    MissingDependency,
    NotConverged,
    RiccatiError,
    batch_solve_qp,
    care,
    eigs,
    hamiltonian_inverse,
    lqe,
    lqr,
    solve_qp,
    svds,
)

I2, I3, ONE = np.eye(2), np.eye(3), np.ones((3, 1))
Q, ROW = np.array([1.0, -1.0]), {"A": [[1.0, 1.0]], "b": [1.0]}
NAN, INF = np.nan, np.inf
INDEFINITE = [[1.0, 2.0], [2.0, 1.0]]

# The words of the message, and what is changed in a good call.
PROGRAMS = [
    ("P has shape", {"P": np.ones((2, 3))}),
    ("P has 1 dim", {"P": np.ones(2)}),
    ("not empty", {"P": np.zeros((0, 0)), "q": []}),
    (r"P\[0, 1\] is nan", {"P": [[1.0, NAN], [NAN, 1.0]]}),
    ("finite", {"P": [[INF, 0.0], [0.0, 1.0]]}),
    ("not symmetric", {"P": [[2.0, 1.0], [0.0, 2.0]]}),
    ("not positive semidefinite", {"P": INDEFINITE}),
    ("definite", {"P": INDEFINITE, "q": [9, 9], "lb": 0.0}),  # off the solution
    ("not positive semidefinite", {"P": sparse.csr_array(INDEFINITE)}),
    ("not positive semidefinite", {"P": [[0.0, 1.0], [1.0, 0.0]]}),
    (r"P\[1, 1\] = -1", {"P": np.diag([1.0, -1.0])}),
    ("real numbers", {"P": [["a", "b"], ["c", "d"]]}),
    ("real numbers", {"P": I2 * 1j}),
    ("real numbers", {"P": [[1.0], [1.0, 2.0]]}),
    ("q has shape", {"q": np.ones(3)}),
    ("q has shape", {"q": np.ones((2, 1))}),
    (r"q\[1\] is nan", {"q": [1.0, NAN]}),
    ("without h", {"G": I2}),
    ("without G", {"h": Q}),
    ("without G", {"h_low": Q}),
    ("2 columns", {"G": np.ones((1, 3)), "h": 1.0}),
    (r"G\[0, 0\] is nan", {"G": [[NAN, 0.0]], "h": 1.0}),
    ("h has shape", {"G": I2, "h": np.ones(3)}),
    (r"h\[1\] is nan", {"G": I2, "h": [0.0, NAN]}),
    (r"h\[1\] is -inf", {"G": I2, "h": [0.0, -INF]}),
    (r"h_low\[1\] is inf", {"G": I2, "h_low": [0.0, INF]}),
    ("lb has shape", {"lb": np.zeros(3)}),
    (r"lb\[1\] is nan", {"lb": [0.0, NAN]}),
    ("lb", {"lb": NAN}),
    (r"lb\[1\] is inf", {"lb": [0.0, INF]}),
    (r"ub\[0\] is -inf", {"ub": -INF}),
    ("together", {"A": ROW["A"]}),
    ("together", {"b": [1.0]}),
    ("2 columns", {"A": np.ones((1, 3)), "b": [1.0]}),
    ("A has 1 dim", {"A": np.ones(2), "b": [1.0]}),
    (r"A\[0, 0\] is inf", {"A": [[INF, 1.0]], "b": [1.0]}),
    ("b has shape", {"A": ROW["A"], "b": [1.0, 2.0]}),
    ("b", {"A": ROW["A"], "b": [NAN]}),
    *[("tol is", {"tol": tol}) for tol in (0.0, NAN, "x", None, 1.0)],
    ("start has shape", {"start": np.zeros(3)}),
    ("start", {"start": [0.0, NAN]}),
    ("-1, 0, 1", {"start": np.array([2, 0], np.int8)}),
    ("3 variables", {"start": solve_qp(I3, np.ones(3))}),
    ("1 equality rows", {"start": solve_qp(I2, Q, **ROW)}),
    # Numbers that count as infinite are shown as they were given.
    (re.escape("h[0] is -1e+200: ") + ".*from 1e.20 on", {"G": [[1.0, 0.0]], "h": -1e200}),
    (re.escape("h_low[0] is 3e+20: ") + ".*from 1e.20 on", {"G": [[1.0, 0.0]], "h_low": 3e20}),
    (re.escape("lb[0] is 1e+21: ") + ".*from 1e.20 on", {"lb": 1e21}),
]
SPECTRA = [
    ("A has shape", {"A": np.zeros((3, 4))}),
    ("NaN", {"A": np.full((6, 6), NAN)}),
    ("k=7", {"k": 7}),
    ("k=0", {"k": 0}),
    ("which=", {"which": "XX"}),
    ("tol=", {"tol": -1.0}),
    ("restart=", {"restart": "none"}),
    ("v0 has shape", {"v0": np.ones(5)}),
    ("M has order", {"M": np.eye(5)}),
    ("M is singular", {"k": 6, "M": np.zeros((6, 6))}),
    ("sigma=", {"sigma": INF}),
    ("v0 is complex", {"A": np.diag(np.arange(300.0)), "v0": np.full(300, 1.0 + 1.0j)}),
    *[("pass v0", {"A": lambda x: x, "v0": start}) for start in (None, 3.0, [], [[1.0]], ["a"])],
]
REGULATORS = [
    ("A holds NaN", {"A": np.full((3, 3), NAN)}),
    ("A holds complex", {"A": I3 * 1j}),
    (r"A has shape \(3, 2\)", {"A": np.ones((3, 2))}),
    ("A has shape", {"A": np.zeros((0, 0))}),
    ("A holds", {"A": [["a"]]}),
    ("A is not an array", {"A": [[1.0], [1.0, 2.0]]}),
    ("A is a function", {"A": lambda x: x}),
    ("A is None", {"A": None}),
    ("A is too large", {"A": np.full(3, -1e154)}),
    (r"B has shape \(2, 1\)", {"B": np.ones((2, 1))}),
    ("B holds NaN or inf", {"B": np.array([[INF], [0], [0]])}),
    ("B is None", {"B": None}),
    ("Q is not symmetric", {"Q": np.triu(np.ones((3, 3)))}),
    ("Q has shape", {"Q": I2}),
    ("Q is not positive semidefinite", {"Q": -I3}),
    ("Q is nan", {"Q": NAN}),
    ("Q is None", {"Q": None}),
    ("R is not positive definite", {"R": -np.eye(1)}),
    ("R is not positive definite", {"R": np.zeros((1, 1))}),
    ("R has shape", {"R": I2}),
    ("N has shape", {"N": np.ones((3, 2))}),
    ("is not", {"N": 5 * ONE}),
    ("E is singular", {"E": np.zeros((3, 3))}),
    ("E has shape", {"E": I2}),
    ("method='magic'", {"method": "magic"}),
    ("steps: method 'doubling' knows", {"steps": 3}),
    ("unstable='ignored'", {"unstable": "ignored"}),
    ("start does not stabilise", {"A": I3, "B": I3, "R": I3, "method": "newton", "start": 0 * I3}),
    ("start has shape", {"method": "newton", "start": ONE}),
    ("rank", {"method": "reduced", "A": -(np.arange(1.0, 513.0) ** 2), "B": np.ones((512, 1)),
              "Q": 1.0, "rank": 2}),
    ("^basis", {"method": "reduced", "basis": np.ones((3, 2))}),
    ("^basis", {"method": "reduced", "basis": np.ones((5, 2))}),
    ("compression", {"method": "reduced", "compression": "x"}),
    ("compression", {"method": "reduced", "compression": "printed"}),
    ("tol", {"method": "reduced", "tol": 0.0}),
    ("^pi", {"method": "hamiltonian", "pi": "x"}),
    ("^modes", {"method": "hamiltonian", "modes": 1}),
    ("^modes", {"method": "hamiltonian", "modes": 2.5}),
    ("^start", {"method": "hamiltonian", "start": "x"}),
    ("^inner", {"method": "hamiltonian", "inner": I3}),
]  # fmt: skip
FILTERS = [
    ("G has shape", {"G": np.ones((2, 1))}),
    ("C has shape", {"C": np.ones((1, 2))}),
    ("W is not positive semidefinite", {"W": -np.eye(1)}),
    ("W has shape", {"W": I2}),
    ("R is not positive definite|V is not", {"V": np.zeros((1, 1))}),
    ("N has shape", {"N": np.ones((2, 2))}),
    ("C is None", {"C": None}),
    ("W holds NaN", {"W": NAN}),
]
INVERSES = [
    ("^A", {"A": np.array([1.0, NAN])}),
    ("^A", {"A": np.ones((2, 3))}),
    ("^A", {"A": np.array([1j, 1.0])}),
    ("^B", {"B": np.ones((3, 1))}),
    ("^B", {"B": np.array([[1.0], [INF]])}),
    ("^B", {"B": np.ones((2, 0))}),
    ("^Q", {"Q": np.array([[1.0, 2.0], [0.0, 1.0]])}),
    ("^Q", {"Q": np.ones(3)}),
    ("^R", {"R": -1.0}),
    ("^R", {"R": I2}),
    ("^E", {"E": np.ones(3)}),
    ("^scale", {"scale": 0.0}),
]
CALLS = {
    solve_qp: (PROGRAMS, {"P": I2, "q": Q}),
    batch_solve_qp: ([("q is 3", {"q": 3.0})], {"P": I2, "q": [Q]}),
    eigs: (SPECTRA, {"A": np.eye(6), "k": 2}),
    svds: ([("k=151", {"k": 151})], {"A": np.eye(180, 150)}),
    lqr: (REGULATORS, {"A": -I3, "B": ONE, "Q": I3, "R": np.eye(1)}),
    care: ([("R is singular", {"r": np.zeros((1, 1))})], {"a": I2, "b": ONE[:2], "q": I2}),
    lqe: (FILTERS, {"A": -I3, "G": ONE, "C": ONE.T, "W": 1.0, "V": 1.0}),
    hamiltonian_inverse: (INVERSES, {"A": np.array([-1.0, -2.0]), "B": np.ones((2, 1)), "Q": 1.0}),
}
# What is no InputError, by the words of the message.
OTHERS = {"is not": RiccatiError, "rank": NotConverged}


@pytest.mark.parametrize(
    ("call", "words", "changed"),
    [
        pytest.param(call, *row, id=f"{call.__name__} {q}: {row[0]}")
        for call, (table, _) in CALLS.items()
        for q, row in enumerate(table)
    ],
)
def test_errors_name_the_argument(call, words, changed):
    with pytest.raises((InputError, OTHERS.get(words, InputError)), match=words) as caught:
        call(**(CALLS[call][1] | changed))
    assert isinstance(caught.value, GpuError)


@pytest.mark.parametrize("method", ["auto", "hamiltonian", "newton"])
def test_singular_mass_of_sparse_problems(method):
    E = np.r_[0.0, np.ones(29)]
    for A, M in ((-np.ones(30), E), (sparse.eye_array(30) * -2.0, sparse.diags_array(E))):
        with pytest.raises(InputError, match="E is singular"):
            lqr(A, np.ones(30), 1.0, E=M, method=method)


def test_sparse_problems_and_operators_that_do_not_fit():
    weight = sparse.csr_array(np.kron(np.eye(20), INDEFINITE))
    with pytest.raises(InputError, match="Q is not positive semidefinite"):
        lqr(sparse.eye_array(40) * -5.0, np.ones(40), weight)
    A = LinearOperator((9, 9), matvec=lambda x: -x, dtype=float)
    with pytest.raises(InputError, match="A has no rmatvec"):
        lqr(A, np.ones(9), 1.0, inverse=A)


@pytest.mark.parametrize("size", [1e151, 1e200, 1e300])
def test_operators_whose_squares_overflow_are_refused(size):
    """SciPy's "SVD did not converge" came out of it."""
    d = -size * np.arange(1.0, 5.0)

    def operator(e):
        return LinearOperator((4, 4), lambda x: e * x, rmatvec=lambda x: e * x, dtype=float)

    for A, inverse in ((operator(d), operator(1 / d)), (d, None), (sparse.diags_array(d), None)):
        with pytest.raises(InputError, match="A is too large"):
            lqr(A, np.ones((4, 1)), np.eye(4), 1.0, inverse=inverse)


def structurally_singular(density, rows):
    A = sparse.random_array((300, 300), density=density, rng=0) + sparse.eye_array(300)
    A = sparse.lil_array(A, dtype=float)
    A[rows, :] = 0.0
    A[rows, rows[0]] = 1.0
    return sparse.csr_array(A)


def test_structurally_singular_matrices_without_words_of_blas(capfd):
    """SuperLU calls BLAS with arguments that it refuses."""
    w = eigs(structurally_singular(0.017, [0, 1, 2]), 2, sigma=0.0, return_eigenvectors=False)
    assert np.abs(w).max() < 1e-8
    E, A = structurally_singular(0.02, [10, 11, 12, 13]), -sparse.eye_array(300, format="csr")
    with pytest.raises(InputError, match="E is singular"):
        lqr(A, np.ones((300, 1)), 1.0, 1.0, E=E)
    out, err = capfd.readouterr()
    assert "illegal value" not in out + err


def test_device_arrays_need_cupy():
    class Device:
        __cuda_array_interface__ = {"shape": (2,)}  # noqa: RUF012

    if importlib.util.find_spec("cupy"):
        pytest.skip("CuPy is installed")
    with pytest.raises(MissingDependency, match=r"cupy|CuPy"):
        solve_qp(I2, Q, lb=Device())


def test_import_needs_numpy_and_scipy_only():
    code = (
        "import sys, gpu; print({m.split('.')[0] for m in sys.modules} & "
        "{'cupy', 'numba', 'qpsolvers', 'skfem', 'osqp', 'matplotlib', 'pyvista'})"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
    assert set(gpu.__all__) <= set(dir(gpu))
