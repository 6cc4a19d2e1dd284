"""Warning if the sagitta of straight facets that approximate a curve affects the pressures."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from contact.arrays.blas_threads import one_blas_thread
from contact.errors import ContactError, warn
from contact.laws.methods import solve_boundary
from contact.laws.options import Options
from contact.problem.nested_start import start_forces

if TYPE_CHECKING:
    from contact.condensation.condensed_contact import CondensedContact
    from contact.result.contact_result import ContactResult

Array = NDArray[np.float64]


def warn_of_sagitta(
    result: ContactResult, rise: Array, condensed: CondensedContact, options: Options
) -> None:
    """Warn (ContactWarning) if pressures on a polygon and on its curve differ by a tenth (rms).
    The middle of a facet of length h lies h^2 / 8R below the curve, the mean gap is off by 2/3 of
    that: the problem is solved again with the gaps of the curve, by `rise` (m,) of `GapRule`."""
    system, body = result.system, result.system.body
    # A smaller difference is rounding of the coordinates.
    if np.abs(rise).max(initial=0.0) <= 1e-14 * body.extent:
        return
    scale, w = condensed.point_scale, system.rows.weights
    friction = system.scaled_friction(scale)
    # If the problem with the curve has no solution, there is nothing to compare with.
    with suppress(ContactError, LinAlgError), condensed.blas_threads():
        boundary = condensed.boundary_problem(
            system.load, system.rows.gap + rise, system.slip_from, system.motion
        )
        boundary = replace(boundary, compliance=system.compliance(scale))
        start = start_forces(result, system, boundary, scale)
        with one_blas_thread(condensed.size):
            forces, _ = solve_boundary(boundary, friction, options, start, scale, lambda line: None)
        pressure = np.where(system.rows.ties, 0.0, forces.mu / scale / w)
        size = float(np.linalg.norm(np.sqrt(w) * pressure))
        change = float(np.linalg.norm(np.sqrt(w) * (pressure - result.pressure)))
        # The rms error of the pressures.
        if change <= 0.1 * size or not max(change, size) > 0:
            return
        off = change / size if size > 0 else np.inf
        # Where the curve touches and the polygon does not, the error is estimated by the rise
        # relative to the overlap.
        pressed = boundary.W @ boundary.forces(forces.mu, np.zeros_like(forces.t))
        live = np.flatnonzero((forces.mu > 0) & (boundary.normal >= 0))
        overlap = np.linalg.norm(pressed[boundary.normal[live]])
        missing = np.linalg.norm((rise / scale)[live])
        # The warning recommends facets with an error of 5 %.
        shorter = np.sqrt(max(min(off, 1e4), missing / overlap if overlap > 0 else 0.0) / 0.05)
        found = f"are {off:.0%} off" if size > 0 else "should be zero"
        warn(
            f"the pressures {found} if the contact boundary stands for a curve: its straight "
            f"facets lie up to {1.5 * np.abs(rise).max():.2g} beside it, too much for what they "
            "overlap the obstacle; take cells of second order (MeshQuad2, MeshTri2, ...), facets "
            f"{np.ceil(shorter):.0f} times as many along the curve, or give the gap at the "
            "vertices as a number or an array"
        )
