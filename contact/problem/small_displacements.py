"""Warning if displacements are too large for the theory of small displacements."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from contact.errors import ContactWarning

if TYPE_CHECKING:
    from contact.result.contact_state import ContactState


def warn_of_large_displacements(state: ContactState) -> None:
    """Warn if displacements exceed the size of the body: the linear theory is then invalid.

    Displacements that the supports prescribe are intended: twice the largest is allowed besides.
    """
    body = state.system.body
    size = body.extent
    reach = body.reach(state.u)
    if reach > size and reach > size + 2.0 * body.reach(body.constraint[1]):
        warnings.warn(
            f"displacements reach {reach:.3g}, {reach / size:.3g} times the size of the body: the "
            "theory is that of small displacements; check the units of E and of the loads, the "
            "place of the obstacle, and what holds the body",
            ContactWarning,
            stacklevel=2,
        )
