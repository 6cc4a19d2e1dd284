"""Where vectors of bodies lie, loads without a mesh, back ends of distributed bodies."""

import copy

import numpy as np
import pytest
from skfem import ElementQuad1, ElementTriP2, MeshQuad, MeshTri

from contact import ElasticBody, LayeredBlock
from contact.arrays.dense_arrays import HostArrays
from contact.body import distributed_body
from contact.body.distributed_body import choose_backend
from contact.body.space import Space
from skfem_adini import ElementQuadAdini


class Elsewhere(HostArrays):
    """The host's arrays in the place of a device's, with or without room."""

    free = None

    def room(self):
        return self.free


def square(element, E=1.0):
    mesh = MeshTri() if element is ElementTriP2 else MeshQuad()
    body = ElasticBody.from_mesh(mesh.refined(3).with_defaults(), element(), E=E, nu=0.3)
    return body.fix("top", "y", -0.1).fix("left", "x", lambda x: 0.1 * x[1])


@pytest.fixture(params=[ElementQuadAdini, ElementQuad1, ElementTriP2], ids=lambda e: e.__name__)
def body(request):
    return square(request.param)


def test_against_dense_matrices(body):
    S, (P, u0) = body.stiffness.toarray(), body.constraint
    P, (lengths, free) = P.toarray(), body.lengths
    u, contact, load = np.random.default_rng(1).standard_normal((3, body.f.size))
    forces = S @ u + contact - load
    held = np.eye(body.f.size) - P @ np.linalg.pinv(P)
    unbalanced, cancelling = body.equilibrium(u, contact, load)
    assert np.isclose(unbalanced, np.abs(P.T @ forces / free).max(), rtol=1e-12)
    assert np.isclose(
        cancelling, np.abs(P.T @ (np.abs(S) @ np.abs(u) + np.abs(load)) / free).max(), rtol=1e-12
    )
    assert np.allclose(body.internal(u), S @ u, rtol=0, atol=1e-12 * np.abs(S).sum(axis=1).max())
    assert np.allclose(body.at_supports(forces), held @ forces, atol=1e-12 * np.abs(forces).max())
    off = np.abs(lengths * (held @ (u - u0))).max()
    assert np.isclose(body.support_error(u), off, rtol=1e-12)
    assert np.isclose(
        body.local_displacement(load), np.abs(load * lengths / np.diag(S)).max(), rtol=1e-14
    )
    assert np.isclose(body.largest_displacement(u), np.abs(u[body.are_values]).max(), rtol=0)
    sums = [np.where(body.are_values, load, 0.0)[c::2].sum() for c in (0, 1)]
    assert np.allclose(body.total(load), sums, rtol=1e-12)


def test_rigid_motions_are_no_deformation(body):
    rigid = body.rigid @ np.array([1.0, -2.0, 0.5])
    assert body.deformation(rigid) < 1e-14 * body.largest_displacement(rigid)
    bent = np.random.default_rng(2).standard_normal(body.f.size)
    both = body.deformation(bent), body.deformation(bent + 1e3 * rigid)
    assert np.isclose(*both, rtol=1e-10)
    lengths = body.lengths[0]
    modes = lengths[:, None] * body.rigid
    left = lengths * bent - modes @ np.linalg.lstsq(modes, lengths * bent, rcond=None)[0]
    assert np.isclose(both[0], np.abs(left).max(), rtol=1e-10)


def test_a_device_without_room_is_not_used(caplog):
    body, full = square(ElementQuad1), Elsewhere()
    full.free = Space.bytes(body) - 1
    with caplog.at_level("INFO"):
        kept = body.compute_with(full)
    assert type(kept.arrays) is HostArrays
    assert "on the host" in caplog.text
    full.free += 1
    assert body.compute_with(full).arrays is full


def block():
    return LayeredBlock(1.0, [(1.0, 4, 2.0, 0.3)], sides="y", top="x")


def loaded():
    body = block().load(["top", "left"], (0.1, -1.0))
    return body.load("top", lambda x: np.array([0 * x[0], x[0]]))


def test_loads_are_those_of_the_body_with_a_mesh():
    whole = loaded().elastic()
    plain = block().elastic().load(["top", "left"], (0.1, -1.0))
    plain.load("top", lambda x: np.array([0 * x[0], x[0]]))
    assert whole.f == pytest.approx(plain.f, abs=1e-15)
    assert np.array_equal(loaded().f, loaded().loads)
    for body in (loaded(), copy.deepcopy(loaded())):
        assert np.array_equal(body.body_force((0.0, -1.0)).f, loaded().body_force((0.0, -1.0)).f)


@pytest.mark.parametrize(
    ("unknowns", "rows", "dim", "processes", "petsc", "found", "why"),
    [
        (396_294, 1028, 2, 2, True, "mumps", "of 16.0 GB"),
        (50_000, 3_000, 3, 2, True, "mumps", "of 16.0 GB"),
        (107_811, 3_267, 3, 2, True, "krylov", "faster by multigrid"),
        (1_000_000, 14_700, 3, 2, True, "krylov", "of 16.0 GB"),
        (20_000_000, 4_000, 2, 2, True, "krylov", "of 16.0 GB"),
        (200_000, 30_000, 2, 2, True, "krylov", "of 16.0 GB"),
        (10**7, 10**5, 3, 1, False, "mumps", ""),
    ],
)
def test_back_end_and_its_reason(unknowns, rows, dim, processes, petsc, found, why, monkeypatch):
    monkeypatch.setattr(distributed_body, "has_petsc", lambda: petsc)
    monkeypatch.setattr(distributed_body, "physical_memory", lambda: 16e9)
    chosen, reason = choose_backend(unknowns, rows, dim, processes)
    assert chosen == found
    assert why in reason
