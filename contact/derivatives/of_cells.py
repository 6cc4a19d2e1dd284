r"""Derivatives of the work :math:`\lambda^T S u` of a body by its moduli and its vertices.

For a velocity V of the mesh, :math:`\delta \nabla u = -\nabla u \nabla V` and :math:`\delta dx =
\operatorname{div} V dx`, so that, with :math:`w = \sigma(u) : \nabla \lambda`,

.. math::
    \delta (\lambda^T S u) = \int \left(w I - \nabla\lambda^T \sigma(u) - \nabla u^T \sigma(\lambda)
    \right) : \nabla V .

Dofs that are gradients g change the function as well: in a node :math:`\delta g = \nabla V^T g`.

References
----------
J. D. Eshelby, J. Elasticity 5 (1975), 321-335: the energy-momentum tensor. M. C. Delfour and J.-P.
Zolesio, Shapes and Geometries, 2nd ed., SIAM 2011, chapter 9.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray

from contact.body.elastic_body import ElasticBody
from contact.body.vector_element import GRADIENT_DOFS
from contact.errors import InputError
from skfem_adini import ElementQuadBFS

Array = NDArray[np.float64]
_SECOND = (ElementQuadBFS, skfem.ElementQuadBFS)  # with dofs u_xy


def refuse_body(body: Any, what: str) -> None:
    """Raise an InputError unless a body has derivatives by `what`, moduli or vertices."""
    why = ""
    if type(body) is not ElasticBody:
        why = f"a {type(body).__name__} has none: its cells are cut, layered or spread"
    elif body.thermal is not None:
        why = "the body was heated, and its loads depend on them too"
    elif what == "vertices" and body._couplings:
        why = "equations between dofs (tie, periodic, constrain) depend on places"
    elif what != "vertices" and body.E is None:
        why = "an anisotropic material has no E and nu"
    elif what == "vertices" and isinstance(body.element, _SECOND):
        why = f"{type(body.element).__name__} has dofs of second derivatives"
    if why:
        raise InputError(f"vjp: no derivatives by {what}: {why}")


def by_moduli(body: ElasticBody, u: Array, adjoint: Array) -> tuple[Array, Array]:
    """Derivatives of -lambda^T S u by E and nu, in the shapes of these, () or (ncells,)."""
    refuse_body(body, "moduli")
    one, other, dx = body.gradients(u), body.gradients(adjoint), body.measure
    mean = [body.mean_dilatation(v) for v in (u, adjoint)]
    traces = [
        np.trace(g) if m is None else m[:, None] for g, m in zip((one, other), mean, strict=True)
    ]
    volume = np.sum(traces[0] * traces[1] * dx, axis=1)
    strain = 0.5 * (one + np.swapaxes(one, 0, 1))
    shear = 2.0 * np.sum(np.sum(strain * other, axis=(0, 1)) * dx, axis=1)
    E, nu, lam, mu = body.E, body.nu, body.lam, body.mu
    by_lam = E * (1 + 2 * nu**2) / ((1 + nu) * (1 - 2 * nu)) ** 2
    if body.plane == "stress":
        by_lam = E * (1 + nu**2) / (1 - nu**2) ** 2
    by_E = -(lam * volume + mu * shear) / E
    by_nu = -(by_lam * volume - mu / (1 + nu) * shear)
    return tuple(  # type: ignore[return-value]
        np.asarray(v.sum() if given.ndim == 0 else v) for v, given in ((by_E, E), (by_nu, nu))
    )


def by_vertices(body: ElasticBody, u: Array, adjoint: Array) -> Array:
    """Derivatives of -lambda^T S u by the places of the mesh's nodes, shape of its doflocs."""
    basis, mesh = body.basis, body.mesh
    one, other = body.gradients(u), body.gradients(adjoint)
    means = [body.mean_dilatation(v) for v in (u, adjoint)]
    volumes: list[Any] = [None if m is None else m[:, None] for m in means]
    s_one, s_other = (body.law.stress(g, v) for g, v in zip((one, other), volumes, strict=True))
    w = np.sum(s_one * other, axis=(0, 1))
    if volumes[0] is not None:
        lam = np.broadcast_to(body.lam, w.shape[:1])[:, None]
        w = w + lam * volumes[1] * (np.trace(one) - volumes[0])
    A = -np.einsum("ikcq,ijcq->kjcq", other, s_one) - np.einsum("ikcq,ijcq->kjcq", one, s_other)
    dim, dx = body.dim, body.measure
    A[range(dim), range(dim)] += w
    nodes, hats = mesh.dofs.element_dofs, mesh.elem()
    found = np.zeros(mesh.doflocs.shape)
    if body.is_ring:
        hoop = w - s_one[2, 2] * other[2, 2] - s_other[2, 2] * one[2, 2]
        hoop = hoop / np.asarray(basis.global_coordinates())[0] * dx
    for a in range(len(nodes)):
        hat = hats.gbasis(basis.mapping, basis.X, a)[0]
        along = np.einsum("kjcq,jcq,cq->kc", A[:dim, :dim], np.asarray(hat.grad), dx)
        if body.is_ring:
            along[0] += np.sum(hoop * np.broadcast_to(np.asarray(hat), hoop.shape), axis=1)
        for c in range(dim):
            np.add.at(found[c], nodes[a], along[c])
    if isinstance(body.element, GRADIENT_DOFS):
        for v, sigma in ((u, s_other), (adjoint, s_one)):
            found += _of_gradients(body, v, sigma * dx)
    return -found


def _of_gradients(body: ElasticBody, v: Array, weighted: Array) -> Array:
    """Work of weighted stresses on what dofs that are gradients add, shape of the doflocs."""
    basis, mesh, dim = body.basis, body.mesh, body.dim
    corners, nodes = mesh.refdom.p, mesh.dofs.element_dofs
    found, count = np.zeros(mesh.doflocs.shape), 1 + dim  # dofs of a component in a node
    dofs = basis.element_dofs
    slopes = [
        np.asarray(mesh.elem().gbasis(basis.mapping, corners, a)[0].grad) for a in range(len(nodes))
    ]
    for n in range(corners.shape[1]):
        for c in range(dim):
            # Functions in the order node, dof of the node, component.
            own = [dim * (count * n + 1 + j) + c for j in range(dim)]
            g = v[dofs[own]]
            tested = (np.asarray(basis.basis[k][0].grad[c]) for k in own)
            force = np.array([np.einsum("icq,icq->c", weighted[c, :dim], t) for t in tested])
            for a, slope in enumerate(slopes):
                along = np.sum(force * slope[:, :, n], axis=0)
                for i in range(dim):
                    np.add.at(found[i], nodes[a], along * g[i])
    return found
