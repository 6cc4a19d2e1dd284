"""Direct solver for constant coefficients on uniform grids, by sine and cosine transforms."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, localcontext
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft
from scipy.sparse.linalg import LinearOperator
from skfem import CellBasis

from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of, choice, dof_numbers, integer, real_part
from skfem_adini.solvers.exact_matrices import exact_matrix
from skfem_adini.uniform.symbols import (
    continuous_eigenvalue,
    exact_symbol,
    extended_eigenvalue,
    is_odd,
    phase,
)

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Condition = Literal["dirichlet", "neumann"]


class UniformSolver:
    r"""Solver of :math:`-\sum_i k_i u_{x_i x_i} + c u = f` with Adini's element on a uniform grid.

    The system is the one that scikit-fem assembles. On a box with equal cells it couples all
    vertices in the same way, so with

    .. math::
        u_j = \sum_m a_m \prod_i \sin\frac{\pi m_i j_i}{n_i}, \qquad
        (h_l u_{x_l})_j = \sum_m b^l_m \cos\frac{\pi m_l j_l}{n_l}
        \prod_{i \ne l} \sin\frac{\pi m_i j_i}{n_i}

    it decouples into systems of dim + 1 unknowns :math:`(a_m, b^1_m, ...)`, one for each m. The
    cost is that of dim + 1 transforms back and forth, O(N log N). The sums satisfy u = 0 and
    u_t = 0 on the boundary, where also the equations of the normal derivatives hold: this is
    exactly the conforming Dirichlet problem. With sines and cosines exchanged they satisfy
    u_n = 0 instead, see `bc`.

    Parameters
    ----------
    shape
        Number of cells in x, y (and z), at least 2 each.
    lengths
        Sides of the box, one number for a square or cube.
    bc
        ``"dirichlet"``: u and its tangential derivatives vanish on the boundary. ``"neumann"``: all
        normal derivatives on the boundary vanish. Imposing u_n = 0 is *not* the natural condition
        of the finite element method, which leaves u_n free and is more accurate; the natural
        problem has no such solver, and this one is a good preconditioner for it.
    k
        Conductivity, positive: one number or one for each direction.
    c
        Reaction coefficient, not negative.

    Attributes
    ----------
    shape, lengths, bc, k, c
        As given, with one entry for each direction.
    free
        The dofs that the boundary condition leaves free, sorted.

    Raises
    ------
    InputError
        Fewer than 2 cells, another `bc`, or lengths, k or c that are not finite or out of range.

    Notes
    -----
    Vectors have the dofs of ``MeshQuad.init_tensor`` and ``MeshHex.init_tensor``: the dim + 1 dofs
    u, u_x, u_y (, u_z) of one vertex after the other, with the vertices counted in 2-D along y
    first and then along x, in 3-D along y, then x, then z. For another numbering of the same grid
    use `from_basis`. `to_grid` and `from_grid` translate to and from arrays indexed by
    (dof, i, j(, k)).

    References
    ----------
    B. L. Buzbee, G. H. Golub and C. W. Nielson, On direct methods for solving Poisson's equations,
    SIAM Journal on Numerical Analysis 7 (1970), 627-656: transforms for the five-point scheme.

    Examples
    --------
    >>> import numpy as np
    >>> from skfem import Basis, LinearForm, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> points = np.linspace(0, 1, 17)
    >>> basis = Basis(MeshQuad.init_tensor(points, points), ElementQuadAdini())
    >>> load = LinearForm(lambda v, w: v).assemble(basis)
    >>> solver = UniformSolver((16, 16), 1.0)
    >>> u = solver.to_grid(solver.solve(load))[0]
    >>> print(f"{u[8, 8]:.5f}")  # the exact solution has .0736713...
    0.07367
    """

    def __init__(
        self,
        shape: Sequence[int],
        lengths: float | Sequence[float] = 1.0,
        bc: Condition = "dirichlet",
        k: float | Sequence[float] = 1.0,
        c: float = 0.0,
    ) -> None:
        cells = array_of("shape", shape)
        if cells.shape not in ((2,), (3,)) or cells.dtype.kind not in "iu" or cells.min() < 2:
            raise InputError(
                f"shape: expected 2 or 3 whole numbers of cells, each at least 2, got {shape!r}"
            )
        choice("bc", bc, ("dirichlet", "neumann"))
        dim = cells.size
        self.shape = tuple(int(n) for n in cells)
        self.lengths = _numbers("lengths", lengths, dim)
        self.k = _numbers("k", k, dim)
        (self.c,) = _numbers("c", c, 1, zero=True)
        self.bc = bc
        self._steps = tuple(l / n for l, n in zip(self.lengths, self.shape, strict=True))
        self._blocks = BlockDiagonalGrid(
            self.shape, self._steps, self.k, self.c, dirichlet=bc == "dirichlet"
        )
        self._nodes = tensor_nodes(self._blocks.shape[1:])

    @classmethod
    def from_basis(
        cls,
        basis: Any,
        bc: Condition = "dirichlet",
        k: float | Sequence[float] = 1.0,
        c: float = 0.0,
    ) -> UniformSolver:
        """Return the solver for the dofs of a basis on a uniform grid with any numbering.

        Parameters
        ----------
        basis
            Basis with Adini's element whose vertices form a box of equal cells.
        bc, k, c
            As for the class.

        Returns
        -------
        UniformSolver
            Its vectors have the numbering of the basis.

        Raises
        ------
        InputError
            Another element, or vertices that are no such grid.
        """
        if not isinstance(basis, CellBasis):
            raise InputError(f"basis: expected a skfem.Basis of cells, got {type(basis).__name__}")
        dim = basis.mesh.dim()
        names = ["u", "u_x", "u_y", "u_z"][: dim + 1]
        if list(basis.elem.dofnames) != names:
            raise InputError(
                f"basis: expected Adini's element with the dofs {names}, "
                f"got {type(basis.elem).__name__}"
            )
        p = basis.mesh.p
        if not np.isfinite(p).all():
            raise InputError("basis: a coordinate of its mesh is NaN or infinite")
        origin, lengths = p.min(axis=1), np.ptp(p, axis=1)
        rounding = 1e-10 * np.abs(p).max()  # closer coordinates lie on one grid line
        shape = [int(np.sum(np.diff(np.sort(row)) > rounding)) for row in p]
        index = np.rint((p - origin[:, None]) * (shape / lengths)[:, None]).astype(int)
        places = origin[:, None] + index * (lengths / shape)[:, None]
        filled = np.zeros([n + 1 for n in shape], dtype=int)
        np.add.at(filled, tuple(index), 1)
        complete = (filled == 1).all() and basis.mesh.nelements == np.prod(shape)
        if not np.abs(p - places).max() <= rounding or not complete:
            raise InputError("basis: its mesh is no uniform grid of a full box")
        solver = cls(shape, lengths, bc, k, c)
        solver._nodes[tuple(index)] = np.arange(p.shape[1])
        return solver

    @property
    def size(self) -> int:
        """Number of all dofs."""
        return int(np.prod(self._blocks.shape))

    @property
    def free(self) -> Indices:
        """The dofs that the boundary condition leaves free, sorted."""
        return np.flatnonzero(self.from_grid(~self._blocks.fixed()))

    def to_grid(self, x: ArrayLike) -> Array:
        """Return a dof vector as an array (dof, i, j) or (dof, i, j, k) over the grid.

        Parameters
        ----------
        x
            Dofs or loads, shape (size,).

        Returns
        -------
        ndarray
            Shape (dim + 1, n_x + 1, n_y + 1), in 3-D (dim + 1, n_x + 1, n_y + 1, n_z + 1).

        Raises
        ------
        InputError
            Another shape, or no real numbers.
        """
        x = real_part("x", x)
        if x.shape != (self.size,):
            raise InputError(f"x: expected shape ({self.size},), got {x.shape}")
        return np.moveaxis(x.reshape(self._nodes.size, -1)[self._nodes], -1, 0)

    def from_grid(self, values: ArrayLike) -> Array:
        """Return the dof vector of an array over the grid; the inverse of `to_grid`.

        Parameters
        ----------
        values
            Shape (dim + 1, n_x + 1, n_y + 1) or (dim + 1, n_x + 1, n_y + 1, n_z + 1).

        Returns
        -------
        ndarray
            Shape (size,).

        Raises
        ------
        InputError
            Another shape, or no real numbers.
        """
        values = real_part("values", values)
        if values.shape != self._blocks.shape:
            raise InputError(f"values: expected shape {self._blocks.shape}, got {values.shape}")
        x = np.empty((self._nodes.size, len(values)))
        x[self._nodes] = np.moveaxis(values, 0, -1)
        return x.ravel()

    def solve(self, f: ArrayLike) -> Array:
        """Return the solution for an assembled load.

        Parameters
        ----------
        f
            Load vector of all dofs, shape (size,); entries of fixed dofs do not count. For
            boundary values that are not zero subtract the stiffness matrix times a lifting.

        Returns
        -------
        ndarray
            All dofs, shape (size,), zero where the condition fixes them. The pure Neumann problem
            (c = 0) has the solution of mean zero.

        Raises
        ------
        InputError
            A wrong shape or NaN; a load of the pure Neumann problem whose sum is not zero, so that
            there is no solution.
        """
        load = self.to_grid(f)
        if not np.isfinite(load).all():
            raise InputError("f: the load holds NaN or infinity")
        if self._blocks.singular:
            total, size = load[0].sum(), np.abs(load[0]).sum()
            if not abs(total) <= 1e-10 * size:
                raise InputError(
                    f"f: the loads of u sum to {total:.3e}, but without reaction (c = 0) they must "
                    "balance for u_n = 0; subtract the mean of the source or set c"
                )
        return self.from_grid(self._blocks.solve(load))

    def as_linear_operator(self, dofs: ArrayLike | None = None) -> LinearOperator:
        """Return a symmetric positive definite preconditioner for variable coefficients.

        With coefficients between a k and b k and the same essential conditions, the condition
        number of the preconditioned system is at most b / a on every grid. With natural conditions
        u_n is free in the system but fixed here; the condition number is larger, still bounded.

        Parameters
        ----------
        dofs
            The dofs of the system, for instance what `skfem.condense` keeps; all by default.

        Returns
        -------
        LinearOperator
            `solve` on the free dofs. Fixed ones are divided by the diagonal of the matrix, and the
            constants of the pure Neumann problem by its next eigenvalue, so that the operator is
            definite and also serves systems in which these dofs are unknowns.

        Raises
        ------
        InputError
            A dof number that does not exist, or comes twice.
        """
        chosen = np.arange(self.size) if dofs is None else dof_numbers("dofs", dofs, self.size)
        if np.unique(chosen).size != chosen.size:
            raise InputError("dofs: expected a list of different dof numbers")
        fixed = self._blocks.fixed()
        diagonal = np.broadcast_to(self._blocks.diagonal(), (*fixed.shape[1:], len(fixed)))
        jacobi = np.where(fixed, 1.0 / np.moveaxis(diagonal, -1, 0), 0.0)
        slowest = min(k * (np.pi / l) ** 2 for k, l in zip(self.k, self.lengths, strict=True))
        constant = 1.0 / (slowest * float(np.prod(self._steps)))

        def apply(r: Array) -> Array:
            load = np.zeros(self.size)
            load[chosen] = np.ravel(r)
            grid = self.to_grid(load)
            return self.from_grid(self._blocks.solve(grid, constant) + jacobi * grid)[chosen]

        return LinearOperator((chosen.size, chosen.size), matvec=apply, dtype=np.float64)

    def eigenvalue(self, *modes: int, digits: int = 50) -> Decimal:
        """Return the discrete eigenvalue next to that of a product of sines or cosines.

        It is exact for the binary values of `lengths`, `k` and `c`; the corresponding eigenvector
        is the smoothest of the block that `modes` belongs to.

        Parameters
        ----------
        modes
            Half waves in each direction: 1 to n - 1 for Dirichlet, 0 to n for Neumann conditions.
        digits
            Significant digits.

        Returns
        -------
        Decimal

        Raises
        ------
        InputError
            Another number of modes than directions, or modes out of range.

        Examples
        --------
        >>> solver = UniformSolver((4, 4))
        >>> print(solver.eigenvalue(1, 1, digits=30))
        19.7426671508633413978287256709
        """
        return self._eigenvalues(modes, digits)[0]

    def eigenvalue_error(self, *modes: int, digits: int = 50) -> float:
        r"""Return the relative error of `eigenvalue`.

        The exact eigenvalue is :math:`\sum_i k_i (\pi m_i / l_i)^2 + c`.

        Parameters
        ----------
        modes, digits
            As for `eigenvalue`.

        Returns
        -------
        float

        Raises
        ------
        InputError
            As for `eigenvalue`, or the exact eigenvalue is zero.

        Examples
        --------
        >>> [f"{UniformSolver((n, n)).eigenvalue_error(1, 1):.5e}" for n in (4, 256)]
        ['1.75202e-04', '3.27525e-15']
        """
        discrete, exact = self._eigenvalues(modes, digits)
        if exact == 0:
            raise InputError("modes: the exact eigenvalue is zero, so there is no relative error")
        with localcontext(prec=digits):
            return float(discrete / exact - 1)

    def _eigenvalues(self, modes: Sequence[int], digits: int) -> tuple[Decimal, Decimal]:
        first = 1 if self.bc == "dirichlet" else 0
        ranges = [range(first, n + 1 - first) for n in self.shape]
        if len(modes) != len(ranges) or any(m not in r for m, r in zip(modes, ranges, strict=True)):
            raise InputError(
                f"modes: expected {len(ranges)} whole numbers from {first} to "
                f"{[r[-1] for r in ranges]}, got {modes}"
            )
        with localcontext(prec=integer("digits", digits, 1, 1000)):
            discrete = extended_eigenvalue(
                self.lengths, self.shape, modes, self.k, self.bc == "dirichlet", digits
            )
            exact = continuous_eigenvalue(self.lengths, modes, self.k, digits)
            return discrete + Decimal(self.c), exact + Decimal(self.c)


def _numbers(name: str, value: Any, count: int, zero: bool = False) -> tuple[float, ...]:
    """Return `count` positive numbers, from as many or from one."""
    found = real_part(name, value)
    if found.shape not in ((), (1,), (count,)):
        raise InputError(f"{name}: expected one number or {count}, got {value!r}")
    if not np.isfinite(found).all() or found.min() < 0 or (found.min() == 0 and not zero):
        kind = "not negative" if zero else "positive"
        raise InputError(f"{name}: expected {kind} and finite, got {value!r}")
    return tuple(np.broadcast_to(found, count).tolist())


def tensor_nodes(grid: Sequence[int]) -> NDArray[np.intp]:
    """Return the vertex numbers of `init_tensor` as an array over the grid, of shape `grid`."""
    if len(grid) == 2:
        return np.arange(np.prod(grid)).reshape(grid)
    x, y, z = grid
    return np.arange(np.prod(grid)).reshape(z, x, y).transpose(1, 2, 0).copy()


class BlockDiagonalGrid:
    r"""The matrix of :math:`-\sum_i k_i u_{ii} + c u` in a basis of sines (`dirichlet`) or cosines.
    All blocks are factored together as :math:`L D L^T`, with an array over the modes for each
    entry. Arrays of dofs have the shape (dim + 1, n_x + 1, n_y + 1(, n_z + 1))."""

    def __init__(
        self,
        cells: Sequence[int],
        steps: Sequence[float],
        k: Sequence[float],
        c: float,
        dirichlet: bool,
    ) -> None:
        self._cells, self._dim, self._dirichlet = tuple(cells), len(cells), dirichlet
        self._scale = np.array([1.0, *steps])
        self.shape = (self._dim + 1, *(n + 1 for n in cells))
        self.singular = not dirichlet and c == 0
        volume = float(np.prod(steps))
        self._weights: list[tuple[int | None, float]] = [
            (i, volume * k[i] / h**2) for i, h in enumerate(steps)
        ]
        self._weights += [(None, volume * c)]
        self._lower, self._pivots = self._factorize()

    def fixed(self) -> NDArray[np.bool_]:
        """Return a mask of the dofs that vanish: those on the boundary where a sine is zero."""
        mask = np.ones(self.shape, dtype=bool)
        for p, part in enumerate(mask):
            part[self._inside(p)] = False
        return mask

    def diagonal(self) -> Array:
        """Return the diagonal of the matrix at an inner vertex, shape (dim + 1,)."""
        total = np.zeros(self._dim + 1)
        for direction, weight in self._weights:
            exact = exact_matrix(self._dim, direction, direction)
            cell = np.diag(exact.numerators)[: self._dim + 1] / exact.denominator
            total += 2**self._dim * weight * cell
        return total * self._scale**2

    def solve(self, load: Array, constant: float = 0.0) -> Array:
        """Return the solution for an assembled load; entries of fixed dofs do not count.
        A singular matrix is inverted on loads of mean zero; the mean itself is multiplied by
        `constant`."""
        z = np.zeros(self.shape)
        for p, scale in enumerate(self._scale):
            inside: Any = (p, *self._inside(p))
            z[inside] = self._forward(p, load[inside] / scale)
        origin = (0,) * z.ndim
        mean = z[origin]
        for (p, q), factor in self._lower.items():
            z[p] -= factor * z[q]
        z /= self._pivots
        if self.singular:
            z[origin] = constant * mean
        for (p, q), factor in reversed(self._lower.items()):
            z[q] -= factor * z[p]
        x = np.zeros(self.shape)
        for p, scale in enumerate(self._scale):
            inside = (p, *self._inside(p))
            x[inside] = self._backward(p, z[inside]) / scale
        return x

    def _has_sine(self, p: int, direction: int) -> bool:
        return (p == direction + 1) != self._dirichlet

    def _inside(self, p: int) -> tuple[slice, ...]:
        """Return the positions, and also the modes, at which the sines of a dof do not vanish."""
        return tuple(
            slice(1, -1) if self._has_sine(p, i) else slice(None) for i in range(self._dim)
        )

    def _axes(self, p: int) -> tuple[list[int], list[int]]:
        sines = [i for i in range(self._dim) if self._has_sine(p, i)]
        return sines, [i for i in range(self._dim) if i not in sines]

    def _forward(self, p: int, load: Array) -> Array:
        """Transform a load, continued by reflection: with cosines this doubles boundary values."""
        sines, cosines = self._axes(p)
        for axis in cosines:
            ends = np.moveaxis(load, axis, 0)
            ends[0] *= 2
            ends[-1] *= 2
        load = fft.dctn(load, type=1, axes=cosines, overwrite_x=True)
        return fft.dstn(load, type=1, axes=sines, overwrite_x=True)

    def _backward(self, p: int, modes: Array) -> Array:
        sines, cosines = self._axes(p)
        values = fft.idctn(modes, type=1, axes=cosines)
        return fft.idstn(values, type=1, axes=sines, overwrite_x=True)

    def _factorize(self) -> tuple[dict[tuple[int, int], Array], Array]:
        """Return the entries below the diagonal of L, row by row, and the diagonal D."""
        size = self._dim + 1
        blocks = {(p, q): self._entry(p, q) for p in range(size) for q in range(p + 1)}
        if self.singular or self._dirichlet:  # no zero pivot for constants or for modes without u
            blocks[0, 0][(0,) * self._dim] = 1.0
        lower: dict[tuple[int, int], Array] = {}
        pivots = np.empty(self.shape)
        for p in range(size):
            for q in range(p):
                entry = blocks[p, q]
                for r in range(q):
                    entry = entry - lower[p, r] * pivots[r] * lower[q, r]
                lower[p, q] = entry / pivots[q]
            pivots[p] = blocks[p, p]
            for r in range(p):
                pivots[p] -= lower[p, r] ** 2 * pivots[r]
        return lower, pivots

    def _entry(self, p: int, q: int) -> Array:
        """Return one entry of the blocks of all modes."""
        entry: Any = sum(
            weight * exact_symbol(self._dim, i).numerators[p, q] / exact_symbol(self._dim, i)[1]
            for i, weight in self._weights
        )
        for i, n in enumerate(self._cells):
            half = 0.5 * np.pi * np.arange(n + 1) / n
            if is_odd(p, q, i):
                sines = 4 * np.sin(half) * np.cos(half)
                sines[-1] = 0.0
                waves = np.array([np.zeros(n + 1), sines])
            else:
                waves = np.array([np.ones(n + 1), -4 * np.sin(half) ** 2])
            entry = np.tensordot(entry, waves, axes=(0, 0))
        return phase(p, q, self._dirichlet) * np.asarray(entry)
