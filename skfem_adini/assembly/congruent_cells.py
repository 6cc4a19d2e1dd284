"""Classes of congruent cells of a Basis, and the sum of local matrices known for each class."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import CellBasis, MeshHex, MeshQuad
from skfem.mapping import MappingAffine

from skfem_adini.assembly.congruence_classes import congruence_classes
from skfem_adini.assembly.csr_scatter import scatter_matrix
from skfem_adini.assembly.device_scatter import scatter_on
from skfem_adini.assembly.dof_blocks import DofBlocks
from skfem_adini.assembly.form_parameters import words_of
from skfem_adini.assembly.local_tensors import Space
from skfem_adini.assembly.translation_invariance import (
    orientations,
    why_not_element,
    why_not_mapping,
)
from skfem_adini.errors import InputError


@dataclass(frozen=True)
class CongruentCells:
    """Classes of cells that have the same local matrix, because they are translates of each other.

    Congruence is that of `assemble`: coordinates, the orientation of facets and fields agree bit by
    bit. Local matrices that no form of scikit-fem gives, such as those with a mean dilatation, are
    so computed for a few cells only and added by the kernels of `assemble`.

    Attributes
    ----------
    cells
        Numbers of one cell of each class in the mesh, shape (classes,).
    labels
        Class of each cell, shape (cells,).

    Examples
    --------
    >>> import numpy as np
    >>> from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad
    >>> mesh = MeshQuad.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> basis = Basis(mesh, ElementQuad1())
    >>> classes = CongruentCells.of(basis)
    >>> len(classes.cells)
    1
    >>> mass = BilinearForm(lambda u, v, w: u * v).elemental(classes.part)
    >>> M = classes.matrix(mass.tolocal())
    >>> round(float(M.sum()), 12)
    1.0
    """

    cells: NDArray[np.integer]
    labels: NDArray[np.integer]
    _basis: Any

    @classmethod
    def of(cls, basis: Any, *fields: ArrayLike) -> CongruentCells | None:
        """Return the classes of all cells of a basis, None where functions depend on the place.

        Parameters
        ----------
        basis
            `skfem.CellBasis` of all cells of its mesh.
        *fields
            What local matrices depend on besides the shape: numbers, or arrays of shape (cells,).
        """
        mesh, element, mapping = basis.mesh, basis.elem, basis.mapping
        if basis.tind is not None or why_not_element(element) or why_not_mapping(mapping, mesh):
            return None
        words = [orientations([element], mapping)]
        words += [words_of(np.asarray(f)[:, None]) for f in fields if np.ndim(f)]
        straight = isinstance(mapping, MappingAffine) or type(mapping.mesh) in (MeshQuad, MeshHex)
        nodes = mapping.mesh.t if straight else mapping.mesh.dofs.element_dofs
        labels, cells = congruence_classes(
            np.ascontiguousarray(mapping.mesh.doflocs),
            np.ascontiguousarray(nodes),
            np.ascontiguousarray(np.hstack(words)),
        )
        return cls(cells, labels, basis)

    @cached_property
    def part(self) -> Any:
        """Basis of one cell of each class."""
        return self.basis_of(self._basis.elem)

    def basis_of(self, element: Any) -> CellBasis:
        """Return a basis of one cell of each class with another element, as that of a component.

        Parameters
        ----------
        element
            Element of the same cells, whose functions depend on nothing else.
        """
        quadrature = self._basis.quadrature
        on, own = Space(element, self._basis.mapping, *quadrature).on(self.cells)
        return CellBasis(
            on.mesh, element, on, elements=own, quadrature=quadrature, disable_doflocs=True
        )

    @cached_property
    def _blocks(self) -> DofBlocks:
        return DofBlocks.of_basis(self._basis)

    def matrix(self, local: NDArray[Any], xp: Any = np) -> Any:
        """Return the sum of the local matrices of all cells.

        Parameters
        ----------
        local
            Local matrix of each class, shape (classes, dofs of a cell, dofs of a cell), the test
            functions by rows.
        xp
            NumPy, or CuPy for a matrix on a CUDA device.

        Returns
        -------
        csr_matrix
            In canonical form, of SciPy or CuPy, shape (dofs, dofs). The values are the same bits on
            both.

        Raises
        ------
        InputError
            Another shape.
        """
        size = int(self._blocks.local[-1])
        if np.shape(local) != (len(self.cells), size, size):
            raise InputError(
                f"local: expected shape {(len(self.cells), size, size)}, got {np.shape(local)}"
            )
        local = np.ascontiguousarray(local)
        if xp is np:
            return scatter_matrix(local, self.labels, self._blocks, self._blocks)
        return scatter_on(xp, local, self.labels, self._blocks, self._blocks)
