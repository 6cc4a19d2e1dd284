"""A body without elimination: its compliance comes from solutions of the whole body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import qr

from contact.arrays.dense_arrays import HostArrays
from contact.condensation.background import BackgroundWork
from contact.condensation.condensed_body import Array, BodyRows
from contact.condensation.device_schur import Tree, on_device, restricted
from contact.condensation.scaled_stiffness import ScaledStiffness
from contact.condensation.schur import not_definite
from contact.condensation.sparse import SparseBody
from contact.errors import ContactError, InputError
from skfem_adini import factorize
from skfem_adini.solvers.cudss import Cudss

# Row compliance times the unknown's stiffness, 1.3 to 4 on uniform meshes; only for scaling.
ROW_COMPLIANCE = 2.0
DENSE_ORDER = 8000  # largest order of a dense stiffness: factoring takes 20 s and half a gigabyte


class SolvedBody(SparseBody):
    """A body whose compliance ``B S^-1 B^T`` comes from solutions, by columns or as an operator.
    Free motions N: ``(S + rho N N^T)^-1 = S^+ + N N^T / rho``. S^+ comes from S with as many
    springs, which are unloaded for forces orthogonal to N. With device `arrays` the device
    factors."""

    thin = False

    def __init__(
        self, body: Any, rows: BodyRows, solver: str = "auto", arrays: HostArrays | None = None,
        devices: tuple[int, ...] | None = None, deterministic: bool = False,
    ) -> None:  # fmt: skip
        self._devices, self._deterministic = devices, deterministic
        super().__init__(body, rows, solver, arrays)

    def _eliminate(
        self, B: sparse.csr_array, background: BackgroundWork, system: ScaledStiffness, solver: str
    ) -> None:
        modes = self._seen(background, system.unit)
        touched, k = self._boundary, modes.shape[1]
        self._boundary = np.arange(system.unit.size)
        self._take(B)
        self.diagonal = system.diagonal
        self.N = self.modes = np.linalg.qr(modes)[0] if k else modes
        self._factor, self._soft = _Whole(system), 0.0
        here = None if k or not self._on_device else restricted(system)
        if here is not None:
            tree = background.tree(np.zeros(0, dtype=np.int64))
            self._solver: Any = _on_devices(here, self._devices, self._deterministic, tree)
            return
        held = system.matrix()
        if k:
            of_touched, springs = self.N[touched], np.zeros(system.unit.size)
            self._soft = k / float((of_touched**2).sum())
            springs[touched[qr(of_touched.T, mode="economic", pivoting=True)[2][:k]]] = 1.0
            held = sparse.csr_array(held + sparse.diags_array(springs))
        self._solver = (
            _on_devices(held, self._devices, self._deterministic)
            if self._on_device
            else _on_host(held, solver)
        )

    def touched_by(self, rows: BodyRows) -> SolvedBody:
        """The same factorisation for other rows."""
        other = super().touched_by(rows)
        assert isinstance(other, SolvedBody)
        other._take(other.B)
        return other

    def _take(self, B: sparse.csr_array) -> None:
        """Store the rows, on all unknowns and on those with entries."""
        self.B, self._touched = B, np.unique(B.indices).astype(np.int64)
        self._of_touched = sparse.csr_array(B[:, self._touched])

    @property
    def order(self) -> int:
        """Order of the largest dense matrix."""
        return self.B.shape[0]

    def statistics(self) -> dict[str, Any]:
        """Entries and bytes of the factors on devices, see `CudssMatrix`; empty on the host."""
        found: dict[str, Any] = getattr(self._solver, "statistics", dict)()
        return found

    def compliance(self) -> Any:
        """``B S^-1 B^T`` on the device of the arrays, by columns, shape (n, n)."""
        if self._on_device and self._devices is None and not self.N.shape[1]:
            return self._solver.congruence(self.B)
        n = self.B.shape[0]
        W, columns = np.zeros((n, n), order="F"), sparse.csc_array(self.B.T)
        together = 32  # columns solved for at a time
        for i in range(0, n, together):
            part = slice(i, i + together)
            W[:, part] = self.B @ self._held(columns[:, part].toarray(), self._solver.solve)
        return self.arrays.put(0.5 * (W + W.T))

    def row_compliance(self) -> Array:
        """Estimated diagonal of the compliance, shape (n,)."""
        return np.asarray(ROW_COMPLIANCE * (self.B.multiply(self.B) @ (1.0 / self.diagonal)))

    def yielded(self, forces: Array, corrected: bool = True) -> Array:
        """``B S^-1 B^T`` times forces on the rows, (n,) or (n, count).
        If `corrected`, solutions are refined by their residuals."""
        if self._on_device and not self.N.shape[1]:
            loads = self._of_touched.T @ forces
            yielded: Array = self._of_touched @ self._solver.at(self._touched, loads, corrected)
            return yielded
        solve = self._solver.solve if corrected else self._once
        moved: Array = self.B @ self._held(self.B.T @ forces, solve)
        return moved

    def flexed(self, r: Array) -> Array:
        """Displacement of all unknowns under forces r on them."""
        return self._held(r, self._solver.solve)

    @property
    def _once(self) -> Callable[[Array], Array]:
        """The solve without iterative refinement, if the solver has one."""
        once: Callable[[Array], Array] = getattr(self._solver, "once", self._solver.solve)
        return once

    def _held(self, forces: Array, solve: Callable[[Array], Array]) -> Array:
        """``(S + rho N N^T)^-1`` times forces (n,) or (n, count)."""
        if not self.N.shape[1]:
            return np.asarray(solve(forces))
        N, along = self.N, self.N.T @ forces
        z = solve(forces - N @ along)
        return np.asarray(z - N @ (N.T @ z) + N @ (self._soft * along))

    def scaled_schur(self) -> Any:
        """A dense copy of the stiffness, for small bodies only."""
        if self.B.shape[1] > DENSE_ORDER:
            raise ContactError(
                f"the stiffness of {self.B.shape[1]} unknowns is not made dense; condense with a "
                "dense boundary problem, on one device or the host"
            )
        return super().scaled_schur()


def _on_host(stiffness: sparse.csr_array, solver: str) -> Any:
    """Factors by a solver of the host."""
    try:
        return factorize(stiffness, solver=solver)  # type: ignore[arg-type]
    except InputError as error:
        raise not_definite() from error


@dataclass(frozen=True)
class _Whole:
    """A `contact.condensation.schur.SchurFactor` without inner unknowns."""

    system: ScaledStiffness

    @property
    def schur(self) -> Array:
        return np.asarray(self.system.matrix().toarray())

    def reduce(self, load: Array) -> Array:
        return load

    def expand(self, load: Array, z_b: Array) -> Array:
        return z_b


Index = NDArray[np.int64]


def _on_devices(
    stiffness: Any, devices: tuple[int, ...] | None, deterministic: bool, tree: Tree = None
) -> Cudss:
    """Factors of a symmetric positive definite matrix on devices, for solutions.
    One device is bitwise reproducible if the factors fit; otherwise they are stored on the host, or
    `deterministic` refuses. `tree` as for `DeviceSchur` (one device); raises as `on_device`."""

    def factored(hybrid: bool) -> Cudss:
        repeats = devices is None and not hybrid
        return Cudss(stiffness, True, repeats, tree if devices is None else None, hybrid, devices)

    return on_device(factored, hybrid=not deterministic)
