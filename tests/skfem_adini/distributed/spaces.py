"""Meshes, elements and forms on which distributed matrices are compared with serial ones."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import skfem
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS


def spaces() -> Iterator[tuple[str, Any, Any, Any]]:
    """Name, mesh, element and form."""
    rng = np.random.default_rng(0)
    quad = skfem.MeshQuad.init_tensor(np.linspace(0, 1, 9) ** 1.2, np.linspace(0, 1, 7))
    tri = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 1, 7))
    tri = skfem.MeshTri(tri.p + 0.02 * rng.standard_normal(tri.p.shape), tri.t)
    bricks = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, k) for k in (4, 5, 6)])
    tet = skfem.MeshTet().refined(2)
    elastic, vector = linear_elasticity(1.0, 1.0), skfem.ElementVector
    mixed = skfem.BilinearForm(lambda u, v, w: dot(u, v) + u.div * v.div)
    mass = skfem.BilinearForm(lambda u, v, w: dot(u, v))
    yield "Adini", quad, ElementQuadAdini(), laplace
    yield "elastic Adini", quad, vector(ElementQuadAdini()), elastic
    yield "BFS", quad, ElementQuadBFS(), laplace
    yield "Q1", quad, skfem.ElementQuad1(), laplace
    yield "Q2", quad, skfem.ElementQuad2(), laplace
    yield "P1", tri, skfem.ElementTriP1(), laplace
    yield "elastic P2", tri, vector(skfem.ElementTriP2()), elastic
    yield "P3", tri, skfem.ElementTriP3(), laplace
    yield "Hermite", tri, skfem.ElementTriHermite(), laplace
    yield "RT1", tri, skfem.ElementTriRT1(), mixed
    yield "elastic Hex1", bricks, vector(skfem.ElementHex1()), elastic
    yield "Hex2", bricks, skfem.ElementHex2(), laplace
    yield "Adini brick", bricks, ElementHexAdini(), laplace
    yield "Tet1", tet, skfem.ElementTetP1(), laplace
    yield "Tet2", tet, skfem.ElementTetP2(), laplace
    yield "N1", tet, skfem.ElementTetN1(), mass
