"""What a step did to its surfaces: jumps of adhesion, and deep wear."""

from __future__ import annotations

from typing import Any

import numpy as np

from contact.errors import JumpWarning, warn
from contact.laws.adhesion import COARSE, MOST_RAMP, Adhesion

Array = Any
DEEP = 0.5  # worn depth over the spacing of contact points that causes a warning


def jump_between(touched: Array, was: Array, touches: Array, gap: Array, reach: float) -> str:
    """Which instability a step passed: more than half of the points in contact were beyond the
    reach of adhesion before ("contact"), or are beyond it now ("pull-off"); empty for neither."""
    if touched.any() and (gap[touched] > reach).mean() > 0.5:
        return "pull-off"
    return "contact" if touches.any() and (was[touches] > reach).mean() > 0.5 else ""


def warn_of_coarse(ramps: Array | None, gap: Array, law: Adhesion) -> None:
    """Warn (ContactWarning) where points part that are too far apart for any ramp."""
    if ramps is not None and np.any((ramps > COARSE) & (np.abs(gap / law.range - 1.0) < MOST_RAMP)):
        warn(
            "adhesion: the contact points are too far apart for this tension: at the edge of the "
            "contact they let go one by one, and the force is that of a lattice; refine there, or "
            "take less tension at the same work, which hardly changes the forces of soft bodies "
            "(JKR), or give a ramp and accept it"
        )


def warn_of_jump(jump: str) -> None:
    """Warn (JumpWarning) in words."""
    if jump:
        event = "pulled off" if jump == "pull-off" else "jumped into contact"
        warn(
            f"adhesion: the surfaces {event} within this step, which passed an instability or was "
            "too long to follow the path; take smaller steps before it to resolve the force there",
            JumpWarning,
        )


def warn_of_wear(worn: Array, cell: float) -> None:
    """Warn (ContactWarning) where wear passes a share of the spacing of contact points."""
    deepest = float(np.max(worn, initial=0.0))
    if deepest > DEEP * cell:
        warn(
            f"wear: the worn depth reaches {deepest:.3g}, more than {DEEP:g} of the spacing of the "
            f"contact points, {cell:.3g}: the body is computed in its first shape; mesh the worn "
            "one, and go on from there"
        )
