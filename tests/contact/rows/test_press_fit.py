"""A ring shrunk onto a rigid shaft, a quarter of it with friction: Lame's pressure, no shear.

Plane stress, inner and outer radius a and b, interference d (S. P. Timoshenko and J. N. Goodier,
Theory of Elasticity, 3rd ed., McGraw-Hill 1970, article 28): the radial displacement of the bore is
p a / E [(b^2 + a^2) / (b^2 - a^2) + nu] = d.
"""

import numpy as np
import pytest
from convergence import order
from skfem import ElementQuad2, ElementTriP2, MeshQuad, MeshQuad2, MeshTri, MeshTri2

from contact import ClosestPoint, ContactProblem, Cylinder, ElasticBody

A, B, D, NU = 1.0, 2.0, 0.01, 0.3
EXACT = D / A / ((B**2 + A**2) / (B**2 - A**2) + NU)


def ring(straight, curved, element, n):
    """A quarter of the ring with sides of second order, held in its planes of symmetry."""
    mesh = curved.from_mesh(
        straight.init_tensor(np.linspace(A, B, n + 1), np.linspace(0, np.pi / 2, 2 * n + 1))
    )
    named = {
        "bore": mesh.facets_satisfying(lambda x: x[0] < A + 1e-9),
        "along x": mesh.facets_satisfying(lambda x: x[1] < 1e-9),
        "along y": mesh.facets_satisfying(lambda x: x[1] > np.pi / 2 - 1e-9),
    }
    r, angle = mesh.doflocs
    mesh = curved(np.array([r * np.cos(angle), r * np.sin(angle)]), mesh.t)
    body = ElasticBody.from_mesh(
        mesh.with_boundaries(named), element(), E=1.0, nu=NU, plane="stress"
    )
    return body.fix("along x", "y").fix("along y", "x")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("gap", [Cylinder, lambda *shape: ClosestPoint(Cylinder(*shape))])
@pytest.mark.parametrize(
    "family", [(MeshQuad, MeshQuad2, ElementQuad2), (MeshTri, MeshTri2, ElementTriP2)]
)
def test_pressure_of_lame_without_shear(family, gap):
    """Of second order and better; no slip, not even where symmetry holds the bore."""
    worst = []
    for n in (4, 8, 16):
        body = ring(*family, n)
        result = ContactProblem(body, "bore", gap((0.0, 0.0), A + D), friction=0.3).solve()
        worst.append(np.abs(result.pressure / EXACT - 1).max())
        # Triangles lie askew to the symmetry of the ring.
        askew = 0.1 / n**1.5 if family[0] is MeshTri else 1e-10
        assert np.abs(result.shear).max() < askew * EXACT
    assert worst[-1] < 0.002
    assert order([4, 8, 16], worst) > 1.6
