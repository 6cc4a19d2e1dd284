"""An elastic block pressed on a rigid foundation, with Coulomb friction.

The test example of section 5.2 of the 2012 dissertation: the unit square, in plane strain, with

* top: u_x = 0 and the traction (0, -1),
* sides: u_y = 0, free along x,
* bottom: a rigid plane at the gap d = .03, friction coefficient F = .9,

on 10 x 10 Adini cells. The dissertation leaves the material open; E = 2, nu = .3 here, so that the
contact shows: strains reach .3, which linear elasticity does not mean to describe. Find u with
-div sigma(u) = 0 and on the bottom u_n <= d, p >= 0, p (u_n - d) = 0, |shear| <= F p, with the
shear opposite to the slip where it is at its bound.

    python examples/contact_block.py --n 10 --output out
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from skfem import MeshQuad

from contact import ContactProblem, ContactResult, CrossCheck, ElasticBody, Plane, cross_check
from skfem_adini import ElementQuadAdini


def block(n: int) -> ElasticBody:
    """Build the unit square with its supports and its load on n x n Adini cells."""
    ticks = np.linspace(0, 1, n + 1)
    mesh = MeshQuad.init_tensor(ticks, ticks).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=2.0, nu=0.3, plane="strain")
    return body.fix("top", "x").fix(["left", "right"], "y").load("top", (0.0, -1.0))


def main(argv: list[str] | None = None) -> tuple[ContactResult, CrossCheck]:
    """Solve, print the proof, write VTK and a picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=10, help="cells a side")
    parser.add_argument("--friction", type=float, default=0.9, help="coefficient F")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for VTK and PNG")
    parser.add_argument("--no-picture", action="store_true")
    options = parser.parse_args(argv)

    begin = time.perf_counter()
    problem = ContactProblem(
        block(options.n), "bottom", Plane((0, -0.03), (0, 1)), options.friction
    )
    result = problem.solve(verbose=True)
    seconds = time.perf_counter() - begin
    check = cross_check(problem, result, "osqp")

    print(f"\n{result.u.size} unknowns, {seconds:.2f} s from mesh to certified result")
    print(result.certificate())
    print("\ncross-check with another solver, friction bound frozen at F mu:")
    print(check)
    left, right = result.zone[0]
    print(
        f"\ncontact force {result.contact_force:.5f}, largest pressure {result.pressure.max():.4f}"
    )
    print(f"contact from x = {left:.3f} to {right:.3f}")
    print(f"min u_y {result.u[1::6].min():.4f}, max |u_x| {np.abs(result.u[::6]).max():.4f}")
    print("balance of forces:", np.abs(result.balance()["residual"]).max())

    options.output.mkdir(parents=True, exist_ok=True)
    result.to_pyvista().save(options.output / "contact_block.vtu")
    result.boundary_to_pyvista().save(options.output / "contact_block_boundary.vtp")
    result.save(options.output / "contact_block.npz")
    if not options.no_picture:
        picture(result).savefig(options.output / "contact_block.png", dpi=160)
    print(f"\nwritten to {options.output}: contact_block.vtu, _boundary.vtp, .npz, .png")
    return result, check


def picture(result: ContactResult) -> Any:
    """Draw the stress of the deformed body on its foundation, and the contact traction."""
    import matplotlib.pyplot as plt

    from contact.plot import draw_edges, plot_cells, plot_tractions

    figure, (body, boundary) = plt.subplots(1, 2, figsize=(12, 6.5), layout="constrained")
    plot_cells(result, body, label="von Mises stress")
    draw_edges(result, body, outline=True)
    body.axhspan(-0.12, -0.03, facecolor="0.8", edgecolor="0.4", hatch="//", zorder=0)
    body.set(xlabel="x", ylabel="y", ylim=(-0.12, 1.05), title="displacements to scale")
    plot_tractions(result, boundary, result.x[0], "x")
    boundary.set_title("contact pressure and shear, with friction coefficient .9")
    return figure


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
