"""A rubber bumper pressed against a rigid roller, with friction.

A real part on an unstructured mesh: the D-shaped bumper of `bumper_mesh.py` (millimetres, made and
written as a .msh file of second order with physical names on the first run), curved P2 triangles,
plane strain. Its mount
moves down and sideways by given amounts; its nose, a circular arc, meets a roller of radius 30:

    u = (shift, -press) on "mount",  u_n <= d along "contact",  |shear traction| <= F p,

where d is the distance to the roller along the normal of the nose. Rubber: E = 6 MPa, nu = .45.

    python examples/contact_part.py --press 1.2 --shift 0.5 --friction 0.5
    python examples/contact_part.py --mesh my_part.msh   # boundaries "mount" and "contact"
    python examples/contact_part.py --small docs/contact_part.png   # the picture of the README
"""

from __future__ import annotations

import argparse
import runpy
from pathlib import Path
from typing import Any

import numpy as np
from skfem import ElementTriP2

from contact import ContactProblem, ContactResult, CrossCheck, Cylinder, ElasticBody, cross_check

RADIUS = 30.0


def bumper_file(folder: Path) -> Path:
    """Make the mesh file once; later runs read it."""
    path = folder / "bumper.msh"
    if not path.exists():
        script = runpy.run_path(str(Path(__file__).with_name("bumper_mesh.py")))
        script["main"](["--output", str(path)])
    return path


def main(argv: list[str] | None = None) -> tuple[ContactResult, CrossCheck]:
    """Press the part, print the proof, write VTK and a picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, help='a .msh file naming "mount" and "contact"')
    parser.add_argument("--press", type=float, default=1.2, help="downward motion of the mount")
    parser.add_argument("--shift", type=float, default=0.5, help="sideways motion of the mount")
    parser.add_argument("--friction", type=float, default=0.5)
    parser.add_argument("--output", type=Path, default=Path("out"))
    parser.add_argument("--small", type=Path, help="a picture of few bytes as well")
    parser.add_argument("--no-picture", action="store_true")
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)

    path = options.mesh or bumper_file(options.output)
    body = ElasticBody.from_mesh(path, ElementTriP2(), E=6.0, nu=0.45, plane="strain")
    body.fix("mount", "x", options.shift).fix("mount", "y", -options.press)
    nose = body.mesh.p[:, np.unique(body.mesh.facets[:, body.facets("contact")])]
    lowest = nose[:, np.argmin(nose[1])]
    roller = Cylinder((lowest[0], lowest[1] - RADIUS), RADIUS)
    problem = ContactProblem(body, "contact", roller, options.friction)
    result = problem.solve(verbose=True)
    check = cross_check(problem, result, "osqp", condensed=True)

    force = result.resultant
    print(f"\n{body.mesh.nelements} triangles, {result.u.size} unknowns")
    print(result.certificate())
    print("\ncross-check with another solver, friction bound frozen at F mu:")
    print(check)
    print(f"\nforce on the part {force[0]:.4f}, {force[1]:.4f} N per mm of depth")
    print(f"largest pressure {result.pressure.max():.4f} MPa")
    stick, slip = (int((result.status == kind).sum()) for kind in (1, 2))
    print(f"contact points: {stick} stick, {slip} slip")

    result.to_pyvista().save(options.output / "contact_part.vtu")
    result.boundary_to_pyvista().save(options.output / "contact_part_boundary.vtp")
    if not options.no_picture:
        picture(result, roller).savefig(options.output / "contact_part.png", dpi=160)
    if options.small:
        picture(result, roller).savefig(options.small, dpi=76, pil_kwargs={"optimize": True})
    print(f"\nwritten to {options.output}: contact_part.vtu, _boundary.vtp, .png")
    return result, check


def picture(result: ContactResult, roller: Cylinder) -> Any:
    """Draw the deformed part on its roller, and pressure and shear along the arc."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Circle

    from contact.plot import draw_edges, plot_cells, plot_tractions

    figure, axes = plt.subplots(
        1, 2, figsize=(13, 5.2), layout="constrained", width_ratios=(1.0, 1.15)
    )
    plot_cells(result, axes[0], label="von Mises stress, MPa")
    draw_edges(result, axes[0], outline=True)
    draw_edges(result, axes[0], magnification=0.0, outline=True)
    axes[0].collections[-1].set(color="0.45", linestyle="--", linewidth=0.8)
    axes[0].add_patch(Circle(roller.centre, roller.radius, color="0.75", zorder=0))
    axes[0].set(title="displacements to scale; dashed: undeformed", ylim=(-14, 52))
    axes[0].set(xlabel="mm", ylabel="mm")
    touched = np.flatnonzero(result.mu > 0)
    plot_tractions(result, axes[1], result.x[0], "x along the arc, mm")
    reach = result.x[0, touched]
    axes[1].set(
        xlim=(reach.min() - 2, reach.max() + 2),
        title="contact pressure and shear, MPa",
        ylabel="traction, MPa",
    )
    return figure


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
