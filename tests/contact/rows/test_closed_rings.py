"""A whole ring between a rigid shaft and a rigid housing: contact all around, held by it alone.

Two boundaries, one of them concave, with a pressure of their own each, and the same in VTK.
"""

import numpy as np
import pytest
import pyvista
from convergence import order
from families import PLANE, STRAIGHT

from contact import ContactProblem, ElasticBody

pytestmark = pytest.mark.filterwarnings("ignore::skfem_adini.ReducedOrderWarning")

A, B, NU = 1.0, 2.0, 0.3
OUT, IN = 0.02, 0.05  # of the bore, and of the rim


def lame():
    """Pressures on bore and rim of u = c r + d / r in plane strain."""
    c, d = np.linalg.solve([[A, 1 / A], [B, 1 / B]], [OUT, -IN])
    lam, mu = NU / ((1 + NU) * (1 - 2 * NU)), 0.5 / (1 + NU)
    return np.array([2 * mu * d / r**2 - 2 * (lam + mu) * c for r in (A, B)])


def ring(element, n):
    """4 n facets around; the first and the last column of a strip are one."""
    kind = STRAIGHT[element]
    layers, around = n // 2, 4 * n
    strip = kind.init_tensor(np.arange(layers + 1.0), np.arange(around + 1.0))
    i, j = strip.p.round().astype(int)
    number = i * around + j % around
    p = np.zeros((2, (layers + 1) * around))
    angle = 0.1 + 2 * np.pi * j / around
    p[:, number] = (A + (B - A) * i / layers) * np.array([np.cos(angle), np.sin(angle)])
    mesh = kind(p, number[strip.t], sort_t=False)
    facets = mesh.boundary_facets()
    inner = np.linalg.norm(p[:, mesh.facets[0, facets]], axis=0) < 0.5 * (A + B)
    mesh = mesh.with_boundaries({"bore": facets[inner], "rim": facets[~inner]})
    return ElasticBody.from_mesh(mesh, element(), E=1.0, nu=NU)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("element", PLANE)
def test_shaft_and_housing(element, tmp_path):
    facets, found = [6, 12, 24], []
    for n in facets:
        result = ContactProblem(ring(element, n), ["bore", "rim"], [-OUT, -IN], 0.3).solve()
        off = result.pressure / lame()[result.part] - 1
        found.append(np.sqrt(np.mean(off**2)))
        # Diagonals that all lean one way turn bore against rim by less than the pressure's error.
        askew = found[-1] * lame().max() if "Tri" in element.__name__ else 1e-8
        assert np.abs(result.shear).max() < askew
    assert found[-1] < 0.01
    assert order(facets, found) > 1.8
    path = tmp_path / "contact.vtp"
    result.boundary_to_pyvista().save(path)
    kept = pyvista.read(path)
    assert kept.n_lines == 2
    np.testing.assert_array_equal(kept["pressure"], result.pressure)
    np.testing.assert_allclose(np.asarray(kept.points)[:, :2].T, result.x, atol=1e-6)
