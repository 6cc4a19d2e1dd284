"""Cells cannot turn inside out by less than the displacement that bodies keep for all steps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import MeshHex, MeshQuad, MeshTet, MeshTri

from contact.body.jacobians import middle_determinants, turning_move


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([MeshTri, MeshQuad, MeshTet, MeshHex]))
def test_no_cell_turns_below_the_bound(seed, mesh_type):
    rng = np.random.default_rng(seed)
    mesh = mesh_type().refined(2)
    mesh = mesh.scaled(np.exp(rng.uniform(-3, 3, mesh.dim())))
    mesh = mesh_type(mesh.p * (1 + 0.05 * rng.uniform(-1, 1, mesh.p.shape)), mesh.t)
    directions = rng.standard_normal(mesh.p.shape)
    moves = turning_move(mesh) * directions / np.linalg.norm(directions, axis=0)
    rest = middle_determinants(mesh, mesh.p)
    assert (rest * middle_determinants(mesh, mesh.p + 0.99 * moves) > 0).all()


@pytest.mark.parametrize("mesh_type", [MeshTri, MeshQuad, MeshTet, MeshHex])
def test_the_bound_is_within_reach_of_what_turns_a_cell(mesh_type):
    mesh = mesh_type().refined(2)
    assert turning_move(mesh) > 0.25 * 0.05
    pushed = mesh.p.copy()
    pushed[:, np.argmin(np.abs(mesh.p - 0.5).sum(axis=0))] += 0.51
    turned = middle_determinants(mesh, mesh.p) * middle_determinants(mesh, pushed) <= 0
    assert turned.any()
