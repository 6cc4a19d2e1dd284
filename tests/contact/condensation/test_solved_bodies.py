"""Bodies that are condensed by solutions of all of them: by columns, or applied to forces.

The oracle is the condensation that eliminates what is inside.
"""

from dataclasses import replace

import numpy as np
import pytest
from fake_cudss import FakeCudss
from skfem import ElementHex1, ElementQuad1

from contact import ContactProblem, InputError, LayeredBlock, LoadStepper
from contact.condensation import condense as condense_module
from contact.condensation.factor_compliance import FactorCompliance, guessed_diagonal
from contact.condensation.solved_body import SolvedBody
from contact.errors import ContactError
from skfem_adini import ElementQuadAdini
from skfem_adini.solvers import cudss_library
from tests.contact.condensation.device_cases import CASES, Elsewhere, bowl, box_body, floating, held

TWO = ("cuda:0", "cuda:1")


@pytest.fixture
def several(monkeypatch):
    """Devices that share factors, imitated."""
    monkeypatch.setattr(condense_module, "arrays_on", lambda device: Elsewhere())
    return FakeCudss().put_in_place(monkeypatch)


@pytest.fixture
def products(monkeypatch):
    """No compliance is small enough to be dense."""
    limits = condense_module.LIMITS._replace(rows=0, columns=0)
    monkeypatch.setattr(condense_module, "LIMITS", limits)


def agree(result, expected):
    size = expected.mu.max()
    assert size > 0
    assert np.abs(result.mu - expected.mu).max() <= 1e-10 * size
    assert np.abs(result.t - expected.t).max() <= 1e-10 * size
    assert np.abs(result.u - expected.u).max() <= 1e-9 * np.abs(expected.u).max()


def solved(problem, device):
    condensed = problem.condense(device)
    assert all(isinstance(part, SolvedBody) for part in condensed.parts)
    return problem.solve(), isinstance(condensed._W, FactorCompliance)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", CASES)
def test_on_the_host_by_products(make, products, case, monkeypatch):
    pose, element = CASES[case]
    result, by_products = solved(pose(make, element), "cpu")
    assert by_products
    assert make.law_error(result) < 1e-8
    monkeypatch.undo()
    agree(result, pose(make, element).solve())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("case", ["Adini", "Hex1", "floating Quad1", "floating Hex1", "cut"])
def test_on_several_devices_by_columns(make, several, case):
    pose, element = CASES[case]
    result, by_products = solved(pose(make, element), TWO)
    assert not by_products
    assert several.devices == [0, 1]
    assert several.keys[24] == 0
    agree(result, pose(make, element).solve())


@pytest.mark.parametrize("device", ["cuda", TWO])
@pytest.mark.parametrize("pose", [held, floating])
def test_on_devices_by_products(make, several, products, pose, device):
    result, by_products = solved(pose(make, ElementQuad1), device)
    assert by_products
    assert several.devices == (None if device == "cuda" else [0, 1])
    agree(result, pose(make, ElementQuad1).solve())


@pytest.mark.gpu
@pytest.mark.parametrize("case", ["Adini", "Hex1", "floating Hex1"])
@pytest.mark.parametrize("columns", [0, 5000])
def test_on_all_devices_that_are_there(make, case, columns, monkeypatch):
    try:
        cupy = cudss_library.device_arrays()
        cudss_library.load_cudss()
    except ImportError:
        pytest.skip("cuDSS, CuPy or a CUDA device is not there")
    monkeypatch.setattr(condense_module, "LIMITS", condense_module.LIMITS._replace(columns=columns))
    pose, element = CASES[case]
    words = tuple(f"cuda:{i}" for i in range(cudss_library.device_count(cupy)))
    result, by_products = solved(pose(make, element), words)
    assert by_products == (columns == 0)
    agree(result, pose(make, element).solve())


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementHex1])
@pytest.mark.parametrize("law", ["frictionless", "tresca"])
def test_other_laws(make, products, element, law, monkeypatch):
    def posed():
        body = box_body(make, element, E=2.0, nu=0.3)
        last = "xyz"[body.dim - 1]
        body.fix("top", last, -0.05).fix("top", "x", lambda x: 0.02 + 0.01 * x[0])
        if body.dim == 3:
            body.fix("top", "y")
        if law == "frictionless":
            return ContactProblem(body, "bottom", bowl)
        return ContactProblem(body, "bottom", bowl, 0.02, law="tresca")

    result, _ = solved(posed(), "cpu")
    assert make.law_error(result) < 1e-8
    monkeypatch.undo()
    agree(result, posed().solve())


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_compliant_surfaces(make, products, friction, monkeypatch):
    def posed():
        body = box_body(make, ElementQuad1, E=2.0, nu=0.3).fix("top", "y", -0.05)
        body.fix("top", "x", lambda x: 0.02 + 0.01 * x[0])
        return ContactProblem(body, "bottom", bowl, friction, overclosure=20.0)

    result, _ = solved(posed(), "cpu")
    monkeypatch.undo()
    expected = posed().solve()
    agree(result, expected)
    hard = held(make, ElementQuad1).solve()
    assert np.abs(hard.mu - expected.mu).max() > 0.01 * hard.mu.max()


def test_bonded_points(make, products, monkeypatch):
    def posed():
        problem = held(make, ElementQuad1)
        tied = np.arange(problem.rows.gap.size) < 3
        gap = np.where(tied, 0.0, problem.rows.gap)
        problem.__dict__["rows"] = replace(problem.rows, bonded=tied, gap=gap)
        return problem

    result, _ = solved(posed(), "cpu")
    monkeypatch.undo()
    expected = posed().solve()
    agree(result, expected)
    assert np.abs(expected.mu[:3]).min() > 0


def test_a_history_with_a_motion(make, products, monkeypatch):
    def last():
        problem = held(make, ElementQuad1)
        return LoadStepper(problem).move("top", "x", 0.01).run([0.5, 1.0])[-1]

    result = last()
    monkeypatch.undo()
    agree(result, last())


def test_the_pseudo_inverse_holds_rigid_motions(make):
    """Against the dense pseudo-inverse of the stiffness."""
    problem = floating(make, ElementQuad1)
    rows = problem.condense()._take(problem.body, problem.rows, None)[0]
    part = SolvedBody(problem.body, rows)
    S, N, B = part.stiffness, part.N, part.B.toarray()
    assert np.abs(S @ N).max() <= 1e-12
    rho = 1.0 / part._soft
    expected = B @ np.linalg.inv(S + rho * N @ N.T) @ B.T
    found = part.compliance()
    assert np.abs(found - expected).max() <= 1e-11 * np.abs(expected).max()
    forces = np.random.default_rng(0).uniform(-1, 1, len(B))
    np.testing.assert_allclose(part.yielded(forces), expected @ forces, atol=1e-10)


def test_a_guess_of_the_scale_is_near(make):
    condensed = held(make, ElementHex1).condense()
    rows = condensed._take(condensed.body, condensed.rows, None)[0]
    part = SolvedBody(condensed.body, rows)
    ratio = guessed_diagonal((part,)) / part.compliance().diagonal()
    assert ratio.min() > 0.2
    assert ratio.max() < 5.0


def test_the_choice_is_told(make, products, caplog):
    caplog.set_level("INFO", logger=condense_module.__name__)
    condensed = held(make, ElementHex1).condense()
    assert f"{condensed.B.shape[0]} contact rows: their compliance is not made dense" in caplog.text


def test_a_device_without_room_applies_the_compliance(make, several, monkeypatch):
    class Small(Elsewhere):
        def room(self):
            return 1000

    monkeypatch.setattr(condense_module, "arrays_on", lambda device: Small())
    result, by_products = solved(held(make, ElementQuad1), "cuda")
    assert by_products
    agree(result, held(make, ElementQuad1).solve())


@pytest.mark.parametrize("error", [1e-9, 1e-12])
def test_solutions_that_lack_digits_cost_steps_alone(make, several, products, error):
    """Newton's residuals come from corrected solutions, its linear systems from quick ones."""
    several.error = error
    result, _ = solved(held(make, ElementQuad1), TWO)
    assert {line.phase for line in result.history} <= {"frictionless", "newton"}
    agree(result, held(make, ElementQuad1).solve())


def test_other_methods_are_refused(make, products):
    problem = held(make, ElementQuad1)
    with pytest.raises(InputError, match=r"method='pdas': the compliance of .* 'newton' alone"):
        problem.solve("pdas")


@pytest.mark.parametrize("device", [("cuda:0", "cuda:0"), ("cuda",), (0, 1), ("cuda:01",), ()])
def test_words_that_name_no_devices(make, device):
    with pytest.raises(InputError, match=r"device=.*: expected 'cpu', .*'cuda:0', 'cuda:1'"):
        held(make, ElementQuad1).condense(device)


def test_devices_that_are_not_there(make, several):
    several.installed = 2
    with pytest.raises(ContactError, match="cudssCreateMg"):
        held(make, ElementQuad1).condense(("cuda:0", "cuda:2"))
    assert several.alive == {}


def test_layers_take_one_device(make):
    block = LayeredBlock(1.0, [(0.5, 4, 1.0, 0.3)], top="xy")
    with pytest.raises(InputError, match="several devices take bodies with a Basis alone"):
        ContactProblem(block, "bottom", 0.0).condense(TWO)
