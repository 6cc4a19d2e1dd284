"""The closed form against elements derived symbolically from the degrees of freedom."""

import numpy as np
import pytest
import sympy
from skfem import MeshQuad
from symfem.finite_element import CiarletElement
from symfem.functionals import DerivativePointEvaluation, PointEvaluation
from symfem.references import Quadrilateral

from skfem_adini import ElementQuadAdini

X, Y = sympy.symbols("x y")
SPACE = [X**i * Y**j for i in range(4) for j in range(4 - i)] + [X**3 * Y, X * Y**3]
POINTS = [(sympy.Rational(a, 7), sympy.Rational(b, 5)) for a in range(8) for b in range(6)]


def test_reference_functions_equal_symfem():
    reference = Quadrilateral()
    dofs = []
    vertices = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for point in vertices:
        entity = (0, reference.vertices.index(point))
        dofs.append(PointEvaluation(reference, point, entity=entity))
        for derivative in ((1, 0), (0, 1)):
            dofs.append(DerivativePointEvaluation(reference, point, derivative, entity=entity))
    oracle = CiarletElement(reference, 3, SPACE, dofs, 2, 1).get_basis_functions()

    points = np.array(POINTS, dtype=float)
    for i, function in enumerate(oracle):
        expression = function.as_sympy()
        value, gradient = ElementQuadAdini().lbasis(points.T, i)
        for computed, exact in (
            (value, expression),
            (gradient[0], sympy.diff(expression, X)),
            (gradient[1], sympy.diff(expression, Y)),
        ):
            expected = [float(exact.subs({X: a, Y: b})) for a, b in POINTS]
            np.testing.assert_allclose(computed, expected, rtol=0, atol=1e-14)


CELLS = {
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "clockwise": [(0, 0), (0, 2), (1, 2), (1, 0)],
    "sheared": [(1, 1), (3, 2), (4, 4), (2, 3)],
    "trapezoid": [(0, 0), (2, 0), (1, 1), (0, 1)],
    "convex": [(0, 0), (3, -1), (4, 3), (1, 2)],
}


def symbolic_functions(corners):
    """Solve for the dual basis of physical values and gradients in exact arithmetic."""
    p = [sympy.Matrix(corner) for corner in corners]
    F = p[0] * (1 - X) * (1 - Y) + p[1] * X * (1 - Y) + p[2] * X * Y + p[3] * (1 - X) * Y
    to_physical = F.jacobian([X, Y]).T.inv()
    rows = []
    for a, b in CELLS["square"]:
        at = {X: a, Y: b}
        gradients = [
            to_physical.subs(at) * sympy.Matrix([m.diff(X), m.diff(Y)]).subs(at) for m in SPACE
        ]
        rows += [[m.subs(at) for m in SPACE], *([g[k] for g in gradients] for k in range(2))]
    functions = sympy.Matrix(rows).inv().T * sympy.Matrix(SPACE)
    gradients = [to_physical * sympy.Matrix([f.diff(X), f.diff(Y)]) for f in functions]
    return functions, gradients


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CELLS)
def test_physical_functions_equal_the_symbolic_dual_basis(name):
    corners = CELLS[name]
    mapping = MeshQuad(np.array(corners, float).T, np.array([[0, 1, 2, 3]]).T)._mapping()
    points = np.array(POINTS, dtype=float).T
    functions, gradients = symbolic_functions(corners)
    for i in range(12):
        (field,) = ElementQuadAdini().gbasis(mapping, points, i)
        for computed, exact in (
            (np.array(field), functions[i]),
            (field.grad[0], gradients[i][0]),
            (field.grad[1], gradients[i][1]),
        ):
            evaluate = sympy.lambdify((X, Y), sympy.nsimplify(exact))
            expected = [float(evaluate(a, b)) for a, b in POINTS]
            np.testing.assert_allclose(computed[0], expected, rtol=0, atol=2e-14)
