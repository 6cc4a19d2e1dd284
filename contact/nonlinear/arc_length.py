r"""Steps along a path of equilibrium, whose time is an unknown.

Behind the displacement u stands the scaled time s, and with the residual r(u, t) Newton's method
solves

.. math:: r(u, t_0 + \rho s) = 0, \qquad c \cdot (u - u_0) = \ell ,

with c the mean of a displacement on a boundary, or the direction of the last step: the plane normal
to it. Limit points of t are no singular points of these equations.

E. Riks, Int. J. Solids Struct. 15 (1979), 529-551; E. Ramm in W. Wunderlich et al. (eds.),
Nonlinear Finite Element Analysis in Structural Mechanics, Springer 1981, 63-89."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.boundary_names import select_components
from contact.body.deferred_basis import dofs_on_facets
from contact.errors import InputError
from contact.nonlinear.boundary_factor import BoundaryFactor
from contact.nonlinear.bulk_newton import StepProblem
from contact.nonlinear.chord import Chord
from contact.nonlinear.free_unknowns import FreeUnknowns, on_host
from contact.nonlinear.touching import Touch

Array = NDArray[np.float64]
Csr = sparse.csr_array
MOST_CURVED = 1.5  # length of a step over its part along the last one
STEP = 1e-6  # of time, for the differences of loads


@dataclass(frozen=True)
class EquilibriumPath:
    """The equations of a step; x is (u, s)."""

    at: Callable[[float], StepProblem]
    time: float
    u: Array  # at the beginning
    direction: Any  # c, shape (ndofs,); None as long as only `tangent` is wanted
    length: float

    def time_of(self, x: Array) -> float:
        """The time of an iterate."""
        return self.time + self._unit * float(x[-1])

    def _load_rate(self, u: Array, time: float) -> Array:
        h = STEP * max(1.0, abs(time))
        ahead, behind = self.at(time + h).load(u), self.at(time - h).load(u)
        return np.asarray((ahead - behind) / (2 * h))

    def check(self) -> None:
        """Raise InputError if no load varies in time."""
        _ = self._unit

    @property
    def _unit(self) -> float:
        """Time whose load moves the stiffest dof by a unit."""
        step = self.at(self.time)
        rate = np.abs(step.free.forces(self._load_rate(self.u, self.time)) / step.lengths)
        size = float(rate.max(initial=0.0))
        if not size > 0.0:
            raise InputError("follow: no load varies at this time; add load(...) or pressure(...)")
        return step.stiffness / size

    def tangent(self) -> Array:
        """Displacement by a unit of time at the beginning, without contact, shape (ndofs,)."""
        step = self.at(self.time)
        A, unit = step.free.matrix(step.tangent(self.u))
        factor = BoundaryFactor(A, step.order, step.kept, step.analysis)
        last, halfway = factor.forward(unit * step.free.forces(self._load_rate(self.u, self.time)))
        return step.free.displacement(unit * factor.backward(halfway, last))

    def problem(self) -> StepProblem:
        """The step with the time among its unknowns."""
        step, unit = self.at(self.time), self._unit
        P, n, row = step.free.P, step.lengths.size, step.stiffness * self.direction

        def load(x: Array) -> Array:
            return np.append(self.at(self.time + unit * x[-1]).load(x[:-1]), 0.0)

        def internal(x: Array) -> Array:
            off = row @ (x[:-1] - self.u) - step.stiffness * self.length
            return np.append(step.internal(x[:-1]), off)

        def tangent(x: Array) -> Csr:
            time = self.time + unit * x[-1]
            column = -unit * self._load_rate(x[:-1], time)
            K = on_host(self.at(time).tangent(x[:-1]))
            blocks: Any = [[K, column[:, None]], [row[None], None]]
            return Csr(sparse.block_array(blocks, format="csr"))

        def touch(x: Array, mu: Array, t: Array) -> Touch:
            return _widened(step.touch(x[:-1], mu, t))

        return replace(
            step,
            load=load,
            internal=internal,
            tangent=tangent,
            touch=touch,
            free=FreeUnknowns(Csr(sparse.block_diag([P, [[1.0]]], format="csr"))),
            picked=Csr(sparse.block_diag([step.picked, [[1.0]]], format="csr")),
            u0=np.append(step.u0, 0.0),
            lengths=np.append(step.lengths, 1.0),
            order=np.append(step.order, n),
            kept=np.array([n]),
            chord=Chord(),
            least_volume=lambda x: step.least_volume(x[:-1]),
        )


def _widened(touch: Touch) -> Touch:
    """The rows with a column of zeros for the time."""
    wide: dict[str, Any] = {}
    for name in ("G", "T", "tilted", "turned", "force"):
        part = getattr(touch, name)
        rows = part.shape[0] + (name == "force")
        wide[name] = Csr((part.data, part.indices, part.indptr), shape=part.shape)
        wide[name].resize((rows, part.shape[1] + 1))
    return replace(touch, **wide)


def control_of(body: Any, own: slice, total: int, boundary: Any, component: Any) -> Array:
    """The mean displacement of a boundary's nodes as a vector of all dofs, shape (total,)."""
    chosen = select_components(body.dim, component)
    if len(chosen) != 1:
        raise InputError(f"control: expected a boundary and one component, got {component!r}")
    dofs = dofs_on_facets(body.basis, body.facets(boundary))
    dofs = dofs[(dofs % body.dim == chosen[0]) & body.are_values[dofs]]
    found = np.zeros(total)
    found[own.start + dofs] = 1.0 / dofs.size
    return found


def mean_square(bodies: Any) -> Array:
    """Weights of the mean square displacement of the nodes, shape (ndofs,)."""
    values = np.concatenate([body.are_values for body in bodies]).astype(float)
    return np.asarray(values * bodies[0].dim / values.sum())
