"""Accuracy and conditioning do not depend on how the boundary cuts the cells."""

import numpy as np
import pytest
from skfem import Basis

from skfem_adini import AdiniExtension, ElementQuadAdini, ghost_penalty, lowest_eigenpairs

N = 16


def configurations(shifts, slivers):
    """Centres and radii: random shifts, and disks that poke eps h across a grid line."""
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-0.5 / N, 0.5 / N, (shifts, 2)):
        yield 0.5 + x, 0.5 + y
    for power in np.linspace(-12, -1, slivers):
        for turn in (0, 1):
            # The rightmost (topmost) point lies eps h beyond the grid line at 14/16.
            offset = 0.875 - 0.411 + 10.0**power / N
            yield (offset, 0.5) if turn == 0 else (0.5, offset)


def scaled_spectrum(A):
    scale = 1 / np.sqrt(A.diagonal())
    return np.linalg.eigvalsh((A.multiply(scale).multiply(scale[:, None])).toarray())


def run(cut_problems, shifts, slivers):
    mesh, element = cut_problems.unit_square(N), ElementQuadAdini()
    basis = Basis(mesh, element, intorder=1)
    exact = cut_problems.disk_eigenvalues(1)[0]
    errors, conditions = {"extension": [], "ghost": []}, {"extension": [], "ghost": []}
    for cx, cy in configurations(shifts, slivers):

        def level_set(x, cx=cx, cy=cy):
            return (x[0] - cx) ** 2 + (x[1] - cy) ** 2 - cut_problems.R**2

        domain, K, M, B = cut_problems.matrices(mesh, level_set, q=5)
        active = domain.active_dofs(basis)
        ghost = [
            (A + ghost_penalty(domain, element, matrix=kind)).tocsr()[active][:, active]
            for A, kind in ((K + B, "stiffness"), (M, "mass"))
        ]
        extension = AdiniExtension(basis, domain).apply(K + B, M)
        for name, (A, mass) in (("extension", extension), ("ghost", ghost)):
            spectrum = scaled_spectrum(A)
            assert spectrum[0] > 0, (name, cx, cy)
            conditions[name].append(spectrum[-1] / spectrum[0])
            value = lowest_eigenpairs(A, mass, 1, shift=0.0)[0][0]
            errors[name].append(abs(value / exact - 1))
    return errors, conditions


def check(errors, conditions):
    for found in errors.values():
        assert max(found) <= 1.2 * min(found)
        assert max(found) <= 2.5e-7
    assert max(conditions["extension"]) <= 6e4
    assert max(conditions["ghost"]) <= 4e3


@pytest.mark.turns(4)
def test_some_shifts_and_slivers(cut_problems):
    check(*run(cut_problems, 3, 2))


@pytest.mark.slow
def test_two_hundred_shifts_and_fifty_slivers(cut_problems):
    check(*run(cut_problems, 200, 25))
