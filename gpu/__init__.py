"""Quadratic programs, partial eigenvalues and regulators on NumPy and CuPy.

`solve_qp` minimises a convex quadratic over a box with equality and inequality rows, dense or
sparse, by primal-dual active sets and interior points; `QPFactor` serves many problems with one
matrix. `eigs`, `eigsh` and `svds` find a few eigenvalues or singular values of a large matrix,
`lqr`, `dlqr` and `lqe` the gains of regulators, `care` and `dare` solve their equations. Each runs
on the host or on a device, where its arrays lie, every result carries residuals recomputed from the
problem, and every failure is a `GpuError`.
"""

from gpu.eigenvalues.eigs import eigs
from gpu.eigenvalues.eigsh import eigsh
from gpu.eigenvalues.svds import svds
from gpu.errors import (
    GpuError,
    Infeasible,
    InputError,
    MissingDependency,
    NotConverged,
    NotSupported,
    RiccatiError,
    Unbounded,
)
from gpu.qp.batch import QPBatch, batch_solve_qp
from gpu.qp.data.derivatives import Gradients
from gpu.qp.data.qp_result import KKT, QPResult, Status, Step
from gpu.qp.qpsolvers_backend import register_qpsolvers
from gpu.qp.sequence import QPFactor
from gpu.qp.solve_qp import solve_qp
from gpu.riccati.dlqr import DLQRResult, dare, dlqr
from gpu.riccati.lqr import care, lqe, lqr
from gpu.riccati.lqr_result import LQRResult
from gpu.riccati.methods.hamiltonian_inverse import hamiltonian_inverse
from gpu.riccati.problem.candidate import LowRankValue

__all__ = [
    "KKT",
    "DLQRResult",
    "GpuError",
    "Gradients",
    "Infeasible",
    "InputError",
    "LQRResult",
    "LowRankValue",
    "MissingDependency",
    "NotConverged",
    "NotSupported",
    "QPBatch",
    "QPFactor",
    "QPResult",
    "RiccatiError",
    "Status",
    "Step",
    "Unbounded",
    "batch_solve_qp",
    "care",
    "dare",
    "dlqr",
    "eigs",
    "eigsh",
    "hamiltonian_inverse",
    "lqe",
    "lqr",
    "register_qpsolvers",
    "solve_qp",
    "svds",
]

__version__ = "1.0.0rc1"


def __dir__() -> list[str]:
    """The public names, without the submodules."""
    return [*__all__, "__version__"]
