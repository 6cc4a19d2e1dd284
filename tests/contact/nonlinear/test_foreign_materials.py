"""Materials with the interface of felupe, and felupe itself where it is installed."""

import numpy as np
import pytest
from rubber_blocks import FAR, cube, pressed
from skfem import ElementHex1, ElementQuad2, MeshHex, MeshQuad

from contact import ContactProblem, InputError, NeoHooke, NonlinearBody, NonlinearStepper


class Rubber:
    """Neo-Hooke by hand: P and dP/dF."""

    x = (np.eye(3), np.zeros(0))
    mu, lam = 1.0, 9.0

    def gradient(self, x):
        F = x[0]
        J, inverse = self._parts(F)
        return [self.mu * (F - inverse) + self.lam * np.log(J) * inverse, x[1]]

    def hessian(self, x):
        J, G = self._parts(x[0])
        one = np.eye(3)
        unit = np.einsum("ik,jl->ijkl", one, one)[..., None, None]
        turned = np.einsum("il...,kj...->ijkl...", G, G)
        both = np.einsum("ij...,kl...->ijkl...", G, G)
        return [self.mu * unit + (self.mu - self.lam * np.log(J)) * turned + self.lam * both]

    def _parts(self, F):
        at = np.moveaxis(F, (0, 1), (-2, -1))
        return np.linalg.det(at), np.moveaxis(np.linalg.inv(at), (-1, -2), (0, 1))


class Creeping(Rubber):
    """With half its stress taken off by that of the last step."""

    x = (np.eye(3), np.zeros((3, 3)))

    def gradient(self, x):
        P = super().gradient(x)[0]
        return [P - 0.5 * x[1], P]


def last(body):
    return pressed(body, 0.2, 0.2).run([0.5, 1.0])[-1]


@pytest.mark.parametrize("dilatation", ["pointwise", "mean"])
def test_the_same_law_gives_the_same_body(dilatation, caplog):
    caplog.set_level("INFO", "contact")
    own = cube(ElementQuad2, NeoHooke(1.0, 9.0), dilatation=dilatation)
    umat = NonlinearBody.from_felupe(own.mesh, ElementQuad2(), umat=Rubber(), dilatation=dilatation)
    one, other = last(own), last(umat)
    assert np.abs(one.u - other.u).max() <= 1e-10
    assert "complex steps" in caplog.text


def test_a_state_is_carried_from_step_to_step():
    mesh = cube(ElementQuad2, NeoHooke(1.0, 9.0)).mesh
    history = pressed(NonlinearBody.from_felupe(mesh, umat=Creeping())).run([0.5, 1.0])
    first, second = history[0][0], history[1][0]
    F = first.body.deformation_gradient(second.u)
    expected = Rubber().gradient([F, None])[0]
    assert np.allclose(second.state["z"], expected, rtol=1e-12)
    J = np.linalg.det(np.moveaxis(F, (0, 1), (-2, -1)))
    P = np.einsum("ij...,kj...->ik...", expected - 0.5 * first.state["z"], F) / J
    assert np.allclose(second.stress(), P, atol=1e-10)


class Mixed(Rubber):
    x = (np.eye(3), 0.0, np.zeros(0))


@pytest.mark.parametrize(("umat", "said"), [(3.0, "umat: expected gradient"), (Mixed(), "mixed")])
def test_other_objects_are_refused(umat, said):
    with pytest.raises(InputError, match=said):
        NonlinearBody.from_felupe(MeshQuad(), umat=umat)


def test_displacements_of_felupe():
    """Its own solver on the same cells, moved as here."""
    felupe = pytest.importorskip("felupe")
    umat = felupe.NeoHooke(mu=1.0, bulk=5.0)
    mesh = MeshHex.init_tensor(*[np.linspace(0.0, 1.0, 4)] * 3)
    body = NonlinearBody.from_felupe(mesh, ElementHex1(), umat=umat, intorder=3)
    low = mesh.facets_satisfying(lambda x: np.isclose(x[2], 0.0))
    high = mesh.facets_satisfying(lambda x: np.isclose(x[2], 1.0))
    body.fix(low, "xyz").fix(high, "xyz")
    stepper = NonlinearStepper(ContactProblem(body, low, FAR[3]), tol=1e-12)
    u = stepper.move(high, "z", 0.4).move(high, "x", 0.2).run([0.5, 1.0])[-1].u
    grid = felupe.Cube(n=4)
    region = felupe.RegionHexahedron(grid)
    field = felupe.FieldContainer([felupe.Field(region, dim=3)])
    places = grid.points
    fixed = np.flatnonzero(np.isclose(places[:, 2], 0.0) | np.isclose(places[:, 2], 1.0))
    dof0 = (3 * fixed[:, None] + np.arange(3)).ravel()
    dof1 = np.setdiff1d(np.arange(places.size), dof0)
    solid = felupe.SolidBody(umat, field)
    for part in (0.5, 1.0):
        given = np.zeros_like(places)
        given[np.isclose(places[:, 2], 1.0)] = part * np.array([0.2, 0.0, 0.4])
        found = felupe.newtonraphson(
            items=[solid], dof0=dof0, dof1=dof1, ext0=given[fixed].ravel(), tol=1e-11, verbose=0
        )
    theirs = found.x[0].values
    corner = body.basis.nodal_dofs
    order = [int(np.argmin(np.abs(places - p).sum(axis=1))) for p in mesh.p.T]
    assert np.abs(u[corner].T - theirs[order]).max() <= 1e-9
