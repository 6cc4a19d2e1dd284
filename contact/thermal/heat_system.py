r"""The equations of heat of one step, steady or in time, under given conductances.

With the heat :math:`s(T)` that flows into each dof by conduction, sources, convection and contact,
and the heat of friction F, a step of length :math:`\Delta t` solves

.. math:: C (T - T^-) / \Delta t = \theta \, s(T) + (1 - \theta) \, s(T^-) + F,

:math:`\theta = 1` for the implicit Euler and 1/2 for the Crank-Nicolson method; steady: without C
and with :math:`\theta = 1`. Where temperatures are prescribed the difference is what the supports
supply.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import Unbounded
from contact.thermal.film import Film
from skfem_adini import factorize

Array = NDArray[np.float64]
Csr = sparse.csr_array
FLOWS = ("conduction", "sources", "convection", "contact")  # rows of `HeatSystem.inflow`
_ROUNDING = 64 * np.finfo(float).eps  # of sums of heat flows, relative to their terms


class Before(NamedTuple):
    """The last step, and how the next one follows it."""

    T: Array  # its temperature, shape (n,)
    inflow: Array  # its `HeatSystem.inflow`, shape (4, n)
    capacity: Csr  # shape (n, n)
    dt: float
    theta: float


@dataclass(frozen=True)
class HeatSystem:
    """Matrices and loads of a step in all bodies together, n dofs and m contact points."""

    stiffness: Csr  # conduction
    convective: Csr  # convection
    sources: Array  # sources and inflow, shape (n,)
    ambient: Array  # convection from the ambient temperature, shape (n,)
    P: Csr  # T = P z + T0, with orthonormal columns
    T0: Array
    values: Array  # dofs of the temperature one, shape (n,)
    ends: NDArray[np.int64]  # first dof of each body, and n
    film: Film
    share: Array  # part of the heat of friction that enters the first side, shape (m,)
    before: Before | None = None
    initial: bool = False  # a state to start from, in which heat need not balance

    def solve(self, h: Array, power: Array) -> Array:
        """Temperature under conductances h and powers of friction, both (m,).
        Raises `Unbounded` where nothing determines it."""
        A = self.stiffness + self.convective + self.film.matrix(h)
        b = self.sources + self.ambient + self.film.load(h)
        if self.before is not None:
            T, inflow, capacity, dt, theta = self.before
            A = theta * A + capacity / dt
            b = theta * b + (1.0 - theta) * inflow.sum(axis=0) + capacity @ T / dt
        b = b + self.film.rubbed(power, self.share)
        inner = Csr(self.P.T @ A @ self.P)
        if self.before is None:
            self._refuse_floating(inner)
        if inner.shape[0] == 0:
            return self.T0.copy()
        z = factorize(inner).solve(np.asarray(self.P.T @ (b - A @ self.T0)))
        return np.asarray(self.P @ z + self.T0)

    def _refuse_floating(self, A: Csr) -> None:
        """Raise if a connected part neither loses heat nor has a prescribed temperature."""
        count, part = sparse.csgraph.connected_components(A, directed=False)
        one, size = self.P.T @ self.values, float(np.abs(A.diagonal()).max(initial=0.0))
        for k in range(count):
            constant = np.where(part == k, one, 0.0)
            left = np.abs(A @ constant).max()
            if left <= 1e-13 * size:  # rounding of row sums
                first = int(self.P[:, part == k].tocoo().row.min())
                body = int(np.searchsorted(self.ends, first, side="right")) - 1
                raise Unbounded(
                    f"body {body}: nothing determines its temperature, because it conducts no heat "
                    "to anything of given temperature. Prescribe one (fix), add a convection, or "
                    "give a conductance that is positive across the gap; run(times) needs none",
                    self.P @ constant,
                )

    def inflow(self, T: Array, h: Array) -> Array:
        """Heat into each dof by each of `FLOWS`, shape (4, n)."""
        inside = T - self.values * np.mean(T[self.values > 0])  # constants conduct nothing
        return np.array(
            [
                -(self.stiffness @ inside),
                self.sources,
                self.ambient - self.convective @ T,
                self.film.load(h) - self.film.matrix(h) @ T,
            ]
        )

    def flows(self, T: Array, h: Array, power: Array) -> dict[str, Array]:
        """Mean heat flows of the step into each dof by name, "prescribed" those of supports."""
        parts, stored = self.inflow(T, h), np.zeros(T.size)
        if self.before is not None:
            last, inflow, capacity, dt, theta = self.before
            parts = theta * parts + (1.0 - theta) * inflow
            stored = capacity @ (T - last) / dt
        found = dict(zip(FLOWS, parts, strict=True))
        found |= {"friction": self.film.rubbed(power, self.share), "stored": stored}
        left = stored - parts.sum(axis=0) - found["friction"]
        if self.initial:
            found["stored"], left = stored - left, np.zeros(left.size)
        found["left"] = self.P @ (self.P.T @ left)
        found["prescribed"] = left - found["left"]
        return found

    def residual(self, T: Array, h: Array, power: Array) -> float:
        """Largest heat that is missing at a free dof, over the largest sum of moduli at a dof."""
        found = self.flows(T, h, power)
        size = abs(self.stiffness) @ np.abs(T - self.values * np.mean(T[self.values > 0]))
        size = size + sum(np.abs(v) for k, v in found.items() if k != "left")
        noise = _ROUNDING * (self._moduli @ np.abs(T))
        excess = np.maximum(np.abs(found["left"]) - noise, 0.0).max(initial=0.0)
        return float(excess / (size.max() or 1.0))

    @cached_property
    def _moduli(self) -> Csr:
        return Csr(abs(self.stiffness) + abs(self.convective))

    def balance(self, T: Array, h: Array, power: Array, body: int | None) -> dict[str, float]:
        """Heat into a body, or all, per time by its origin; "stored" is what warms it.
        "error": what is missing, relative to the sum of the moduli."""
        found = self.flows(T, h, power)
        own = slice(None) if body is None else slice(*self.ends[[body, body + 1]])
        total = {name: float(self.values[own] @ flow[own]) for name, flow in found.items()}
        conducted, _ = total.pop("conduction"), total.pop("left")
        missing = sum(v for k, v in total.items() if k != "stored") - total["stored"]
        noise = _ROUNDING * float(self.values @ (self._moduli @ np.abs(T)))
        size = sum(abs(v) for v in total.values())
        total["error"] = max(abs(missing) + abs(conducted) - noise, 0.0) / (size or 1.0)
        return total
