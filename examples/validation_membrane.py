"""A membrane on a staircase: the obstacle problem of deal.II's tutorial step-41, in Adini's space.

Find u >= g with u = 0 on the boundary of the square [-1, 1]^2 that minimises

    1/2 int |grad u|^2 - int f u,   f = -10,
    g = -.2, -.4, -.6, -.8   for x < -.5, x < 0, x < .5, x >= .5

(J. Froehlich, step-41 of the deal.II tutorial, www.dealii.org). Adini's scalar element with the
obstacle at the vertices, by the primal-dual active set method (M. Hintermueller, K. Ito and K.
Kunisch, SIAM J. Optim. 13 (2003)); the reference is a finer
solution with quadratic triangles, by another solver (OSQP).

    python examples/validation_membrane.py --cells 32
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from qpsolvers import Problem, solve_problem
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem import Basis, ElementTriP2, MeshQuad, MeshTri, asm
from skfem.models.poisson import laplace, unit_load

from skfem_adini import ElementQuadAdini, essential_dofs

Array = NDArray[np.float64]
FORCE = -10.0


def stairs(x: Array) -> Array:
    """Height of the obstacle; on a riser the upper step counts, a membrane does not tear."""
    edge = x[0] - 1e-12
    return np.select([edge <= -0.5, edge <= 0.0, edge <= 0.5], [-0.2, -0.4, -0.6], -0.8)


def rest_on(S, f: Array, fixed: Array, chosen: Array, g: Array) -> tuple[Array, Array]:
    """Minimise u S u / 2 - f u with u = 0 at `fixed` and u >= g at `chosen`: (u, forces >= 0)."""
    free = np.setdiff1d(np.arange(f.size), fixed)
    u, force = np.zeros_like(f), np.zeros_like(f)
    stiff = S.diagonal()[chosen]
    active = np.zeros(chosen.size, dtype=bool)
    for _ in range(100):
        u[:], held = 0.0, chosen[active]
        u[held] = g[active]
        inner = np.setdiff1d(free, held)
        u[inner] = splu(S[inner][:, inner].tocsc()).solve((f - S @ u)[inner])
        force = S @ u - f
        following = force[chosen] * active + stiff * (g - u[chosen]) > 1e-12 * np.abs(f).max()
        if np.array_equal(following, active):
            return u, np.where(np.isin(np.arange(f.size), held), force, 0.0)
        active = following
    raise RuntimeError("the active set method did not end")


def adini(n: int) -> SimpleNamespace:
    """N x n cells of Adini's element, the obstacle at the vertices."""
    ticks = np.linspace(-1, 1, n + 1)
    basis = Basis(MeshQuad.init_tensor(ticks, ticks), ElementQuadAdini())
    edge = basis.mesh.boundary_facets()
    fixed = essential_dofs(basis, edge)
    inner = basis.mesh.interior_nodes()
    chosen = basis.nodal_dofs[0, inner]
    S, f = laplace.assemble(basis), FORCE * asm(unit_load, basis)
    u, force = rest_on(S, f, fixed, chosen, stairs(basis.mesh.p[:, inner]))
    return summary(basis, u, S, f, force)


def quadratic(n: int) -> SimpleNamespace:
    """The same with quadratic triangles, the obstacle at vertices and midpoints."""
    ticks = np.linspace(-1, 1, n + 1)
    basis = Basis(MeshTri.init_tensor(ticks, ticks), ElementTriP2())
    fixed = basis.get_dofs().flatten()
    chosen = np.setdiff1d(np.arange(basis.N), fixed)
    S, f = laplace.assemble(basis), FORCE * asm(unit_load, basis)
    inner = sparse.csc_matrix(S[chosen][:, chosen])
    problem = Problem(inner, -f[chosen], lb=stairs(basis.doflocs[:, chosen]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PendingDeprecationWarning)  # of OSQP's interface
        solution = solve_problem(
            problem, "osqp", eps_abs=1e-7, eps_rel=1e-7, max_iter=100_000, polishing=True
        )
    u, force = np.zeros(basis.N), np.zeros(basis.N)
    u[chosen], force[chosen] = solution.x, np.maximum(-solution.z_box, 0.0)
    return summary(basis, u, S, f, force)


def summary(basis: Basis, u: Array, S, f: Array, force: Array) -> SimpleNamespace:
    """Contact force, energy, where the membrane is within .01 of the stairs, and a section."""
    s = (np.arange(150) + 0.5) / 75 - 1
    points = np.array(np.meshgrid(s, s)).reshape(2, -1)
    close = basis.probes(points) @ u - stairs(points) < 0.01
    energy = float(0.5 * u @ (S @ u) - f @ u)
    section = basis.probes(np.array([s, 0 * s])) @ u
    return SimpleNamespace(
        u=u, force=float(force.sum()), close=close, energy=energy, section=section
    )


def main(argv: list[str] | None = None) -> tuple[SimpleNamespace, SimpleNamespace]:
    """Print contact force, contact set and energy of both, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=32)
    parser.add_argument("--fine", type=int, default=32)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    ours, reference = adini(options.cells), quadratic(options.fine)
    for name, found in (("Adini", ours), ("quadratic triangles", reference)):
        print(
            f"{name:>20}: {found.u.size:6d} unknowns, contact force {found.force:.4f}, near the "
            f"stairs {4 * found.close.mean():.4f}, energy {found.energy:.5f}"
        )
    print(f"contact sets differ on {4 * np.mean(ours.close != reference.close):.4f}")
    picture(ours, reference, options.output)
    return ours, reference


def picture(ours: SimpleNamespace, reference: SimpleNamespace, output: Path) -> None:
    """Draw the section y = 0 through both membranes and the stairs, and both contact sets."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    n = ours.section.size
    s = (np.arange(n) + 0.5) / (n / 2) - 1
    left.plot(s, reference.section, "k", lw=1, label="quadratic triangles, OSQP")
    left.plot(s[::3], ours.section[::3], "C0o", ms=4, mfc="none", label="Adini")
    left.fill_between(s, stairs(np.array([s])), -0.9, color="0.85", step="mid", label="stairs")
    left.set(xlim=(-1, 1), ylim=(-0.9, 0.02), xlabel="x at y = 0")
    left.set_ylabel("height, arbitrary units")
    left.legend()
    close = [found.close.reshape(n, n).astype(float) for found in (ours, reference)]
    right.contourf(s, s, close[0], [0.5, 1.5], colors="#a9c8e6")
    right.contour(s, s, close[1], [0.5], colors="k", linewidths=1)
    right.fill([], [], color="#a9c8e6", label="Adini")
    right.plot([], [], "k", lw=1, label="quadratic triangles, OSQP")
    right.set(aspect="equal", xlabel="x", ylabel="y", title="membrane within .01 of the stairs")
    right.set(xlim=(-1, 1), ylim=(-1, 1), xticks=(-1, -0.5, 0, 0.5, 1))
    right.legend(loc="upper left", bbox_to_anchor=(1, 1))
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "validation_membrane.png", dpi=120)


if __name__ == "__main__":
    main()
