"""The disk's eigenvalue problem by NGSolve: triangles that fit it, and cells that it cuts.

``pip install ngsolve xfem``; Schoeberl, TU Wien report 30/2014; Lehrenfeld, Heimann, Preuss and
von Wahl, J. Open Source Softw. 6 (2021). Both packages write only the matrices here; the
eigenvalues are found by the same solver as all others.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import sparse

INSTALLED = all(importlib.util.find_spec(name) for name in ("ngsolve", "xfem", "netgen"))


def fitted(order: int, radius: float) -> Callable[[int, Any], tuple[Any, Any]]:
    """Return the problem on curved triangles of this order, sides about radius / 2^level."""

    def matrices(level: int, clock: Any) -> tuple[Any, Any]:
        import ngsolve as ngs
        from netgen.geom2d import SplineGeometry

        geometry = SplineGeometry()
        geometry.AddCircle((0.5, 0.5), radius, bc="circle")
        mesh = ngs.Mesh(geometry.GenerateMesh(maxh=radius / 2**level))
        mesh.Curve(order)
        clock("mesh")
        space = ngs.H1(mesh, order=order, dirichlet="circle")
        u, v = space.TnT()
        K = ngs.BilinearForm(ngs.grad(u) * ngs.grad(v) * ngs.dx).Assemble()
        M = ngs.BilinearForm(u * v * ngs.dx).Assemble()
        clock("assembly")
        found = _of_dofs(space.FreeDofs(), K, M)
        clock("reduction")
        return found

    return matrices


def unfitted(order: int, radius: float) -> Callable[[int, Any], tuple[Any, Any]]:
    """Return the problem on n x n squares that the circle cuts, with a ghost penalty.

    The mesh is deformed so that the level set's linear interpolant becomes one of this order
    (Lehrenfeld, Comput. Methods Appl. Mech. Engrg. 300 (2016)); Nitsche's method on the circle.
    """

    def matrices(n: int, clock: Any) -> tuple[Any, Any]:
        import ngsolve as ngs
        import xfem
        from ngsolve.meshes import MakeStructured2DMesh
        from xfem.lsetcurv import LevelSetMeshAdaptation

        mesh = MakeStructured2DMesh(quads=True, nx=n, ny=n)
        clock("mesh")
        level_set = ngs.sqrt((ngs.x - 0.5) ** 2 + (ngs.y - 0.5) ** 2) - radius
        adaptation = LevelSetMeshAdaptation(mesh, order=order, levelset=level_set)
        linear, deformation = adaptation.lset_p1, adaptation.deform
        cuts = xfem.CutInfo(mesh, linear)
        inside = cuts.GetElementsOfType(xfem.HASNEG)
        cut = cuts.GetElementsOfType(xfem.IF)
        facets = xfem.GetFacetsWithNeighborTypes(mesh, a=inside, b=cut)
        clock("quadrature")
        space = ngs.H1(mesh, order=order, dgjumps=True)
        u, v = space.TnT()
        normal = ngs.grad(linear) / ngs.Norm(ngs.grad(linear))
        h = 1 / n
        area = xfem.dCut(linear, xfem.NEG, definedonelements=inside, deformation=deformation)
        circle = xfem.dCut(linear, xfem.IF, definedonelements=cut, deformation=deformation)
        patch = xfem.dFacetPatch(definedonelements=facets, deformation=deformation)
        jumps = 0.1 * (u - u.Other()) * (v - v.Other())

        def form(terms: list[Any]) -> Any:
            found = xfem.RestrictedBilinearForm(space, facet_restriction=facets, check_unused=False)
            for term in terms:
                found += term
            return found.Assemble()

        flux = (ngs.grad(u) * normal) * v + (ngs.grad(v) * normal) * u
        penalty = 10 * order**2 / h * u * v
        K = form(
            [ngs.grad(u) * ngs.grad(v) * area, (penalty - flux) * circle, jumps / h**2 * patch]
        )
        M = form([u * v * area, 0.1 * jumps * patch])
        clock("assembly")
        found = _of_dofs(xfem.GetDofsOfElements(space, inside), K, M)
        clock("reduction")
        return found

    return matrices


def _of_dofs(chosen: Any, *forms: Any) -> tuple[Any, Any]:
    dofs = np.flatnonzero(np.array(list(chosen)))
    K, M = (sparse.csr_matrix(form.mat.CSR())[dofs][:, dofs] for form in forms)
    return K, M
