"""Contact pressures of linear triangles and tetrahedra are their own consistent reactions.

A ring or a part of one is given the same normal displacement without contact, in plain scikit-fem,
by one multiplier a vertex: its forces over the vertices' shares of the facets are the pressures.
What these are off by is the element's, and hangs on how the cells lie about a vertex.
"""

import numpy as np
import pytest
from convergence import order
from scipy import sparse
from scipy.sparse.linalg import spsolve
from skfem import ElementTetP1, ElementTriP1, MeshQuad, MeshTet, MeshTri

from contact import ContactProblem, ElasticBody

A, B, D, NU, DEPTH = 1.0, 2.0, 0.05, 0.3, 0.3
EXACT = D / (1 - NU**2) / (A * ((B**2 + A**2) / (B**2 - A**2) + NU / (1 - NU)))


def ring(n, cells):
    """A quarter of a ring, n facets on its bore."""
    ticks = np.linspace(A, B, max(2, n // 2) + 1), np.linspace(0, np.pi / 2, n + 1)
    if cells == "crossed":
        mesh = MeshQuad.init_tensor(*ticks).to_meshtri(style="x")
    elif cells == "one diagonal":
        mesh = MeshTri.init_tensor(*ticks)
    else:
        mesh = MeshTet.init_tensor(*ticks, np.array([0.0, DEPTH]))
    names = {
        "bore": mesh.facets_satisfying(lambda x: x[0] < A + 1e-9),
        "low": mesh.facets_satisfying(lambda x: x[1] < 1e-9),
        "side": mesh.facets_satisfying(lambda x: x[1] > np.pi / 2 - 1e-9),
    }
    solid = mesh.dim() == 3
    if solid:
        names["ends"] = mesh.facets_satisfying(lambda x: np.abs(x[2] - DEPTH / 2) > 0.499 * DEPTH)
    x = mesh.p.copy()
    x[:2] = x[0] * np.array([np.cos(x[1]), np.sin(x[1])])
    mesh = type(mesh)(x, mesh.t, sort_t=False).with_boundaries(names)
    element = ElementTetP1() if solid else ElementTriP1()
    body = ElasticBody.from_mesh(mesh, element, E=1.0, nu=NU).fix("low", "y").fix("side", "x")
    return body.fix("ends", "z") if solid else body


def reactions(body, rows):
    """Pressures that move the rows by -D without contact."""
    P = body.constraint[0]
    K, B = P.T @ body.stiffness @ P, sparse.diags_array(rows.weights) @ rows.G @ P
    saddle = sparse.block_array([[K, B.T], [B, None]], format="csc")
    return spsolve(saddle, np.r_[np.zeros(K.shape[0]), -D * rows.weights])[K.shape[0] :]


def rms(result):
    w = result.system.rows.weights
    return float(np.sqrt(np.sum(w * (result.pressure / EXACT - 1) ** 2) / w.sum()))


@pytest.mark.parametrize("cells", ["one diagonal", "crossed", "tetrahedra"])
def test_pressure_is_the_reaction(cells):
    body = ring(8, cells)
    result = ContactProblem(body, "bore", -D).solve()
    # Rounding of two factorisations.
    assert np.abs(result.pressure - reactions(body, result.system.rows)).max() < 1e-9 * EXACT


def test_rows_are_radial_displacements():
    """What plain geometry says: of the facets' normals, half of either facet."""
    body = ring(12, "one diagonal")
    rows = ContactProblem(body, "bore", -D).rows
    turn = np.pi / 24
    outwards = (body.mesh.p / np.linalg.norm(body.mesh.p, axis=0)).ravel(order="F")
    np.testing.assert_allclose(rows.G @ outwards, -np.cos(turn / 2), rtol=1e-12)
    np.testing.assert_allclose(rows.weights[1:-1], 2 * np.sin(turn / 2), rtol=1e-12)


def test_cells_that_meet_a_hundredth():
    """One diagonal leaves the ends of first order; triangles that cross are of second all over."""
    facets = [6, 12, 24]
    found = {
        cells: [rms(ContactProblem(ring(n, cells), "bore", -D, 0.3).solve()) for n in facets]
        for cells in ("one diagonal", "crossed")
    }
    rate = {c: order(facets, e) for c, e in found.items()}
    assert found["crossed"][-1] < 0.003
    assert 1.9 < rate["crossed"] < 2.2
    assert 0.02 < found["one diagonal"][-1] < 0.03
    assert 1.2 < rate["one diagonal"] < 1.7
