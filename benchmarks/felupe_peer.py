"""Displacements of a sheared and pressed block of neo-Hooke rubber beside those of felupe.

``pip install felupe``; A. Dutzler, felupe, Zenodo (2022). Same mesh, same points of integration.
Prints the largest difference, and fails above 1e-9.

    python benchmarks/felupe_peer.py
"""

from __future__ import annotations

import numpy as np
from skfem import ElementQuad1, MeshQuad

from contact import ContactProblem, NeoHooke, NonlinearBody, NonlinearStepper, Plane

MU, LAM, PULL, STEPS = 1.0, 9.0, (0.3, -0.3), np.linspace(0.25, 1.0, 4)


def of_felupe(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (2, nv), cells (4, nc) and displacements (2, nv)."""
    import felupe as fe

    mesh = fe.Rectangle(n=n + 1)
    region = fe.RegionQuad(mesh, quadrature=fe.GaussLegendre(order=2, dim=2))
    field = fe.FieldContainer([fe.FieldPlaneStrain(region, dim=2)])
    solid = fe.SolidBody(fe.NeoHookeCompressible(mu=MU, lmbda=LAM), field)
    for s in STEPS:
        held = {"bottom": fe.Boundary(field[0], fy=0)}
        for c, skip in enumerate([(0, 1), (1, 0)]):
            held[f"top {c}"] = fe.Boundary(field[0], fy=1, skip=skip, value=PULL[c] * s)
        dof0, dof1 = fe.dof.partition(field, held)
        given = fe.dof.apply(field, held, dof0)
        known = {"dof0": dof0, "dof1": dof1, "ext0": given}
        fe.newtonraphson(items=[solid], **known, tol=1e-13, verbose=0)
    return mesh.points.T.copy(), mesh.cells.T.copy(), field[0].values.T


def main(n: int = 16) -> float:
    """The largest difference of the displacements."""
    p, t, expected = of_felupe(n)
    mesh = MeshQuad(p, t, sort_t=False).with_defaults()
    body = NonlinearBody.from_mesh(mesh, ElementQuad1(), stress=NeoHooke(MU, LAM))
    problem = ContactProblem(body.fix("bottom").fix("top"), "bottom", Plane((0, -50), (0, 1)))
    stepper = NonlinearStepper(problem, tol=1e-12)
    for c, value in zip("xy", PULL, strict=True):
        stepper.move("top", c, value)
    u = stepper.run(STEPS).results[-1].u
    return float(np.abs(u[body.basis.nodal_dofs] - expected).max())


if __name__ == "__main__":
    difference = main()
    print(f"largest difference of displacements: {difference:.1e}")
    if not difference <= 1e-9:
        raise SystemExit("felupe and contact disagree")
