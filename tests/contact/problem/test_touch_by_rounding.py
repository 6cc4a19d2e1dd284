"""A body that moves until it touches, and no further: what presses then is rounding alone."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTriP2

from contact import ContactProblem, ElasticBody, LayeredBlock
from skfem_adini import ElementHexAdini, ElementQuadAdini

ELEMENTS = [
    ElementQuad1,
    ElementQuad2,
    ElementTriP2,
    ElementQuadAdini,
    ElementHex1,
    ElementHexAdini,
]


def rotation(rng, dim):
    Q = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
    return Q * np.sign(np.linalg.det(Q))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("friction", [0.0, 0.6])
@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.__name__)
def test_gap_closed_exactly(element, friction, make):
    """Translated onto the obstacle by the gap itself, and turned onto it, in any units."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        dim = 3 if element in (ElementHex1, ElementHexAdini) else 2
        size, E, Q = 10.0 ** rng.uniform(-6, 3), 10.0 ** rng.uniform(-3, 12), rotation(rng, dim)
        box = make.box(element, *[np.linspace(0, 1, 4)] * dim)
        body = ElasticBody.from_mesh(make.remesh(box, size * Q @ box.p), element(), E=E, nu=0.3)
        shift = size * rng.uniform(0.01, 0.05) * Q[:, -1]
        W = np.zeros((dim, dim))
        W[0, 1], W[1, 0] = (-0.01, 0.01) if seed % 2 else (0.0, 0.0)

        def move(x, W=W, shift=shift):
            return np.tensordot(W, x, axes=1) - shift.reshape(-1, *[1] * (x.ndim - 1))

        for c in range(dim):
            body.fix("top", c, lambda x, c=c, move=move: move(x)[c])
        normal = -Q[:, -1]
        result = ContactProblem(
            body, "bottom", lambda x, move=move, n=normal: np.tensordot(n, move(x), 1), friction
        ).solve()
        assert np.abs(result.pressure).max() < 1e-11 * E
        assert np.abs(result.u).max() > 1e-3 * size
        assert max(result.kkt.values()) < 1e-10


@pytest.mark.parametrize("turn", [0.0, 0.01])
@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_gap_of_layers_closed_exactly(friction, turn):
    """A block of layers, translated onto a plane, and turned onto it."""
    for push in (0.01, 0.03, 0.0123456789):
        block = LayeredBlock((1.0, 0.5), [(0.5, 4, 2e5, 0.3)])
        block.fix("top", "x", lambda x, push=push: push - turn * x[1])
        block.fix("top", "y", lambda x, push=push: turn * x[0] - push)
        result = ContactProblem(
            block, "bottom", lambda x, push=push: push - turn * x[0], friction
        ).solve()
        assert np.abs(result.pressure).max() < 1e-11 * 2e5
        assert max(result.kkt.values()) < 1e-10


@pytest.mark.parametrize("beyond", [1e-12, 1e-9, 1e-6])
def test_what_presses_is_balanced(beyond, make):
    """A push that is small beside the way there has the digits that are left of it."""
    box = make.box(ElementQuad1, *[np.linspace(0, 1, 4)] * 2)
    body = ElasticBody.from_mesh(box, ElementQuad1(), E=1.0, nu=0.0)
    body.fix("top", "x").fix("top", "y", -0.03 * (1 + beyond))
    result = ContactProblem(body, "bottom", 0.03).solve()
    left = 1e-14 / beyond
    assert result.contact_force == pytest.approx(0.03 * beyond, rel=left)
    assert np.abs(result.balance()["residual"]).max() < left
    wrong = result.system.kkt(result.u, (1 + 1e4 * left + 1e-3) * result.mu, result.t)
    assert max(wrong.values()) > 1e-10
