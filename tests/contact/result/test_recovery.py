"""Stresses at vertices and in cells, centre of pressure, and their export."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementHex2, ElementQuad1, ElementTetP2, ElementTriP2

from contact import ContactProblem, ElasticBody, Rigid
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

PLANAR = [ElementQuadAdini, ElementQuadBFS, ElementTriP2, ElementQuad1]
ELEMENTS = [*PLANAR, ElementHex1, ElementHex2, ElementTetP2, ElementHexAdini]


def squeezed(make, element, plane="strain"):
    """A block on a flat foundation under a uniform pressure of one: uniform stress."""
    dim = element().dim
    ticks = make.graded if dim == 2 else make.graded[[0, 3, 5, 7]]
    mesh = make.box(element, *(ticks,) * dim)
    body = ElasticBody.from_mesh(mesh, element(), E=2.0, nu=0.3, plane=plane)
    body.fix("left", "x").load("top", -np.eye(dim)[-1])
    if dim == 3:
        body.fix("front", "y")
    return ContactProblem(body, "bottom", 0.0).solve()


@pytest.mark.parametrize("element", ELEMENTS)
def test_uniform_stress(element, make):
    result = squeezed(make, element)
    dim = result.x.shape[0]
    expected = np.zeros((3, 3))
    expected[dim - 1, dim - 1] = -1.0
    if dim == 2:
        expected[2, 2] = -0.3  # of plane strain
    for found in (result.nodal_stress(), result.cell_stress()):
        assert found.shape[:2] == (3, 3)
        # One factorisation of a matrix of condition 1e4.
        assert np.abs(found - expected[:, :, None]).max() < 1e-10
    np.testing.assert_allclose(result.centre_of_pressure[0, : dim - 1], 0.5, rtol=1e-10)
    grid = result.to_pyvista()
    assert np.abs(grid.point_data["nodal_stress"][:, 4 * (dim - 1)] + 1.0).max() < 1e-9
    # sqrt(1 - .3 + .09) in plane strain, one in 3-D.
    mises = np.sqrt(0.79) if dim == 2 else 1.0
    np.testing.assert_allclose(grid.point_data["nodal_von_mises"], mises, rtol=1e-9)
    assert {"displacement", "nodal_stress"} <= set(grid.point_data)
    assert f"stress_{'xyz'[dim - 1] * 2}" in grid.cell_data
    if dim == 2:  # none across
        thin = squeezed(make, element, "stress")
        assert not np.any(thin.nodal_stress()[2, 2])
        assert not np.any(thin.cell_stress()[2, 2])


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementTriP2, ElementHex1])
def test_centre_of_pressure_balances_the_moment(element, make):
    """A stamp with an eccentric force and free to tilt: the pressure's centre is the force's."""
    dim = element().dim
    ticks = np.linspace(0, 1, 7 if dim == 2 else 5)
    body = ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=2.0, nu=0.3)
    body.fix("top")
    place = np.array([0.45, 0.6, 0.0])[[0, 2]] if dim == 2 else np.array([0.45, 0.6, 0.0])
    force = [None] * (dim - 1) + [0.2]
    moment = 0.0 if dim == 2 else (0.0, 0.0, None)
    stamp = Rigid(0.0, force=force, moment=moment, centre=place)
    result = ContactProblem(body, "bottom", stamp).solve()
    np.testing.assert_allclose(result.centre_of_pressure[0], place, atol=1e-9)


def test_many_points_at_once(make):
    """Points are located in parts: each value is that of the point alone, wherever it lies."""
    apart = ContactProblem(make.block(4), "bottom", 10.0).solve()
    assert np.all(np.isnan(apart.centre_of_pressure))
    _, result = make.solved()
    points = np.random.default_rng(8).uniform(0.01, 0.99, (2, 250))
    together, displaced = result.stress(points), result.sample(points)
    for i in (0, 99, 100, 125, 249):
        alone = points[:, i : i + 1]
        # Rounding alone.
        np.testing.assert_allclose(together[..., i : i + 1], result.stress(alone), atol=1e-13)
        np.testing.assert_allclose(displaced[:, i : i + 1], result.sample(alone), atol=1e-13)
