"""Compliant surfaces of two bodies: Newton is quadratic, stiff surfaces tend to hard contact."""

import numpy as np
import pytest
from posed_pairs import Pose, posed
from skfem import ElementHex1, ElementHex2, ElementQuad1, ElementQuad2, ElementTetP2, ElementTriP2

from contact import PressureOverclosure
from skfem_adini import ElementHexAdini, ElementQuadAdini

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
PLANE = [ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini]
SPACE = [ElementTetP2, ElementHex1, ElementHex2, ElementHexAdini]
elements = pytest.mark.parametrize("element", PLANE + SPACE, ids=lambda e: e.__name__)
LAWS = [("coulomb", 0.0), ("coulomb", 0.8), ("tresca", None)]
laws = pytest.mark.parametrize(("law", "friction"), LAWS)


def solved(element, law, friction, overclosure):
    pose = Pose(np.eye(3 if element in SPACE else 2))
    return posed(element, pose, friction=friction, law=law, overclosure=overclosure)[0].solve()


@pytest.mark.sampled(7)
@laws
@elements
def test_stiff_surfaces_tend_to_hard_contact(element, law, friction):
    """Displacements and pressures differ by a multiple of 1 / stiffness, down to 1e-8."""
    hard = solved(element, law, friction, None)
    stiffness, off, pressure = 10.0 ** np.arange(4, 7), [], []
    for k in [*stiffness, 1e11]:
        soft = solved(element, law, friction, k)
        off.append(np.abs(soft.u - hard.u).max() / np.abs(hard.u).max())
        pressure.append(np.abs(soft.pressure - hard.pressure).max() / hard.pressure.max())
    rate = np.polyfit(np.log(stiffness), np.log(off[:-1]), 1)[0]
    assert -1.01 < rate < -0.99
    assert max(off[-1], pressure[-1]) <= 1e-8


@pytest.mark.sampled(4)
@laws
@elements
def test_newton_is_quadratic(element, law, friction):
    """r_{k+1} <= C r_k^2 on a smooth curve, until rounding."""
    curve = PressureOverclosure.exponential(0.02, 0.02)
    result = solved(element, law, friction, curve)
    r = np.array([line.residual for line in result.history if line.phase.endswith("newton")])
    assert r[-1] <= 1e-12
    assert r.size <= 12
    late = np.flatnonzero((r[:-1] < 1e-3) & (r[1:] > 1e-14))  # no status changes any more
    # In space slip turns: its direction has curvature 1 / |slip|.
    constant = 100.0 if element in SPACE else 10.0
    assert np.all(r[late + 1] <= constant * r[late] ** 2)
    # Every point obeys the curve.
    assert np.abs(curve.pressure(-result.gap) - result.pressure).max() <= 1e-10
