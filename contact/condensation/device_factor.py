"""Factors of the whole stiffness on one CUDA device or on several, by cuDSS."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.condensation.condensed_body import Array
from contact.condensation.device_schur import Tree, on_device
from skfem_adini.solvers.cudss import Cudss

Index = NDArray[np.int64]


class DeviceFactor:
    """Factors of a positive definite matrix, for solutions.

    Parameters
    ----------
    stiffness : csr_array or Restricted, shape (n, n)
        Symmetric and positive definite.
    devices : tuple of int, optional
        Devices that share the factors; None for the present one, where equal calls give equal bits
        as long as the factors fit.
    deterministic : bool
        Refuse factors that do not fit.
    tree : tuple of ndarray, or callable () -> tuple of ndarray or None
        As for `DeviceSchur`, of all unknowns; several devices find one of their own.

    Raises
    ------
    InputError
        The matrix is not positive definite, or a device is not there.
    MissingDependency
        cuDSS, CuPy or a device is not there.
    ContactError
        cuDSS fails, for lack of memory say.

    Notes
    -----
    Factors that will not fit into one device lie on the host, which is logged, unless this is
    refused.
    """

    def __init__(
        self, stiffness: Any, devices: tuple[int, ...] | None, deterministic: bool = False,
        tree: Tree = None,
    ) -> None:  # fmt: skip
        def factored(hybrid: bool) -> Cudss:
            repeats = devices is None and not hybrid
            order = tree if devices is None else None
            return Cudss(stiffness, True, repeats, order, hybrid, devices)

        self._cudss = on_device(factored, hybrid=not deterministic)

    def solve(self, loads: Array) -> Array:
        """Solutions for loads (n,) or (n, count), each corrected by its residual."""
        return self._cudss.solve(loads)

    def at(self, places: Index, loads: Array, corrected: bool) -> Array:
        """Solutions at some unknowns (k,) for loads on them, (k,) or (k, count)."""
        return self._cudss.at(places, loads, corrected)

    def once(self, loads: Array) -> Array:
        """Solutions by the factors alone, which lack a digit or two of those of `solve`."""
        return self._cudss.once(loads)

    def congruence(self, rows: sparse.csr_array) -> Any:
        """``R A^-1 R^T`` on the device for sparse rows R; see `skfem_adini.solvers.cudss.Cudss`."""
        return self._cudss.congruence(rows)

    def statistics(self) -> dict[str, Any]:
        """See `skfem_adini.solvers.cudss.CudssMatrix.statistics`."""
        return self._cudss.statistics()
