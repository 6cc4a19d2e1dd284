"""Contact patch test: a uniform pressure on a graded mesh is reproduced, whatever the cells."""

import copy

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)

from contact import ContactProblem, ElasticBody
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

E, NU, PRESSURE = 2.0, 0.3, 1.0
PASSES = [
    (ElementQuadAdini, "bernstein"),
    (ElementQuadAdini, "gauss"),
    (ElementQuadAdini, "centroid"),
    (ElementQuadBFS, "bernstein"),
    (ElementQuadBFS, "gauss"),
    (ElementQuadBFS, "centroid"),
    (ElementTriP1, "nodal"),
    (ElementQuad1, "nodal"),
    (ElementTriP2, "bernstein"),
    (ElementTriP2, "gauss"),
    (ElementQuad2, "bernstein"),
    (ElementQuad2, "gauss"),
    (ElementTetP1, "nodal"),
    (ElementTetP2, "bernstein"),
    (ElementHex1, "nodal"),
    (ElementHex2, "bernstein"),
    (ElementHex2, "gauss"),
    (ElementHexAdini, "centroid"),
]
HERMITE = (ElementQuadAdini, ElementQuadBFS, ElementHexAdini)


_BODIES = {}


def graded(make, element, plane, distorted):
    """The block on a graded mesh, built once."""
    key = element, plane, distorted
    if key in _BODIES:
        return _BODIES[key]
    dim = element().dim
    ticks = make.graded if dim == 2 else make.graded[[0, 2, 3, 5, 7]]
    mesh = make.box(element, *(ticks,) * dim)
    if distorted:
        inside = np.all((mesh.p > 0) & (mesh.p < 1), axis=0)
        shake = np.random.default_rng(4).uniform(-1, 1, mesh.p.shape)
        mesh = make.remesh(mesh, mesh.p + 0.015 * shake * inside)
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=NU, plane=plane)
    _BODIES[key] = body
    return body


def squeezed(make, element, functional, plane="strain", distorted=False, **law):
    """Block on a flat rigid foundation that touches it at rest, under a uniform pressure."""
    body = copy.deepcopy(graded(make, element, plane, distorted))
    dim = body.dim
    body.fix("left", "x").load("top", -PRESSURE * np.eye(dim)[-1])
    if dim == 3:
        body.fix("front", "y")
    return ContactProblem(body, "bottom", 0.0, functional=functional, **law)


def exact(x, plane="strain"):
    """Displacement at points x of a block that is free to widen."""
    if x.shape[0] == 2 and plane == "strain":
        across, down = NU * (1 + NU) * PRESSURE / E, (1 - NU**2) * PRESSURE / E
    else:
        across, down = NU * PRESSURE / E, PRESSURE / E
    factors = np.full(x.shape[0], across)
    factors[-1] = -down
    return factors[:, None] * x


def errors(result, plane="strain"):
    """Of the pressure at all points and of the displacement in the quadrature points."""
    basis = result.system.body.basis
    expected = exact(np.asarray(basis.global_coordinates()).reshape(basis.mesh.dim(), -1), plane)
    found = np.asarray(basis.interpolate(result.u)).reshape(expected.shape)
    return (
        np.abs(result.pressure - PRESSURE).max() / PRESSURE,
        np.abs(found - expected).max() / np.abs(expected).max(),
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "functional"), PASSES)
def test_uniform_pressure(element, functional, make):
    pressure, displacement = errors(squeezed(make, element, functional).solve())
    # One factorisation of a matrix of condition 1e4.
    assert pressure < 1e-12
    assert displacement < 1e-12


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementTriP2, ElementQuad1])
def test_plane_stress(element, make):
    pressure, displacement = errors(squeezed(make, element, None, "stress").solve(), "stress")
    # One factorisation of a matrix of condition 1e4.
    assert pressure < 1e-12
    assert displacement < 1e-12


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "functional"), [p for p in PASSES if p[0] not in HERMITE])
def test_distorted_cells(element, functional, make):
    """Isoparametric families contain the affine fields on any mesh, hence the solution."""
    pressure, displacement = errors(squeezed(make, element, functional, distorted=True).solve())
    # One factorisation of a matrix of condition 1e4.
    assert pressure < 1e-12
    assert displacement < 1e-12


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("element", "functional"), PASSES)
def test_with_sliding_friction(element, functional, make):
    """Dragged along x by its top, with friction F below: a uniform shear F p besides."""
    F, dim = 0.05, element().dim
    ticks = make.graded if dim == 2 else make.graded[[0, 2, 3, 5, 7]]
    body = ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=E, nu=NU)
    up = np.eye(dim)[-1]
    body.load("top", -PRESSURE * up)
    body.load("right", F * PRESSURE * up).load("left", -F * PRESSURE * up)  # conjugate shears
    angle = 2 * F * PRESSURE * (1 + NU) / E  # engineering shear strain
    widening = exact(np.eye(2)[:, :1])[0, 0]
    body.fix("top", "x", lambda x: 1.0 + angle + widening * x[0])
    if dim == 3:
        body.fix(["front", "back"], "y")  # plane strain: slip along x alone
    result = ContactProblem(body, "bottom", 0.0, F, functional=functional).solve()
    points = np.random.default_rng(1).uniform(0, 1, (dim, 200))
    expected = np.zeros_like(points)
    expected[[0, -1]] = exact(points[[0, -1]])
    expected[0] += 1.0 + angle * points[-1]
    # Newton's own tolerance, 1e-12 of forces that a slide of one would cause.
    assert np.abs(result.pressure - PRESSURE).max() < 1e-10
    along = np.einsum("mj,djm->dm", result.shear, result.system.rows.tangents)
    assert np.abs(along + F * PRESSURE * np.eye(dim)[:, :1]).max() < 1e-10
    assert np.abs(result.sample(points) - expected).max() < 1e-12


def test_nodal_rows_of_adini_fail(make):
    """Nodal forces cannot carry a uniform pressure to the slope dofs (28 % here)."""
    pressure, displacement = errors(squeezed(make, ElementQuadAdini, "nodal").solve())
    assert pressure > 0.1
    assert displacement > 0.01
