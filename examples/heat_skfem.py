r"""Optimal control of a heated plate, discretised by scikit-fem: sparse E and A, no dense matrix.

On a rectangle with two holes, heated through the parts "left" and "bottom" of its boundary and
insulated elsewhere,

    y_t = div(grad y) - 0.1 y,   y_n = u_1 on left,   y_n = u_2 on bottom,

two sensors measure means over disks, and the cost is the integral of 100 |C y|^2 + |u|^2. With
quadratic triangles E y' = A y + B u: E the mass matrix, A minus the stiffness, B from the facets of
the two parts. `lqr` returns the gain, a low-rank factor of the value, and the slowest poles. The
cost of the simulated closed loop is compared with the value x.E S E x that the equation promises.

    python examples/heat_skfem.py --refine 2 --output out
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, ElementTriP2, FacetBasis, LinearForm, MeshTri
from skfem.models.poisson import laplace, mass

from gpu import lqr

HOLES = ((0.5, 0.875, 0.375, 0.75), (1.375, 1.75, 0.25, 0.5))  # x from, to, y from, to
SENSORS = ((1.1, 0.75, 0.12), (1.8, 0.8, 0.12))
LOSS, COST = 0.1, 100.0


def plate(refine: int) -> MeshTri:
    """Return the mesh: right triangles, those in the holes left out."""
    n = 2 ** (refine + 2)
    mesh = MeshTri.init_tensor(np.linspace(0, 2, 2 * n + 1), np.linspace(0, 1, n + 1))
    centres = mesh.p[:, mesh.t].mean(axis=1)
    inside = np.zeros(mesh.nelements, dtype=bool)
    for left, right, low, high in HOLES:
        x, y = centres
        inside |= (left < x) & (x < right) & (low < y) & (y < high)
    mesh = mesh.remove_elements(np.flatnonzero(inside))
    return mesh.with_boundaries({"left": lambda x: x[0] == 0, "bottom": lambda x: x[1] == 0})


@LinearForm
def one(v, _):
    """Return v."""
    return v


def heat_model(refine: int) -> tuple[Any, ...]:
    """Return the basis and E, A, B, C."""
    mesh = plate(refine)
    basis = Basis(mesh, ElementTriP2())
    E = mass.assemble(basis).tocsr()
    A = -(laplace.assemble(basis) + LOSS * E).tocsr()
    sides = [FacetBasis(mesh, basis.elem, facets=side) for side in ("left", "bottom")]
    B = np.stack([one.assemble(side) for side in sides], axis=1)

    rows = []
    for x, y, radius in SENSORS:

        @LinearForm
        def within(v, w, x=x, y=y, radius=radius):
            return v * ((w.x[0] - x) ** 2 + (w.x[1] - y) ** 2 < radius**2)

        row = within.assemble(basis)
        rows.append(row / row.sum())
    return basis, E, A, B, np.array(rows)


def closed_loop(
    E: Any, A: Any, B: np.ndarray, K: np.ndarray, y: np.ndarray, dt: float, steps: int
) -> np.ndarray:
    """Return states of E y' = (A - B K) y by the Crank-Nicolson rule, K by Sherman and Morrison.

    The first two steps are pairs of half steps of Euler's implicit rule, which has the same matrix
    and damps what the sudden start of the heating excites (Rannacher 1984).
    """
    ahead = splu((E - dt / 2 * A).tocsc(), permc_spec="MMD_AT_PLUS_A")
    lifted = ahead.solve(dt / 2 * B)
    small = np.linalg.inv(np.eye(B.shape[1]) + K @ lifted)

    def solve(r: np.ndarray) -> np.ndarray:
        z = ahead.solve(r)
        return z - lifted @ (small @ (K @ z))

    states = [y]
    for step in range(steps):
        y = states[-1]
        if step < 2:
            states.append(solve(E @ solve(E @ y)))
        else:
            states.append(solve(E @ y + dt / 2 * (A @ y - B @ (K @ y))))
    return np.array(states)


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, simulate, print, draw; return the numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--refine", type=int, default=2, help="2**(refine + 2) cells a unit")
    parser.add_argument("--output", type=Path, default=Path("out"))
    options = parser.parse_args(argv)

    basis, E, A, B, C = heat_model(options.refine)
    result = lqr(A, B, np.sqrt(COST) * C, np.eye(2), E=E, factored=True)
    K, S, poles = result
    print(f"{basis.N} dofs, value of rank {S.rank}, residual {result.residual:.1e}")
    print("slowest poles:", "  ".join(f"{pole.real:.4f}" for pole in poles[:4]))

    y = np.ones(basis.N)
    promised = float((E.T @ y) @ (S @ (E @ y)))
    dt = 0.01
    states = closed_loop(E, A, B, K, y, dt, 600)
    u, seen = -states @ K.T, states @ C.T
    rate = COST * (seen**2).sum(axis=1) + (u**2).sum(axis=1)
    paid = dt * (rate.sum() - (rate[0] + rate[-1]) / 2)
    print(f"cost from y = 1: promised {promised:.5f}, simulated {paid:.5f}")
    assert result.stable
    assert abs(paid - promised) < 1e-2 * promised

    options.output.mkdir(parents=True, exist_ok=True)
    picture(basis, states, u, seen, K, dt).savefig(options.output / "heat_skfem.png", dpi=130)
    print(f"written to {options.output}: heat_skfem.png")
    return {"promised": promised, "paid": paid, "residual": result.residual, "dofs": basis.N}


def picture(basis: Any, states: Any, u: Any, seen: Any, K: Any, dt: float) -> Any:
    """Draw the state at t = 0.3, the gain of the first input, inputs and measurements."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(14, 3.4), layout="constrained")
    vertices = basis.nodal_dofs[0]
    mesh = basis.mesh
    for ax, field, title in (
        (axes[0], states[30], "temperature at $t = 0.3$"),
        (axes[1], density(basis, K[0]), "gain of $u_1$, as a density"),
    ):
        image = ax.tripcolor(*mesh.p, mesh.t.T, field[vertices], shading="gouraud", cmap="inferno")
        figure.colorbar(image, ax=ax, shrink=0.7)
        ax.plot([0, 0], [0, 1], "c", lw=4)
        ax.plot([0, 2], [0, 0], "c", lw=4)
        angle = np.linspace(0, 2 * np.pi, 60)
        for x, y, radius in SENSORS:
            ax.plot(x + radius * np.cos(angle), y + radius * np.sin(angle), "w", lw=1)
        ax.set(aspect="equal", title=title)
    times = dt * np.arange(121)
    for k, name in enumerate(("left", "bottom")):
        axes[2].plot(times, u[:121, k], label=f"heat flux, {name}")
        axes[2].plot(times, seen[:121, k], "--", label=f"sensor {k + 1}")
    axes[2].set(xlabel="time")
    axes[2].legend()
    return figure


def density(basis: Any, k: np.ndarray) -> np.ndarray:
    """Return the g whose integral against y is k.y."""
    return splu(mass.assemble(basis).tocsc()).solve(k)


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
