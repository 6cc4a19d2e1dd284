"""The periodic elastic half space, or half plane, in Fourier space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from contact.errors import InputError
from contact.spectral.filtered_compliance import FilteredCompliance
from contact.spectral.real_symbol import RealSymbol
from skfem_adini.ground.arguments import (
    array_of,
    finite_number,
    keywords_named,
    numbers,
    positive_number,
)


class HalfSpace(FilteredCompliance):
    r"""An elastic half space (2-D: half plane in plane strain) whose loads repeat periodically.

    Per wave vector k of the surface with outward normal n the displacements are, with
    :math:`e = k / |k|`, the shear modulus G and the tractions p,

    .. math::
        u_n &= \frac{1 - \nu}{G |k|} p_n + i \frac{1 - 2 \nu}{2 G |k|} e \cdot p_t, \\
        u_t &= \frac{1}{G |k|} (I - \nu e e^T) p_t - i \frac{1 - 2 \nu}{2 G |k|} e p_n.

    They are relative to the mean displacement, which is infinite in a half space; so is the motion
    of an obstacle. Forces on points are tractions times the area of a cell; waves not resolved by
    the grid are omitted.

    Parameters
    ----------
    lengths : float or sequence of float
        Period, one number a direction: one for the half plane, two for the half space.
    shape : int or sequence of int
        Points along each direction.
    E, nu : float
        Young's modulus and Poisson's ratio.
    normal : sequence of float, optional
        Outward normal, along a coordinate axis; default: downwards, as for the lower side of a
        block on its foundation.
    xp : module
        `numpy`, or `cupy` for arrays on a device.

    Attributes
    ----------
    lengths, E, nu
        As they were given, the lengths as a tuple.
    stiffness : array, shape (dim, dim, nx // 2 + 1) or (dim, dim, nx, ny // 2 + 1)
        Forces on points per displacement, for each wave of a real transform; the mean has the value
        of the longest wave.
    contact_modulus : float
        E* = E / (1 - nu^2).

    Raises
    ------
    InputError
        Lengths, shape or material out of range, an oblique normal.

    References
    ----------
    K. L. Johnson, Contact Mechanics, Cambridge University Press 1985, sections 2.2 and 3.2. J. M.
    Leroux, B. Fulleringer and D. Nelias, Contact analysis in presence of spherical inhomogeneities
    within a half-space, Int. J. Solids Structures 47 (2010) 3034, for the use of transforms.

    Examples
    --------
    A wave of normal traction, and the wave of displacement that it causes (Johnson, section 13.2):

    >>> ground = HalfSpace(1.0, 64, E=1.0, nu=0.3)
    >>> wave = np.cos(2 * np.pi * np.arange(64) / 64)
    >>> u = ground.apply(np.array([0 * wave, wave / 64]))  # forces: tractions times spacing
    >>> print((u[1] @ wave / (wave @ wave)).round(6), round((1 - 0.3**2) / np.pi, 6))
    0.289662 0.289662
    """

    @keywords_named
    def __init__(
        self,
        lengths: float | Sequence[float],
        shape: int | Sequence[int],
        E: float,
        nu: float,
        *,
        normal: Sequence[float] | None = None,
        xp: Any = np,
    ) -> None:
        sides, points = (
            np.atleast_1d(numbers("lengths", lengths)),
            np.atleast_1d(array_of("shape", shape)),
        )
        if sides.shape not in ((1,), (2,)) or not np.all((sides > 0) & np.isfinite(sides)):
            raise InputError(f"lengths={lengths!r}: expected one or two positive numbers")
        if points.dtype.kind not in "iu" or points.shape != sides.shape or np.any(points < 2):
            raise InputError(f"shape={shape!r}: expected {sides.size} numbers of points")
        young, ratio = positive_number("E", E), finite_number("nu", nu)
        if not -1 < ratio < 0.5:
            raise InputError(f"nu={nu!r}: expected a number between -1 and .5")
        dim = sides.size + 1
        given = numbers("normal", -np.eye(dim)[-1] if normal is None else normal)
        if given.shape != (dim,) or np.count_nonzero(given) != 1 or not np.all(np.isfinite(given)):
            raise InputError(f"normal={normal!r}: expected a direction along one of {dim} axes")
        self.shape: tuple[int, ...] = tuple(int(m) for m in points)
        self.spacing: tuple[float, ...] = tuple((sides / points).tolist())
        self.lengths, self.E, self.nu = tuple(sides.tolist()), young, ratio
        self.normal = np.sign(given)
        self.contact_modulus = young / (1 - ratio**2)
        self.constant = np.zeros(dim, dtype=bool)
        self.initial = xp.zeros((dim, *self.shape))
        _check_range(E, young, self.spacing, max(sides))
        symbol = _symbol(self.shape, self.spacing, young, ratio, self.normal)
        turns = (self.normal == 0).astype(int).tolist()
        compliance = RealSymbol.of(xp.asarray(symbol), turns)
        stiffness = compliance.inverse()
        compliance.entries[(slice(None),) + (0,) * len(self.shape)] = 0.0
        self._take_symbols(compliance, stiffness, int(np.argmax(np.abs(given))))

    @property
    def stiffness(self) -> Any:
        """Forces on points per displacement, for each wave."""
        return self._stiffness.full()

    def __repr__(self) -> str:
        """Return the class with the number of points."""
        return f"HalfSpace({' x '.join(map(str, self.shape))} points)"


def _check_range(given: Any, E: float, spacing: Sequence[float], period: float) -> None:
    """Raise an `InputError` if products of stiffnesses would overflow or underflow."""
    with np.errstate(over="ignore", under="ignore"):
        k = np.array([1.0 / np.float64(period), 1.0 / min(spacing)])
        sizes = np.r_[k, np.float64(E) * k * np.prod(spacing)]
    largest = 1e100  # determinants of three components multiply three stiffnesses
    if not np.all((sizes > 1 / largest) & (sizes < largest)):
        raise InputError(
            f"E={given!r}: with points {min(spacing):.3g} apart on a period of {period:.3g} the "
            "stiffness of a point, or its cube, is beyond the range of numbers; choose other "
            "units of length or force"
        )


def _symbol(
    shape: tuple[int, ...], spacing: tuple[float, ...], E: float, nu: float, normal: Any
) -> Any:
    """Displacements per force of each wave; the free mean is treated as the longest wave."""
    fft = scipy.fft
    steps = [fft.fftfreq(m, h) for m, h in zip(shape, spacing, strict=True)]
    steps[-1] = np.abs(fft.fftfreq(shape[-1], spacing[-1])[: shape[-1] // 2 + 1])
    k = 2 * np.pi * np.array(np.meshgrid(*steps, indexing="ij"))
    length = np.sqrt(np.sum(k**2, axis=0))
    mean = (0,) * len(shape)
    length[mean] = np.min(length[length > 0])
    e = k / length
    # A wave at the Nyquist limit has no sign: terms odd in its direction vanish.
    odd = e.copy()
    for axis, m in enumerate(shape):
        if m % 2 == 0:
            at = [slice(None)] * len(shape)
            at[axis] = slice(m // 2, m // 2 + 1)
            odd[axis][tuple(at)] = 0.0
    dim, size = len(shape) + 1, E / (2 * (1 + nu)) * length * float(np.prod(spacing))
    axis = int(np.argmax(np.abs(normal)))
    across = [i for i in range(dim) if i != axis]
    symbol = np.zeros((dim, dim, *length.shape), dtype=complex)
    symbol[axis, axis] = (1 - nu) / size
    for a, i in enumerate(across):
        for b, j in enumerate(across):
            symbol[i, j] = ((i == j) - nu * (e[a] ** 2 if a == b else odd[a] * odd[b])) / size
        symbol[axis, i] = 1j * normal[axis] * (0.5 - nu) * odd[a] / size
        symbol[i, axis] = -symbol[axis, i]
    return symbol
