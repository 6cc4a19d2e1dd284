"""Velocities with free coefficients: sums of B-splines for components or a stream function."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.formula import Formula
from cip.formulas.spline_basis import SplineBasis, SplineFormula, check_pieces
from cip.formulas.velocity import Velocity
from cip.grid import Grid, check_grid
from skfem_adini.ground.arguments import real_array


class SplineVelocity(Velocity):
    r"""A steady velocity made of B-splines, whose coefficients are its named parameters.

    The components, or in two dimensions a stream function :math:`\psi` with
    :math:`c = (\psi_y, -\psi_x)` and so div c = 0, are sums of tensor products of uniform
    B-splines (de Boor 1978, chapters IX and XVII). Splines are nowhere negative and their sum is 1,
    so a component lies between its least and its largest coefficient.

    Parameters
    ----------
    grid : Grid
        Of the solver. The splines live on its box and are periodic where it is.
    pieces : int, or one for each direction
        Number of polynomial pieces; there are never more splines than nodes.
    start : number, callable, array of nodal values, or a sequence of these for each component
        What the splines begin with, fitted by least squares at the nodes; for a stream function
        what this is.
    degree : {5, 3}
        Kinks in the second derivatives of cubic splines cost the characteristics sub-steps.
    stream : bool
        Whether the splines make a stream function, which needs degree 5.

    Attributes
    ----------
    names : tuple of str
        Of the parameters: ``s0, s1, ...``, components one after the other, the last direction
        fastest.

    Raises
    ------
    InputError
        A number of pieces that does not fit the grid, a start of another shape or with NaN, a
        stream function that is cubic or not in two dimensions.

    References
    ----------
    C. de Boor, A Practical Guide to Splines, Springer 1978.

    Examples
    --------
    >>> from cip import Grid, SplineVelocity
    >>> velocity = SplineVelocity(Grid((0, 1), 40, periodic=True), 6, start=1.0)
    >>> velocity.names
    ('s0', 's1', 's2', 's3', 's4', 's5')
    >>> round(velocity.with_parameters(s0=0.5).parameters["s0"], 12)
    0.5
    """

    def __init__(
        self, grid: Grid, pieces: Any, start: Any = 0.0, degree: int = 5, stream: bool = False
    ) -> None:
        check_grid(grid)
        if isinstance(degree, bool) or degree not in (3, 5):
            raise InputError(f"degree: expected 3 or 5, got {degree!r}")
        if stream and grid.dim != 2:
            raise InputError(f"stream: needs a grid of two dimensions, this has {grid.dim}")
        if stream and degree == 3:
            raise InputError(
                "degree: the velocity of a cubic stream function has kinks in its derivatives, "
                "which no characteristics pass accurately; take degree=5"
            )
        super().__init__([0.0] * grid.dim)
        basis = SplineBasis(grid, check_pieces(pieces, grid, degree), int(degree))
        fields = 1 if stream else grid.dim
        self.names = tuple(f"s{k}" for k in range(fields * basis.size))
        fitted = [basis.fit(one, grid) for one in _start(start, grid, fields)]
        numbers = np.concatenate([one.ravel() for one in fitted])
        self._parameters = dict(zip(self.names, map(float, numbers), strict=True))
        # A stream function psi has the velocity (psi_y, -psi_x).
        curl = (((0, 1, 0, 0), 1.0), ((1, 0, 0, 0), -1.0))
        parts = curl if stream else (((0, 0, 0, 0), 1.0),) * grid.dim
        self._formulas = tuple(
            SplineFormula(
                basis,
                self.names[: basis.size] if stream else self.names[q * basis.size :][: basis.size],
                orders,
                sign,
                self._parameters,
            )
            for q, (orders, sign) in enumerate(parts)
        )

    def on(self, grid: Grid) -> tuple[Formula, ...]:
        """One `Formula` for each component; the grid must have the box of the splines."""
        found = super().on(grid)
        basis = found[0].basis if isinstance(found[0], SplineFormula) else None
        if basis is not None and (
            grid.periodic != basis.periodic
            or not np.allclose(grid.bounds, basis.bounds, rtol=1e-9, atol=0.0)
        ):
            raise InputError(
                f"velocity: its splines live on {basis.bounds}, periodic {basis.periodic}, the "
                f"grid is {grid}"
            )
        return found


def _start(start: Any, grid: Grid, fields: int) -> list[np.ndarray[Any, Any]]:
    """The argument `start` as nodal values of each field."""
    several = isinstance(start, list | tuple)
    parts = list(start) if several else [start] * fields
    if len(parts) != fields:
        raise InputError(f"start: expected {fields} fields, got {len(parts)}")
    found = []
    for part in parts:
        values = real_array("start", part(*grid.mesh()) if callable(part) else part).astype(float)
        if values.shape not in ((), grid.nodes):
            raise InputError(
                f"start: expected a number or values of shape {grid.nodes}, got {values.shape}"
            )
        if not np.isfinite(values).all():
            raise InputError("start: expected finite values")
        found.append(np.broadcast_to(values, grid.nodes).astype(float))
    return found
