"""Forces and sums of a body are those of its matrices, wherever and in whatever copy."""

import copy
import gc

import numpy as np
import pytest
from skfem import ElementQuad1, ElementTriP2, MeshQuad, MeshTri

from contact import ElasticBody
from contact.arrays.dense_arrays import HostArrays
from contact.arrays.sparse_rows import DeviceRows, SparseRows
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
    assert np.isclose(body.give(load), np.abs(load * lengths / np.diag(S)).max(), rtol=1e-14)
    assert np.isclose(body.reach(u), np.abs(u[body.are_values]).max(), rtol=0)
    sums = [np.where(body.are_values, load, 0.0)[c::2].sum() for c in (0, 1)]
    assert np.allclose(body.total(load), sums, rtol=1e-12)


def test_rigid_motions_are_no_deformation(body):
    rigid = body.rigid @ np.array([1.0, -2.0, 0.5])
    assert body.deformation(rigid) < 1e-14 * body.reach(rigid)
    bent = np.random.default_rng(2).standard_normal(body.f.size)
    both = body.deformation(bent), body.deformation(bent + 1e3 * rigid)
    assert np.isclose(*both, rtol=1e-10)
    lengths = body.lengths[0]
    modes = lengths[:, None] * body.rigid
    left = lengths * bent - modes @ np.linalg.lstsq(modes, lengths * bent, rcond=None)[0]
    assert np.isclose(both[0], np.abs(left).max(), rtol=1e-10)


def test_translations_meet_no_force():
    body = square(ElementQuadAdini)
    u = np.where(body.are_values, 1e6, 0.0)
    assert np.abs(body.internal(u)).max() < 1e-20


def test_a_device_is_left_with_what_was_condensed_there():
    body = square(ElementQuadAdini)
    there = body.compute_with(Elsewhere())
    copies = body.under(body.f, body.constraint[1]), body.snapshot()
    assert all(each.vectors is there for each in (body, *copies))
    assert copy.deepcopy(body).vectors is not there
    del there
    gc.collect()
    vectors = body.vectors
    assert type(vectors.arrays) is HostArrays
    assert all(each.vectors is vectors for each in copies)


def test_another_stiffness_or_support_is_noticed():
    body = square(ElementQuadAdini)
    there = body.compute_with(Elsewhere())
    u = np.random.default_rng(3).standard_normal(body.f.size)
    forces = body.internal(u)
    body.E = 2.0
    assert np.allclose(body.internal(u), 2.0 * forces, atol=1e-13 * np.abs(forces).max())
    body.fix("right", "x")
    assert body.vectors is not there
    assert body.support_error(u) > 0.0


def test_a_device_without_room_is_not_used(caplog):
    body, full = square(ElementQuad1), Elsewhere()
    full.free = Space.bytes(body) - 1
    with caplog.at_level("INFO"):
        kept = body.compute_with(full)
    assert type(kept.arrays) is HostArrays
    assert "on the host" in caplog.text
    full.free += 1
    assert body.compute_with(full).arrays is full


def test_forces_are_computed_once(monkeypatch):
    body, seen = square(ElementQuad1), []
    product = SparseRows.__matmul__
    monkeypatch.setattr(
        SparseRows, "__matmul__", lambda rows, x: seen.append(rows) or product(rows, x)
    )
    u = np.ones(body.f.size)
    first = body.internal(u)
    assert body.snapshot().internal(u.copy()) is first
    assert len(seen) == 1
    assert body.internal(2.0 * u) is not first
    assert len(seen) == 2


@pytest.mark.gpu
def test_products_on_a_device():
    cupy = pytest.importorskip("cupy")
    body = square(ElementQuadAdini)
    x = np.random.default_rng(4).standard_normal(body.f.size)
    host, device = SparseRows(body.stiffness), DeviceRows(body.stiffness, cupy)
    for ours, theirs in (
        (host @ x, device @ cupy.asarray(x)),
        (host.moduli(x), device.moduli(cupy.asarray(x))),
    ):
        assert np.allclose(ours, theirs.get(), rtol=0, atol=1e-14 * np.abs(host.moduli(x)).max())
    assert bool((device @ cupy.asarray(x) == device @ cupy.asarray(x)).all())
