"""However a body is condensed, its contact is that of the elimination on the host.

Ways are the Schur complement on a device, solutions for every column in the same bits again, and
products with the factors; on a device, or on a library that imitates cuDSS.
"""

import functools
import gc
import pickle
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from fake_cudss import FakeCudss
from scipy import sparse
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTetP2, ElementTriP2, MeshQuad

from contact import ContactProblem, ElasticBody, InputError, LayeredBlock, LoadStepper
from contact.arrays.dense_arrays import DeviceArrays, HostArrays
from contact.condensation import condense as condense_module
from contact.condensation import device_choice, device_schur, elimination_order
from contact.condensation.condense import condense
from contact.condensation.device_schur import DeviceSchur
from contact.condensation.factor_compliance import FactorCompliance
from contact.condensation.solved_body import SolvedBody
from contact.errors import ContactError, MissingDependency
from skfem_adini import ElementHexAdini, ElementQuadAdini
from skfem_adini.solvers import cudss, cudss_library
from tests.contact.condensation.device_cases import CASES, Elsewhere, bowl, box_body, held

TWO = ("cuda:0", "cuda:1")
WAYS = {  # the device, whether in the same bits again, whether the compliance is only applied
    "eliminated": ("cuda", None, False),
    "repeatable": ("cuda", True, False),
    "repeatable, by products": ("cuda", True, True),
    "host, by products": ("cpu", None, True),
    "device, by products": ("cuda", None, True),
    "two devices": (TWO, None, False),
    "two devices, by products": (TWO, None, True),
}


def on_host(array):
    return array.get() if hasattr(array, "get") else array


@pytest.fixture(params=["fake", pytest.param("device", marks=pytest.mark.gpu)])
def engine(request, monkeypatch):
    """A library that imitates cuDSS on the host, or None for a device."""
    if request.param == "device":
        try:
            cudss_library.device_arrays()
            cudss_library.load_cudss()
        except ImportError:
            pytest.skip("cuDSS, CuPy or a CUDA device is not there")
        return None
    monkeypatch.setattr(condense_module, "arrays_on", lambda device: Elsewhere())
    return FakeCudss().put_in_place(monkeypatch)


@pytest.fixture(scope="module")
def host(make):
    """Results of the cases by elimination on the host."""
    return functools.cache(lambda case: CASES[case][0](make, CASES[case][1]).solve())


@pytest.fixture
def condensed(engine, monkeypatch):
    """Condense a problem in one of the ways; no compliance is small enough for products."""

    def run(problem, way):
        device, deterministic, products = WAYS[way]
        if engine is None and device != "cuda":
            pytest.skip("nothing for this device")
        with monkeypatch.context() as patch:
            if products:
                limits = condense_module.LIMITS._replace(rows=0, columns=0, alone=0)
                patch.setattr(condense_module, "LIMITS", limits)
            found = problem.condense(device, deterministic=deterministic)
        if way == "eliminated":
            assert all(isinstance(part._factor, DeviceSchur) for part in found.parts)
        else:
            assert all(isinstance(part, SolvedBody) for part in found.parts)
        assert isinstance(found._W, FactorCompliance) == products
        return found

    return run


def agree(result, expected):
    size = expected.mu.max()
    assert size > 0
    assert np.abs(result.mu - expected.mu).max() <= 1e-10 * size
    assert np.abs(result.t - expected.t).max() <= 1e-10 * size
    assert np.abs(result.u - expected.u).max() <= 1e-9 * np.abs(expected.u).max()


def bits(result):
    return [getattr(result, name).tobytes() for name in ("u", "mu", "t")]


@pytest.mark.sampled(6)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("case", CASES)
def test_results_are_those_of_the_elimination_on_the_host(engine, make, host, condensed, case, way):
    pose, element = CASES[case]
    if engine is not None:
        if (case, way) == ("TetP2", "repeatable"):
            pytest.skip("the imitation solves for each column anew")
        engine.jitter = 1e-13 * way.startswith("repeatable")
    results = []
    for _ in range(1 + way.startswith("repeatable")):
        problem = pose(make, element)
        condensed(problem, way)
        results.append(problem.solve())
    assert bits(results[0]) == bits(results[-1])
    assert make.law_error(results[0]) < 1e-8
    agree(results[0], host(case))
    if WAYS[way][0] == TWO:
        assert engine.devices == [0, 1]
        assert engine.keys[24] == 0


def smooth(make, element):
    body = box_body(make, element, E=2.0, nu=0.3)
    return ContactProblem(body.fix("top", value=lambda x: -0.05 + 0.01 * x[0]), "bottom", bowl)


def given_friction(make, element):
    problem = held(make, element)
    return ContactProblem(problem.body, "bottom", bowl, 0.02, law="tresca")


def compliant(make, element):
    return ContactProblem(held(make, element).body, "bottom", bowl, 0.3, overclosure=20.0)


def bonded(make, element):
    problem = held(make, element)
    tied = np.arange(problem.rows.gap.size) < 3
    gap = np.where(tied, 0.0, problem.rows.gap)
    problem.__dict__["rows"] = replace(problem.rows, bonded=tied, gap=gap)
    return problem


def small_units(make, element):
    return held(make, element, 1e-6)


def large_units(make, element):
    return held(make, element, 1e11)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("way", ["eliminated", "host, by products"])
@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHex1])
@pytest.mark.parametrize(
    "pose", [smooth, given_friction, compliant, bonded, small_units, large_units]
)
def test_other_laws_and_units(engine, make, condensed, pose, element, way):
    problem = pose(make, element)
    condensed(problem, way)
    result = problem.solve()
    agree(result, pose(make, element).solve())
    if pose in (smooth, given_friction):
        assert make.law_error(result) < 1e-8
    if pose is smooth:
        assert np.abs(result.t).max() == 0.0
    if pose is bonded:
        assert np.abs(result.mu[:3]).min() > 0


@pytest.mark.parametrize(
    ("method", "limit"), [("newton", 1), ("pdas", None), ("tresca_loop", None)]
)
def test_the_host_solves_what_stalls_and_all_other_methods(make, condensed, method, limit):
    problem = held(make, ElementQuad1)
    condensed(problem, "eliminated")
    agree(problem.solve(method, max_iterations=limit), held(make, ElementQuad1).solve())


@pytest.mark.parametrize("way", ["eliminated", "host, by products"])
def test_one_condensation_serves_a_history(make, condensed, way):
    results = []
    for chosen in (way, None):
        problem = held(make, ElementQuad1)
        kept = condensed(problem, way) if chosen else problem.condense()
        stepper = LoadStepper(problem).move("top", "y", -0.05).move("top", "x", 0.01)
        results.append(stepper.run([0.5, 1.0])[-1])
        assert problem.condense() is kept
    agree(*results)


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


def test_a_boundary_without_inner_unknowns(engine):
    body = ElasticBody.from_mesh(MeshQuad().with_defaults(), ElementQuad1(), E=1.0, nu=0.3)
    body.fix("top", "xy", -0.05)
    expected = ContactProblem(body, "bottom", 0.0, 0.3).solve()
    problem = ContactProblem(body, "bottom", 0.0, 0.3)
    problem.condense("cuda")
    assert np.abs(problem.solve().mu - expected.mu).max() <= 1e-12 * expected.mu.max()


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


def test_factors_that_do_not_fit_lie_on_the_host(engine, make, host, monkeypatch, caplog):
    if engine is None:
        pytest.skip("a device has room for this body")
    engine.estimates[1], engine.estimates[4] = 2**30, 2**20
    free = [2**28]
    monkeypatch.setattr(cudss, "free_memory", lambda xp: free[0])
    caplog.set_level("INFO", logger=device_schur.__name__)
    problem = held(make, ElementQuadAdini)
    with pytest.raises(ContactError, match="the factorisation needs 1 GiB"):
        problem.condense("cuda", deterministic=True)
    found = problem.condense("cuda", deterministic=False)
    assert "hybrid memory: cuDSS: the factorisation needs 1" in caplog.text
    assert engine.keys[11] == 1
    assert found.parts[0]._factor._cudss._given[3] is True
    agree(problem.solve(), host("Adini"))
    free[0] = 2**19
    with pytest.raises(ContactError, match=r"fewer kept unknowns, .* or solver='pardiso'"):
        held(make, ElementQuad1).condense("cuda")


class Small(Elsewhere):
    """A device with little memory."""

    def __init__(self, free):
        self._free = free

    def room(self):
        return self._free


def test_a_compliance_that_does_not_fit_is_refused_with_what_would(engine, make, monkeypatch):
    if engine is None:
        pytest.skip("the memory of a device is imitated")
    problem = held(make, ElementHexAdini)
    rows, unknowns = problem.condense("cpu").B.shape
    room = 16 * rows**2  # two matrices of the rows fit, the boundary's unknowns are more
    monkeypatch.setattr(condense_module, "arrays_on", lambda device: Small(room))
    with pytest.raises(ContactError, match=r"GB of the device's memory") as error:
        problem.condense("cuda")
    asked, fits = (int(x) for x in re.findall(r"(\d+) (?:contact )?rows", str(error.value)))
    assert asked == rows > fits > 0
    assert 8 * fits**2 * (1 + unknowns / rows) <= room < 8 * (fits + 1) ** 2 * (1 + unknowns / rows)


def test_a_device_without_room_applies_the_compliance(engine, make, monkeypatch):
    if engine is None:
        pytest.skip("the memory of a device is imitated")
    monkeypatch.setattr(condense_module, "arrays_on", lambda device: Small(1000))
    problem = held(make, ElementQuad1)
    assert isinstance(problem.condense("cuda")._W, FactorCompliance)
    agree(problem.solve(), held(make, ElementQuad1).solve())


def test_the_choice_is_kept_and_without_determinism_the_bits_may_vary(engine, make):
    if engine is None:
        pytest.skip("a device may vary, but need not")
    engine.jitter, engine.installed, results = 1e-13, 2, []
    problem = held(make, ElementQuad1)
    first = problem.condense("cuda", deterministic=True)
    assert problem.condense() is problem.condense("cuda") is first
    assert problem.condense(deterministic=False) is not first
    for _ in range(2):
        problem = held(make, ElementQuad1)
        problem.condense("cuda", deterministic=False)
        results.append(problem.solve())
    assert bits(results[0]) != bits(results[1])
    assert np.abs(results[0].mu - results[1].mu).max() <= 1e-9 * results[0].mu.max()
    with pytest.raises(ContactError, match="cudssCreateMg"):
        held(make, ElementQuad1).condense(("cuda:0", "cuda:2"))


@pytest.mark.parametrize("error", [1e-9, 1e-12])
def test_solutions_that_lack_digits_cost_steps_alone(engine, make, condensed, error):
    """Newton's residuals come from corrected solutions, its linear systems from quick ones."""
    if engine is None:
        pytest.skip("errors are imitated")
    problem = held(make, ElementQuad1)
    engine.error = error
    condensed(problem, "two devices, by products")
    result = problem.solve()
    assert {line.phase for line in result.history} <= {"frictionless", "newton"}
    agree(result, held(make, ElementQuad1).solve())


@pytest.mark.gpu
@pytest.mark.parametrize("case", ["Adini", "Hex1", "floating Hex1"])
@pytest.mark.parametrize("columns", [0, 5000])
def test_on_all_devices_that_are_there(make, host, case, columns, monkeypatch):
    try:
        cupy = cudss_library.device_arrays()
        cudss_library.load_cudss()
    except ImportError:
        pytest.skip("cuDSS, CuPy or a CUDA device is not there")
    monkeypatch.setattr(condense_module, "LIMITS", condense_module.LIMITS._replace(columns=columns))
    problem = CASES[case][0](make, CASES[case][1])
    found = problem.condense(tuple(f"cuda:{i}" for i in range(cudss_library.device_count(cupy))))
    assert isinstance(found._W, FactorCompliance) == (columns == 0)
    agree(problem.solve(), host(case))


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


def test_auto_takes_a_device_for_large_bodies_and_says_why(engine, make, monkeypatch, caplog):
    with monkeypatch.context() as patch:
        patch.setattr(device_choice, "missing_for_cudss", lambda: None)
        patch.setattr(device_choice, "arrays_on", lambda device: None)
        caplog.set_level("INFO", logger=device_choice.__name__)
        problem = held(make, ElementQuad1)
        assert type(problem.condense("auto").parts[0].arrays) is HostArrays
        assert f"cpu: {problem.body.f.size} unknowns are fewer than" in caplog.text
        patch.setattr(device_choice, "LARGE", 100)
        found = problem.condense("auto")
        assert isinstance(found.parts[0]._factor, DeviceSchur)
        assert f"cuda: {problem.body.f.size} unknowns" in caplog.text
        assert problem.condense("auto") is found
    monkeypatch.setattr(device_choice, "LARGE", 100)
    expected = ("cpu", "solver='superlu' runs on the host")
    assert device_choice.choose_device(problem.body, "superlu") == expected
    monkeypatch.setitem(sys.modules, "cupy", None)
    where, why = device_choice.choose_device(problem.body, "auto")
    assert where == "cpu"
    assert "skfem-adini[cuda13]" in why
    monkeypatch.setattr(device_choice, "arrays_on", lambda device: None)
    where, why = device_choice.choose_device(problem.body, "auto")
    assert where == "cpu"
    assert "skfem-adini[cudss]" in why


@pytest.mark.parametrize("case", ["Adini", "Hex1", "floating Quad1", "turned wood"])
def test_the_stiffness_of_congruent_cells_is_assembled_on_the_device(engine, make, case):
    """In the bits of the host, where it is computed when somebody asks for it."""
    pose, element = CASES[case]
    problem = pose(make, element)
    parts = problem.condense(device="cuda").parts
    problem.solve()
    for part in parts:
        assert "stiffness" not in vars(part.body)
        factor, there = part._factor, part.body.vectors._S.placed
        stiffness = part.body.stiffness
        for ours, name in zip(there, ("indptr", "indices", "data"), strict=True):
            np.testing.assert_array_equal(on_host(ours), getattr(stiffness, name))
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


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("element", "cells", "deterministic"),
    [
        (ElementQuadAdini, 64, False),
        (ElementTriP2, 72, False),
        (ElementHex1, 20, False),
        (ElementTetP2, 9, False),
        (ElementQuadAdini, 64, True),
    ],
)
def test_a_dissection_of_the_mesh_is_handed_over(
    engine, make, element, cells, deterministic, monkeypatch
):
    if engine is None and deterministic:
        pytest.skip("a device tells nobody its order")
    if engine is not None:  # which is slow, and knows no smallest tree
        cells = 9 if element().dim == 2 else 3 if element is ElementTetP2 else 5
        limits = elimination_order.LIMITS._replace(unknowns=0, flattest=2)
        monkeypatch.setattr(elimination_order, "LIMITS", limits)
    problem = held(make, element, cells=cells)
    found = problem.condense("cuda", deterministic=deterministic)
    agree(problem.solve(), held(make, element, cells=cells).solve())
    if engine is None:
        return
    (order,), (sizes,) = engine.orders, engine.trees
    unknowns = problem.body.constraint[0].shape[1]
    np.testing.assert_array_equal(np.sort(order), np.arange(unknowns))
    assert sizes.sum() == unknowns
    assert sizes.min() > 0
    if not deterministic:
        kept = found.parts[0]._boundary
        np.testing.assert_array_equal(order[-kept.size :], kept)
        assert engine.keys[17] == np.log2(sizes.size + 1)


def square(kind):
    mesh = MeshQuad().refined(2).with_defaults()
    return kind.from_mesh(mesh, ElementQuad2(), E=2.0, nu=0.3).fix("top", "xy", -0.1)


LAYERS = LayeredBlock(1.0, [(0.5, 4, 1.0, 0.3)], top="xy")
REFUSED = [  # body or None for a square, solver, arguments, message
    (None, "superlu", {"device": "cuda"}, "solver='superlu': with device='cuda'"),
    (None, "auto", {"device": TWO, "deterministic": True}, "deterministic: cuDSS has no such mode"),
    (None, "auto", {"device": "cuda", "deterministic": 1}, "deterministic=1: expected True, False"),
    (LAYERS, "auto", {"device": TWO}, "several devices take bodies with a Basis alone"),
    (LAYERS, "superlu", {}, "solver='superlu': a LayeredBlock is condensed without"),
    (LAYERS, "auto", {"device": "tpu"}, "device='tpu'"),
    *(
        (None, "auto", {"device": device}, r"device=.*: expected 'cpu', .*'cuda:0', 'cuda:1'")
        for device in (("cuda:0", "cuda:0"), ("cuda",), (0, 1), ("cuda:01",), ())
    ),
]


@pytest.mark.parametrize(("body", "solver", "arguments", "message"), REFUSED)
def test_what_is_refused(body, solver, arguments, message):
    problem = ContactProblem(body or square(ElasticBody), "bottom", 0.0, solver=solver)
    with pytest.raises(InputError, match=message):
        problem.condense(**arguments)


def test_kinds_and_methods_that_are_not_known(make, condensed):
    problem = held(make, ElementQuad1)
    with pytest.raises(InputError, match="condense a MeshQuad"):
        condense(MeshQuad(), problem.rows, "auto", "cpu")
    condensed(problem, "host, by products")
    with pytest.raises(InputError, match=r"method='pdas': the compliance of .* 'newton' alone"):
        problem.solve("pdas")


def test_a_missing_package_names_its_extra(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", None)
    with pytest.raises(MissingDependency, match=r"skfem-adini\[cu"):
        held(make, ElementQuad1).condense("cuda")
    monkeypatch.setattr(condense_module, "arrays_on", lambda device: HostArrays())
    with pytest.raises(MissingDependency, match=r"skfem-adini\[cudss\]"):
        held(make, ElementQuad1).condense("cuda")
