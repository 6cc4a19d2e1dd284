"""Contact points of which supports move one tangential component, without condensation."""

from typing import Any

import numpy as np
import pytest
from skfem import MeshHex

from contact import ContactProblem, DistributedBody, InputError, Plane
from contact.condensation import primal


def problem(side: float, backend: str) -> ContactProblem:
    mesh = MeshHex.init_tensor(*[np.linspace(0, 1, 4)] * 3).with_defaults()
    body: Any = DistributedBody(mesh, contact="front", E=1.0, nu=0.3, backend=backend)
    body = body.fix("back", "xy").fix("back", "z", -0.02).fix("front", "x", side)
    return ContactProblem(body, "front", Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), friction=0.3)


def test_moved_in_one_direction_and_free_in_the_other_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is refused before multigrid, which needs PETSc, is asked."""
    monkeypatch.setattr(primal, "AlteredSystem", lambda *args, **kwargs: None)
    with pytest.raises(InputError, match=r"^supports: one tangential .*backend='mumps'"):
        problem(0.01, "krylov").solve()
    condensed = problem(0.01, "mumps").solve()
    assert condensed.resultant[2] > 0
