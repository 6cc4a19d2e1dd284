"""The elements and the model problems that `elements.py` compares them on.

Boundary conditions hold exactly: Adini and BFS fix u and u_t, Argyris u, u_t and u_tt at the
vertices, which determine its trace of degree 5; u_n, u_nt and u_nn stay free. QuadP(2) is run as
ElementQuad2, the same space and quicker; BFS with a quadrature of order 6, enough on rectangles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from skfem import (
    Basis,
    ElementQuad2,
    ElementQuadP,
    ElementTriArgyris,
    ElementTriP3,
    ElementVector,
    FacetBasis,
    LinearForm,
    MeshQuad,
    MeshTri,
)
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    ElementQuadAdini,
    ElementQuadBFS,
    essential_dofs,
    factorize,
    lowest_eigenpairs,
)

pi = np.pi
LAMBDA, MU = 1.5, 1.0


@dataclass(frozen=True)
class Family:
    """An element.

    Attributes
    ----------
    make
        Returns the scalar element.
    dofs
        How many it has for each of the n^2 squares of a fine mesh.
    triangles
        Whether the squares are halved.
    intorder
        Order of the quadrature, scikit-fem's choice by default.
    most
        Largest problem worth its time, in unknowns.
    """

    make: Callable[[], Any]
    dofs: int
    triangles: bool = False
    intorder: int | None = None
    most: int = 10**9


FAMILIES = {
    "Adini": Family(ElementQuadAdini, 3),
    "QuadP(2)": Family(ElementQuad2, 4),
    "QuadP(3)": Family(lambda: ElementQuadP(3), 9),
    "TriP3": Family(ElementTriP3, 9, True),
    "BFS": Family(ElementQuadBFS, 4, intorder=6),
    "Argyris": Family(ElementTriArgyris, 9, True, most=8000),
}


def square(family: Family, n: int) -> Any:
    """Return n x n squares on the unit square, halved for triangles."""
    ticks = np.linspace(0, 1, n + 1)
    return (MeshTri if family.triangles else MeshQuad).init_tensor(ticks, ticks)


def l_shape(family: Family, n: int) -> Any:
    """Return (-1, 1)^2 without its lower right quarter, about n^2 squares."""
    ticks = np.linspace(-1, 1, 2 * max(1, round(n / np.sqrt(3))) + 1)
    mesh = (MeshTri if family.triangles else MeshQuad).init_tensor(ticks, ticks)
    x, y = mesh.p[:, mesh.t].mean(axis=1)
    return mesh.remove_elements(np.flatnonzero((x > 0) & (y < 0)))


def fixed_dofs(basis: Any, facets: Any) -> Any:
    """Return the dofs of u = 0 on axis-parallel facets; nothing else is held."""
    element = getattr(basis.elem, "elem", basis.elem)
    if isinstance(element, ElementQuadAdini | ElementQuadBFS):
        return essential_dofs(basis, facets)
    if not isinstance(element, ElementTriArgyris):
        return basis.get_dofs(facets).all()
    vertical = np.ptp(basis.mesh.p[0, basis.mesh.facets[:, facets]], axis=0) == 0
    fixed = []
    for along, where in (("x", facets[~vertical]), ("y", facets[vertical])):
        names = ("u", f"u_{along}", f"u_{along}{along}")
        wanted = [name for name in basis.elem.dofnames if name.split("^")[0] in names]
        if where.size:
            fixed.append(basis.get_dofs(where).all(wanted))
    return np.unique(np.concatenate(fixed))


@dataclass(frozen=True)
class Source:
    """A source problem: exact(x) gives u and its gradient, force(x) the right-hand side."""

    norms = ("L2", "H1")
    title: str
    mesh: Callable[[Family, int], Any]
    exact: Callable[[Any], tuple[Any, Any]]
    force: Callable[[Any], Any]
    components: int = 1

    def solve(self, mesh: Any, family: Family) -> tuple[Any, Any, int]:
        """Return basis, dofs and the number of unknowns."""
        element = family.make() if self.components == 1 else ElementVector(family.make())
        basis = Basis(mesh, element, intorder=family.intorder)
        if self.components == 1:
            K = laplace.assemble(basis)
            b = LinearForm(lambda v, w: self.force(w.x) * v).assemble(basis)
            held = mesh.boundary_facets()
        else:
            K = linear_elasticity(LAMBDA, MU).assemble(basis)
            b = LinearForm(lambda v, w: dot(self.force(w.x), v)).assemble(basis)
            middle = mesh.p[1, mesh.facets].mean(axis=0)
            loaded = np.setdiff1d(mesh.boundary_facets(), np.flatnonzero(middle == 0))
            sides = FacetBasis(mesh, element, facets=loaded)
            b += LinearForm(lambda v, w: dot(traction(w.x, w.n), v)).assemble(sides)
            held = np.flatnonzero(middle == 0)
        x = basis.zeros()
        free = basis.complement_dofs(fixed_dofs(basis, held))
        x[free] = factorize(K[free][:, free]).solve(b[free])
        return basis, x, free.size

    def errors(self, solution: Any) -> dict[str, float]:
        """Return relative errors in L2 and in the H1 seminorm."""
        basis, x, _ = solution
        points = Basis(basis.mesh, basis.elem, intorder=10)  # finer than what solved
        found, places = points.interpolate(x), np.array(points.global_coordinates())
        u, gradient = self.exact(places)

        def norm(field: Any) -> float:
            return float(np.sqrt(np.sum(np.asarray(field) ** 2 * points.dx)))

        return {
            "L2": norm(np.asarray(found) - u) / norm(u),
            "H1": norm(found.grad - gradient) / norm(gradient),
        }


@dataclass(frozen=True)
class Eigenvalue:
    """Neumann eigenvalues of the unit square: pi^2 times 0, 1, 1, 2, 4, 4, 5, 5, 8."""

    norms = ("8 pi^2", "5 pi^2")
    title: str
    components = 1

    def mesh(self, family: Family, n: int) -> Any:
        """Return the mesh."""
        return square(family, n)

    def solve(self, mesh: Any, family: Family) -> tuple[Any, Any, int]:
        """Return basis, eigenvalues and the number of unknowns."""
        basis = Basis(mesh, family.make(), intorder=family.intorder)
        values, _ = lowest_eigenpairs(laplace.assemble(basis), mass.assemble(basis), 9)
        return basis, values, int(basis.N)

    def errors(self, solution: Any) -> dict[str, float]:
        """Return the relative errors of a simple eigenvalue and of the mean of a double one."""
        values = solution[1] / pi**2
        return {
            "8 pi^2": float(abs(values[8] / 8 - 1)),
            "5 pi^2": float(abs(values[6:8].mean() / 5 - 1)),
        }


def smooth(x: Any) -> tuple[Any, Any]:
    """Return sin(pi x) sin(pi y) exp(x + y/2) and its gradient."""
    s, c, e = np.sin(pi * x), np.cos(pi * x), np.exp(x[0] + x[1] / 2)
    gradient = [(pi * c[0] + s[0]) * s[1] * e, s[0] * (pi * c[1] + s[1] / 2) * e]
    return s[0] * s[1] * e, np.array(gradient)


def smooth_force(x: Any) -> Any:
    """Return minus the Laplacian of `smooth`."""
    s, c, e = np.sin(pi * x), np.cos(pi * x), np.exp(x[0] + x[1] / 2)
    f = (2 * pi**2 - 5 / 4) * s[0] * s[1] - 2 * pi * c[0] * s[1] - pi * s[0] * c[1]
    return f * e


def _corner(x: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Return the singular function s, its gradient, the factor g = (1-x^2)(1-y^2), its gradient."""
    r, theta = np.hypot(*x), np.arctan2(x[1], x[0]) % (2 * pi)
    s = r ** (2 / 3) * np.sin(2 * theta / 3)
    slope = 2 / 3 * r ** (-1 / 3) * np.array([-np.sin(theta / 3), np.cos(theta / 3)])
    a, b = 1 - x[0] ** 2, 1 - x[1] ** 2
    return s, slope, a * b, np.array([-2 * x[0] * b, -2 * x[1] * a]), -2 * (a + b)


def corner(x: Any) -> tuple[Any, Any]:
    """Return r^(2/3) sin(2 theta/3) (1 - x^2) (1 - y^2) and its gradient."""
    s, slope, g, g_slope, _ = _corner(np.array(x))
    return s * g, slope * g + s * g_slope


def corner_force(x: Any) -> Any:
    """Return minus the Laplacian of `corner`; s is harmonic."""
    s, slope, _, g_slope, g_laplacian = _corner(np.array(x))
    return -(2 * np.sum(slope * g_slope, axis=0) + s * g_laplacian)


def displacement(x: Any) -> tuple[Any, Any]:
    """Return (sin 2y cos 3x, sin 1.5y exp x) and its gradient [component, direction]."""
    e = np.exp(x[0])
    u = np.array([np.sin(2 * x[1]) * np.cos(3 * x[0]), np.sin(1.5 * x[1]) * e])
    first = [-3 * np.sin(2 * x[1]) * np.sin(3 * x[0]), 2 * np.cos(2 * x[1]) * np.cos(3 * x[0])]
    return u, np.array([first, [u[1], 1.5 * np.cos(1.5 * x[1]) * e]])


def body_force(x: Any) -> Any:
    """Return -mu lap u - (lambda + mu) grad div u of `displacement`."""
    u, gradient = displacement(x)
    laplacian = np.array([-13 * u[0], (1 - 1.5**2) * u[1]])
    mixed = -6 * np.cos(2 * x[1]) * np.sin(3 * x[0])
    grad_div = np.array([-9 * u[0] + gradient[1, 1], mixed - 1.5**2 * u[1]])
    return -MU * laplacian - (LAMBDA + MU) * grad_div


def traction(x: Any, normal: Any) -> Any:
    """Return sigma n of `displacement`."""
    _, gradient = displacement(x)
    sigma = MU * (gradient + gradient.swapaxes(0, 1))
    return np.einsum("ij...,j...->i...", sigma, normal) + LAMBDA * (
        gradient[0, 0] + gradient[1, 1]
    ) * np.asarray(normal)


PROBLEMS: dict[str, Source | Eigenvalue] = {
    "poisson": Source("Poisson, u = 0, smooth", square, smooth, smooth_force),
    "corner": Source("Poisson, re-entrant corner", l_shape, corner, corner_force),
    "elasticity": Source("Elasticity, tractions", square, displacement, body_force, 2),
    "eigenvalue": Eigenvalue("Laplace eigenvalues, natural condition"),
}
