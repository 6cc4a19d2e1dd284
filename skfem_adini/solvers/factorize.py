"""Solution of symmetric sparse systems: PARDISO, SuperLU, or multigrid with CG, by one call."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Literal, Protocol, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from skfem_adini.errors import InputError, MissingDependency, SolverError
from skfem_adini.ground.arguments import real_matrix, real_part
from skfem_adini.ground.pardiso import DEFINITE, INDEFINITE, Pardiso, has_pardiso
from skfem_adini.solvers.cudss import Cudss
from skfem_adini.solvers.multigrid import Multigrid, NearNullSpace

Array = NDArray[np.float64]
Solver = Literal["auto", "pardiso", "superlu", "amg", "cudss"]


class Factorization(Protocol):
    """The common interface of the results of `factorize`."""

    @property
    def iterations(self) -> int:
        """Iterations of the last solution; 0 for the direct solvers."""
        ...

    def solve(self, b: Array) -> Array:
        """Return the solution for one load (n,) or several (n, loads)."""
        ...

    def refactor(self, A: Any) -> None:
        """Factor other values in the places of the same pattern, zeros included."""
        ...


def factorize(
    A: Any,
    definite: bool = True,
    solver: Solver = "auto",
    near_null: NearNullSpace | None = None,
    tol: float = 1e-10,
    max_iterations: int = 500,
    order: ArrayLike | None = None,
    hybrid_memory: bool | int = False,
    devices: Iterable[int] | None = None,
) -> Factorization:
    r"""Factor a symmetric sparse matrix once, for any number of solves.

    Rows and columns are first scaled by :math:`a_{ii}^{-1/2}`, those of indefinite matrices until
    the largest entry of every row is 1 (Ruiz). For Hermite elements this amounts to the dofs u and
    h u_x, which makes the condition number that of a Lagrange element.

    Parameters
    ----------
    A
        Symmetric sparse matrix, shape (n, n).
    definite
        Whether A is positive definite. If so, PARDISO factors without pivoting, and detects if A is
        not definite.
    solver
        ``"auto"`` takes PARDISO when pypardiso is importable; ``"superlu"`` is SciPy's SuperLU with
        minimum degree ordering of A + A^T and diagonal pivots. ``"amg"`` is the method of conjugate
        gradients preconditioned by smoothed aggregation (pyamg), for definite matrices in 3-D,
        where the factors of a direct solver outgrow the memory; it needs `near_null` and stops at
        `tol`. ``"cudss"`` factors on a CUDA device, and equal calls give equal bits there.
    near_null
        For ``"amg"``: what `near_null_space` returns for the unknowns of A.
    tol
        For ``"amg"``: bound of the residual relative to the load, both in the scaled dofs,
        recomputed from A after the iteration; the rounding error of A x is allowed in addition.
    max_iterations
        For ``"amg"``: largest number of iterations of conjugate gradients.
    order
        For ``"cudss"``: order of elimination, shape (n,), the unknown of each step, as that of a
        nested dissection of the mesh. None: cuDSS computes one.
    hybrid_memory
        For ``"cudss"``: keep the factors in the memory of the host, and a part of them on the
        device: of as many bytes as the number says, or as cuDSS decides if True. Slower, for
        factors that do not fit; equal calls may then differ in the last bits.
    devices
        For ``"cudss"``: numbers of the CUDA devices that share the factors, ``(0, 1)`` for
        instance, where one cannot hold them; equal calls may then differ in the last bits. None:
        the present device.

    Returns
    -------
    Factorization
        Its method ``solve(b)`` takes loads of shape (n,) or (n, loads), real or complex. Threads
        may share it, and it can be copied and pickled; a copy repeats the factorisation if needed.
        Its method ``refactor(A)`` factors other values with the same pattern; cuDSS keeps its
        analysis, which takes longer than the factorisation, the others begin anew.

    Raises
    ------
    InputError
        A is not real, square, finite and symmetric, or singular, or (PARDISO, cuDSS) not definite;
        a load that is not finite; a pattern in ``refactor`` that is not that of A; `order` that is
        no permutation; `devices` that are not there; `order`, `hybrid_memory` or `devices` for
        another solver than cuDSS, or the last two together; ``"amg"`` without a fitting
        `near_null`, with `definite` false, or a `tol` that is not in (0, 1).
    MissingDependency
        PARDISO, pyamg or cuDSS was asked for and is not installed, or there is no device for cuDSS.
    AdiniError
        The factors will not fit into the memory of the device; the text says what would.

    The method ``solve`` of ``"amg"`` raises `NotConverged` when the residual stays above `tol`.

    References
    ----------
    P. Vanek, J. Mandel and M. Brezina, Algebraic multigrid by smoothed aggregation for second and
    fourth order elliptic problems, Computing 56 (1996), 179-196.
    D. Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices, report
    RAL-TR-2001-034, Rutherford Appleton Laboratory, 2001.

    Notes
    -----
    The factors are tested: they must recover a random vector from its product with A to three
    digits. If they do not, A is singular in double precision, and solutions would be meaningless.
    Multigrid checks the residual of each solution instead.

    Examples
    --------
    >>> from scipy import sparse
    >>> A = sparse.diags_array([2.0, 4.0]).tocsr()
    >>> factorize(A).solve(np.array([2.0, 2.0])).tolist()
    [1.0, 0.5]
    """
    if solver not in get_args(Solver):
        raise InputError(f"solver: expected one of {get_args(Solver)}, got {solver!r}")
    if solver == "pardiso" and not has_pardiso():
        raise MissingDependency("PARDISO needs pypardiso: pip install 'skfem-adini[mkl]'")
    options = {"order": order, "hybrid_memory": hybrid_memory, "devices": devices}
    if solver != "cudss" and (order is not None or hybrid_memory or devices is not None):
        raise InputError(f"{', '.join(options)}: for solver='cudss', not {solver!r}")
    A = _checked(A)
    scale = _scale(A, definite)
    scaled = _scaled(A, scale)
    if solver == "amg":
        modes = _scaled_modes(near_null, scale, definite)
        if not 0 < tol < 1 or not max_iterations >= 1:
            raise InputError(
                f"tol, max_iterations: expected a number in (0, 1) and a positive one, got {tol!r} "
                f"and {max_iterations!r}"
            )
        return _Scaled(Multigrid(scaled, modes, tol, max_iterations), scale, A, definite)
    factors = _direct(solver)(scaled, definite, **(options if solver == "cudss" else {}))
    _probe(factors, scaled, definite)
    return _Scaled(factors, scale, A, definite)


def _checked(A: Any) -> Any:
    """Return a matrix that is real, square and finite, by rows with ascending columns."""
    A = real_matrix("A", A)
    if not A.has_canonical_format:
        A = A.copy()
        A.sum_duplicates()
    if A.shape[0] != A.shape[1] or A.shape[0] == 0:
        raise InputError(f"A: expected a square matrix, got shape {A.shape}")
    if not np.isfinite(A.data).all():
        raise InputError("A: the matrix holds NaN or infinity")
    return A


def _scaled(A: Any, scale: Array) -> Any:
    """Return D A D, where D is the diagonal matrix `scale`, if it is symmetric."""
    data = np.repeat(scale, np.diff(A.indptr)) * A.data * scale[A.indices]
    scaled = sparse.csr_array((data, A.indices, A.indptr), shape=A.shape)
    if not np.abs(scaled - scaled.T).max() <= 1e-12:  # of the diagonal: thousands of roundings
        raise InputError("A: the matrix is not symmetric")
    return scaled


def _probe(factors: Any, scaled: Any, definite: bool) -> None:
    """Raise unless the factors recover a random vector."""
    probe = np.random.default_rng(0).uniform(-1, 1, scaled.shape[0])
    # Three digits show that the matrix is regular.
    if not np.abs(factors.solve(scaled @ probe) - probe).max() <= 1e-3:
        raise _singular(definite)


def _direct(solver: Solver) -> Any:
    """Return the class that factors a scaled matrix."""
    if solver == "cudss":
        return _Cudss
    return _Pardiso if solver != "superlu" and has_pardiso() else _SuperLU


def _scale(A: Any, definite: bool) -> Array:
    """Return the factors by which rows and columns are scaled, shape (n,)."""
    if definite:
        diagonal = A.diagonal()
        if not (diagonal > 0).all():
            raise InputError("A: an entry of the diagonal is not positive, so A is not definite")
        return 1 / np.sqrt(diagonal)
    scale = np.ones(A.shape[0])
    for _ in range(10):  # Ruiz steps: each halves the logarithms of the rows' largest entries
        D = sparse.diags_array(scale)
        largest = np.abs(D @ A @ D).max(axis=1).toarray().ravel()
        if not largest.all():
            raise InputError("A: a row is zero, so the matrix is singular")
        scale /= np.sqrt(largest)
    return scale


def _scaled_modes(near_null: NearNullSpace | None, scale: Array, definite: bool) -> NearNullSpace:
    """Return the near-null space in the scaled unknowns."""
    if near_null is None or not definite:
        raise InputError(
            "near_null: solver='amg' needs a definite matrix and near_null=near_null_space(basis, "
            "dofs) with the dofs of its unknowns"
        )
    if len(near_null.modes) != len(scale) or len(near_null.vertex) != len(scale):
        raise InputError(
            f"near_null: it has {len(near_null.modes)} unknowns, A has {len(scale)}; pass the same "
            "dofs to near_null_space that A was restricted to"
        )
    return NearNullSpace(near_null.modes / scale[:, None], near_null.vertex)


def require_definite(factors: Factorization) -> None:
    """Raise if a pivot is negative: PARDISO and cuDSS report them, SuperLU continues."""
    inner = getattr(factors, "_factors", None)
    if isinstance(inner, _SuperLU) and not inner.definite():
        raise _singular(definite=True)


def _singular(definite: bool) -> InputError:
    if definite:
        return InputError(
            "A: the matrix is singular or not positive definite; are essential conditions missing, "
            "or is a penalty too small?"
        )
    return InputError("A: the matrix is singular; are essential conditions missing?")


class _Scaled:
    """Solver for A by the factors of D A D, where D is the diagonal matrix `scale`."""

    def __init__(self, factors: Any, scale: Array, A: Any, definite: bool) -> None:
        self._factors, self._scale, self._definite = factors, scale, definite
        self._pattern = A.shape, A.indptr, A.indices

    def refactor(self, A: Any) -> None:
        A = _checked(A)
        pattern = A.shape, A.indptr, A.indices
        if not all(map(np.array_equal, pattern, self._pattern)):
            raise InputError(
                f"A: its {A.nnz} entries are not in the places of the {self._pattern[2].size} that "
                "were factored; call factorize for another pattern"
            )
        if isinstance(self._factors, Multigrid):
            raise InputError("refactor: solver='amg' has no analysis to keep; call factorize")
        scale = _scale(A, self._definite)
        scaled = _scaled(A, scale)
        if isinstance(self._factors, _Cudss):
            self._factors.refactor(scaled)
        else:
            self._factors = type(self._factors)(scaled, self._definite)
        _probe(self._factors, scaled, self._definite)
        self._scale = scale

    @property
    def iterations(self) -> int:
        return self._factors.iterations

    def solve(self, b: ArrayLike) -> Any:
        b = np.asarray(b)
        if np.iscomplexobj(b):
            return np.asarray(self.solve(b.real) + 1j * self.solve(b.imag))
        b = real_part("b", b)
        if b.ndim not in (1, 2) or len(b) != len(self._scale):
            raise InputError(f"b: expected {len(self._scale)} rows, got shape {b.shape}")
        if not np.isfinite(b).all():
            raise InputError("b: the load holds NaN or infinity")
        scale = self._scale if b.ndim == 1 else self._scale[:, None]
        return scale * self._factors.solve(scale * b)


class _SuperLU:
    iterations = 0

    def __init__(self, A: Any, definite: bool) -> None:
        try:
            # 0.01: a pivot off the diagonal where the diagonal is a hundred times smaller.
            self._factors = SuperLUFactor(A, "MMD_AT_PLUS_A", 0.0 if definite else 0.01)
        except RuntimeError as error:  # SuperLU: exactly singular
            raise _singular(definite) from error

    def definite(self) -> bool:
        """Whether all pivots are positive (Sylvester), which copies the factor to be read."""
        factors = self._factors.factors
        diagonal = np.array_equal(factors.perm_r, factors.perm_c)
        return diagonal and bool((factors.U.diagonal() > 0).all())

    def solve(self, b: Array) -> Array:
        return self._factors.solve(b)


class _Pardiso:
    iterations = 0

    def __init__(self, A: Any, definite: bool) -> None:
        self._definite = definite
        self._pardiso = Pardiso(A, DEFINITE if definite else INDEFINITE)
        self._run(12)  # analysis and factorisation

    def solve(self, b: Array) -> Array:
        columns = np.asfortranarray(b.reshape(len(b), -1))
        x = np.zeros_like(columns, order="F")
        self._run(33, columns, x)  # solution
        return x.reshape(b.shape)

    def _run(self, phase: int, b: Array | None = None, x: Array | None = None) -> None:
        try:
            self._pardiso(phase, b, x)
        except SolverError as error:
            raise (_singular(self._definite) if error.pivot else error) from error


class _Cudss:
    iterations = 0

    def __init__(
        self, A: Any, definite: bool, order: ArrayLike | None, hybrid_memory: bool | int,
        devices: Iterable[int] | None,
    ) -> None:  # fmt: skip
        self._definite = definite
        with self._typed():
            repeats = not hybrid_memory and devices is None
            self._cudss = Cudss(A, definite, repeats, order, hybrid_memory, devices)

    def refactor(self, A: Any) -> None:
        with self._typed():
            self._cudss.refactor(A)

    @contextmanager
    def _typed(self) -> Iterator[None]:
        """Raise a pivot's error as one of the argument."""
        try:
            yield
        except SolverError as error:
            raise (_singular(self._definite) if error.pivot else error) from error

    def solve(self, b: Array) -> Array:
        return self._cudss.solve(b)


Ordering = Literal["NATURAL", "MMD_AT_PLUS_A"]


class SuperLUFactor:
    """Factors of a symmetric matrix A (n, n), without row exchanges where the pivots allow it.
    Threads may share it, and a copy is the object itself; a pickle factors the matrix again.
    With a `threshold` of 0 every pivot on the diagonal that is not zero is kept."""

    def __init__(self, A: Any, ordering: Ordering, threshold: float) -> None:
        A = sparse.csc_matrix(A)
        self._given = A, ordering, threshold
        self.factors = splu(
            A,
            permc_spec=ordering,
            diag_pivot_thresh=threshold,
            options={"SymmetricMode": True},
        )

    def solve(self, b: Array) -> Array:
        """Return the solution for one load (n,) or several (n, loads)."""
        return np.asarray(self.factors.solve(b))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._given

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self
