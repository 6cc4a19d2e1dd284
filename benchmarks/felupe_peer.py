"""Displacements of neo-Hooke rubber beside those of felupe, without and with contact.

``pip install felupe``; A. Dutzler, felupe, Zenodo (2022). Same mesh, same points of integration. A
block is sheared and pressed, by our law and by felupe's (`NonlinearBody.from_felupe`): the largest
difference is printed, and must be below 1e-9. Half a cylinder is pressed flat by 40 % on a plane:
felupe penalises the gap there, so that the difference must fall as one over the penalty. With
friction its Newton's method stops above a penalty of some hundreds.

    python benchmarks/felupe_peer.py
"""

from __future__ import annotations

import numpy as np
from skfem import ElementQuad1, ElementTriP1, MeshQuad, MeshTri

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
    """The largest difference of the displacements, of both laws."""
    import felupe as fe

    p, t, expected = of_felupe(n)
    mesh = MeshQuad(p, t, sort_t=False).with_defaults()
    umat = fe.NeoHookeCompressible(mu=MU, lmbda=LAM)
    ours = NonlinearBody.from_mesh(mesh, ElementQuad1(), stress=NeoHooke(MU, LAM))
    theirs = NonlinearBody.from_felupe(mesh, ElementQuad1(), umat=umat)
    off = []
    for body in (ours, theirs):
        problem = ContactProblem(body.fix("bottom").fix("top"), "bottom", Plane((0, -50), (0, 1)))
        stepper = NonlinearStepper(problem, tol=1e-12)
        for c, value in zip("xy", PULL, strict=True):
            stepper.move("top", c, value)
        u = stepper.run(STEPS).results[-1].u
        off.append(float(np.abs(u[body.basis.nodal_dofs] - expected).max()))
    return max(off)


def pressed_flat(friction: float, penalties: tuple[float, ...], steps: int) -> list[float]:
    """Largest differences of half a cylinder's displacements for each penalty of felupe."""
    disk = MeshTri.init_circle(3)
    half = disk.restrict(np.flatnonzero(disk.p[1][disk.t].mean(axis=0) < 0.0))
    named = {"top": lambda x: np.isclose(x[1], 0.0), "arc": lambda x: x[1] < -1e-9}
    half = MeshTri(half.p, half.t).with_boundaries(named)
    body = NonlinearBody.from_mesh(half, ElementTriP1(), stress=NeoHooke(MU, LAM)).fix("top")
    problem = ContactProblem(body, "arc", Plane((0.0, -1.0), (0.0, 1.0)), friction)
    times = np.linspace(1 / steps, 1, steps)
    u = NonlinearStepper(problem).move("top", "y", -0.4).run(times)[-1].u
    own = u[body.basis.nodal_dofs]
    return [np.abs(own - penalised(half, friction, p, times)).max() for p in penalties]


def penalised(half: MeshTri, friction: float, penalty: float, times: np.ndarray) -> np.ndarray:
    """Displacements (2, nv) of half a cylinder on a plane through (0, -1) by felupe."""
    import felupe as fe

    t = half.t.T.copy()
    (ax, ay), (bx, by) = (half.p[:, t[:, k]] - half.p[:, t[:, 0]] for k in (1, 2))
    t[ax * by < ay * bx] = t[ax * by < ay * bx][:, [0, 2, 1]]  # corners counterclockwise
    mesh = fe.Mesh(np.vstack((half.p.T, [[0.0, -1.0]])), t, "triangle")
    field = fe.FieldContainer([fe.FieldPlaneStrain(fe.RegionTriangle(mesh), dim=2)])
    solid = fe.SolidBody(fe.NeoHookeCompressible(mu=MU, lmbda=LAM), field)
    arc, last = np.unique(half.facets[:, half.boundaries["arc"]]), mesh.npoints - 1
    known = {"multiplier": penalty, "multiplier_tangential": penalty, "friction": friction}
    normal = np.array([0.0, 1.0])
    plane = fe.ContactRigidPlane(field, points=arc, centerpoint=last, normal=normal, **known)
    held = np.r_[np.flatnonzero(np.isclose(half.p[1], 0.0)), last]
    dof0 = (2 * held[:, None] + np.arange(2)).ravel()
    dof1 = np.setdiff1d(np.arange(2 * mesh.npoints), dof0)
    for time in times:
        given = np.zeros((held.size, 2))
        given[:-1, 1] = -0.4 * time
        fe.newtonraphson(
            items=[solid, plane], dof0=dof0, dof1=dof1, ext0=given.ravel(), tol=1e-9, verbose=0
        )
    return field[0].values[:-1].T


if __name__ == "__main__":
    difference = main()
    print(f"largest difference of displacements: {difference:.1e}")
    if not difference <= 1e-9:
        raise SystemExit("felupe and contact disagree")
    for friction, penalties, steps in ((0.0, (1e2, 1e3, 1e4), 10), (0.3, (1e2, 3e2), 40)):
        off = pressed_flat(friction, penalties, steps)
        print(f"friction {friction}, penalties {penalties}: {[f'{v:.1e}' for v in off]}")
        ratios = np.diff(np.log(off)) / np.diff(np.log(penalties))
        if not np.all(np.abs(ratios + 1.0) <= 0.1):
            raise SystemExit("felupe's contact does not approach that of contact")
