"""Displacement and stress at points inside periodic layers are those of the sparse path."""

import numpy as np
import pytest

from contact import Cylinder, GridContact, InputError
from contact.spectral.periodic_layers import PeriodicLayers
from skfem_adini import ElementHexAdini, ElementQuadAdini

COATED = [(0.1, 2, 100.0, 0.2), (0.5, 3, 1.0, 0.4)]
CASES = {
    "Q1": lambda: PeriodicLayers(1.3, COATED, 8, motion=(0.1, -0.2)),
    "Q1, stress": lambda: PeriodicLayers(1.3, [(0.5, 5, 2e5, 0.3)], 7, plane="stress"),
    "Adini": lambda: PeriodicLayers(1.3, COATED, 8, element=ElementQuadAdini()),
    "hexahedra": lambda: PeriodicLayers((1.0, 1.5), COATED, (4, 5), motion=(0.1, 0.0, -0.2)),
    "rollers": lambda: PeriodicLayers(1.3, COATED, 6, sides="x", element=ElementQuadAdini()),
    "held": lambda: PeriodicLayers((1.0, 1.5), COATED, (4, 5), sides=("periodic", "xz")),
    "Adini's brick": lambda: PeriodicLayers((1.0, 1.5), COATED, (4, 3), element=ElementHexAdini()),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("make", CASES.values(), ids=CASES)
def test_fields_are_those_of_the_sparse_body(make):
    block = make()
    body, dim = block.elastic(), block.dim
    rng = np.random.default_rng(0)
    forces = rng.standard_normal((dim, *block.shape))
    forces[block.fixed] = 0.0
    load = np.zeros(body.basis.N)
    low = np.flatnonzero(
        (body.mesh.p[-1] < 1e-9)
        & np.all([body.mesh.p[a] < (1 - 1e-9) * block.lengths[a] for a in range(dim - 1)
                  if not block.mirrored[a]], axis=0)
    )  # fmt: skip
    at = tuple(np.rint(body.mesh.p[a, low] / block.spacing[a]).astype(int) for a in range(dim - 1))
    for c in range(dim):
        load[body.basis.nodal_dofs[c, low]] = forces[(c, *at)]
    P, u0 = body.constraint
    S = (P.T @ body.stiffness @ P).toarray()
    u = P @ np.linalg.solve(S, P.T @ (load - body.stiffness @ u0)) + u0
    height = sum(layer[0] for layer in COATED) if len(block.layers) > 1 else 0.5
    x = rng.uniform(0.0, 1.0, (dim, 60)) * np.array([*block.lengths, height])[:, None]
    exact, sigma = body.displacement(u, x), body.stress_at(u, x)
    periods = np.where(block.mirrored, 0.0, block.lengths)
    turns = rng.integers(-2, 3, (dim, 60)) * np.array([*periods, 0.0])[:, None]
    assert abs(block.sample(forces, x + turns) - exact).max() < 1e-10 * abs(exact).max()
    assert abs(block.stress(forces, x + turns) - sigma).max() < 1e-10 * abs(sigma).max()


def test_stress_under_a_uniform_pressure_is_oedometric():
    block = PeriodicLayers((2.0, 3.0), COATED, (4, 4))
    forces = np.zeros((3, 4, 4))
    forces[2] = 0.01 * np.prod(block.spacing)
    x = np.array([[0.3, 1.9], [2.2, 0.1], [0.05, 0.4]])
    sigma = block.stress(forces, x)
    side = np.array([0.25, 2 / 3])  # nu / (1 - nu) in the coating and in the base
    assert np.allclose(sigma[2, 2], -0.01, rtol=1e-12)
    assert np.allclose(sigma[0, 0], -0.01 * side, rtol=1e-11)


@pytest.mark.parametrize("sides", ["periodic", "x"])
def test_a_half_space_carries_the_mean_pressure(sides):
    """It is uniform in the layers, and they are compressed by it, whatever they lie on."""
    block = PeriodicLayers(2.0, COATED, 6, base=(2.0, 0.3), sides=sides)
    forces = np.zeros((2, *block.shape))
    forces[1] = 0.01 * block.spacing[0] * block.weights
    x = np.array([[0.3, 1.9, 1.2], [0.05, 0.1, 0.4]])
    assert np.allclose(block.stress(forces, x)[1, 1], -0.01, rtol=1e-12)
    stiff = np.array([100 * 0.8 / (1.2 * 0.6), 0.6 / (1.4 * 0.2)])  # oedometric
    shortened = -0.01 * np.array([0.05 / stiff[0], 0.1 / stiff[0], 0.1 / stiff[0] + 0.3 / stiff[1]])
    assert np.allclose(block.sample(forces, x)[1], shortened, rtol=1e-11)
    assert abs(block.displacement(forces, 0) - block.apply(forces)).max() < 1e-15


def test_forces_of_a_contact_balance_the_stress_on_every_plane():
    """The mean of the traction on a plane is the resultant, by means over each cell (Q1)."""
    block = PeriodicLayers(1.0, [(0.4, 4, 1.0, 0.3)], 16, motion=(0.01, -0.04))
    result = GridContact(block, Cylinder((0.5, -0.3), 0.3), friction=0.3).solve()
    forces = result.cell * np.concatenate([result.shear, result.pressure[None]])
    assert np.allclose(block.sample(forces, [[0.5], [0.0]])[:, 0], result.u[:, 8], atol=1e-13)
    place, weight = np.polynomial.legendre.leggauss(2)
    across, along = ((place + 1) / 2 + np.arange(16)[:, None]).ravel() / 16, (place + 1) / 20
    mean = np.zeros(2)
    for y, w in zip(along + 0.2, weight / 2, strict=True):
        x = np.vstack([across, np.full(across.size, y)])
        mean += w * block.stress(forces, x)[1].mean(axis=1)
    assert np.allclose(-mean, result.resultant, rtol=1e-9)


@pytest.mark.parametrize(
    "points", [[[0.1], [0.7]], [[0.1], [-0.01]], [0.1, 0.2], [[0.1], [np.nan]]]
)
def test_points_outside_are_refused(points):
    block = PeriodicLayers(1.0, [(0.6, 2, 1.0, 0.3)], 4)
    with pytest.raises(InputError, match="points"):
        block.sample(np.zeros((2, 4)), points)


@pytest.mark.parametrize(
    "forces", [np.zeros((2, 5)), np.full((2, 4), np.nan), np.zeros(4), [[1.0], [1.0, 2.0]]]
)
def test_forces_that_do_not_fit_are_refused(forces):
    block = PeriodicLayers(1.0, [(0.6, 2, 1.0, 0.3)], 4)
    with pytest.raises(InputError, match="forces: expected finite numbers of shape"):
        block.stress(forces, [[0.5], [0.3]])


def test_points_beyond_a_side_are_refused():
    block = PeriodicLayers(1.0, [(0.6, 2, 1.0, 0.3)], 4, sides="x")
    assert np.all(block.sample(np.zeros((2, 5)), [[0.0, 1.0], [0.1, 0.6]]) == 0)
    with pytest.raises(InputError, match="beyond a side"):
        block.sample(np.zeros((2, 5)), [[1.1], [0.1]])
