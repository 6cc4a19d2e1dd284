"""Internal forces of cells from a stress function or from weak forms, and their tangents.

Cell forces r(u) of a cell's own dofs are evaluated for complex dofs, so that
``K_ij = Im r_i(u + i h e_j) / h`` is exact up to rounding for any analytic r (W. Squire and
G. Trapp, SIAM Review 40 (1998), 110-112). Where r is not, central differences replace it."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, BilinearForm, DiscreteField, LinearForm
from skfem.assembly.form.form import FormExtraParams

from contact.errors import InputError

Array = NDArray[np.float64]
State = dict[str, Array]
COMPLEX_STEP = 1e-30


class CellForces(ABC):
    """Forces of all cells, with the state of their points."""

    basis: Basis
    rest: State  # state of the undeformed body, arrays (..., ncells, npoints)
    complex_step = True

    @abstractmethod
    def forces(self, dofs: Any, state: State, dt: float) -> Any:
        """Forces (nfunctions, ncells) for possibly complex dofs of the same shape."""

    @abstractmethod
    def updated(self, u: Array, state: State, dt: float) -> State:
        """The state after a step to the displacement u."""

    @abstractmethod
    def recomputed(self, u: Array, state: State, dt: float) -> Array:
        """Forces on all dofs, assembled by scikit-fem."""

    @abstractmethod
    def energy(self, u: Array) -> float:
        """Stored energy; NaN if none is known."""

    def at(self, u: Array, state: State, dt: float) -> Array:
        """Forces on all dofs, shape (ndofs,)."""
        dofs = self.basis.element_dofs
        of_cells = self.forces(u[dofs], state, dt)
        return np.asarray(np.bincount(dofs.ravel(), of_cells.ravel(), self.basis.N), dtype=float)

    def tangent(self, u: Array, state: State, dt: float) -> sparse.csr_array:
        """Derivative of `at` in u."""
        dofs = self.basis.element_dofs
        own, n = u[dofs], len(dofs)
        blocks = np.empty((n, *dofs.shape))  # blocks[j, i] = d r_i / d u_j
        h = 1e-6 * (float(np.abs(u).max(initial=0.0)) or 1.0)
        for j in range(n):
            if self.complex_step:
                moved = own.astype(complex)
                moved[j] += 1j * COMPLEX_STEP
                blocks[j] = np.imag(self.forces(moved, state, dt)) / COMPLEX_STEP
            else:
                ahead, behind = own.copy(), own.copy()
                ahead[j] += h
                behind[j] -= h
                difference = self.forces(ahead, state, dt) - self.forces(behind, state, dt)
                blocks[j] = difference / (2.0 * h)
        column = np.broadcast_to(dofs[:, None], blocks.shape)
        row = np.broadcast_to(dofs[None], blocks.shape)
        place = row.ravel(), column.ravel()
        N = self.basis.N
        return sparse.csr_array(sparse.coo_array((blocks.ravel(), place), shape=(N, N)))

    def check_tangent(self) -> str:
        """Choose between complex and real differences; a line for the log.
        At random strains of about .01, which plastic bodies do not bear elastically, the tangent is
        compared with central differences of the forces along one direction."""
        rng, state, dt = np.random.default_rng(0), self.rest, 1.0
        corners = self.basis.mesh.p[:, self.basis.mesh.t]
        cell = float(np.ptp(corners, axis=1).min())
        u, way = 0.01 * cell * rng.uniform(-1.0, 1.0, (2, self.basis.N))
        way *= 1e-5
        expected = 0.5 * (self.at(u + way, state, dt) - self.at(u - way, state, dt))
        if not np.all(np.isfinite(expected)):
            raise InputError("stress: the law or form gives NaN or infinity at strains of .01")
        size = float(np.abs(expected).max()) or 1.0

        def error() -> float:
            with warnings.catch_warnings():
                warnings.simplefilter("error", np.exceptions.ComplexWarning)
                found = self.tangent(u, state, dt) @ way
            return float(np.abs(found - expected).max()) / size

        try:
            off = error()
        except (TypeError, np.exceptions.ComplexWarning):
            off = np.inf
        if off <= 1e-4 or not self.complex_step:
            named = "complex steps" if self.complex_step else "the given form"
            return f"tangent by {named}: differs from central differences by {off:.1e}"
        self.complex_step = False
        return (
            f"tangent by central differences, for that by complex steps is off by {off:.1e}; "
            "the stress or form is not analytic (abs, norm, conj, real arrays of results?)"
        )


def spread(state: Mapping[str, Any] | None, basis: Basis) -> State:
    """Initial state of all points from that of one; InputError for names that forms reserve."""
    shape, found = basis.dx.shape, {}
    for name, value in (state or {}).items():
        if not isinstance(name, str) or name in ("u", "dt", "x", "h", "n", "P"):
            raise InputError(f"state: {name!r} is no name for a state; u, dt, x, h, n, P are taken")
        array = np.asarray(value, dtype=float)
        if not np.all(np.isfinite(array)):
            raise InputError(f"state: {name!r} holds values that are not finite")
        found[name] = np.broadcast_to(array[..., None, None], (*array.shape, *shape)).copy()
    return found


def checked_state(new: Any, old: State) -> State:
    """A new state with the names and shapes of the old one; InputError otherwise."""
    if not isinstance(new, Mapping) or set(new) != set(old):
        raise InputError(f"state: expected arrays named {sorted(old)}, got {new!r:.80}")
    found = {name: np.asarray(value, dtype=float) for name, value in new.items()}
    for name, value in found.items():
        if value.shape != old[name].shape:
            raise InputError(
                f"state: {name!r} has the shape {value.shape}, expected {old[name].shape}: axes of "
                "the tensor first, then cells and quadrature points"
            )
        if not np.all(np.isfinite(value)):
            raise InputError(f"state: the new {name!r} holds values that are not finite")
    return found


class StressForces(CellForces):
    """Forces from the first Piola-Kirchhoff stress as a function of F (3, 3, ncells, npoints).

    With mean dilatation the stress is taken at :math:`\\bar F = (\\bar J / J)^{1/3} F`, with the
    mean :math:`\\bar J` of each cell, and the forces are the derivative of the energy of
    :math:`\\bar F` (J. C. Simo, R. L. Taylor and K. S. Pister, Comput. Methods Appl. Mech. Engrg.
    51 (1985), 177-208): linear cells then do not lock."""

    def __init__(
        self, basis: Basis, stress: Callable[..., Any], state: Any, mean: bool, ring: bool
    ) -> None:
        self.basis, self.stress, self.mean, self._ring = basis, stress, mean, ring
        self.rest = spread(state, basis)
        dim = basis.mesh.dim()
        functions = [basis.basis[dim * k][0] for k in range(basis.Nbfun // dim)]
        self._slope = np.array([np.asarray(f.grad)[0] for f in functions])
        self._r = np.asarray(basis.global_coordinates())[0]
        self._dx = basis.dx * (2.0 * np.pi * self._r if ring else 1.0)
        self._hoop = np.array([np.asarray(f)[0] for f in functions]) / self._r if ring else None

    def gradient(self, dofs: Any) -> Any:
        """F at the quadrature points, shape (3, 3, ncells, npoints)."""
        dim = self._slope.shape[1]
        own = dofs.reshape(-1, dim, dofs.shape[1])
        F = np.zeros((3, 3, *self._dx.shape), dtype=dofs.dtype)
        F[:dim, :dim] = np.einsum("kce,kjeq->cjeq", own, self._slope)
        if self._hoop is not None:
            F[2, 2] = np.einsum("ke,keq->eq", own[:, 0], self._hoop)
        F[np.arange(3), np.arange(3)] += 1.0
        return F

    def _called(self, F: Any, state: State, dt: float) -> Any:
        """Stress at F, and the new state or None."""
        if not self.rest:
            return self.stress(F), None
        return self.stress(F, state, dt)

    def _averaged(self, F: Any) -> tuple[Any, Any, Any]:
        """J, its mean over each cell, and F with that mean."""
        J = det(F)
        mean = (J * self._dx).sum(axis=1, keepdims=True) / self._dx.sum(axis=1, keepdims=True)
        return J, mean, (mean / J) ** (1 / 3) * F

    def stresses(self, dofs: Any, state: State, dt: float) -> Any:
        """First Piola-Kirchhoff stress that is work-conjugate to F, (3, 3, ncells, npoints)."""
        F = self.gradient(dofs)
        if not self.mean:
            return self._checked(self._called(F, state, dt)[0], F)
        J, mean, averaged = self._averaged(F)
        P = self._checked(self._called(averaged, state, dt)[0], F)
        s = (mean / J) ** (1 / 3)
        work = s * (P * F).sum(axis=(0, 1)) / 3.0
        # Each cell's factor of dJ / J_mean.
        factor = (work * self._dx).sum(axis=1, keepdims=True)
        factor = factor / (mean * self._dx.sum(axis=1, keepdims=True))
        return s * P + (J * factor - work) * cofactor(F) / J

    def _checked(self, P: Any, F: Any) -> Any:
        if np.shape(P) != F.shape:
            raise InputError(
                f"stress: expected P of the shape {F.shape} of F, got {np.shape(P)}"
                + ("; with a state: P, new state" if self.rest else "")
            )
        return P

    def forces(self, dofs: Any, state: State, dt: float) -> Any:
        """Forces of the cells' dofs."""
        P = self.stresses(dofs, state, dt) * self._dx
        dim = self._slope.shape[1]
        found = np.einsum("cjeq,kjeq->kce", P[:dim, :dim], self._slope)
        if self._hoop is not None:
            found[:, 0] += np.einsum("eq,keq->ke", P[2, 2], self._hoop)
        return found.reshape(-1, found.shape[2])

    def updated(self, u: Array, state: State, dt: float) -> State:
        """The state after a step."""
        if not self.rest:
            return {}
        F = self.gradient(u[self.basis.element_dofs])
        F = self._averaged(F)[2] if self.mean else F
        return checked_state(self._called(F, state, dt)[1], self.rest)

    def recomputed(self, u: Array, state: State, dt: float) -> Array:
        """Forces on all dofs by a scikit-fem form."""
        P, ring = self.stresses(u[self.basis.element_dofs], state, dt), self._ring

        def work(v: Any, w: Any) -> Any:
            dim = len(v)
            density = sum(w["P"][c, j] * v.grad[c, j] for c in range(dim) for j in range(dim))
            hoop = w["P"][2, 2] * v[0] / w.x[0] if ring else 0.0
            return (density + hoop) * (2.0 * np.pi * w.x[0] if ring else 1.0)

        return np.asarray(LinearForm(work).assemble(self.basis, P=P))

    def energy(self, u: Array) -> float:
        """Stored energy, of a stress with a method `energy`; NaN without."""
        density = getattr(self.stress, "energy", None)
        if density is None:
            return np.nan
        F = self.gradient(u[self.basis.element_dofs])
        return float(np.sum(density(self._averaged(F)[2] if self.mean else F) * self._dx))


class FormForces(CellForces):
    """Forces from the user's forms; see `NonlinearBody.from_forms`."""

    def __init__(self, basis: Basis, internal: Any, tangent: Any, update: Any, state: Any) -> None:
        if not isinstance(internal, LinearForm):
            raise InputError(f"internal: expected a LinearForm, got {type(internal).__name__}")
        if tangent is not None and not isinstance(tangent, BilinearForm):
            raise InputError(f"tangent: expected a BilinearForm, got {type(tangent).__name__}")
        if bool(state) != callable(update):
            raise InputError(
                "update: a function w -> new state, for forms with a state; and a state, if there "
                "is an update"
            )
        self.basis, self.internal, self.given, self.update = basis, internal, tangent, update
        self.rest = spread(state, basis)
        if tangent is not None:
            self.complex_step = False

    def _field(self, dofs: Any) -> DiscreteField:
        """The displacement and its derivatives from dofs of the cells."""
        functions = [own[0] for own in self.basis.basis]

        def sum_of(values: list[Any]) -> Any:
            if values[0] is None:
                return None
            return sum(np.asarray(v) * own[:, None] for v, own in zip(values, dofs, strict=True))

        names = DiscreteField._extra_attrs
        derived = {name: sum_of([getattr(f, name) for f in functions]) for name in names}
        return DiscreteField(sum_of(list(functions)), **derived)

    def _known(self, dofs: Any, state: State, dt: float) -> FormExtraParams:
        known = {name: DiscreteField(value) for name, value in state.items()}
        extra = {**self.basis.default_parameters(), **known, "u": self._field(dofs), "dt": dt}
        return FormExtraParams(extra)

    def forces(self, dofs: Any, state: State, dt: float) -> Any:
        """Forces of the cells' dofs."""
        w, form = self._known(dofs, state, dt), self.internal.form
        return np.array([np.sum(form(*v, w) * self.basis.dx, axis=1) for v in self.basis.basis])

    def tangent(self, u: Array, state: State, dt: float) -> sparse.csr_array:
        """Derivative of the forces: the user's form, if given."""
        if self.given is None:
            return super().tangent(u, state, dt)
        return sparse.csr_array(self.given.assemble(self.basis, **self._params(u, state, dt)))

    def _params(self, u: Array, state: State, dt: float) -> dict[str, Any]:
        return {**state, "u": self.basis.interpolate(u), "dt": dt}

    def updated(self, u: Array, state: State, dt: float) -> State:
        """The state after a step, by the user's function."""
        if not self.rest:
            return {}
        known = self._known(u[self.basis.element_dofs], state, dt)
        return checked_state(self.update(known), self.rest)

    def recomputed(self, u: Array, state: State, dt: float) -> Array:
        """Forces on all dofs by the user's form."""
        return np.asarray(self.internal.assemble(self.basis, **self._params(u, state, dt)))

    def energy(self, u: Array) -> float:
        """Forms have no known energy."""
        return np.nan


def cofactor(F: Any) -> Any:
    """``det(F) F^-T`` of tensors (3, 3, ...)."""
    rows = (np.cross(F[(i + 1) % 3], F[(i + 2) % 3], axis=0) for i in range(3))
    return np.array(list(rows))


def det(F: Any) -> Any:
    """Determinants of tensors (3, 3, ...)."""
    return (F[0] * np.cross(F[1], F[2], axis=0)).sum(axis=0)


def with_unit(H: Array) -> Array:
    """F (3, 3, ...) from the displacement gradient (2, 2, ...) or (3, 3, ...)."""
    F = np.zeros((3, 3, *H.shape[2:]))
    F[: len(H), : len(H)] = H
    F[np.arange(3), np.arange(3)] += 1.0
    return F
