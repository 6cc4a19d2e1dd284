"""Random layered problems: contact by transforms beside the sparse body and dense laws.

Planes and space, bilinear elements and Adini's, contrasts up to 1e4, units of length and
modulus over many decades, tops held or loose, obstacles moved or pressed and dragged by forces,
without friction, with Tresca's and Coulomb's, numbers and fields.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from dense_laws import forces_of
from layer_problems import SparseCompliance, random_problem

from contact import NotConverged
from contact.laws.friction import Coulomb, Tresca
from contact.spectral.grid_result import certified


def difference(seed):
    """What a problem is, and how far the forces are from the sparse path's, over the largest.

    None where the dense solvers of the laws give up: then the certificate with the displacements of
    the sparse body, which every problem passes, is the only judge.
    """
    contact, kind = random_problem(seed)
    result = contact.solve()
    sparse = replace(contact, compliance=SparseCompliance.of(contact.compliance))
    problem, coulomb = sparse._case(None).problem(), contact.law == "coulomb"
    friction = contact._friction() * (1.0 if coulomb else result.cell)
    a = -problem.turned(result.motion.reshape(-1, *[1] * (kind["dim"] - 1))).ravel()
    a[np.isnan(problem.force)] = 0.0
    given = contact._controls()[0]
    law = (Coulomb if coulomb else Tresca)(friction)
    certified(problem, law, (result.forces, a), given, 1e-8, ())
    assert max(result.kkt.values()) < 1e-10
    assert result.forces.any()
    try:
        wanted = forces_of(problem, None if kind["law"] == "none" else friction, contact.law)
    except NotConverged:
        return kind, None
    return kind, np.abs(result.forces - wanted).max() / np.abs(wanted).max()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", [65, 1000, 1003, 1006, 1012, 1019, 1013, 1020, 1023])
def test_forces_are_those_of_the_sparse_path(seed):
    assert difference(seed)[1] < 1e-9


def test_given_friction_is_solved_where_newton_cycles():
    seed = 185
    contact, _ = random_problem(seed)
    result = contact.solve()
    assert result.history[-1].phase.startswith("proximal")
    assert difference(seed)[1] < 1e-9


@pytest.mark.slow
def test_three_hundred_problems_and_none_wrong():
    found = Counter()
    for seed in range(300):
        kind, error = difference(seed)
        if error is None:
            found["certificate alone"] += 1
            continue
        assert error < 1e-8, (seed, kind)
        found.update(["compared", *(f"{name} {value}" for name, value in kind.items())])
    assert found["compared"] >= 295
    for feature in ("dim 3", "adini True", "loose True", "law tresca", "law coulomb", "law none"):
        assert found[feature] >= 30
