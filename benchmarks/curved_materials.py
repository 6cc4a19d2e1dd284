r"""Nearly incompressible bodies and strongly varying conductivities on a disk that cuts its cells.

Elasticity, plane strain, mu = 1: u = curl psi + grad phi / (lambda + 2 mu) with
psi = sin 3x cos 2y, phi = sin(2x + 1) cos 3y, so that the pressure -lambda div u neither vanishes
nor grows. The same on the whole square, which the mesh fits, with strong conditions: what is lost
there is lost by the element. Then the torsion of the disk held at its edge, free of divergence,
whose eigenvalue mu (j_{1,1} / R)^2 does not know lambda.

Conduction, -div k grad u = f: k = exp(s (x + y)); k that jumps at the grid line x = 1/2, with
u = cos(3 X) e^{2y} + sin(5 X) e^y / k, X = x - 1/2; and at a circle in the cells, with
u = (r^4 - r_0^4) / k.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import jn_zeros
from skfem import Basis, BilinearForm, ElementVector, Functional, LinearForm, MeshQuad
from skfem.helpers import dot, grad
from skfem.models.elasticity import linear_elasticity

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdini,
    essential_constraints,
    factorize,
    ghost_penalty,
    lowest_eigenpairs,
    nitsche,
)

RADIUS = 0.411
RATIOS = [0.3, 0.45, 0.49, 0.499, 0.4999, 0.49999]
CELLS = [8, 12, 16, 24, 32]
SCALAR = ElementQuadAdini()
VECTOR = ElementVector(SCALAR)
DEGREE = 10


def disk(x: Any) -> Any:
    """Return the level set."""
    return (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - RADIUS**2


def grid(n: int) -> MeshQuad:
    """Return n x n cells of the unit square."""
    return MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)


def solved(domain: CutDomain, A: Any, b: Any, element: Any, ghost: float | None) -> Any:
    """Return the solution with the extension, or with a ghost penalty of this weight."""
    basis = Basis(domain.mesh, element, intorder=1)
    if ghost is None:
        return AdiniExtension(basis, domain).solve(A, b)
    active, x = domain.active_dofs(basis), basis.zeros()
    A = (A + ghost * ghost_penalty(domain, element)).tocsr()[active][:, active]
    x[active] = factorize(A, definite=True).solve(b[active])
    return x


def relative_errors(bases: Any, x: Any, u: Any, slope: Any) -> tuple[float, float]:
    """Return the errors in L2 and H1 over the norms of the solution."""

    def total(integrand: Callable[..., Any], **fields: Any) -> float:
        return float(sum(Functional(integrand).assemble(b, **part(b)) for b in bases))

    def part(basis: Any) -> dict[str, Any]:
        return {"x_h": basis.interpolate(x)}

    def square(values: Any) -> Any:
        return (values**2).reshape(-1, *values.shape[-2:]).sum(axis=0)

    pairs = [
        (lambda w: square(np.asarray(w.x_h) - u(w.x)), lambda w: square(u(w.x))),
        (lambda w: square(w.x_h.grad - slope(w.x)), lambda w: square(slope(w.x))),
    ]
    error, size = np.transpose([[total(form) for form in pair] for pair in pairs])
    return tuple(np.sqrt(error / size).tolist())


def elastic(lam: float) -> tuple[Any, Any, Any]:
    """Return displacement, its gradient and the volume force for mu = 1."""
    share, s, c = 1 / (lam + 2), np.sin, np.cos

    def curl(x: Any) -> Any:
        return np.array([-2 * s(3 * x[0]) * s(2 * x[1]), -3 * c(3 * x[0]) * c(2 * x[1])])

    def gradient(x: Any) -> Any:
        return np.array([2 * c(2 * x[0] + 1) * c(3 * x[1]), -3 * s(2 * x[0] + 1) * s(3 * x[1])])

    def slope(x: Any) -> Any:
        X, Y, Z = 3 * x[0], 2 * x[1], 2 * x[0] + 1
        of_curl = [[-6 * c(X) * s(Y), -4 * s(X) * c(Y)], [9 * s(X) * c(Y), 6 * c(X) * s(Y)]]
        mixed = -6 * c(Z) * s(3 * x[1])
        value = s(Z) * c(3 * x[1])
        return np.array(of_curl) + share * np.array([[-4 * value, mixed], [mixed, -9 * value]])

    def displacement(x: Any) -> Any:
        return curl(x) + share * gradient(x)

    # Both parts have lap = -13 times themselves; -mu lap u - (lambda + mu) grad div u.
    return displacement, slope, lambda x: 13 * (curl(x) + gradient(x))


def elasticity(method: str, n: int, lam: float) -> tuple[float, float]:
    """Return the errors of one solution."""
    u, slope, force = elastic(lam)
    load = LinearForm(lambda v, w: dot(force(w.x), v))
    stiffness = linear_elasticity(Lambda=lam, Mu=1.0)
    if method == "square, strong":
        basis = Basis(grid(n), VECTOR, intorder=DEGREE)
        A, b = stiffness.assemble(basis), load.assemble(basis)
        T, x0 = essential_constraints(basis, basis.mesh.boundary_facets(), u)
        reduced = factorize((T.T @ A @ T).tocsc(), definite=True)
        return relative_errors([basis], T @ reduced.solve(T.T @ (b - A @ x0)) + x0, u, slope)
    domain = CutDomain(grid(n), disk, q=6)
    B, data = nitsche(domain.boundary(VECTOR), u, lame=(lam, 1.0))
    A = domain.assemble(stiffness, VECTOR) + B
    ghost = 2 + lam if method == "disk, ghost penalty" else None
    x = solved(domain, A, data + domain.assemble(load, VECTOR, DEGREE), VECTOR, ghost)
    return relative_errors(list(domain.groups(VECTOR, DEGREE)), x, u, slope)


def torsion(n: int, lam: float) -> float:
    """Return the relative error of the eigenvalue of torsion."""
    domain = CutDomain(grid(n), disk, q=6)
    A = domain.assemble(linear_elasticity(Lambda=lam, Mu=1.0), VECTOR)
    A = A + nitsche(domain.boundary(VECTOR), lame=(lam, 1.0))[0]
    M = domain.assemble(BilinearForm(lambda u, v, _: dot(u, v)), VECTOR)
    A, M = AdiniExtension(Basis(domain.mesh, VECTOR, intorder=1), domain).apply(A, M)
    exact = (jn_zeros(1, 1)[0] / RADIUS) ** 2
    return float(np.abs(lowest_eigenpairs(A, M, 10, shift=0.0)[0] / exact - 1).min())


def conduction(kind: str, contrast: float) -> tuple[Any, Any, Any, Any]:
    """Return conductivity, solution, its gradient and the source."""
    steep = np.log(contrast) / (2 * np.sqrt(2) * RADIUS)

    def radius(x: Any) -> Any:
        return np.hypot(x[0] - 0.5, x[1] - 0.5)

    if kind == "smooth":

        def k(x: Any) -> Any:
            return np.exp(steep * (x[0] + x[1] - 1))

        def u(x: Any) -> Any:
            return np.sin(5 * x[0] + 0.3) * np.exp(2 * x[1])

        def slope(x: Any) -> Any:
            return np.exp(2 * x[1]) * np.array(
                [5 * np.cos(5 * x[0] + 0.3), 2 * np.sin(5 * x[0] + 0.3)]
            )

        return k, u, slope, lambda x: k(x) * (21 * u(x) - steep * slope(x).sum(axis=0))
    if kind == "jump at a grid line":

        def k(x: Any) -> Any:
            return np.where(x[0] < 0.5, 1.0, contrast)

        def u(x: Any) -> Any:
            X, e = x[0] - 0.5, np.exp(x[1])
            return np.cos(3 * X) * e**2 + np.sin(5 * X) * e / k(x)

        def slope(x: Any) -> Any:
            X, e = x[0] - 0.5, np.exp(x[1])
            return np.array(
                [
                    -3 * np.sin(3 * X) * e**2 + 5 * np.cos(5 * X) * e / k(x),
                    2 * np.cos(3 * X) * e**2 + np.sin(5 * X) * e / k(x),
                ]
            )

        def source(x: Any) -> Any:
            X, e = x[0] - 0.5, np.exp(x[1])
            return k(x) * 5 * np.cos(3 * X) * e**2 + 24 * np.sin(5 * X) * e

        return k, u, slope, source

    def k(x: Any) -> Any:
        return np.where(radius(x) < 0.213, contrast, 1.0)

    def slope(x: Any) -> Any:
        return 4 * radius(x) ** 2 * np.array([x[0] - 0.5, x[1] - 0.5]) / k(x)

    return (
        k,
        lambda x: (radius(x) ** 4 - 0.213**4) / k(x),
        slope,
        lambda x: -16 * radius(x) ** 2,
    )


def heat(kind: str, contrast: float, n: int) -> tuple[float, float]:
    """Return the errors of one solution, with the extension."""
    k, u, slope, source = conduction(kind, contrast)
    domain = CutDomain(grid(n), disk, q=6)
    stiffness = BilinearForm(lambda u, v, w: k(w.x) * dot(grad(u), grad(v)))
    load = LinearForm(lambda v, w: source(w.x) * v)
    B, data = nitsche(domain.boundary(SCALAR), u, coefficient=k)
    A = domain.assemble(stiffness, SCALAR, DEGREE) + B
    x = solved(domain, A, data + domain.assemble(load, SCALAR, DEGREE), SCALAR, None)
    return relative_errors(list(domain.groups(SCALAR, DEGREE)), x, u, slope)


def row(errors: list[tuple[float, float]], cells: list[int], **names: Any) -> dict[str, Any]:
    """Return errors and the orders fitted to those of the three finest meshes."""
    l2, h1 = np.transpose(errors)
    orders = [-np.polyfit(np.log(cells[-3:]), np.log(error[-3:]), 1)[0] for error in (l2, h1)]
    found = {"cells": cells, "l2": l2.tolist(), "h1": h1.tolist(), "orders": orders}
    names = ", ".join(f"{key} {value}" for key, value in names.items()), names
    print(f"{names[0]:48} L2 {l2[-1]:.1e} ({orders[0]:.1f})   H1 {h1[-1]:.1e} ({orders[1]:.1f})")
    return names[1] | found


def measure(cells: list[int] | None = None) -> dict[str, Any]:
    """Return and print the tables."""
    cells = CELLS if cells is None else cells
    incompressible, contrasts = [], []
    print(f"\nrelative errors at n = {cells[-1]} (order)")
    for method in ("disk, extension", "disk, ghost penalty", "square, strong"):
        for nu in RATIOS:
            lam = 2 * nu / (1 - 2 * nu)
            found = row([elasticity(method, n, lam) for n in cells], cells, method=method, nu=nu)
            if method == "disk, extension":
                found["torsion"] = [torsion(n, lam) for n in cells]
                print(f"{'':48} torsion {found['torsion'][-1]:.1e}")
            incompressible.append(found)
    for kind in ("smooth", "jump at a grid line", "jump in the cells"):
        for contrast in (1e3, 1e6):
            errors = [heat(kind, contrast, n) for n in cells]
            contrasts.append(row(errors, cells, conductivity=kind, contrast=contrast))
    return {"incompressible": incompressible, "contrasts": contrasts}
