"""What the host condenses, a device condenses too; on a device or a library that imitates cuDSS."""

import copy
import gc
import pickle
import re

import numpy as np
import pytest
from scipy import sparse
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementTetP2,
    ElementTriP2,
    MeshQuad,
)

from contact import ContactProblem, ElasticBody, InputError, LoadStepper
from contact.arrays.dense_arrays import HostArrays
from contact.condensation import condense as condense_module
from contact.condensation import device_choice, device_schur, elimination_order
from contact.condensation.device_schur import DeviceSchur
from contact.condensation.schur import SuperLUSchur
from contact.errors import ContactError, MissingDependency
from skfem_adini import ElementHexAdini, ElementQuadAdini
from skfem_adini.solvers import cudss
from skfem_adini.solvers.cudss import CudssSchur, DissectionTree
from tests.contact.condensation.device_cases import CASES, Elsewhere, bowl, box_body, held


def on_host(array):
    return array.get() if hasattr(array, "get") else array


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", CASES)
def test_results_of_the_device_are_those_of_the_host(engine, make, case):
    pose, element = CASES[case]
    host = pose(make, element).solve()
    problem = pose(make, element)
    condensed = problem.condense(device="cuda")
    assert all(isinstance(part._factor, DeviceSchur) for part in condensed.parts)
    result = problem.solve()
    assert make.law_error(result) < 1e-8
    assert np.abs(result.mu - host.mu).max() <= 1e-10 * host.mu.max()
    assert np.abs(result.t - host.t).max() <= 1e-10 * host.mu.max()
    assert np.abs(result.u - host.u).max() <= 1e-9 * np.abs(host.u).max()


@pytest.mark.parametrize("unit", [1e-6, 1e11])
def test_units(engine, make, unit):
    host = held(make, ElementQuadAdini, unit).solve()
    problem = held(make, ElementQuadAdini, unit)
    problem.condense(device="cuda")
    assert np.abs(problem.solve().mu - host.mu).max() <= 1e-10 * host.mu.max()


def test_one_condensation_serves_a_history(engine, make):
    results = []
    for device in ("cpu", "cuda"):
        problem = held(make, ElementQuad1)
        condensed = problem.condense(device)
        stepper = LoadStepper(problem).move("top", "y")
        results.append(stepper.run([0.5, 1.0])[-1])
        assert problem.condense() is condensed
    host, there = results
    assert np.abs(there.mu - host.mu).max() <= 1e-10 * host.mu.max()


@pytest.mark.parametrize("case", ["Hex1", "floating Adini", "pair of Quad1"])
def test_the_certificate_is_computed_on_the_device(engine, make, case):
    pose, element = CASES[case]
    problem = pose(make, element)
    where = [part.arrays for part in problem.condense(device="cuda").parts]
    for result in (problem.solve(), LoadStepper(problem).step(1.0)):
        bodies = result.solid.bodies
        assert [body.vectors.arrays for body in bodies] == where
    there = result.kkt
    problem.condense(device="cpu")  # takes the place of the other condensation
    gc.collect()
    assert {type(body.vectors.arrays) for body in bodies} == {HostArrays}
    here = result.kkt
    assert all(abs(here[name] - there[name]) < 1e-13 for name in there)


def test_factor_against_superlu(engine, make):
    problem = held(make, ElementHexAdini)
    part = problem.condense().parts[0]
    P, b = part._P, part._boundary
    S = (P.T @ problem.body.stiffness @ P).tocsr()
    reference = SuperLUSchur(S, b, np.arange(S.shape[0]), np.abs(S.diagonal()[b]))
    factor = DeviceSchur(S, b)
    assert np.abs(on_host(factor.schur) - reference.schur).max() <= 1e-12
    rng = np.random.default_rng(0)
    f, z = rng.uniform(-1, 1, S.shape[0]), rng.uniform(-1, 1, b.size)
    for one in (factor, copy.deepcopy(factor)):
        np.testing.assert_allclose(one.reduce(f), reference.reduce(f), atol=1e-10)
        np.testing.assert_allclose(one.expand(f, z), reference.expand(f, z), atol=1e-10)


def test_a_boundary_without_inner_unknowns(engine):
    body = ElasticBody.from_mesh(MeshQuad().with_defaults(), ElementQuad1(), E=1.0, nu=0.3)
    body.fix("top", "xy", -0.05)
    host = ContactProblem(body, "bottom", 0.0, 0.3).solve()
    problem = ContactProblem(body, "bottom", 0.0, 0.3)
    problem.condense("cuda")
    assert np.abs(problem.solve().mu - host.mu).max() <= 1e-12 * host.mu.max()


def test_an_indefinite_inner_block_and_lack_of_memory_are_typed(engine, make):
    part = held(make, ElementQuad1).condense().parts[0]
    P, b = part._P, part._boundary
    S = (P.T @ part.body.stiffness @ P).tocsr()
    inner = np.setdiff1d(np.arange(S.shape[0]), b)[3]
    S[inner, inner] = -1.0
    with pytest.raises(InputError, match="not positive definite"):
        DeviceSchur(S, b)
    if engine is not None:
        engine.fail["cudssExecute"] = 2
        with pytest.raises(ContactError, match="memory of the device"):
            DeviceSchur(S, b)
        assert engine.alive == {}


def test_factors_that_do_not_fit_lie_on_the_host(engine, make, monkeypatch, caplog):
    if engine is None:
        pytest.skip("a device has room for this body")
    host = held(make, ElementQuad1).solve()
    engine.estimates[1], engine.estimates[4] = 2**30, 2**20
    free = [2**28]
    monkeypatch.setattr(cudss, "free_memory", lambda xp: free[0])
    caplog.set_level("INFO", logger=device_schur.__name__)
    problem = held(make, ElementQuad1)
    condensed = problem.condense("cuda")
    assert "hybrid memory: cuDSS: the factorisation needs 1" in caplog.text
    assert engine.keys[11] == 1
    assert condensed.parts[0]._factor._cudss._given[3] is True
    result = problem.solve()
    assert np.abs(result.mu - host.mu).max() <= 1e-10 * host.mu.max()
    free[0] = 2**19
    with pytest.raises(ContactError, match=r"fewer kept unknowns, .* or solver='pardiso'"):
        held(make, ElementQuad1).condense("cuda")


def test_a_compliance_that_does_not_fit_is_refused_with_what_would(engine, make, monkeypatch):
    class Small(Elsewhere):
        def room(self):
            return room

    if engine is None:
        pytest.skip("the memory of a device is imitated")
    problem = held(make, ElementHexAdini)
    rows, unknowns = problem.condense("cpu").B.shape
    room = 16 * rows**2  # two matrices of the rows fit, the boundary's unknowns are more
    monkeypatch.setattr(condense_module, "arrays_on", lambda device: Small())
    with pytest.raises(ContactError, match=r"GB of the device's memory") as error:
        problem.condense("cuda")
    asked, fits = (int(x) for x in re.findall(r"(\d+) (?:contact )?rows", str(error.value)))
    assert asked == rows > fits > 0
    assert 8 * fits**2 * (1 + unknowns / rows) <= room < 8 * (fits + 1) ** 2 * (1 + unknowns / rows)


def test_a_sparse_solver_of_the_host_is_refused(make):
    problem = ContactProblem(held(make, ElementQuad1).body, "bottom", 0.0, solver="superlu")
    with pytest.raises(InputError, match="solver='superlu': with device='cuda'"):
        problem.condense("cuda")


def test_a_missing_package_names_its_extra(make, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cupy", None)
    with pytest.raises(MissingDependency, match=r"skfem-adini\[cu"):
        held(make, ElementQuad1).condense("cuda")
    monkeypatch.setattr(condense_module, "arrays_on", lambda device: HostArrays())
    with pytest.raises(MissingDependency, match=r"skfem-adini\[cudss\]"):
        held(make, ElementQuad1).condense("cuda")


def test_auto_takes_a_device_for_large_bodies_and_says_why(engine, make, monkeypatch, caplog):
    monkeypatch.setattr(device_choice, "missing_for_cudss", lambda: None)
    monkeypatch.setattr(device_choice, "arrays_on", lambda device: None)
    caplog.set_level("INFO", logger=device_choice.__name__)
    problem = held(make, ElementQuad1)
    assert type(problem.condense("auto").parts[0].arrays) is HostArrays
    assert f"cpu: {problem.body.f.size} unknowns are fewer than" in caplog.text
    monkeypatch.setattr(device_choice, "LARGE", 100)
    condensed = problem.condense("auto")
    assert isinstance(condensed.parts[0]._factor, DeviceSchur)
    assert f"cuda: {problem.body.f.size} unknowns" in caplog.text
    assert problem.condense("auto") is condensed


def test_auto_names_what_is_missing(make, monkeypatch):
    body = held(make, ElementQuad1).body
    monkeypatch.setattr(device_choice, "LARGE", 100)
    assert device_choice.choose_device(body, "superlu") == (
        "cpu",
        "solver='superlu' runs on the host",
    )
    monkeypatch.setitem(__import__("sys").modules, "cupy", None)
    where, why = device_choice.choose_device(body, "auto")
    assert where == "cpu"
    assert "skfem-adini[cuda13]" in why
    monkeypatch.setattr(device_choice, "arrays_on", lambda device: None)
    where, why = device_choice.choose_device(body, "auto")
    assert where == "cpu"
    assert "skfem-adini[cudss]" in why


ALIKE = ["Adini", "Hex1", "floating Quad1", "turned wood", "mean dilatation"]


@pytest.mark.parametrize("case", ALIKE)
def test_the_stiffness_of_congruent_cells_is_assembled_on_the_device(engine, make, case):
    """In the bits of the host, where it is computed when somebody asks for it."""
    pose, element = CASES[case]
    problem = pose(make, element)
    parts = problem.condense(device="cuda").parts
    problem.solve()
    for part in parts:
        assert "stiffness" not in vars(part.body)
        factor, there = part._factor, part.body.vectors._S.placed
        host = part.body.stiffness
        for ours, name in zip(there, ("indptr", "indices", "data"), strict=True):
            np.testing.assert_array_equal(on_host(ours), getattr(host, name))
        part.body.E = None if part.body.E is None else 7.0 * part.body.E
        copied = pickle.loads(pickle.dumps(factor))  # factors anew, and not the other material
        np.testing.assert_allclose(on_host(copied.schur), on_host(factor.schur), rtol=0, atol=1e-12)


def test_a_device_path_that_eliminates_nothing_assembles_nothing_on_the_host(engine, make):
    problem = held(make, ElementQuadAdini)
    (part,) = problem.condense(device="cuda", deterministic=True).parts
    problem.solve()
    assert "stiffness" not in vars(part.body)
    P = part.body.constraint[0]
    expected = (P.T @ part.body.stiffness @ P).diagonal() * part._factor.system.unit**2
    np.testing.assert_allclose(part.diagonal, expected, rtol=1e-15)
    assert part._factor.system.whole is part.body.stiffness  # one matrix, and not a copy's


def test_cells_that_differ_are_assembled_on_the_host(engine, make):
    uneven = ElasticBody.from_mesh(
        make.box(ElementQuadAdini, np.linspace(0.0, 1.0, 6) ** 1.5, np.linspace(0.0, 1.0, 7) ** 2),
        ElementQuadAdini(), E=2.0, nu=0.3,
    ).fix("top", value=-0.05)  # fmt: skip
    for problem in (ContactProblem(uneven, "bottom", bowl), CASES["cut"][0](make, None)):
        problem.condense(device="cuda")
        assert "stiffness" in vars(problem.body)


@pytest.mark.parametrize("case", ["Adini", "P2", "Hex1", "TetP2"])
def test_free_rows_are_taken_on_the_device_where_unknowns_are_dofs(engine, make, case, monkeypatch):
    """Of every element, also where essential conditions list derivatives after values."""
    taken = []
    build = DeviceSchur.__init__

    def noted(self, stiffness, *others):
        taken.append(stiffness.free)
        build(self, stiffness, *others)

    monkeypatch.setattr(DeviceSchur, "__init__", noted)
    pose, element = CASES[case]
    pose(make, element).condense(device="cuda")
    (free,) = taken
    assert (np.diff(free) > 0).all()


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("element", "cells"),
    [(ElementQuadAdini, 64), (ElementTriP2, 72), (ElementHex1, 20), (ElementTetP2, 9)],
)
def test_a_dissection_of_the_mesh_is_handed_over(engine, make, element, cells, monkeypatch):
    if engine is not None:  # which is slow, and knows no smallest tree
        cells = 9 if element().dim == 2 else 5
        limits = elimination_order.LIMITS._replace(unknowns=0, flattest=2)
        monkeypatch.setattr(elimination_order, "LIMITS", limits)
    problem = held(make, element, cells=cells)
    condensed = problem.condense(device="cuda")
    there = problem.solve()
    here = held(make, element, cells=cells).solve()
    np.testing.assert_allclose(there.mu, here.mu, rtol=0, atol=1e-10 * here.mu.max())
    np.testing.assert_allclose(there.u, here.u, rtol=0, atol=1e-9 * np.abs(here.u).max())
    if engine is None:
        return
    kept = condensed.parts[0]._boundary
    (order,), (sizes,) = engine.orders, engine.trees
    np.testing.assert_array_equal(np.sort(order), np.arange(order.size))
    np.testing.assert_array_equal(order[-kept.size :], kept)
    assert sizes.sum() == order.size
    assert sizes.min() > 0
    assert engine.keys[17] == np.log2(sizes.size + 1)


def test_a_tree_that_does_not_separate_is_not_handed_over(engine):
    A = 9.0 * np.eye(7) + np.diag(np.ones(6), 1) + np.diag(np.ones(6), -1)
    tree = DissectionTree(np.array([0, 1, 2, 4, 5, 3, 6]), np.array([3, 2, 2]))
    far = A.copy()
    far[0, 5] = far[5, 0] = 1.0  # joins two leaves
    A[3, 6] = A[6, 3] = A[2, 6] = A[6, 2] = 1.0  # joins with the root
    for matrix, trees in ((A, 1), (far, 0)):
        factor = CudssSchur(sparse.csr_array(matrix), [6], tree)
        inner = np.linalg.solve(matrix[:6, :6], matrix[:6, 6:])
        exact = matrix[6:, 6:] - matrix[6:, :6] @ inner
        np.testing.assert_allclose(on_host(factor.complement), exact, atol=1e-14)
        if engine is not None:
            assert len(engine.trees) == trees
            engine.trees.clear()


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHex1])
def test_contact_without_friction(engine, make, element):
    host, there = (
        ContactProblem(
            box_body(make, element, E=2.0, nu=0.3).fix("top", value=lambda x: -0.05 + 0.01 * x[0]),
            "bottom",
            bowl,
        )
        for _ in range(2)
    )
    there.condense(device="cuda")
    expected, result = host.solve(), there.solve()
    assert make.law_error(result) < 1e-8
    assert expected.mu.max() > 0
    assert np.abs(result.t).max() == 0.0
    assert np.abs(result.mu - expected.mu).max() <= 1e-10 * expected.mu.max()
    assert np.abs(result.u - expected.u).max() <= 1e-9 * np.abs(expected.u).max()
