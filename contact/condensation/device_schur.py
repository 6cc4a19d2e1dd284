"""The dense Schur complement of the contact boundary on a CUDA device, by cuDSS."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.condensation.scaled_stiffness import ScaledStiffness
from contact.condensation.schur import ForwardCache, Vector, not_definite
from contact.errors import InputError, MissingDependency
from skfem_adini.ground.arrays import host
from skfem_adini.solvers.cudss import CudssGeneralSchur, CudssSchur
from skfem_adini.solvers.cudss_library import (
    SolverError,
    device_arrays,
    load_cudss,
)
from skfem_adini.solvers.device_triangle import Restricted, Rows

_log = logging.getLogger(__name__)
Factors = TypeVar("Factors")
Blocks = tuple[NDArray[np.int64], NDArray[np.int64]]  # an order, and the sizes of its blocks
Tree = Blocks | Callable[[], Blocks | None] | None


class DeviceSchur(ForwardCache):
    """A `contact.condensation.schur.SchurFactor` whose complement is on the device.
    `boundary` (nb,), ascending, is kept; `tree`, of `elimination_tree`, may be a callable. Factors
    too large for the device are stored on the host, with a log entry; raises as `on_device`."""

    def __init__(
        self,
        stiffness: sparse.csr_array | Restricted,
        boundary: NDArray[np.int64],
        tree: Tree = None,
    ) -> None:
        self._boundary = boundary
        self._cudss = on_device(
            lambda hybrid: CudssSchur(stiffness, boundary, tree, hybrid_memory=hybrid)
        )

    @property
    def schur(self) -> Any:
        """S_bb - S_bI S_II^-1 S_Ib, on the device."""
        return self._cudss.complement

    def _eliminate(self, load: Any) -> Any:
        return self._cudss.forward(load)

    def reduce(self, load: Any) -> Vector:
        """Reduce a load, on host or device, to the boundary: f_b - S_bI S_II^-1 f_I."""
        carried = self._forward(load)[load.size - self._boundary.size :]
        return np.array(host(carried))

    def expand(self, load: Any, z_b: Vector) -> Any:
        """Return all unknowns from the boundary's, on the device of the load."""
        halfway, given = self._forward(load).copy(), self._cudss.placed(z_b)
        halfway[load.size - z_b.size :] = given
        z = self._cudss.backward(halfway)
        z[self._boundary] = given
        return host(z) if isinstance(load, np.ndarray) else z

    def __getstate__(self) -> dict[str, Any]:
        """Omit the cached loads, which are in the order of these factors."""
        return {name: value for name, value in vars(self).items() if name != "_known"}


class DeviceParts:
    """The complement of the unknowns `last`, ascending, of a general matrix, and substitutions.
    Raises SolverError for pivots that are zero, else as `on_device`."""

    def __init__(self, A: Rows, last: NDArray[np.int64]) -> None:
        self.pattern, self.last, self.turn = (A.indptr, A.indices), last, 0
        self._cudss = on_device(
            lambda hybrid: CudssGeneralSchur(A, last, hybrid_memory=hybrid), definite=False
        )

    def fits(self, A: Rows, last: NDArray[np.int64]) -> bool:
        """Whether a matrix has the pattern and the last unknowns of this one."""
        pairs = zip((*self.pattern, self.last), (A.indptr, A.indices, last), strict=True)
        return all(a is b or np.array_equal(a, b) for a, b in pairs)

    def refactor(self, A: Rows) -> None:
        """Factor other values of the same pattern."""
        self.turn += 1
        self._cudss.refactor(A)

    @property
    def fill(self) -> int:
        """Entries of the factors."""
        return int(self._cudss.statistics()["entries"])

    @property
    def schur(self) -> Any:
        """The complement, on the device."""
        return self._cudss.complement

    def forward(self, load: Vector) -> tuple[Vector, Any]:
        """What is left of a load on the last unknowns, and what `backward` needs."""
        halfway = self._cudss.forward(load).copy()
        return np.array(host(halfway[-self.last.size :])), halfway

    def backward(self, halfway: Any, last: Vector) -> Vector:
        """All unknowns, shape (n,), from the last ones."""
        halfway[-self.last.size :] = self._cudss.placed(last)
        found = np.array(host(self._cudss.backward(halfway)))
        found[self.last] = last
        return found


def restricted(system: ScaledStiffness) -> Restricted | None:
    """The matrix, formed on the device; None unless unknowns are dofs in ascending order."""
    if system.free is None or np.any(np.diff(system.free) <= 0):
        return None
    placed = None if system.placed is None else system.placed.placed
    return Restricted(system.given, system.free, system.unit, placed)


def on_device(
    factored: Callable[[bool], Factors], hybrid: bool = True, definite: bool = True
) -> Factors:
    """Factors by ``factored(hybrid)``; in hybrid memory with the host if the device is too small.
    Raises InputError (not definite, if it should be), MissingDependency (no cuDSS, CuPy or device)
    or ContactError (cuDSS fails, as for lack of memory)."""
    try:
        try:
            return factored(False)
        except SolverError as error:
            if error.hybrid is None or not hybrid:
                raise
            _log.info("hybrid memory: %s", error)
        return factored(True)
    except MissingDependency as error:
        raise MissingDependency(f"device='cuda': {error}") from error
    except InputError as error:
        raise InputError(f"device: {error}") from error
    except SolverError as error:
        if error.pivot and definite:
            raise not_definite() from error
        raise


def missing_for_cudss() -> str | None:
    """The reason why cuDSS cannot run here, and how to install it; None if it can."""
    try:
        device_arrays()
        load_cudss()
    except MissingDependency as error:
        return str(error)
    return None
