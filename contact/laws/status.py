"""What a contact point does: open, stick or slip."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """State of a contact point.

    ======  =====================================================================
    OPEN    no pressure (Tresca without an obstacle: friction at rest or sliding)
    STICK   in contact, no slip
    SLIP    in contact, the shear is at its bound
    ======  =====================================================================
    """

    OPEN = 0
    STICK = 1
    SLIP = 2
