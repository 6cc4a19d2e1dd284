"""The second opinion, by default, does not depend on the units, and says what it is worth."""

import numpy as np
import pytest
from families import PLANE_AND_BFS
from skfem import ElementHex1, ElementHex2, ElementTetP2, ElementTriP2

from contact import ContactProblem, ElasticBody, Parabola, Plane, Rigid, cross_check
from contact.laws.qp_peers import solve_with
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

SPATIAL = [ElementHex1, ElementHex2, ElementTetP2, ElementHexAdini]
UNITS = [(1e-6, 1e12), (1e-3, 2e11), (1e3, 1e-3), (1e3, 1e12)]  # length, modulus
KINDS = ["frictionless", "tresca", "coulomb", "floating", "driven", "open"]


def planar(element, kind, length, E, make):
    """A block in units of length and modulus; what is pressed, how, by the name of the kind."""
    ticks = np.linspace(0, length, 7)
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks), element(), E=E, nu=0.3)
    floor = Plane((0, -0.03 * length), (0, 1))
    if kind == "driven":
        stamp = Rigid(
            Plane((0, -0.05 * length), (0, 1)),
            force=(None, 0.2 * E * length),
            moment=0.01 * E * length**2,
            centre=(0.5 * length, 0),
        )
        return ContactProblem(body.fix("top"), "bottom", stamp, 0.4)
    body.load("top", (0.0, -0.5 * E))
    if kind == "floating":
        bowl = Parabola((0.5 * length, -0.03 * length), 4.0 * length)
        return ContactProblem(body.load("left", (0.02 * E, 0.0)), "bottom", bowl, 0.4)
    body.fix("top", "x").fix(["left", "right"], "y")
    if kind == "open":
        body.f *= 1e-3
    friction = {"frictionless": 0.0, "tresca": 0.025 * E}.get(kind, 0.6)
    return ContactProblem(
        body, "bottom", floor, friction, "tresca" if kind == "tresca" else "coulomb"
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("length", "E"), UNITS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_planar(element, kind, length, E, make):
    pytest.importorskip("osqp")
    problem = planar(element, kind, length, E, make)
    check = cross_check(problem, problem.solve())
    assert check.verdict == "agrees"
    # A polished solution is right to rounding times the condition of the boundary problem.
    assert max(check.displacement, check.multipliers, check.residual) < 1e-9
    assert check.ours < 1e-10
    assert "agrees" in str(check)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("length", "E"), UNITS[::3])
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("element", SPATIAL)
def test_spatial(element, friction, length, E, make):
    pytest.importorskip("clarabel")
    ticks = np.linspace(-length, length, 5 if element is ElementHex1 else 3)
    mesh = make.box(element, ticks, ticks, length * np.array([0.0, 0.4, 1.0]))
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=0.3)
    body.fix("top", "x", lambda x: 0.01 * length - 0.03 * x[1]).fix(
        "top", "y", lambda x: 0.03 * x[0]
    )
    body.fix("top", "z", -0.05 * length)
    problem = ContactProblem(
        body, "bottom", lambda x: 0.04 / length * (x[0] ** 2 + x[1] ** 2), friction
    )
    check = cross_check(problem, problem.solve(), "clarabel")
    assert check.verdict == "agrees"
    # An interior point method of tolerance 1e-13 on the energy: about half the digits in u.
    assert max(check.displacement, check.multipliers) < 1e-6


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuadBFS, ElementTriP2])
def test_certificate_is_the_same_in_all_units(element, make):
    """Derivatives among the dofs grow as the length falls; they are no displacements."""
    spoiled = []
    for length in (1e-6, 1.0, 1e3):
        problem = planar(element, "coulomb", length, 1.0, make)
        result = problem.solve()
        dofs = result.system.body.basis.nodal_dofs[:2]
        u = result.u.copy()
        u[dofs] += 1e-3 * length * np.sin(np.arange(dofs.size)).reshape(dofs.shape)
        kkt = result.system.kkt(u, result.mu, result.t)
        spoiled.append([kkt[name] for name in ("penetration", "complementarity", "slip")])
    assert min(spoiled[1]) > 1e-4
    np.testing.assert_allclose(spoiled[0], spoiled[1], rtol=1e-6)
    np.testing.assert_allclose(spoiled[2], spoiled[1], rtol=1e-6)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("peer", ["osqp", "proxqp", "piqp", "clarabel"])
@pytest.mark.parametrize("kind", ["open", "coulomb", "frictionless", "tresca"])
@pytest.mark.parametrize(("length", "E"), [(1.0, 2.0), (1e-3, 2e11)])
def test_qp_methods_in_all_units_and_where_nothing_touches(kind, peer, length, E, make):
    pytest.importorskip({"proxqp": "proxsuite"}.get(peer, peer))
    problem = planar(ElementQuadAdini, kind, length, E, make)
    theirs, ours = problem.solve(f"qp:{peer}"), problem.solve()
    size = ours.system.body.reach(ours.u)
    # The method's tolerance of 1e-7, loosely.
    assert ours.system.body.reach(theirs.u - ours.u) < 1e-5 * size
    assert (kind == "open") == (theirs.contact_force == 0.0)


def test_verdicts(make, monkeypatch):
    """A peer that gives up, one that stops early, and one that is right where we are not."""
    import importlib
    from dataclasses import replace

    problem, result = make.solved()
    module = importlib.import_module("contact.checks.frozen_problem")
    assert cross_check(problem, replace(result, u=1.01 * result.u)).verdict == "disagrees"

    def gives_up(*program):
        solution, seconds = solve_with(*program)
        solution.x = None
        return solution, seconds

    def stops_early(*program):
        solution, seconds = solve_with(*program)
        solution.x = 1.001 * solution.x
        return solution, seconds

    for peer in (gives_up, stops_early):
        monkeypatch.setattr(module, "solve_with", peer)
        check = cross_check(problem, result)
        assert check.verdict == "the peer did not converge"
        assert not check.residual <= 1e-6
        assert check.ours < 1e-10
        assert "did not converge" in str(check)
