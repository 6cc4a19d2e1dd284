"""Contact laws of compliant surfaces: the pressure as a function of the overclosure."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from skfem_adini.ground.arguments import numbers, positive_number

Array = NDArray[np.float64]


class PressureOverclosure:
    r"""Contact pressure p(c) of a compliant surface, growing with the overclosure c = u_n - d.

    The overclosure is the overlap of the undeformed surfaces, which may be positive on rough
    surfaces, coatings and thin soft layers. With its inverse h the law is ``u_n - d = h(p)`` where
    p > 0 and ``u_n - d <= h(0)`` where p = 0; h = 0 is Signorini's law.

    Parameters
    ----------
    pressures : array_like, shape (k,)
        Strictly increasing from zero, in the unit of E.
    overclosures : array_like, shape (k,)
        Their overclosures, strictly increasing, lengths; negative where the pressure begins before
        the surfaces touch. Straight lines connect the points; the last one is extended.

    Raises
    ------
    InputError
        Fewer than two points, other shapes, or values that do not increase.

    References
    ----------
    P. Wriggers, Computational Contact Mechanics, 2nd edition, Springer 2006, chapter 5. G.
    Zavarise, P. Wriggers, E. Stein and B. A. Schrefler, Real contact mechanisms and finite element
    formulation, Int. J. Numer. Methods Engrg. 35 (1992), 767-785.

    Examples
    --------
    A layer that stiffens under a column of unit height and modulus: under a pressure of .3 its
    overclosure is .015.

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, PressureOverclosure
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.0)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.3))
    >>> layer = PressureOverclosure([0.0, 0.1, 0.5], [0.0, 0.01, 0.02])
    >>> result = ContactProblem(body, "bottom", 0.0, overclosure=layer).solve()
    >>> bool(abs(result.gap + 0.015).max() < 1e-12)
    True
    """

    def __init__(self, pressures: ArrayLike, overclosures: ArrayLike) -> None:
        p, c = numbers("pressures", pressures), numbers("overclosures", overclosures)
        for name, values in (("pressures", p), ("overclosures", c)):
            if values.ndim != 1 or values.size < 2 or values.shape != p.shape:
                raise InputError(f"{name}: expected as many numbers as pressures, two at least")
            if not np.all(np.isfinite(values)) or not np.all(np.diff(values) > 0):
                raise InputError(f"{name}={values!r}: expected finite numbers, each larger")
        if p[0] != 0.0:
            raise InputError(f"pressures={p!r}: expected zero first, where contact begins")
        self._p, self._c = p, c

    def __repr__(self) -> str:
        return f"PressureOverclosure({self._p.tolist()}, {self._c.tolist()})"

    @staticmethod
    def exponential(pressure: float, clearance: float) -> PressureOverclosure:
        r"""The softened law :math:`p(c) = \frac{p_0}{e - 1} x (e^x - 1)`, with x = 1 + c / c_0.

        The pressure begins, with slope zero, at the clearance c_0 before the surfaces touch, and
        is p_0 where they touch.

        Parameters
        ----------
        pressure : float
            p_0 > 0, in the unit of E.
        clearance : float
            c_0 > 0, a length.

        Raises
        ------
        InputError
            Not positive numbers.
        """
        return Exponential(pressure, clearance)

    @property
    def start(self) -> float:
        """Overclosure where the pressure begins, h(0)."""
        return float(self._c[0])

    def pressure(self, overclosure: ArrayLike) -> Array:
        """Pressure p at overclosures c, zero below `start`."""
        return self.evaluated(numbers("overclosure", overclosure))[0]

    def evaluated(self, c: Array) -> tuple[Array, Array]:
        """Pressure and its derivative at overclosures c; at a kink the larger derivative."""
        slopes = np.diff(self._p) / np.diff(self._c)
        at = np.clip(np.searchsorted(self._c, c, side="right") - 1, 0, slopes.size - 1)
        p = self._p[at] + slopes[at] * (c - self._c[at])
        return np.where(c > self.start, p, 0.0), slopes[at]

    def resolved(self, q: Array, a: Array, b: Array) -> Array:
        """The overclosure c with ``a p(c) + b c = q``, all (k,), for positive a and b; `start`
        where the pressure is zero."""
        ends = a[:, None] * self._p + b[:, None] * self._c
        at = np.clip(np.sum(ends <= q[:, None], axis=1) - 1, 0, self._p.size - 2)
        slope = (np.diff(self._p) / np.diff(self._c))[at]
        found = self._c[at] + (q - ends[np.arange(q.size), at]) / (a * slope + b)
        return np.maximum(found, self.start)

    def stored(self) -> dict[str, Any]:
        """Data from which `from_stored` restores the law."""
        return {"pressures": self._p.tolist(), "overclosures": self._c.tolist()}

    @staticmethod
    def from_stored(data: dict[str, Any] | None) -> PressureOverclosure | None:
        """The law from the output of `stored`; None for hard contact."""
        if data is None:
            return None
        return Exponential(**data) if "clearance" in data else PressureOverclosure(**data)


class Exponential(PressureOverclosure):
    """The law of `PressureOverclosure.exponential`."""

    def __init__(self, pressure: float, clearance: float) -> None:
        self._p0 = positive_number("pressure", pressure)
        self._c0 = positive_number("clearance", clearance)

    def __repr__(self) -> str:
        return f"PressureOverclosure.exponential({self._p0}, {self._c0})"

    @property
    def start(self) -> float:
        """Overclosure where the pressure begins, h(0)."""
        return -self._c0

    def evaluated(self, c: Array) -> tuple[Array, Array]:
        """Pressure and its derivative at overclosures c."""
        x = np.maximum(1.0 + c / self._c0, 0.0)
        factor = self._p0 / np.expm1(1.0)
        return factor * x * np.expm1(x), factor / self._c0 * (np.expm1(x) + x * np.exp(x))

    def resolved(self, q: Array, a: Array, b: Array) -> Array:
        """As for `PressureOverclosure`; Newton's method from above on a convex function."""
        rest = np.maximum(np.where(np.isfinite(q), q, -np.inf) - b * self.start, 0.0)
        # x (e^x - 1) >= e^x - 1 for x >= 1: the pressure bounds x, and so does b c.
        largest = np.maximum(1.0, np.log1p(rest / a * (np.expm1(1.0) / self._p0)))
        x = np.minimum(largest, rest / (b * self._c0))
        for _ in range(100):  # Newton's method needs fewer than twenty
            p, slope = self.evaluated(self._c0 * (x - 1.0))
            missed = a * p + b * self._c0 * x - rest
            new = np.maximum(x - missed / ((a * slope + b) * self._c0), 0.0)
            if np.all(np.abs(new - x) <= np.finfo(float).eps * new):
                break
            x = new
        return self._c0 * (x - 1.0)

    def stored(self) -> dict[str, Any]:
        """Data from which `from_stored` restores the law."""
        return {"pressure": self._p0, "clearance": self._c0}


def checked(value: Any, count: int, several: bool) -> tuple[PressureOverclosure | None, ...]:
    """The law of each of `count` boundaries from the caller's argument, a list only if `several`;
    empty for hard contact.
    """
    if isinstance(value, list | tuple):
        if not several or len(value) != count:
            raise InputError(
                f"overclosure: a list of {len(value)} for {count} contact boundaries; give one, "
                "or one for each boundary of a list"
            )
        laws = tuple(_one(law) for law in value)
    else:
        laws = (_one(value),) * count
    return () if all(law is None for law in laws) else laws


def _one(value: Any) -> PressureOverclosure | None:
    if value is None or isinstance(value, PressureOverclosure):
        return value
    stiffness = numbers("overclosure", value)
    if stiffness.shape != () or not 0 < stiffness < np.inf:
        raise InputError(
            f"overclosure={value!r}: expected a positive stiffness, pressure per length, a "
            "PressureOverclosure, or None for hard contact"
        )
    # Unit pressure at 1 / stiffness: a line through the origin.
    return PressureOverclosure([0.0, 1.0], [0.0, 1.0 / float(stiffness)])
