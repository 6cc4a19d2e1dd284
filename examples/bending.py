r"""Pure bending of an elastic beam of Adini bricks: exact displacements, exact stresses.

A beam of length l and square section, of Young's modulus E and Poisson's ratio nu, is bent to the
curvature k by the traction -E k y on its end x = l. Saint-Venant's solution is quadratic,

    u = -k x y,   v = k/2 (x^2 + nu (y^2 - z^2)),   w = k nu y z,   sigma_xx = -E k y,

and all other stresses vanish. It lies in the space of the brick, so it comes out to round-off, and
so do the stresses, which are read off the dofs of the vertices. The face x = 0 is held in x; what
is left of the rigid motions is held in a single vertex, where the rotation is a dof as well.

The system is solved by a factorisation, or with --solver amg by conjugate gradients and multigrid,
which needs pyamg.

    python examples/bending.py [--solver amg] [--output out]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from skfem import Basis, ElementVector, FacetBasis, LinearForm, MeshHex
from skfem.models.elasticity import lame_parameters, linear_elasticity

from skfem_adini import (
    ElementHexAdini,
    essential_dofs,
    factorize,
    near_null_space,
    nodal_stress,
    save,
    von_mises,
)

E, NU, CURVATURE, LENGTH = 2.0, 0.3, 0.1, 4.0


def exact(p: np.ndarray) -> np.ndarray:
    """Return Saint-Venant's displacement."""
    x, y, z = p
    return CURVATURE * np.array([-x * y, (x**2 + NU * (y**2 - z**2)) / 2, NU * y * z])


@LinearForm
def end_load(v, w):
    """Return the work of the traction -E k y."""
    return -E * CURVATURE * w.x[1] * v[0]


def held_dofs(basis: Basis) -> np.ndarray:
    """Return the dofs of u on the face x = 0, and v, w and the rotation w_y of its middle."""
    face = basis.mesh.facets_satisfying(lambda x: x[0] == 0)
    middle = np.argmin(np.linalg.norm(basis.mesh.p, axis=0))
    names = list(basis.elem.dofnames)
    single = [basis.nodal_dofs[names.index(name), middle] for name in ("u^2", "u^3", "u_y^3")]
    return np.union1d(essential_dofs(basis, face, components=0), single)


def main(argv: list[str] | None = None) -> tuple[float, float, int]:
    """Solve, save, draw, return the errors of displacement and stress and the iterations."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=2, help="across the section, an even number")
    parser.add_argument("--solver", choices=["auto", "pardiso", "superlu", "amg"], default="auto")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for VTK and PNG")
    options = parser.parse_args(argv)

    across = np.linspace(-0.5, 0.5, options.cells + 1)
    mesh = MeshHex.init_tensor(np.linspace(0, LENGTH, 2 * options.cells + 1), across, across)
    basis = Basis(mesh, ElementVector(ElementHexAdini()))
    K = linear_elasticity(*lame_parameters(E, NU)).assemble(basis)
    end = mesh.facets_satisfying(lambda x: x[0] == LENGTH)
    f = end_load.assemble(FacetBasis(mesh, basis.elem, facets=end))

    free = basis.complement_dofs(held_dofs(basis))
    near_null = near_null_space(basis, free) if options.solver == "amg" else None
    solver = factorize(K[free][:, free], solver=options.solver, near_null=near_null, tol=1e-12)
    x = basis.zeros()
    x[free] = solver.solve(f[free])

    u = exact(mesh.p)
    error = np.abs(x[basis.nodal_dofs[:3]] - u).max() / np.abs(u).max()
    stress = nodal_stress(basis, x, E, NU)
    expected = np.zeros_like(stress)
    expected[0, 0] = -E * CURVATURE * mesh.p[1]
    stress_error = np.abs(stress - expected).max() / np.abs(expected).max()

    print(f"{basis.N} dofs, {solver.iterations} iterations")
    print(f"relative errors: displacement {error:.1e}, stress {stress_error:.1e}")
    path = save(
        options.output / "bending.vtk",
        basis,
        {"displacement": x},
        point_data={"stress": stress, "von_mises": von_mises(stress)},
    )
    print(f"written: {path}")
    picture(mesh, x[basis.nodal_dofs[:3]], stress[0, 0], options.output)
    return float(error), float(stress_error), solver.iterations


def picture(mesh: MeshHex, u: np.ndarray, stress: np.ndarray, output: Path) -> None:
    """Draw the vertices of the plane z = 0, moved and coloured by the stress, and the stress."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1))
    middle = mesh.p[2] == 0
    around = np.linspace(0, 1, 50)
    x = LENGTH * np.r_[around, 0 * around + 1, around[::-1], 0 * around]
    y = np.r_[0 * around, around, 0 * around + 1, around[::-1]] - 0.5
    moved = np.array([x, y]) + exact(np.array([x, y, 0 * x]))[:2]
    left.plot(x, y, "0.6", label="undeformed")
    left.plot(*moved, "k", lw=1, label="Saint-Venant")
    points = (mesh.p + u)[:2, middle]
    marks = left.scatter(*points, c=stress[middle], cmap="coolwarm", ec="k", zorder=3, label="ours")
    figure.colorbar(marks, ax=left, location="bottom", label=r"$\sigma_{xx}$, arbitrary units")
    left.set(
        aspect="equal",
        xlabel="x, arbitrary units",
        ylabel="y",
        title="plane z = 0, displacements to scale 1",
    )
    left.legend(loc="upper left")
    right.plot(mesh.p[1], stress, "o", mfc="none", label="ours, all vertices")
    right.plot([-0.5, 0.5], E * CURVATURE * np.array([0.5, -0.5]), "k", lw=1, label="$-E k y$")
    right.set(xlabel="y, arbitrary units", ylabel=r"$\sigma_{xx}$, arbitrary units")
    right.legend()
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "bending.png", dpi=120)


if __name__ == "__main__":
    main()
