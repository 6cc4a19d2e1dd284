r"""Matrices of forms of gradients on affine cells, from one table of the reference cell.

On a cell T with :math:`x = A \hat x + b` gradients are
:math:`\nabla \varphi = A^{-T} \hat\nabla \hat\varphi`, so that for a tensor C that is constant on T

.. math::
    K^T_{ic,jd} = \int_T \sum_{ab} C_{cadb} \, \partial_a \varphi_i \, \partial_b \varphi_j
                = \sum_{pq} G^T_{cd,pq} R_{pq,ij}, \qquad
    R_{pq,ij} = \int_{\hat T} \hat\partial_p \hat\varphi_i \, \hat\partial_q \hat\varphi_j ,

.. math::
    G^T_{cd,pq} = |\det A| \sum_{ab} C_{cadb} (A^{-1})_{pa} (A^{-1})_{qb} .
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import CellBasis, ElementH1, ElementVector
from skfem.mapping import MappingAffine

from skfem_adini.assembly import affine_kernels
from skfem_adini.assembly.csr_scatter import in_threads, index_type, row_kernel, shares_of
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import real_part
from skfem_adini.ground.jit import compiled_later

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AffineCells:
    r"""Straight triangles or tetrahedra whose shape functions are those of the reference cell.

    A matrix needs no shape functions in the cells then: a compiled kernel multiplies numbers of
    each cell with one table of the reference cell, row by row.

    Attributes
    ----------
    inverse
        :math:`A^{-1}` of :math:`x = A \hat x + b`, shape (cells, dim, dim).
    size
        Its determinant's modulus, shape (cells,).
    components
        Number k of components of a function.

    References
    ----------
    A. Logg, K.-A. Mardal, G. N. Wells (eds.), Automated Solution of Differential Equations by the
    Finite Element Method, Springer 2012, chapter 8 (reference and geometry tensors).

    Examples
    --------
    Laplace's operator, with the unit tensor:

    >>> import numpy as np
    >>> from skfem import Basis, ElementTriP2, MeshTri
    >>> from skfem.models.poisson import laplace
    >>> basis = Basis(MeshTri().refined(2), ElementTriP2())
    >>> K = AffineCells.of(basis).matrix(np.eye(2)[None, :, None])
    >>> bool(abs(K - laplace.assemble(basis)).max() < 1e-14)
    True
    """

    inverse: Array
    size: Array
    components: int
    _functions: NDArray[np.int32]
    _table: Array
    _count: int

    @classmethod
    def of(cls, basis: Any) -> AffineCells | None:
        """Return the cells of a basis; None if gradients are not those of the reference cell.

        Parameters
        ----------
        basis
            `skfem.CellBasis` of all cells of its mesh, of an H1 element of scikit-fem or an
            `skfem.ElementVector` of one.
        """
        if not isinstance(basis, CellBasis) or basis.tind is not None:
            return None
        vector = isinstance(basis.elem, ElementVector)
        element = basis.elem.elem if vector else basis.elem
        given = type(element).gbasis is ElementH1.gbasis and "gbasis" not in vars(element)
        if type(basis.mapping) is not MappingAffine or not given:
            return None
        k = int(basis.elem.dim) if vector else 1
        dofs = basis.dofs.element_dofs
        functions = np.ascontiguousarray(dofs[::k] // k, dtype=np.int32)
        if not all(np.array_equal(k * functions + c, dofs[c::k]) for c in range(k)):
            return None
        gradient = np.array([element.lbasis(basis.X, i)[1] for i in range(len(functions))])
        R = np.einsum("ipw,jqw,w->ipqj", gradient, gradient, basis.W, optimize=True)
        # With R and G symmetric to the last bit, so are the sums of the kernel.
        table = np.ascontiguousarray(0.5 * (R + R.transpose(3, 2, 1, 0)))
        inverse = np.ascontiguousarray(basis.mapping.invA.transpose(2, 0, 1))
        return cls(inverse, np.abs(basis.mapping.detA), k, functions, table, int(basis.N) // k)

    def matrix(self, tensor: Array) -> Any:
        r"""Return the matrix of :math:`\int C_{cadb} \, \partial_a v_c \, \partial_b u_d`, summed.

        It equals that of `skfem.asm`, exactly symmetric and independent of the number of threads.

        Parameters
        ----------
        tensor
            C with :math:`C_{cadb} = C_{dbca}`, shape (k, dim, k, dim), or (k, dim, k, dim, cells).

        Returns
        -------
        csr_matrix
            With an entry for each pair of functions that share a cell, zeros among them.

        Raises
        ------
        InputError
            Another shape, no finite real numbers, or another symmetry.
        """
        k, around = self.components, self._around()
        geometry, shares = self._geometry(tensor), shares_of(around[0], len(self._functions))
        counts = np.zeros(self._count + 1, dtype=np.int64)
        count, fill = _kernel("count_neighbours"), _kernel("fill_affine")
        in_threads(lambda i, j: count(i, j, around, counts), shares)
        heads = np.cumsum(counts)
        indptr = np.zeros(k * self._count + 1, dtype=np.int64)
        np.cumsum(np.repeat(k * counts[1:], k), out=indptr[1:])
        index = index_type(int(indptr[-1]), k * self._count)
        indices, data = np.empty(indptr[-1], dtype=index), np.empty(indptr[-1])
        rows = around, np.arange(self._count + 1), heads
        in_threads(lambda i, j: fill(i, j, *rows, geometry, self._table, indices, data), shares)
        matrix = sparse.csr_matrix((data, indices, indptr.astype(index)))
        matrix.has_canonical_format = True
        return matrix

    def _around(self) -> tuple[Any, ...]:
        """Return where each function's cells begin, the cells, its numbers there, the functions."""
        return *row_kernel("cells_of_blocks")(self._functions, self._count), self._functions

    def _geometry(self, tensor: Array) -> Array:
        """Return G, shape (cells, k, k, dim, dim)."""
        k, (cells, dim, _) = self.components, self.inverse.shape
        tensor = real_part("tensor", tensor)
        if tensor.shape not in ((k, dim, k, dim), (k, dim, k, dim, cells)):
            raise InputError(
                f"tensor: expected shape {(k, dim, k, dim)} or {(k, dim, k, dim, cells)}, got "
                f"{tensor.shape}"
            )
        swapped = tensor.swapaxes(0, 2).swapaxes(1, 3)
        with np.errstate(invalid="ignore"):  # NaN and infinity are unequal
            largest = np.abs(tensor).max(initial=0.0)
            equal = np.abs(tensor - swapped) <= 1e-12 * largest  # up to rounding
        if not (equal.all() and np.isfinite(tensor).all()):
            raise InputError("tensor: expected finite numbers with C_cadb = C_dbca")
        letters = "cadb" if tensor.ndim == 4 else "cadbt"
        weighted = self.size[:, None, None] * self.inverse
        half = np.einsum(f"{letters},tqb->tcadq", tensor, weighted, optimize=True)
        G = np.einsum("tpa,tcadq->tcdpq", self.inverse, half, optimize=True)
        return np.ascontiguousarray(0.5 * (G + G.transpose(0, 2, 1, 4, 3)))


@lru_cache
def _kernel(name: str) -> Callable[..., Any]:
    return compiled_later(getattr(affine_kernels, name), affine_kernels.PARTS)
