"""Velocities from scikit-fem solutions: what a grid gets of them, divergence, coasts, time."""

import pickle
import warnings

import numpy as np
import pytest
import skfem

from cip import DivergenceWarning, Grid, Solver, Velocity

PLANE, SPACE = Grid([(0, 1)] * 2, (16, 12)), Grid([(0, 1)] * 3, (8, 7, 6))
TRI, QUAD = skfem.MeshTri().refined(3), skfem.MeshQuad().refined(3)


def parabolas(x):
    return np.stack([x[0] ** 2, -2 * x[0] * x[1]])


def dilation(x):
    return np.stack([1 + 2 * x[0], 3 + 2 * x[1]])


def shears(x):
    return np.stack([x[0] + 2 * x[1], -2 * x[1], x[2] + x[0]])


def basis_of(mesh, element, vector=True):
    return skfem.Basis(mesh, skfem.ElementVector(element) if vector else element)


@pytest.mark.parametrize(
    ("mesh", "element", "field", "divergence"),
    [
        (TRI, skfem.ElementVector(skfem.ElementTriP2()), parabolas, 0.0),
        (skfem.MeshTri2.from_mesh(TRI), skfem.ElementVector(skfem.ElementTriP2()), parabolas, 0.0),
        (QUAD, skfem.ElementVector(skfem.ElementQuad2()), parabolas, 0.0),
        (TRI, skfem.ElementTriRT0(), dilation, 4.0),
        (QUAD, skfem.ElementQuadRT0(), dilation, 4.0),
        (skfem.MeshTet().refined(1), skfem.ElementVector(skfem.ElementTetP1()), shears, 0.0),
        (skfem.MeshHex().refined(1), skfem.ElementVector(skfem.ElementHex1()), shears, 0.0),
        (skfem.MeshWedge1(), skfem.ElementVector(skfem.ElementWedge1()), shears, 0.0),
    ],
    ids=lambda one: type(one).__name__ + getattr(one, "__name__", ""),
)
def test_polynomials_of_an_element_are_the_velocity(mesh, element, field, divergence):
    basis = skfem.Basis(mesh, element)
    grid = PLANE if mesh.p.shape[0] == 2 else SPACE
    velocity = Velocity.from_basis(basis, basis.project(field), grid)
    points = np.random.default_rng(2).random((grid.dim, 40))
    padded = [*points, *np.zeros((4 - grid.dim, 40))]
    for component, expected in zip(velocity.on(grid), field(points), strict=True):
        found = component.derivative((0, 0, 0, 0), (1.0,) * 4)(*padded)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert velocity.error < 1e-12
    assert abs(velocity.divergence - divergence) < 1e-11
    assert abs(velocity.divergence_of_solution - divergence) < 1e-11
    assert velocity.land is None


def test_error_and_divergence_shrink_with_the_grid():
    """On one mesh whose solution is a smooth polynomial, at the spline's orders 6 and 5."""
    basis = basis_of(skfem.MeshQuad().refined(5), skfem.ElementQuad2())
    u = basis.project(lambda x: np.stack([np.sin(3 * x[1] + x[0]), np.cos(2 * x[0])]))
    exact, n = np.cos(1.5), np.array([8, 12, 16])
    found = [Velocity.from_basis(basis, u, Grid([(0, 1)] * 2, (k, k))) for k in n]
    # The mesh's own error, of order 3, is below the grid's here.
    orders = np.polyfit(np.log(n), np.log([one.error for one in found]), 1)[0]
    assert -7.0 < orders < -3.5
    assert abs(found[-1].divergence - found[-1].divergence_of_solution) < 5e-3 * exact


@pytest.mark.turns(4)
def test_stream_function_has_no_divergence():
    """A uniform field stays uniform as far as the grid resolves the velocity: much better than with
    components of the same accuracy, one degree lower."""
    mesh, grid = skfem.MeshTri().refined(4), Grid([(0, 1)] * 2, (24, 24))
    scalar = basis_of(mesh, skfem.ElementTriP2(), False)
    vector = basis_of(mesh, skfem.ElementTriP1())

    def psi(x):
        return np.sin(np.pi * x[0]) ** 2 * np.sin(np.pi * x[1]) ** 2 / np.pi

    def rotated(x):
        a, b = np.pi * x
        return np.stack([np.sin(a) ** 2 * np.sin(2 * b), -np.sin(2 * a) * np.sin(b) ** 2])

    stream = Velocity.from_basis(scalar, scalar.project(psi), grid, stream=True)
    with pytest.warns(DivergenceWarning, match="stream=True"):
        sampled = Velocity.from_basis(vector, vector.project(rotated), grid)
    assert stream.divergence < 1e-12 < 0.5 < sampled.divergence
    change = []
    for velocity in (stream, sampled):
        solver = Solver(grid, velocity, "advection", "csl4", boundary=1.0)
        start = solver.state(1.0)
        change.append(np.abs(solver.run(start, 0.4, dt=0.02).final["mean"] - 1).max())
    assert change[0] < 0.2 * change[1]
    assert change[1] < np.expm1(0.4 * sampled.divergence)
    x = np.array([[0.3], [0.6]])
    found = [c.derivative((0,) * 4, (1.0,) * 4)(*x, 0.0, 0.0) for c in stream.on(grid)]
    np.testing.assert_allclose(found, rotated(x), atol=0.02)


@pytest.mark.turns(4)
def test_outside_is_land():
    """A disc in a box: its area, and the flow that does not leave it."""
    basis = basis_of(skfem.MeshTri.init_circle(4), skfem.ElementTriP2(), False)
    grid = Grid([(-1.2, 1.2)] * 2, (48, 48))
    psi = basis.project(lambda x: np.maximum(0, 1 - x[0] ** 2 - x[1] ** 2) ** 3)
    velocity = Velocity.from_basis(basis, psi, grid, stream=True, outside="land")
    assert abs((~velocity.land).sum() * 0.05**2 - np.pi) < 0.05
    more = {"boundary": "closed", "land": velocity.land}
    solver = Solver(grid, velocity, "advection", "csl4", **more)
    start = solver.state("exp(-8*(x1 - 0.4)**2 - 8*x2**2)")
    end = solver.run(start, 1.0, dt=0.05).final
    assert abs(end.mass - start.mass) < 1e-13
    assert (end["mean"][velocity.land] == 0).all()
    assert np.abs(end["mean"] - start["mean"]).max() > 0.1


def test_in_time_it_is_the_snapshots():
    basis = basis_of(TRI, skfem.ElementTriP2())
    u = basis.project(parabolas)
    times = [0.0, 0.4, 1.0]
    velocity = Velocity.from_basis(basis, [u, 2 * u, 4 * u], PLANE, times=times)
    nodes = parabolas(np.stack(PLANE.mesh()))
    expected = Velocity.from_snapshots(times, np.multiply.outer([1, 2, 4], nodes), PLANE)
    point = (np.array([0.2, 0.7]), np.array([0.5, 0.1]), np.zeros(2), 0.3)
    for one, other in zip(velocity.on(PLANE), expected.on(PLANE), strict=True):
        found, same = (f.derivative((0, 1, 0, 0), (1.0,) * 4)(*point) for f in (one, other))
        np.testing.assert_allclose(found, same, rtol=0, atol=1e-12)
    assert not velocity.steady


def test_it_is_pickled_without_the_mesh():
    basis = basis_of(TRI, skfem.ElementTriP1(), False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        velocity = Velocity.from_basis(basis, basis.project(lambda x: x[0]), PLANE, stream=True)
    text = pickle.dumps(velocity)
    assert b"skfem.mesh" not in text
    again = pickle.loads(text)
    for solver in (Solver(PLANE, one, boundary=0.0) for one in (velocity, again)):
        end = solver.step(solver.state("x1 + 2*x2"), 0.1)  # psi = x1 is the velocity (0, -1)
        np.testing.assert_allclose(
            end["u"][:, :10], (PLANE.mesh()[0] + 2 * PLANE.mesh()[1] + 0.2)[:, :10]
        )
