"""Patch test of two bodies: a uniform pressure is passed on, whatever the meshes and the coverage.

With the exact linear displacement u of a uniform stress and the forces ``w_k p`` at the contact
points, both bodies are in equilibrium: ``S u + G^T mu - f = 0`` at every dof, f being the loads of
all sides that the other body does not cover. Nothing is solved, so no solver can hide an error.
"""

import numpy as np
import pytest
from families import PLANE, PLANE_AND_BFS
from hypothesis import given, settings
from hypothesis import strategies as st
from two_blocks import NU, E, facing, sides, turned

from contact.facet_basis import facet_basis
from contact.rows.mortar.mortar_rows import mortar_rows
from skfem_adini import ElementQuadBFS

PRESSURE = 0.7


def uniform(body, n):
    """Displacement under a uniform pressure along n, free to widen across, shape (ndofs,)."""
    across, along = NU * (1 + NU) / E, -(1 - NU**2) / E
    t = np.array([-n[1], n[0]])
    gradient = PRESSURE * (along * np.outer(n, n) + across * np.outer(t, t))
    dofs, u = body.scalar_dofs, np.zeros(body.basis.N)
    for c in range(2):
        nodal = dofs.nodal_dofs
        u[2 * nodal[0] + c] = gradient[c] @ body.mesh.p
        for k in range(1, min(len(nodal), 3)):
            u[2 * nodal[k] + c] = gradient[c, k - 1]
        for table in (dofs.facet_dofs, dofs.interior_dofs):
            for row in table:
                u[2 * row + c] = gradient[c] @ body.basis.doflocs[:, 2 * row]
    return u


def pressed(body, boundary, n, along, covered):
    """Load of the pressure on the part of a boundary that is not covered, by Gauss points there.

    The parts of a facet before and beyond the covered interval are integrated by themselves.
    """
    f, mesh = np.zeros(body.basis.N), body.mesh
    points, weights = np.polynomial.legendre.leggauss(4)
    for facet in body.facets(boundary):
        a, b = along @ mesh.p[:, mesh.facets[:, facet]]
        cut = np.sort(np.clip((np.array(covered) - a) / (b - a), 0.0, 1.0))
        for low, high in ((0.0, cut[0]), (cut[1], 1.0)):
            if high > low:
                rule = (low + 0.5 * (1 + points) * (high - low))[None], 0.5 * weights * (high - low)
                basis = facet_basis(mesh, body.basis.elem, np.array([facet]), quadrature=rule)
                f += body._load_vector(basis, -PRESSURE * n, "traction")
    return f


def imbalance(pair, boundaries, angle, size, covered, kind):
    """Largest force that is left at a dof, relative to the largest there is."""
    first, _, second, _ = pair
    c, s = np.cos(angle), np.sin(angle)
    n, along = np.array([-s, c]), np.array([c, s])
    found = mortar_rows(*pair, kind)
    mu = PRESSURE * found.rows.weights
    worst = 0.0
    for body, contact, near, far in (
        (first, found.rows.G.T @ mu, *boundaries),
        (second, found.other_G.T @ mu, *boundaries[::-1]),
    ):
        outward = n if near == "top" else -n
        load = pressed(body, near, outward, along, np.array(covered) * size)
        load += pressed(body, far, -outward, along, (1e300, 2e300))
        forces = body.stiffness @ uniform(body, n)
        left = (forces + contact - load) / body.lengths[0]
        worst = max(worst, np.abs(left).max() / np.abs(load / body.lengths[0]).max())
    return worst


@pytest.mark.sampled(9)
@pytest.mark.parametrize("kind", [None, "standard", "hat"])
@pytest.mark.parametrize("multipliers", ["upper", "lower"])
@pytest.mark.parametrize("angle", [0.0, 0.37])
@pytest.mark.parametrize(("n", "m"), [(1, 10), (10, 1), (7, 9), (20, 6)])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_uniform_pressure(element, n, m, angle, multipliers, kind):
    angle = 0.0 if element is ElementQuadBFS else angle
    upper, lower = facing(element, n, m, place=turned(angle))
    ends = ("bottom", "top") if multipliers == "upper" else ("top", "bottom")
    pair = sides(upper, lower, multipliers)
    # 1e-15 of single entries of the stiffness matrix, of condition 1e4 on these cells.
    assert imbalance(pair, ends, angle, 1.0, (0.0, 1.0), kind) < 1e-11


@pytest.mark.turns(4)
@settings(max_examples=40)
@given(
    st.sampled_from(PLANE),
    st.sampled_from(PLANE),
    st.sampled_from([None, "standard", "hat"]),
    st.sampled_from(["upper", "lower"]),
    st.integers(1, 8),
    st.integers(1, 8),
    st.floats(-0.95, 0.95),
    st.floats(-3.0, 3.0),
    st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_partial_coverage(one, two, kind, multipliers, n, m, shift, angle, size):
    """After R. L. Taylor and P. Papadopoulos: the pressure goes on beside the covered part."""
    upper, lower = facing(one, n, m, two, shift, place=turned(angle), size=size)
    ends = ("bottom", "top") if multipliers == "upper" else ("top", "bottom")
    pair = sides(upper, lower, multipliers)
    covered = max(0.0, shift), min(1.0, 1.0 + shift)
    assert imbalance(pair, ends, angle, size, covered, kind) < 1e-11


@pytest.mark.sampled(3)
@pytest.mark.parametrize("part", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("element", PLANE)
def test_slivers(element, part):
    """A facet of which next to nothing is covered, on either side."""
    upper, lower = facing(element, 4, 3, shift=0.75 - part)
    for multipliers, ends in (("upper", ("bottom", "top")), ("lower", ("top", "bottom"))):
        pair = sides(upper, lower, multipliers)
        assert imbalance(pair, ends, 0.0, 1.0, (0.75 - part, 1.0), None) < 1e-11
