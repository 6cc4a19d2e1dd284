"""Supports of multi-moment bodies: a bar in tension is exact, nothing is over-constrained."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from skfem import MeshHex, MeshQuad

from contact import ElasticBody
from skfem_adini import ElementHexAdini, ElementQuadAdini

E, NU, LOAD = 3.0, 0.3, 0.2
TICKS = np.array([0.0, 0.3, 0.7, 1.0])


def sides(mesh):
    names = {
        "xyz"[a]: mesh.facets_satisfying(lambda x, a=a: x[a] < 1e-9) for a in range(mesh.dim())
    }
    names["end"] = mesh.facets_satisfying(lambda x: x[0] > 1 - 1e-9)
    return mesh.with_boundaries(names)


@pytest.mark.parametrize(
    ("mesh", "element", "plane"),
    [
        (MeshQuad.init_tensor(TICKS, TICKS), ElementQuadAdini(), "stress"),
        (MeshHex.init_tensor(TICKS, TICKS, TICKS), ElementHexAdini(), None),
    ],
    ids=["ElementQuadAdini", "ElementHexAdini"],
)
def test_tension(mesh, element, plane) -> None:
    mesh = sides(mesh)
    body = ElasticBody.from_mesh(mesh, element, E=E, nu=NU, plane=plane)
    for axis in "xyz"[: mesh.dim()]:
        body.fix(axis, axis)
    body.load("end", np.eye(mesh.dim())[0] * LOAD)
    P, u0 = body.constraint
    u = P @ spsolve((P.T @ body.stiffness @ P).tocsc(), P.T @ body.f) + u0
    strain = LOAD / E * np.array([1.0, -NU, -NU][: mesh.dim()])
    values = u[body.basis.nodal_dofs[: mesh.dim()]]
    # Linear fields lie in the space: only round-off of the solve is left.
    np.testing.assert_allclose(values, strain[:, None] * mesh.p, atol=1e-13)
