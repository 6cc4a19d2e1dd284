"""Results, factors and errors go to other processes and come back the same."""

import copy
import inspect
import pickle

import numpy as np
import pytest
from optional_packages import PARDISO
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, aslinearoperator

import gpu
from gpu import (
    GpuError,
    Infeasible,
    InputError,
    NotConverged,
    QPFactor,
    RiccatiError,
    Unbounded,
    batch_solve_qp,
    dlqr,
    eigs,
    hamiltonian_inverse,
    lqe,
    lqr,
    solve_qp,
)
from gpu.arrays.sparse_factor import PardisoFactor

A, B = np.diag([-1.0, -2.0, -3.0]), np.ones((3, 1))
LONG = sparse.csr_array(np.diag(-np.arange(1.0, 50.0)))
REGULATORS = {
    "dense": lambda: lqr(A, B, 1.0, 1.0),
    "mass and weight": lambda: lqr(A, B, np.eye(3), 1.0, E=2.0 * np.eye(3)),
    "diagonal": lambda: lqr(np.diag(A), B, 1.0, 1.0),
    "sparse": lambda: lqr(sparse.csr_array(A), B, 1.0, 1.0),
    "factored": lambda: lqr(LONG, np.ones((49, 1)), np.ones((1, 49)), 1.0, factored=True),
    "crossed": lambda: lqr(sparse.csr_array(A), B, 1.0, 1.0, N=0.1 * B),
    "newton": lambda: lqr(A, B, 1.0, 1.0, method="newton"),
    "reduced": lambda: lqr(np.diag(A), B, 1.0, 1.0, method="reduced"),
    "hamiltonian": lambda: lqr(A, B, 1.0, 1.0, method="hamiltonian", modes=6),
    "filter": lambda: lqe(A, np.eye(3), B.T, np.eye(3), 1.0),
}
COPIES = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}


@pytest.mark.parametrize("make", REGULATORS.values(), ids=REGULATORS)
def test_regulators(make):
    result = make()
    x, best = np.ones(max(result.K.shape)), result.refined().K
    for again in COPIES.values():
        other = again(result)
        assert type(other) is type(result)
        for name in ("K", "E"):
            np.testing.assert_array_equal(getattr(other, name), getattr(result, name))
        for name in ("stable", "method"):
            assert getattr(other, name) == getattr(result, name)
        assert other.info.keys() == result.info.keys()
        assert result.S is None or other.cost(x) == result.cost(x)
        np.testing.assert_array_equal(other.refined().K, best)


@pytest.mark.parametrize("weight", [(1.0, {}), (np.ones((1, 5)), {"factored": True})])
def test_functions_of_an_operator_stay_behind(weight):
    d = -np.arange(1.0, 6.0)
    product, inverse = (
        LinearOperator((5, 5), lambda x, f=f: f(x), rmatvec=lambda x, f=f: f(x), dtype=float)
        for f in (lambda x: d * x, lambda x: x / d)
    )
    result = lqr(product, np.ones((5, 1)), weight[0], 1.0, inverse=inverse, **weight[1])
    for again in COPIES.values():
        other = again(result)
        np.testing.assert_array_equal(other.K, result.K)
        with pytest.raises(InputError, match=r"^problem"):
            other.refined()


@pytest.mark.parametrize("again", COPIES.values(), ids=COPIES)
def test_quadratic_programs(again):
    P, q = np.diag([1.0, 2.0]), np.array([-1.0, 1.0])
    for arguments in ({"lb": 0.0}, {"G": np.ones((1, 2)), "h": [0.5]}):
        result = solve_qp(P, q, **arguments)
        other = again(result)
        np.testing.assert_array_equal(other.x, result.x)
        assert (other.kkt, other.status, other.history) == (
            result.kkt, result.status, result.history,
        )  # fmt: skip
        assert other.residuals(P, q, **arguments) == result.residuals(P, q, **arguments)
    for stored in (P, sparse.csr_array(P), np.ones((2, 2))):
        factor = again(QPFactor(stored))
        np.testing.assert_array_equal(
            solve_qp(factor, q, lb=0.0, ub=1.0).x, solve_qp(stored, q, lb=0.0, ub=1.0).x
        )


def failures():
    with pytest.raises(Infeasible) as one:
        solve_qp(np.eye(2), [0.0, 0.0], A=[[1.0, 1.0]], b=[5.0], ub=1.0)
    with pytest.raises(Unbounded) as two:
        solve_qp(np.zeros((2, 2)), [1.0, 0.0])
    with pytest.raises(RiccatiError) as three:
        lqr(np.diag([1.0, -1.0]), np.array([[0.0], [1.0]]), 1.0, 1.0)
    with pytest.raises(NotConverged) as four:
        eigs(np.random.default_rng(0).standard_normal((300, 300)), 5, maxiter=1)
    with pytest.raises(GpuError) as five:
        batch_solve_qp(np.eye(2), [[0.0, 0.0], [np.nan, 0.0]])
    return [caught.value for caught in (one, two, three, four, five)]


def test_errors_with_all_they_carry():
    """A pool that cannot unpickle the error of a worker waits for ever."""
    for error in failures():
        for again in COPIES.values():
            other = again(error)
            assert type(other) is type(error)
            assert str(other) == str(error)
            assert vars(other).keys() == vars(error).keys()
            for name, value in vars(error).items():
                np.testing.assert_array_equal(getattr(other, name), value)


@PARDISO
def test_factors_of_pardiso_are_made_anew():
    """A copy shared the handle, and freed it twice."""
    factor = PardisoFactor(sparse.csc_array(np.eye(3)))
    factor.factor(np.full(3, 2.0))
    for again in COPIES.values():
        copied = again(factor)
        np.testing.assert_allclose(copied.solve(np.ones(3)), 0.5)
        copied.factor(np.ones(3))
        np.testing.assert_allclose(copied.solve(np.ones(3)), 1.0)
    np.testing.assert_allclose(factor.solve(np.ones(3)), 0.5)


STEPS = -np.arange(1.0, 7.0)
CHAIN = sparse.diags_array([np.ones(5), -3 * np.ones(6), np.ones(5)], offsets=[-1, 0, 1]).tocsc()
INVERSES = {
    "diagonal": lambda B: hamiltonian_inverse(STEPS, B, 1.0),
    "dense": lambda B: hamiltonian_inverse(np.diag(STEPS) + 0.1, B, np.eye(6)),
    "sparse": lambda B: hamiltonian_inverse(CHAIN, B, 2.0, np.eye(2)),
    "mass and scale": lambda B: hamiltonian_inverse(CHAIN, B, 1.0, E=2.0 * CHAIN, scale=3.0),
    "zero mode": lambda B: hamiltonian_inverse(STEPS + 1.0, B, 1.0),
    "factored as a whole": lambda B: hamiltonian_inverse(np.diag(np.ones(5), 1), B, 1.0),
    "operator": lambda B: hamiltonian_inverse(
        aslinearoperator(np.diag(STEPS)), B, 1.0, inverse=aslinearoperator(np.diag(1 / STEPS))
    ),
}


@pytest.mark.parametrize("kind", INVERSES)
def test_inverse_hamiltonians(kind):
    """The operator held functions that pickle cannot carry; copies factor anew."""
    rng = np.random.default_rng(0)
    B, V = rng.standard_normal((6, 2)), rng.standard_normal((12, 3))
    operator = INVERSES[kind](B)
    for other in (again(operator) for again in COPIES.values()):
        for apply, v in (("matvec", V[:, 0]), ("rmatvec", V[:, 0]), ("matmat", V[:, :1])):
            np.testing.assert_array_equal(getattr(other, apply)(v), getattr(operator, apply)(v))
        for one, product, matrix in (
            (operator.matvec, other @ V, operator @ V),
            (operator.rmatvec, other.H @ V, operator.H @ V),
        ):
            np.testing.assert_array_equal(product, matrix)
            np.testing.assert_allclose(product, np.transpose([one(v) for v in V.T]), 1e-9)


def public_objects():
    P, q = np.diag([1.0, 2.0]), np.array([-1.0, 1.0])
    result = solve_qp(P, q, lb=0.0)
    low = lqr(LONG, np.ones((49, 1)), np.ones((1, 49)), 1.0, factored=True)
    found = [result, result.kkt, result.status, *result.history[:1], QPFactor(P), low, low.S]
    found += [batch_solve_qp(P, [q, -q], lb=0.0), result.vjp(q)]
    found.append(dlqr(P, P, P))
    return {type(value).__name__: value for value in found}


@pytest.mark.parametrize("name", [n for n in gpu.__all__ if inspect.isclass(getattr(gpu, n))])
def test_every_public_class(name):
    kind = getattr(gpu, name)
    if issubclass(kind, Exception):
        raised = {type(error): error for error in failures()}
        value = raised[kind] if kind in raised else kind("P: not so")
    else:
        value = public_objects()[name]
    for other in (again(value) for again in COPIES.values()):
        assert type(other) is kind
        assert str(other) == str(value) or " at 0x" in str(value)
