"""Internal forces of cells from a stress function or from weak forms, and their tangents.

Cell forces r(u) of a cell's own dofs are evaluated for complex dofs, so that
``K_ij = Im r_i(u + i h e_j) / h`` is exact up to rounding for any analytic r (W. Squire and
G. Trapp, SIAM Review 40 (1998), 110-112). Where r is not, central differences replace it."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, BilinearForm, DiscreteField, LinearForm
from skfem.assembly.form.form import FormExtraParams

from contact.condensation.device_schur import Rows
from contact.errors import InputError
from skfem_adini.ground.arrays import host

Array = NDArray[np.float64]
State = dict[str, Array]
COMPLEX_STEP = 1e-30


class Forces(ABC):
    """Forces of cells or facets as a function of their own dofs, and their derivatives."""

    basis: Any
    complex_step = True
    xp: Any = np  # module of the arrays of cells
    device = False  # whether they are on a device, that is of CuPy
    _last: tuple[Any, State] = (None, {})  # a state, and its copy on a device

    @abstractmethod
    def forces(self, dofs: Any, state: State, dt: float) -> Any:
        """Forces (nfunctions, ncells) for possibly complex dofs of the same shape."""

    @cached_property
    def _dofs(self) -> Any:
        """Dofs of the cells, shape (nfunctions, ncells)."""
        return self.xp.asarray(self.basis.element_dofs)

    def of_cells(self, u: Array) -> Any:
        """A vector of all dofs as dofs of the cells, shape (nfunctions, ncells)."""
        return self.xp.asarray(u)[self._dofs]

    def placed(self, state: State) -> State:
        """A state by arrays where the cells are; the last one is kept."""
        if self.device and self._last[0] is not state:
            self._last = state, {name: self.xp.asarray(value) for name, value in state.items()}
        return self._last[1] if self.device else state

    def at(self, u: Array, state: State, dt: float) -> Array:
        """Forces on all dofs, shape (ndofs,), on the host."""
        found = self.forces(self.of_cells(u), self.placed(state), dt)
        return host(np.bincount(self._dofs.ravel(), found.ravel(), self.basis.N)).astype(float)

    def tangent(self, u: Array, state: State, dt: float) -> Any:
        """Derivative of `at` in u, as `matrix`."""
        own = u[self.basis.element_dofs]
        h = 1e-6 * (float(np.abs(u).max(initial=0.0)) or 1.0)
        blocks = np.empty((own.shape[1], len(own), len(own)))
        for j in range(len(own)):
            way = np.zeros((len(own), 1))
            way[j] = 1.0
            blocks[:, :, j] = self.slope(lambda v: self.forces(v, state, dt), own, way, h).T
        return self.matrix(blocks)

    def slope(self, function: Callable[[Any], Any], x: Any, way: Any, h: float) -> Any:
        """Derivative of a function at x along a way, by complex or central differences."""
        if self.complex_step:
            return np.imag(function(x + 1j * COMPLEX_STEP * way)) / COMPLEX_STEP
        return (function(x + h * way) - function(x - h * way)) / (2.0 * h)

    @cached_property
    def _pattern(self) -> tuple[sparse.csr_array, Any]:
        """The sparse matrix of all cells, and the place of each cell's entries in it."""
        dofs, N = self._dofs.astype(np.int64).T, self.basis.N
        keys, place = np.unique(N * dofs[:, :, None] + dofs[:, None], return_inverse=True)
        keys = host(keys)
        ends = np.searchsorted(keys, N * np.arange(N + 1))
        empty = sparse.csr_array((np.zeros(keys.size), keys % N, ends), shape=(N, N))
        return empty, place.ravel()

    def matrix(self, blocks: Any) -> Any:
        """Sum of the cells' matrices, shape (ncells, n, n); on a device `Rows`."""
        like, place = self._pattern
        data = np.bincount(place, blocks.ravel(), like.nnz)
        if self.device:
            return Rows(like.indptr, like.indices, data)
        return sparse.csr_array((data, like.indices, like.indptr), shape=like.shape)


class CellForces(Forces):
    """Internal forces of all cells, with the state of their points."""

    rest: State  # state of the undeformed body, arrays (..., ncells, npoints)

    @abstractmethod
    def updated(self, u: Array, state: State, dt: float) -> State:
        """The state after a step to the displacement u."""

    @abstractmethod
    def recomputed(self, u: Array, state: State, dt: float) -> Array:
        """Forces on all dofs, assembled by scikit-fem."""

    @abstractmethod
    def energy(self, u: Array) -> float:
        """Stored energy; NaN if none is known."""

    @abstractmethod
    def on_device(self, xp: Any) -> CellForces:
        """The same forces by arrays of CuPy, for Newton's method alone."""

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

    def on_device(self, xp: Any) -> CellForces:
        """Refused: scikit-fem's forms run on the host."""
        raise InputError("device: weak forms run on the host; give stress=, or device='cpu'")


def cofactor(F: Any) -> Any:
    """``det(F) F^-T`` of tensors (3, 3, ...)."""
    C = np.empty_like(F)
    for i, j in np.ndindex(3, 3):
        a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        C[i, j] = F[a, c] * F[b, d] - F[a, d] * F[b, c]
    return C


def det(F: Any) -> Any:
    """Determinants of tensors (3, 3, ...)."""
    a, b, c = F[0]
    return (
        a * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
        + b * (F[1, 2] * F[2, 0] - F[1, 0] * F[2, 2])
        + c * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
    )


def with_unit(H: Array) -> Array:
    """F (3, 3, ...) from the displacement gradient (2, 2, ...) or (3, 3, ...)."""
    F = np.zeros((3, 3, *H.shape[2:]))
    F[: len(H), : len(H)] = H
    F[np.arange(3), np.arange(3)] += 1.0
    return F
