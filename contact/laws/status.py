"""States of a contact point; `contact.result.contact_forces` decides which one holds."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """State of a contact point.

    ============  ===================================================================
    OPEN          no pressure (Tresca without an obstacle: friction at rest or sliding)
    STICK         in contact, no slip
    SLIP          in contact, the shear is at its bound
    BONDED        tied to the obstacle: forces of either sign, no friction
    UNDETERMINED  in contact, held by supports at no slip: the shear may be anything up
                  to its bound, cannot be told apart from the reactions of the
                  supports, and counts as part of these; it is reported as zero
    ============  ===================================================================

    Attributes
    ----------
    OPEN, STICK, SLIP, BONDED, UNDETERMINED : Status
        Integers 0, 1, 2, 3 and 4, as `ContactResult.status` holds them.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    >>> problem = ContactProblem(body, "bottom", 0.0, friction=0.3)
    >>> from contact import Status
    >>> status = problem.solve().status
    >>> status.shape, bool((status == Status.OPEN).any())
    ((9,), False)
    """

    OPEN = 0
    STICK = 1
    SLIP = 2
    BONDED = 3
    UNDETERMINED = 4
