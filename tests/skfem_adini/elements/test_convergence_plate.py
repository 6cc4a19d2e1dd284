"""As plate elements, Adini (nonconforming) and BFS (conforming) are of order 2 in H2."""

import numpy as np
import pytest
from skfem import Basis, BilinearForm, LinearForm, MeshQuad, condense, solve
from skfem.helpers import ddot

from skfem_adini import ElementQuadAdini, ElementQuadBFS, essential_dofs

pi = np.pi


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuadBFS])
def test_clamped_plate(element, convergence_order):
    """Broken H2 norm, w = (sin sin)^2, all dofs on the boundary fixed."""

    @BilinearForm
    def plate(u, v, _):
        return ddot(u.hess, v.hess)

    @LinearForm
    def pressure(v, w):
        a, b = 2 * pi * w.x
        return 4 * pi**4 * (4 * np.cos(a) * np.cos(b) - np.cos(a) - np.cos(b)) * v

    cells, errors = [8, 16, 32], []
    for n in cells:
        mesh = MeshQuad().refined(int(np.log2(n)))
        basis = Basis(mesh, element(derivatives=2), intorder=6)
        fixed = essential_dofs(basis, mesh.boundary_facets(), clamp_normal=True)
        x = solve(*condense(plate.assemble(basis), pressure.assemble(basis), D=fixed))
        hess = basis.interpolate(x).hess
        a, b = 2 * pi * np.array(basis.global_coordinates())
        exact = pi**2 * np.array(
            [
                [np.cos(a) * (1 - np.cos(b)), np.sin(a) * np.sin(b)],
                [np.sin(a) * np.sin(b), (1 - np.cos(a)) * np.cos(b)],
            ]
        )
        errors.append(np.sqrt(np.sum((hess - exact) ** 2 * basis.dx)))
    assert convergence_order(cells, errors) == pytest.approx(2, abs=0.1)
