r"""Kirchhoff plates with Adini's element: deflection, frequency, and a plate above a rigid floor.

The deflection w of a thin square plate with the bending stiffness D and Poisson's ratio nu under
the pressure q minimises

    D/2 int (1 - nu) |hess w|^2 + nu (lap w)^2  -  int q w,

with w = 0 on the boundary (simply supported) and also w_n = 0 (clamped). The dofs are w, w_x, w_y
at the vertices and the functions are C0: here the element is nonconforming, of order 2, and the
frequencies come from below. Classical values for side, D, q and mass of 1:

    clamped           w(centre) = .00126532,   omega = 35.98519
    simply supported  w(centre) = .00406235,   omega = 2 pi^2.

With a floor below the plate the vertices obey w <= gap. The slopes are eliminated, a dense
quadratic program in the deflections is left, and its multipliers are the contact forces. Within the
zone of contact the plate is flat, so the floor carries the pressure q there; the rest of its force
is a line load on the rim of the zone.

    python examples/plate.py --cells 8 16 32 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from skfem import Basis, BilinearForm, MeshQuad
from skfem.helpers import ddot, trace
from skfem.models.poisson import mass, unit_load

from gpu import QPResult, solve_qp
from skfem_adini import ElementQuadAdini, essential_dofs, factorize, lowest_eigenpairs

NU = 0.3
CLASSICAL = {
    "clamped": (0.00126532, 35.98519),
    "simply supported": (0.00406235, 2 * np.pi**2),
}


@BilinearForm
def bending(w, v, _):
    """Return the integrand of the bending energy for D = 1."""
    return (1 - NU) * ddot(w.hess, v.hess) + NU * trace(w.hess) * trace(v.hess)


def plate(n: int) -> Basis:
    """Build n x n cells with second derivatives."""
    ticks = np.linspace(0, 1, n + 1)
    return Basis(MeshQuad.init_tensor(ticks, ticks), ElementQuadAdini(derivatives=2))


def supports(basis: Basis, support: str) -> np.ndarray:
    """Return the dofs that a support fixes on the whole boundary."""
    clamped = support == "clamped"
    return essential_dofs(basis, basis.mesh.boundary_facets(), clamp_normal=clamped)


def response(n: int, support: str) -> tuple[float, float]:
    """Return the deflection of the centre under q = 1 and the lowest frequency."""
    basis = plate(n)
    K, fixed = bending.assemble(basis), supports(basis, support)
    free = basis.complement_dofs(fixed)
    w = basis.zeros()
    w[free] = factorize(K[free][:, free]).solve(unit_load.assemble(basis)[free])
    centre = np.argmin(np.hypot(*(basis.mesh.p - 0.5)))
    values, _ = lowest_eigenpairs(K, mass.assemble(basis), 1, fixed)
    return float(w[basis.nodal_dofs[0, centre]]), float(np.sqrt(values[0]))


def plate_on_floor(n: int, gap: float) -> tuple[Basis, np.ndarray, np.ndarray, QPResult]:
    """Return basis, dofs, contact forces of all vertices, and the solved program.

    With the deflections u and the slopes s among the free dofs, minimising over s leaves

        P = K_uu - K_us K_ss^-1 K_su,   q = K_us K_ss^-1 f_s - f_u,   u <= gap.
    """
    basis = plate(n)
    K, f = bending.assemble(basis), unit_load.assemble(basis)
    free = basis.complement_dofs(supports(basis, "clamped"))
    u = np.intersect1d(free, basis.nodal_dofs[0])
    s = np.setdiff1d(free, u)
    slopes = factorize(K[s][:, s])
    K_su = K[s][:, u].toarray()
    eliminated = slopes.solve(np.column_stack([K_su, f[s]]))
    P = K[u][:, u].toarray() - K_su.T @ eliminated[:, :-1]
    result = solve_qp(P, K_su.T @ eliminated[:, -1] - f[u], ub=gap)
    x = basis.zeros()
    x[u] = result.x
    x[s] = eliminated[:, -1] - eliminated[:, :-1] @ result.x
    forces = basis.zeros()
    forces[u] = result.z_box
    return basis, x, forces[basis.nodal_dofs[0]], result


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Print the tables, write the picture, return the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[8, 16, 32], help="even, per side")
    parser.add_argument("--floor-cells", type=int, default=32, help="cells of the plate on a floor")
    parser.add_argument("--gap", type=float, default=1e-4, help="from the plate to the floor")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)
    cells = options.cells

    results: dict[str, Any] = {"cells": cells}
    for support, classical in CLASSICAL.items():
        found = np.array([response(n, support) for n in cells])
        errors = found / classical - 1
        results[support] = found
        orders = -np.polyfit(np.log(cells), np.log(np.abs(errors)), 1)[0]
        print(f"\n{support} plate\n   n   w(centre)      error       omega      error")
        for n, (w, omega), (dw, domega) in zip(cells, found, errors, strict=True):
            print(f"{n:4d}  {w:.8f}  {dw:9.2e}  {omega:10.6f}  {domega:9.2e}")
        print(f"order {orders[0]:22.2f} {orders[1]:22.2f}")
        results[f"{support}, orders"] = orders

    basis, x, forces, result = plate_on_floor(options.floor_cells, options.gap)
    results["floor"] = basis, x, forces, result
    pressure = forces * options.floor_cells**2
    touching = forces > 0
    print(f"\nclamped plate above a floor, gap {options.gap:g}, {options.floor_cells} cells a side")
    print(f"{touching.sum()} vertices touch, after {result.iterations} active-set steps")
    print(f"the floor carries {forces.sum():.4f} of the load 1, the supports the rest")
    print(f"contact force at the centre {pressure[len(pressure) // 2]:.4f} q h^2")
    print(f"largest optimality residual {result.kkt.worst:.1e}")

    options.output.mkdir(parents=True, exist_ok=True)
    picture(results, options.gap).savefig(options.output / "plate.png", dpi=160)
    print(f"\nwritten to {options.output}: plate.png")
    return results


def picture(results: dict[str, Any], gap: float) -> Any:
    """Draw the errors, the section through the plate on its floor, and the contact forces."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(14, 4.4), layout="constrained")
    cells = np.array(results["cells"])
    for support, marker in zip(CLASSICAL, "os", strict=True):
        errors = np.abs(results[support] / CLASSICAL[support] - 1)
        for name, color, row in zip(
            ("w(centre)", r"$\omega$"), ("C0", "C1"), errors.T, strict=True
        ):
            axes[0].loglog(cells, row, marker + "-", color=color, label=f"{support}, {name}")
    axes[0].loglog(cells, 3.0 / cells**2, "k--", lw=1, label="$3 n^{-2}$")
    axes[0].set(xlabel="cells a side n", ylabel="relative error", title="order 2")
    axes[0].set_xticks(cells, cells)
    axes[0].minorticks_off()
    axes[0].legend(fontsize=8)

    basis, x, forces, _ = results["floor"]
    n = int(np.sqrt(basis.mesh.nelements))
    section = np.linspace(0, 1, 8 * n + 1)
    points = np.array([section, np.full_like(section, 0.5)])
    with_floor = basis.probes(points) @ x
    K, f, fixed = bending.assemble(basis), unit_load.assemble(basis), supports(basis, "clamped")
    free = basis.complement_dofs(fixed)
    alone = basis.zeros()
    alone[free] = factorize(K[free][:, free]).solve(f[free])
    axes[1].plot(section, basis.probes(points) @ alone, "0.6", label="without floor")
    axes[1].plot(section, with_floor, "C0", label="with floor")
    axes[1].axhspan(gap, 4 * gap, facecolor="0.9", edgecolor="0.5", hatch="//", label="floor")
    axes[1].set(ylim=(4 * gap, -gap), xlabel="x at y = 1/2", ylabel="w, downwards")
    axes[1].set_title("clamped plate above a rigid floor")
    axes[1].legend(fontsize=8, loc="lower left")

    loaded = forces > 0
    points = basis.mesh.p[:, loaded]
    marks = axes[2].scatter(*points, c=forces[loaded] * n**2, s=3e3 / n, marker="s", cmap="viridis")
    figure.colorbar(marks, ax=axes[2], label=r"contact force / $(q h^2)$")
    axes[2].set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xlabel="x", ylabel="y")
    axes[2].set_title("contact forces at the vertices")
    return figure


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
