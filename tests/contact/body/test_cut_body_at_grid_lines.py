"""A block whose flat side cuts its cells anywhere, pressed on a plane: uniform pressure."""

import numpy as np
import pytest
from skfem import MeshQuad

from contact import ContactProblem, CutBody, Plane


@pytest.mark.parametrize("e", [0.0, 1e-12, 1e-8, 1e-4, 1e-3, 0.01, 0.03, 0.0624, 0.1249])
def test_pressure_is_uniform_wherever_the_side_lies(e):
    """Without Poisson's effect it is E times the shortening over the height."""
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 9)] * 2).with_defaults()
    bottom = 0.25 - e
    body = CutBody(mesh, lambda x: bottom - x[1], E=1.0, nu=0.0)
    body.fix("top", "x").fix("top", "y", -0.01)
    P = body.constraint[0]
    A = (P.T @ body.stiffness @ P).toarray()
    scale = 1 / np.sqrt(A.diagonal())
    assert np.linalg.eigvalsh(scale[:, None] * A * scale)[0] > 1e-3
    plane = Plane((0.0, bottom), (0.0, 1.0))
    result = ContactProblem(body, body.arc(), plane, friction=0.3).solve()
    np.testing.assert_allclose(result.pressure, 0.01 / (1 - bottom), rtol=1e-10)
