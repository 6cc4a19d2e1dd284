"""Internal forces of all bodies, pressures that follow them, and their tangents."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.condensation import device_schur
from contact.condensation.elimination_order import elimination_order
from contact.errors import InputError
from contact.histories.load_program import value_at
from contact.nonlinear.cell_forces import State, cofactor, det
from contact.nonlinear.free_unknowns import FreeUnknowns, Matrix, added, on_host, stacked
from contact.nonlinear.nonlinear_body import NonlinearBody
from contact.nonlinear.stress_forces import FollowerPressure

Array = NDArray[np.float64]
Csr = sparse.csr_array
logger = logging.getLogger(__name__)


class BodyForces:
    """The forces of several bodies, `NonlinearBody` and linear ones, on all their dofs; those of
    cells are computed on the host or on a device."""

    def __init__(self, together: Any, device: Any) -> None:
        self._together = together
        self.bodies: list[tuple[Any, slice]] = list(
            zip(together.bodies, together.slices, strict=True)
        )
        self.pressures: list[tuple[int, FollowerPressure, Callable[[float], float]]] = []
        self._checked = False
        self.cells: list[Any] = [getattr(body, "cells", None) for body, _ in self.bodies]
        if device == "cpu":
            return
        if device != "cuda":
            raise InputError(f"device={device!r}: large strain takes one device, 'cuda'")
        xp = device_schur.device_arrays()
        self.cells = [own if own is None else own.on_device(xp) for own in self.cells]

    def internal(
        self, u: Array, states: tuple[State, ...], dt: float, recomputed: bool = False
    ) -> Array:
        """Internal forces, or those recomputed by scikit-fem's forms on the host."""
        found = []
        for k, (body, own) in enumerate(self.bodies):
            if isinstance(body, NonlinearBody):
                of = body.cells.recomputed if recomputed else self.cells[k].at
                found.append(of(u[own], states[k], dt))
            else:
                found.append(np.asarray(body.stiffness @ u[own]))
        return np.concatenate(found)

    def tangent(self, u: Array, states: tuple[State, ...], dt: float, end: float) -> Matrix:
        """Derivative of the internal minus the applied forces at the time `end`."""
        found = list[Any]()
        for k, (body, own) in enumerate(self.bodies):
            if not isinstance(body, NonlinearBody):
                found.append(body.stiffness)
                continue
            if not self._checked:
                logger.info("%s", self.cells[k].check_tangent())
            found.append(self.cells[k].tangent(u[own], states[k], dt))
        self._checked = True
        for k, one, factor in self.pressures:
            own = self._together.slices[k]
            found[k] = added(found[k], -value_at(factor, end) * one.tangent(u[own], {}, 0.0))
        return stacked(found)

    def pressed(self, load: Array, end: float) -> Callable[[Array], Array]:
        """Applied forces at a time as a function of the displacement."""
        now = [(k, one, value_at(factor, end)) for k, one, factor in self.pressures]

        def forces(u: Array) -> Array:
            found = load.copy()
            for k, one, size in now:
                own = self._together.slices[k]
                found[own] += size * one.at(u[own], {}, 0.0)
            return found

        return forces

    @cached_property
    def stiffness(self) -> tuple[float, float]:
        """Largest diagonal entry of the tangent of the undeformed bodies, and of one times a cell's
        size."""
        found, of_cells = [], [0.0]
        for (body, _), cells in zip(self.bodies, self.cells, strict=True):
            if isinstance(body, NonlinearBody):
                rest = np.zeros(body.ndofs)
                diagonal = on_host(cells.tangent(rest, cells.rest, 1.0)).diagonal()
            else:
                diagonal = body.stiffness.diagonal()
            found.append(float((np.abs(diagonal) / body.lengths[0] ** 2).max()))
            if isinstance(body, NonlinearBody):
                volume = np.asarray(body.basis.dx).sum(axis=1).max()
                of_cells.append(found[-1] * float(volume) ** (1 / body.dim))
        return max(found), max(of_cells)

    @cached_property
    def free(self) -> FreeUnknowns:
        """The unknowns of all bodies."""
        return FreeUnknowns(Csr(self._together.constraint[0]))

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Free unknowns of all bodies, each by nested dissection."""
        found, start = list[Any](), 0
        for body, _ in self.bodies:
            found.append(elimination_order(body) + start)
            start += body.constraint[0].shape[1]
        return np.concatenate(found)

    def gradients(self, u: Array, corners: bool = False) -> list[Array]:
        """F of each nonlinear body."""
        return [
            body.deformation_gradient(u[own], corners)
            for body, own in self.bodies
            if isinstance(body, NonlinearBody)
        ]

    def least_volume(self, u: Array) -> float:
        """Smallest det F at the quadrature points."""
        found = []
        for (body, own), cells in zip(self.bodies, self.cells, strict=True):
            if cells is not None and cells.device:
                found.append(cells.least_volume(u[own]))
            elif cells is not None:
                found.append(float(det(body.deformation_gradient(u[own])).min()))
        return min(found)

    def place_of_least(self, u: Array) -> str:
        """Words for the least det F at the corners, and its undeformed place."""
        found = []
        for body, own in self.bodies:
            if isinstance(body, NonlinearBody):
                J = det(body.deformation_gradient(u[own], at_nodes=True))
                cell, corner = np.unravel_index(np.argmin(J), J.shape)
                place = body.mesh.p[:, body.mesh.t[corner, cell]]
                found.append((float(J.min()), ", ".join(f"{x:.3g}" for x in place)))
        least, place = min(found)
        return f"{least:.2g} at ({place})"

    def largest_change(self, before: Array, now: Array) -> float:
        """Largest norm of F_now F_before^-1 - I: other solutions of the same loads are far away."""
        largest = 0.0
        for one, other in zip(self.gradients(before), self.gradients(now), strict=True):
            step = np.einsum("ij...,kj...->ik...", other - one, cofactor(one) / det(one))
            largest = max(largest, float(np.sqrt((step**2).sum(axis=(0, 1))).max()))
        return largest
