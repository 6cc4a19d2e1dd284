"""Newton's method for friction solves for the live components of points alone."""

import numpy as np
import pytest

from contact import GridContact, HalfSpace, Parabola, Rigid
from contact.spectral import friction_newton


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_krylov_vectors_hold_what_is_live(law, monkeypatch):
    sizes, solve = [], friction_newton.gmres

    def watched(product, right, *arguments, **options):
        sizes.append(right.size)
        assert product(np.ones_like(right)).size == right.size
        return solve(product, right, *arguments, **options)

    monkeypatch.setattr(friction_newton, "gmres", watched)
    ball = Rigid(Parabola((0.5, 0.5, 0.0), 2.0), (2e-3, 0.0, None), force=(None, None, 1e-3))
    friction = 0.3 if law == "coulomb" else 1e-3
    result = GridContact(HalfSpace((1.0, 1.0), (32, 32), 1.0, 0.3), ball, friction, law).solve()
    near = 1.5 * np.count_nonzero(result.pressure)
    # Tresca's bound acts on every point, and the free motion of the ball is an unknown.
    most = 3 * near + 1 if law == "coulomb" else 2 * 32**2 + near + 1
    assert sizes
    assert max(sizes) <= most
    assert min(sizes) > 3 if law == "coulomb" else 2 * 32**2
