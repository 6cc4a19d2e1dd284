"""Bodies that slide by more than a facet, on the factorisation of the state of rest."""

import itertools

import numpy as np
import pytest
from skfem import ElementQuad1, ElementQuad2, MeshQuad

from contact import ContactProblem, ElasticBody, InputError, LayeredBlock, LoadStepper, Plane
from contact.condensation import sparse
from skfem_adini import ElementQuadAdini

FRICTION = 0.3
pytestmark = pytest.mark.filterwarnings("ignore:the cells are not parallelograms")


def indenter(element, n=9, bend=1.5, **more):
    """A block with a curved lower side, of length one, above the origin."""
    mesh = MeshQuad.init_tensor(np.linspace(-0.5, 0.5, n + 1), np.linspace(0, 0.5, 5))
    names = dict(mesh.with_defaults().boundaries)
    rise = bend - np.sqrt(bend**2 - mesh.p[0] ** 2)
    p = np.array([mesh.p[0], mesh.p[1] + rise * (1 - 2 * mesh.p[1])])
    body = ElasticBody.from_mesh(
        MeshQuad(p, mesh.t, sort_t=False).with_boundaries(names), element(), E=10.0, nu=0.3
    )
    return body.fix("top", "xy")


def slab(element, n=48):
    mesh = MeshQuad.init_tensor(np.linspace(-1.2, 2.0, n + 1), np.linspace(-1, 0, 7))
    return ElasticBody.from_mesh(mesh.with_defaults(), element(), E=1.0, nu=0.3).fix("bottom", "xy")


def ironing(element, times, friction=FRICTION, **more):
    upper, lower = indenter(element), slab(element)
    problem = ContactProblem(upper, "bottom", lower.surface("top"), friction=friction)
    stepper = LoadStepper(problem, sliding="finite", **more)
    stepper.move("top", "y", -0.03, lambda t: min(t, 1.0), body=upper)
    stepper.move("top", "x", 0.1, lambda t: max(t - 1.0, 0.0), body=upper)
    return stepper.run(times), upper, lower


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
def test_ironing(element, monkeypatch):
    made = []
    whole = sparse.schur_factor
    monkeypatch.setattr(
        sparse, "schur_factor", lambda *args, **more: made.append(1) or whole(*args, **more)
    )
    history, upper, lower = ironing(element, [0.5, 1.0, 1.7, 2.4, 3.1, 5.0, 7.0])
    assert len(made) == 2  # one for each body, once
    for result in history.results:
        assert max(result.kkt.values()) <= 1e-10
        one, two = result[upper].resultant, result[lower].resultant
        assert np.abs(one + two).max() <= 1e-11 * np.abs(one).max()
    for result in history.results[2:]:  # full slip: the whole friction force is F times the normal
        assert abs(result.t.sum() - FRICTION * result.mu.sum()) <= 1e-10 * result.mu.sum()
    forces = np.array([result.resultant for result in history.results[3:]])
    assert np.ptp(forces[:, 1]) <= 5e-3 * forces[0, 1]  # a long slab looks the same everywhere
    assert history.results[-1].x[0, history.results[-1].mu > 0].min() > -0.5


@pytest.mark.sampled(4)
@pytest.mark.parametrize("element", [ElementQuad1, ElementQuad2, ElementQuadAdini])
def test_newton_with_the_derivative_of_the_projection_is_quadratic(element):
    """In full slip four projections are enough: errors are squared, up to a part of 1e-3."""
    history, *_ = ironing(element, [0.5, 1.0, 1.7, 2.4, 3.1, 3.8])
    for k, result in enumerate(history.results):
        changes = [line.residual for line in result.history if line.phase == "projection"]
        assert len(changes) <= (5 if k < 4 else 4)
        pairs = itertools.pairwise(changes[1:])
        assert all(after <= 20 * before**2 + 2e-3 * before for before, after in pairs)


def test_the_gap_of_a_result_is_that_of_the_displaced_bodies():
    history, upper, lower = ironing(ElementQuad2, [1.0, 3.3])
    result = history.results[-1]
    touching = result.mu > 1e-3 * result.mu.max()
    assert np.abs(result.gap[touching]).max() <= 1e-10
    # Independent of the rows: vertices of the slab under the indenter, by the bodies' own fields.
    mesh, u = lower.mesh, result[lower].u
    top = np.unique(mesh.facets[:, mesh.boundaries["top"]])
    y = mesh.p[:, top] + u.reshape(-1, 2)[: mesh.nvertices].T[:, top]
    side = np.linspace(-0.5, 0.5, 4001)
    facet_ends = np.linspace(-0.5, 0.5, 10)
    height = np.interp(side, facet_ends, 1.5 - np.sqrt(1.5**2 - facet_ends**2))
    X = np.array([side, height])
    x = X + result[upper].sample(X)
    surface = np.interp(y[0], x[0], x[1], left=np.inf, right=np.inf)
    inside = np.isfinite(surface)
    depth = surface[inside] - y[1, inside]
    # Conditions hold in the mean over facets: vertices may be off by the facets' own sagitta.
    assert depth.min() > -2e-3
    assert np.sort(np.abs(depth))[:4].max() < 1e-3


def test_without_sliding_it_is_small_sliding():
    """A flat pair that is pressed only: both theories agree, and so do steps and loads."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 6), np.linspace(0, 1, 5)).with_defaults()
    upper = ElasticBody.from_mesh(mesh, ElementQuad2(), E=2.0, nu=0.3).fix("left", "x")
    below = MeshQuad.init_tensor(np.linspace(0, 1, 8), np.linspace(-1, 0, 5)).with_defaults()
    lower = ElasticBody.from_mesh(below, ElementQuad2(), E=2.0, nu=0.3).fix("left", "x")
    lower.fix("bottom", "y")
    found = []
    for sliding in ("small", "finite"):
        problem = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.2)
        stepper = LoadStepper(problem, sliding=sliding)
        stepper.load("top", (0.0, -0.01), body=upper)
        found.append(stepper.run([0.5, 1.0]).results[-1])
    small, finite = found
    np.testing.assert_allclose(finite.resultant, small.resultant, atol=1e-13)
    # They differ by the square of the strain, .005.
    np.testing.assert_allclose(finite.pressure, small.pressure, rtol=5e-3)
    np.testing.assert_allclose(finite.u, small.u, atol=5e-3 * np.abs(small.u).max())


def test_what_has_no_finite_sliding_is_refused():
    upper, lower = indenter(ElementQuad1), slab(ElementQuad1)
    rigid = ContactProblem(upper, "bottom", Plane((0, -0.01), (0, 1)))
    given = ContactProblem(upper, "bottom", lower.surface("top", clearance=0.0))
    for problem, message in ((rigid, "rigid obstacle"), (given, "clearance")):
        with pytest.raises(InputError, match=message):
            LoadStepper(problem, sliding="finite")
    layers = LayeredBlock(1.0, [(0.5, 4, 1.0, 0.3)], top="xy").named("layers")
    of_layers = ContactProblem(layers, "bottom", lower.surface("top"))
    with pytest.raises(InputError, match="sliding: 'layers' is a LayeredBlock"):
        LoadStepper(of_layers, sliding="finite")
    with pytest.raises(InputError, match="sliding='large'"):
        LoadStepper(given, sliding="large")
