r"""Diffusion of all moments on uniform grids, exact in time at any diffusion number.

Values, derivatives and means of a field all solve :math:`m_t = \kappa \Delta m`, so each is
convolved with the kernel of its grid: in Fourier space a product with
:math:`e^{-\kappa s(\theta) \tau / h^2}`, after reflection at walls, through which nothing diffuses
(Strang, SIAM Review 41, 1999, 135-147). :math:`s = \theta^2` is exact for what the grid resolves;
the second difference :math:`s = 2 - 2 \cos\theta` has a kernel without negative values.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.errors import InputError, NotSupported
from cip.grid import AXES, Grid
from cip.profiles.catalogue import moments
from skfem_adini.ground.arguments import real_array


class Diffusion:
    """Constant coefficients `rates`, length^2 / time, one for each direction; as part of a step it
    is called like a `Reaction` without parameters. `positive`: by the second difference."""

    parameters = source_parameters = decay_parameters = ()

    def __init__(
        self, grid: Grid, profile: str, rates: tuple[float, ...], positive: bool, xp: Any
    ) -> None:
        self._grid, self._xp, self._moments = grid, xp, moments(profile, grid.dim)
        self.rates, self._positive = rates, positive
        self._kept: dict[tuple[int, float], Any] = {}

    def added(self, data: Any, t: float, length: float) -> Any:
        """The moments themselves: diffusion adds nothing."""
        return data

    def decayed(self, data: Any, t: float, length: float, transpose: bool = False) -> Any:
        """The moments after a time, or the transpose of that map."""
        if length < 0.0:
            raise InputError("dt: diffusion cannot be undone; run forward in time")
        new = self._xp.empty_like(data)
        for q, moment in enumerate(self._moments):
            values = data[q]
            for axis, rate in enumerate(self.rates):
                if rate:
                    odd, means = moment.orders[axis] % 2 == 1, axis in moment.averaged
                    values = self._spread(values, axis, odd, means, length, transpose)
            new[q] = values
        return new

    def _spread(
        self, values: Any, axis: int, odd: bool, means: bool, length: float, transpose: bool
    ) -> Any:
        """The convolution along an axis: of values at nodes, at walls `odd` or even, or `means`."""
        xp, n = self._xp, self._grid.cells[axis]
        v = xp.moveaxis(values, axis, -1)
        if self._grid.periodic[axis]:
            return xp.moveaxis(self._convolved(v, axis, n, length), -1, axis)
        sign, count = -1.0 if odd else 1.0, n if means else n + 1
        first = 0 if means else 1  # of the values that have an image of their own
        if transpose:
            whole = xp.zeros((*v.shape[:-1], 2 * n), v.dtype)
            whole[..., :count] = v[..., :count]
        else:
            whole = xp.concatenate([v[..., :count], sign * v[..., first:n][..., ::-1]], axis=-1)
            if odd:
                whole[..., [0, n]] = 0.0
        spread = self._convolved(whole, axis, 2 * n, length)
        new = xp.zeros_like(v)
        new[..., :count] = spread[..., :count]
        if transpose:
            new[..., first:n] += sign * spread[..., count:][..., ::-1]
            if odd:
                new[..., [0, n]] = 0.0
        return xp.moveaxis(new, -1, axis)

    def _convolved(self, values: Any, axis: int, size: int, length: float) -> Any:
        """A periodic convolution of `size` values in the last direction."""
        key = axis, length
        if key not in self._kept:
            theta = 2.0 * np.pi * np.arange(size // 2 + 1) / size
            symbol = 2.0 - 2.0 * np.cos(theta) if self._positive else theta**2
            number = self.rates[axis] * length / self._grid.widths[axis][0] ** 2
            # A new dict: other threads may be reading the old one.
            last = dict(list(self._kept.items())[-2 * self._grid.dim :])
            self._kept = {**last, key: self._xp.asarray(np.exp(-number * symbol))}
        fft = self._xp.fft
        return fft.irfft(fft.rfft(values) * self._kept[key], size)


def diffusion(grid: Grid, profile: str, value: Any, limited: bool, xp: Any) -> Diffusion | None:
    """The diffusion of a solver, from its argument; None without it. Raises `InputError` for
    coefficients that are negative, `NotSupported` on grids that are not uniform."""
    if value is None:
        return None
    found = real_array("diffusion: expected a number, or one for each direction", value)
    if found.shape not in ((), (grid.dim,)) or not np.isfinite(found).all() or (found < 0.0).any():
        raise InputError(
            f"diffusion: expected a number >= 0, or {grid.dim} of them, in length^2 / time, got "
            f"{value!r}"
        )
    rates = tuple(float(rate) for rate in np.broadcast_to(found, (grid.dim,)))
    for axis, rate in enumerate(rates):
        if rate and not grid.uniform[axis]:
            raise NotSupported(
                f"diffusion: the grid is not uniform in {AXES[axis]}; take a uniform grid, or 0 "
                "for that direction"
            )
    return Diffusion(grid, profile, rates, limited, xp) if any(rates) else None
