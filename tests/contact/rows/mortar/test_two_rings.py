"""Rings: closed interfaces, and Lame's pressure of one that is shrunk onto another."""

import numpy as np
import pytest
from families import PLANE, STRAIGHT
from scipy import sparse
from scipy.sparse.linalg import spsolve
from skfem import ElementQuad1, ElementQuad2, ElementTriP2
from two_blocks import block, ring

from contact import ElasticBody
from contact.rows.mortar.mortar_rows import mortar_rows
from skfem_adini import ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

NU, INTERFERENCE = 0.3, 1e-3


def closed(element, n, inner, outer, turn):
    """A whole ring of n facets, and the facets of its inner and its outer side."""
    mesh = STRAIGHT[element].init_tensor(
        np.linspace(inner, outer, 3), np.linspace(0, 2 * np.pi, n + 1) + turn
    )
    x = mesh.p[0] * np.array([np.cos(mesh.p[1]), np.sin(mesh.p[1])])
    _, first, vertex = np.unique(x.round(9), axis=1, return_index=True, return_inverse=True)
    mesh = type(mesh)(x[:, first], vertex.ravel()[mesh.t], sort_t=False)
    radius = np.linalg.norm(mesh.p[:, mesh.facets], axis=0)
    sides = [np.flatnonzero(np.all(np.abs(radius - r) < 1e-9, axis=0)) for r in (inner, outer)]
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=NU), *sides


@pytest.mark.parametrize("element", PLANE)
@pytest.mark.parametrize(("n", "m"), [(8, 8), (8, 31), (40, 13), (37, 37)])
def test_closed_interfaces(element, n, m):
    """All of either polygon is covered once; gaps are between the sagittas of the polygons."""
    inner, _, outside = closed(element, n, 0.5, 1.0, 0.0)
    outer, inside, _ = closed(element, m, 1.0, 2.0, 0.1)
    for count, pair in (
        (n, (inner, outside, outer, inside)),
        (m, (outer, inside, inner, outside)),
    ):
        found = mortar_rows(*pair)
        length = 2 * count * np.sin(np.pi / count)
        assert abs(found.rows.weights.sum() - length) < 1e-13 * length
        assert found.rows.gap.size == count
        assert np.abs(found.rows.weights - length / count).max() < 1e-13
        # The points run round: neighbours are neighbours.
        step = np.linalg.norm(np.diff(found.rows.x_nominal, axis=1), axis=0)
        assert np.abs(step - length / count).max() < 1e-12
        sagittas = 1.0 / np.cos(np.pi / np.array([n, m])) - 1.0
        assert np.abs(found.quadrature.gap).max() < 1.01 * sagittas.max()


def quarter(element, n, inner, outer, curved):
    """A quarter of a ring, held in its planes of symmetry."""
    ticks = np.linspace(inner, outer, n // 4 + 1), np.linspace(0, np.pi / 2, n + 1)
    place = ring(1.0, (0.0, 0.0), 0.0)
    body = block(element, *ticks, place=place, curved=curved, E=1.0, nu=NU)
    return body.fix("bottom", "y").fix("top", "x")


def pressures(element, n, turned, curved):
    """Pressures over Lame's, and their weights; S. P. Timoshenko and J. N. Goodier, article 28."""
    inner = quarter(element, n, 0.5, 1.0, curved)
    outer = quarter(element, round(1.37 * n), 1.0, 2.0, curved)
    pair = [inner, inner.facets("right"), outer, outer.facets("left")]
    first, facets, second, others = pair[2:] + pair[:2] if turned else pair
    found = mortar_rows(first, facets, second, others, clearance=-INTERFERENCE)
    S = sparse.block_diag([first.stiffness, second.stiffness])
    P = sparse.block_diag([first.constraint[0], second.constraint[0]])
    G = sparse.hstack([found.rows.G, found.other_G]) @ P
    K = sparse.block_array([[P.T @ S @ P, G.T], [G, None]], format="csc")
    solution = spsolve(K, np.concatenate((np.zeros(P.shape[1]), found.rows.gap)))
    E, nu = 1 / (1 - NU**2), NU / (1 - NU)
    gives = (4 + 1) / (4 - 1) + nu + (1 + 0.25) / (1 - 0.25) - nu
    w = found.rows.weights
    return solution[P.shape[1] :] / w / (INTERFERENCE * E / gives), w


CASES = [
    (ElementQuad1, False, 2e-3, 1.8),
    (ElementTriP2, False, 1e-3, 1.2),
    (ElementQuad2, False, 1e-3, 1.2),
    (ElementQuadAdini, False, 1e-3, 1.2),
    (ElementQuad2, True, 1e-5, 3.5),
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("element", "curved", "bound", "order"), CASES)
def test_shrink_fit(element, curved, bound, order, turned):
    """Orders without the polygons' sagittas, which the clearance replaces."""
    counts, errors = [8, 16, 32], []
    for n in counts:
        p, w = pressures(element, n, turned, curved)
        errors.append(np.sqrt(w @ (p - 1) ** 2 / w.sum()))
    assert errors[-1] < bound
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > order
