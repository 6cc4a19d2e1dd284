"""With ``deterministic=True`` a device gives the same bits again, and the results of the host."""

import numpy as np
import pytest
from scipy import sparse
from skfem import ElementQuad1

from contact import ContactProblem, ContactResult, InputError
from contact.arrays.dense_arrays import DeviceArrays, HostArrays
from contact.condensation import condense as condense_module
from contact.condensation import elimination_order
from contact.condensation.device_schur import DeviceSchur
from contact.condensation.factor_compliance import FactorCompliance
from contact.condensation.solved_body import SolvedBody
from contact.errors import ContactError
from skfem_adini import ElementQuadAdini
from skfem_adini.solvers import cudss
from tests.contact.condensation.device_cases import CASES, held


def bits(result: ContactResult) -> list[bytes]:
    return [getattr(result, name).tobytes() for name in ("u", "mu", "t")]


def solved(problem: ContactProblem, deterministic: bool) -> ContactResult:
    condensed = problem.condense("cuda", deterministic=deterministic)
    assert all(isinstance(part, SolvedBody) == deterministic for part in condensed.parts)
    return problem.solve()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("columns", [0, 300])
@pytest.mark.parametrize("case", CASES)
def test_the_same_bits_again_and_the_results_of_the_host(engine, make, case, columns, monkeypatch):
    monkeypatch.setattr(condense_module, "LIMITS", condense_module.LIMITS._replace(alone=columns))
    pose, element = CASES[case]
    if engine is not None:
        engine.jitter = 1e-13
    one, again = (solved(pose(make, element), True) for _ in range(2))
    assert bits(one) == bits(again)
    host = pose(make, element).solve()
    assert make.law_error(one) < 1e-8
    assert np.abs(one.mu - host.mu).max() <= 1e-10 * host.mu.max()
    assert np.abs(one.t - host.t).max() <= 1e-10 * host.mu.max()
    assert np.abs(one.u - host.u).max() <= 1e-9 * np.abs(host.u).max()


def test_without_it_the_bits_may_vary(engine, make):
    if engine is None:
        pytest.skip("a device may, but need not")
    engine.jitter = 1e-13
    one, again = (solved(held(make, ElementQuad1), False) for _ in range(2))
    assert bits(one) != bits(again)
    assert np.abs(one.mu - again.mu).max() <= 1e-9 * one.mu.max()


@pytest.mark.parametrize(("most", "by_products"), [(0, True), (300, False)])
def test_the_compliance_of_many_rows_is_applied(engine, make, monkeypatch, most, by_products):
    monkeypatch.setattr(condense_module, "LIMITS", condense_module.LIMITS._replace(alone=most))
    condensed = held(make, ElementQuad1).condense("cuda", deterministic=True)
    assert isinstance(condensed._W, FactorCompliance) == by_products


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuad1])
def test_a_dissection_of_all_unknowns_is_handed_over(engine, make, element, monkeypatch):
    if engine is None:
        pytest.skip("a device tells nobody its order")
    limits = elimination_order.LIMITS._replace(unknowns=0, flattest=2)
    monkeypatch.setattr(elimination_order, "LIMITS", limits)
    problem = held(make, element, cells=9)
    problem.condense("cuda", deterministic=True)
    (order,), (sizes,) = engine.orders, engine.trees
    unknowns = problem.body.constraint[0].shape[1]
    np.testing.assert_array_equal(np.sort(order), np.arange(unknowns))
    assert sizes.sum() == unknowns
    assert sizes.min() > 0


def test_the_choice_is_kept_until_another_is_made(engine, make):
    problem = held(make, ElementQuad1)
    first = problem.condense("cuda", deterministic=True)
    assert problem.condense() is first
    assert problem.condense("cuda") is first
    other = problem.condense(deterministic=False)
    assert other is not first
    assert isinstance(other.parts[0]._factor, DeviceSchur)


def test_what_cudss_cannot_repeat_is_refused(engine, make, monkeypatch):
    problem = held(make, ElementQuad1)
    with pytest.raises(InputError, match="deterministic: cuDSS has no such mode on several"):
        problem.condense(("cuda:0", "cuda:1"), deterministic=True)
    with pytest.raises(InputError, match="deterministic=1: expected True, False or None"):
        problem.condense("cuda", deterministic=1)
    if engine is None:
        return
    engine.estimates[1], engine.estimates[4] = 2**30, 2**20
    monkeypatch.setattr(cudss, "free_memory", lambda xp: 2**28)
    with pytest.raises(ContactError, match="the factorisation needs 1 GiB"):
        problem.condense("cuda", deterministic=True)
    problem.condense("cuda", deterministic=False)


@pytest.mark.parametrize("density", [0.0, 0.05, 0.5])
def test_congruence_entry_by_entry_is_that_of_the_host(density):
    rng = np.random.default_rng(3)
    B = sparse.csr_array(sparse.random_array((30, 40), density=density, rng=rng))
    A = rng.uniform(-1, 1, (40, 40))
    device = object.__new__(DeviceArrays)
    device.xp = np
    found = device.congruent(B, A + A.T)
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(found, HostArrays().congruent(B, A + A.T), atol=1e-13)
