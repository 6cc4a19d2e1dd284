"""Factors of earlier iterates: when they are taken, and that the solution is the same."""

import numpy as np
import pytest
from scipy import sparse
from skfem import ElementQuad2, MeshQuad

from contact import ContactProblem, Cylinder, NeoHooke, NonlinearBody, NonlinearStepper, Plasticity
from contact.nonlinear import chord
from contact.nonlinear.chord import Chord, Tangent
from contact.nonlinear.free_unknowns import FreeUnknowns, added, stacked

RUBBER, METAL = NeoHooke(1.0, 9.0), Plasticity(100.0, 0.3, 1.0, 10.0)


class Priced:
    """A tangent of a given price."""

    def __init__(self, price):
        self.price = price


@pytest.mark.parametrize(
    ("residuals", "price", "expected"),
    [
        ((1.0, 1e-2), 1.4, False),  # 2e-2 an iteration, so five more; or C = 1e-2, two more
        ((1.0, 1e-2), 3.0, True),
        ((1.0, 0.3), 99.0, False),  # too far away
        ((1e-3, 2e-3), 99.0, False),
    ],
)
def test_the_cheaper_way_to_the_tolerance(residuals, price, expected):
    tangent = Priced(price)
    found = Chord().next(tangent, True, *residuals, 1e-10)
    assert found is (tangent if expected else None)


def test_a_poor_contraction_ends_the_chord():
    rule, tangent = Chord(), Priced(9.0)
    assert rule.next(tangent, True, 1.0, 1e-2, 1e-9) is tangent
    assert rule.next(tangent, False, 1e-2, 1e-4, 1e-9) is tangent
    assert rule.next(tangent, False, 1e-4, 6e-5, 1e-9) is None


def pressed(law, depth):
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 9), np.linspace(0, 1, 5)).with_defaults()
    body = NonlinearBody.from_mesh(mesh, ElementQuad2(), stress=law).fix("top")
    problem = ContactProblem(body, "bottom", Cylinder((0.2, -2.0), 2.0), friction=0.3)
    stepper = NonlinearStepper(problem).move("top", "y", -depth)
    return stepper.run(np.linspace(0.25, 1.0, 4)).results


@pytest.mark.parametrize(("law", "depth"), [(RUBBER, 0.2), (METAL, 0.01)], ids=["rubber", "metal"])
def test_chords_end_at_the_solution_of_newton(law, depth, monkeypatch):
    expected = pressed(law, depth)
    assert all(line.phase == "newton" for result in expected for line in result.history)
    monkeypatch.setattr(chord, "WORK", chord.WORK._replace(least=0.0, overhead=1e-6))
    found = pressed(law, depth)
    ways = [[line.phase for line in result.history] for result in found]
    assert sum(way.count("newton") for way in ways) < sum(len(one.history) for one in expected)
    if law is RUBBER:
        assert [way[0] for way in ways] == ["newton", *3 * ["chord"]]  # that of the step before
    for one, other in zip(found, expected, strict=True):
        assert max(one.kkt.values()) <= 1e-9
        assert np.abs(one.u - other.u).max() <= 1e-7 * np.abs(other.u).max()  # residuals of 1e-9


def test_gathered_matrices_are_products():
    rng = np.random.default_rng(3)

    def matrix(n, density):
        return sparse.csr_array(sparse.random_array((n, n), density=density, rng=rng))

    K = sparse.csr_array(matrix(12, 0.4) + sparse.diags_array(np.arange(12.0)))  # K_00 is zero
    K.sort_indices()
    dofs = np.array([7, 2, 0, 9, 4])
    P = sparse.csr_array((np.ones(5), (dofs, np.arange(5))), shape=(12, 5))
    coupled = sparse.csr_array(np.where(rng.random((12, 5)) < 0.3, 1.0, 0.0))
    for one in (P, coupled):
        free = FreeUnknowns(one)
        for factor in (1.0, 2.0):
            A, unit = free.matrix(factor * K)
            expected = unit[:, None] * (one.T @ (factor * K).toarray() @ one.toarray()) * unit
            np.testing.assert_allclose(A.toarray(), expected, atol=1e-14)
            np.testing.assert_allclose(free.rows(K).toarray(), (K @ one).toarray(), atol=1e-14)
    for other in (matrix(12, 0.1), sparse.csr_array(0.5 * K), sparse.csr_array((12, 12))):
        np.testing.assert_allclose(added(K, other).toarray(), K.toarray() + other.toarray())
    both = stacked([K, matrix(3, 0.5)])
    assert both.shape == (15, 15)
    np.testing.assert_allclose(both.toarray()[:12, :12], K.toarray())


def test_small_tangents_are_not_kept():
    factor = type("Factor", (), {"fill": 10_000})
    assert Tangent(sparse.eye_array(100, format="csr"), np.ones(100), factor).price == 0.0
