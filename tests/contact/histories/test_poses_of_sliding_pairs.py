"""A block that slides far on another, both turned, mirrored, rescaled or named in another order."""

import numpy as np
import pytest
from families import PLANE
from posed_pairs import SOFT, STIFF, Pose, body

from contact import ContactProblem, LoadStepper, Pair

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def dragged(element, pose, swap=False):
    """Pressed down, then dragged over several facets and pressed further."""
    upper = body(element, (np.linspace(0.2, 0.8, 6), [0.0, 0.2, 0.4]), STIFF, pose).fix("top")
    lower = body(element, (np.linspace(0, 2, 12), [-0.8, -0.4, 0.0]), SOFT, pose).fix("bottom")
    if swap:
        pair = Pair(lower, "top", upper, "bottom", friction=0.3, multipliers="second")
    else:
        pair = Pair(upper, "bottom", lower, "top", friction=0.3)
    problem = ContactProblem([lower, upper] if swap else [upper, lower], [pair])
    stepper = LoadStepper(problem, sliding="finite")

    def path(t):
        u = np.array([0.3 * max(t - 1, 0.0), -0.02 * min(t, 1.0) - 0.004 * max(t - 1, 0.0)])
        return pose.size * pose.Q @ u

    for c in range(2):
        stepper.move("top", c, 1.0, lambda t, c=c: path(t)[c], body=upper)
    return stepper.run([1.0, 2.0, 3.0, 4.0])


def traction(result):
    rows = result.system.rows
    return np.einsum("mj,djm->dm", result.shear, rows.tangents) - result.pressure * rows.normals


POSES = {
    "turned and moved": (Pose(rotation(2.1), [0.7, -2.0]), False),
    "mirrored": (Pose(np.diag([-1.0, 1.0]) @ rotation(0.4)), False),
    "in millimetres": (Pose(np.eye(2), size=1e3, stress=1e-6), False),
    "in the other order": (Pose(np.eye(2)), True),
}


@pytest.mark.sampled(8)
@pytest.mark.parametrize("element", PLANE, ids=lambda e: e.__name__)
def test_every_step_is_the_same(element):
    expected = dragged(element, Pose(np.eye(2)))
    assert np.abs(expected[-1].shear).max() > 0.1 * expected[-1].pressure.max()
    for pose, swap in POSES.values():
        for found, reference in zip(dragged(element, pose, swap), expected, strict=True):
            at = pose.home(found.x_nominal)
            near = np.abs(at[:, :, None] - reference.x_nominal[:, None]).max(axis=0)
            match = near.argmin(axis=0)
            assert near.min(axis=0).max() <= 1e-9
            off = traction(found)[:, match] / pose.stress - pose.Q @ traction(reference)
            # Newton's tolerance is that of the forces as a whole.
            assert np.abs(off).max() <= 1e-8 * reference.pressure.max()
            np.testing.assert_array_equal(found.status[match], reference.status)
            assert max(found.kkt.values()) <= 1e-10
