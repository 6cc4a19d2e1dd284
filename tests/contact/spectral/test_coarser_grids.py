"""Frictionless contact that begins on every other point: the same solution by fewer products."""

import numpy as np
import pytest

from contact import GridContact, HalfSpace, PeriodicLayers, Rigid, self_affine
from contact.spectral.real_symbol import RealSymbol

LAYERS = [(0.25, 4, 1.0, 0.3), (0.5, 6, 20.0, 0.2)]


def bodies():
    """Of 64 cells along each direction: periodic and mirrored, a plane and in space."""
    return {
        "half plane": HalfSpace(1.0, 64, 1.0, 0.3),
        "half space": HalfSpace((1.0, 2.0), (64, 128), 1.0, 0.3),
        "periodic": PeriodicLayers((1.0, 1.0), LAYERS, (64, 64)),
        "rollers": PeriodicLayers(1.0, LAYERS, 64, sides="x"),
        "held tangentially": PeriodicLayers((1.0, 1.0), LAYERS, (64, 64), sides=("periodic", "xz")),
        "all mirrored": PeriodicLayers((1.0, 1.0), LAYERS, (64, 64), sides=("x", "y")),
    }


@pytest.fixture(scope="module", params=list(bodies()))
def body(request):
    return bodies()[request.param]


def smooth(body):
    """A pressure of two waves, as even or odd about the sides as the normal displacement."""
    lateral = body.normal_filter.lateral
    odd = (
        [False] * len(body.shape)
        if lateral is None
        else [p is not None and p[-1] for p in lateral.odd]
    )
    places = np.meshgrid(
        *(np.arange(m) / n for m, n in zip(body.shape, body.normal_filter.cells, strict=True)),
        indexing="ij",
    )
    parts = [
        np.sin(np.pi * x) if turned else 1.0 + 0.5 * np.cos(2 * np.pi * x)
        for x, turned in zip(places, odd, strict=True)
    ]
    return np.prod(parts, axis=0)


def test_smooth_pressures_move_every_other_point_as_the_fine_grid(body):
    fine = body.normal_filter
    coarse = fine.coarser
    assert all(2 * n == m for n, m in zip(coarse.cells, fine.cells, strict=True))
    every = (slice(None, None, 2),) * len(body.shape)
    weights = np.broadcast_to(getattr(body, "weights", 1.0), body.shape)
    pressure = smooth(body)
    u = fine.apply_normal(pressure * weights)
    share = 2 ** len(body.shape)  # each point takes the place of so many
    there = coarse.apply_normal(share * (pressure * weights)[every])
    assert np.abs(there - u[every]).max() < 1e-13 * np.abs(u).max()
    again = coarse.precondition_normal(there) / share
    off = again / weights[every] - pressure[every]
    assert np.ptp(off) < 1e-12  # but for a mean that nothing holds


def test_refined_forces_are_those_of_the_interpolated_pressure(body):
    fine = body.normal_filter
    weights = np.broadcast_to(getattr(body, "weights", 1.0), body.shape)
    every = (slice(None, None, 2),) * len(body.shape)
    pressure, share = smooth(body), 2 ** len(body.shape)
    found = fine.refined(share * (pressure * weights)[every]) / weights
    assert found[every] == pytest.approx(pressure[every], rel=1e-14)
    between = np.abs(found - pressure).max()
    assert 1e-4 < between < (np.pi / 32) ** 2  # of second order: h^2 / 8 times the curvature
    ones = fine.refined(share * weights[every])
    assert ones == pytest.approx(weights, rel=1e-14)


def test_a_half_space_is_coarsened_to_the_half_space_of_fewer_points():
    fine, coarse = (HalfSpace((1.0, 2.0), (n, 2 * n), 1.0, 0.3) for n in (64, 32))
    forces = np.random.default_rng(0).standard_normal((32, 64))
    wanted = coarse.apply_normal(forces)
    found = fine.normal_filter.coarser.apply_normal(forces)
    assert np.abs(found - wanted).max() < 1e-14 * np.abs(wanted).max()
    assert fine.normal_filter.coarser.coarser is None


@pytest.mark.parametrize("pressed", [True, False])
def test_the_same_forces_by_fewer_products(body, pressed):
    if not pressed and body.constant.any():
        pytest.skip("nothing holds its mean displacement")
    n = body.normal_filter.cells
    heights = self_affine(n, 0.8, 5e-3, (2, 16), seed=3)
    heights = np.pad(heights, [(0, m - k) for m, k in zip(body.shape, n, strict=True)], "wrap")
    if hasattr(body, "fixed"):
        heights -= 0.1 * body.fixed[-1]  # out of reach of what a side holds
    total = [None] * (heights.ndim) + [2e-2]
    ground = Rigid(heights.max() - heights, force=total)
    if not pressed:
        ground = Rigid(heights.max() - heights, displacement=[0.0] * heights.ndim + [4e-3])
    products = []

    def counting(forces):
        products[-1] += 1
        return body.normal_filter.apply_normal(forces)

    def solved(coarser):
        """Forces, counting the products of the fine grid."""
        vars(body.normal_filter)["coarser"] = coarser
        products.append(0)
        return GridContact(body, ground).solve().forces

    body.apply_normal, known = counting, body.normal_filter.coarser
    try:
        wanted, found = solved(None), solved(known)
    finally:
        del body.apply_normal
    assert np.abs(found - wanted).max() < 1e-9 * wanted.max()
    assert products[1] < products[0]


@pytest.mark.parametrize("n", [2, 3])
def test_a_symbol_is_inverted_wave_by_wave(n):
    rng = np.random.default_rng(n)
    root = rng.standard_normal((6, n, n))
    N = np.einsum("kij,klj->ilk", root, root) + np.eye(n)[:, :, None]
    turns = [1] * (n - 1) + [0]
    phase = np.array([1j, 1.0])[[0 if t else 1 for t in turns]]
    symbol = phase[:, None, None] * N * phase.conj()[None, :, None]
    own = RealSymbol.of(symbol, turns)
    assert own.full() == pytest.approx(symbol, abs=1e-14)
    wanted = np.moveaxis(np.linalg.inv(np.moveaxis(symbol, -1, 0)), 0, -1)
    assert np.abs(own.inverse().full() - wanted).max() < 1e-12 * np.abs(wanted).max()
