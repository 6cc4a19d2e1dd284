"""The near-null space for multigrid: functions of nearly zero energy."""

from __future__ import annotations

from itertools import combinations
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.elements.vertex_dofs import vertex_dofs
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of, finite_numbers
from skfem_adini.solvers.factorize import factorize
from skfem_adini.solvers.multigrid import NearNullSpace

Array = NDArray[np.float64]
Indices = NDArray[np.integer]


def near_null_space(basis: Any, dofs: Any = None) -> NearNullSpace:
    r"""Return the functions without energy of a scalar equation or of an elastic body.

    For a scalar field these are the constants; the linear functions, which have little energy, are
    added. For a displacement field they are the rigid motions :math:`a + b \times x`. The elements
    contain them exactly: the dofs of a rotation are the values of :math:`u = b \times x` and of its
    gradient.

    Parameters
    ----------
    basis
        Basis with an element of this package that has u and its gradient at the vertices, or
        `ElementVector` of one with a component for each direction.
    dofs
        The unknowns of the system: dof numbers, for instance ``basis.complement_dofs(fixed)``, or
        a sparse matrix T with x = T z from `essential_constraints` or `hanging_constraints`; all
        dofs by default.

    Returns
    -------
    NearNullSpace
        For ``factorize(A, solver="amg", near_null=...)``.

    Raises
    ------
    InputError
        Another element, another number of components, or dofs out of range.

    References
    ----------
    P. Vanek, J. Mandel and M. Brezina, Algebraic multigrid by smoothed aggregation for second and
    fourth order elliptic problems, Computing 56 (1996), 179-196: rigid motions as candidates.

    Examples
    --------
    >>> from skfem import Basis, ElementVector, MeshQuad
    >>> from skfem.models.elasticity import linear_elasticity
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad().refined(1), ElementVector(ElementQuadAdini()))
    >>> space = near_null_space(basis)
    >>> space.modes.shape
    (54, 3)
    >>> bool(abs(linear_elasticity(1.0, 1.0).assemble(basis) @ space.modes).max() < 1e-12)
    True
    """
    places = vertex_dofs(basis)
    dim, components = basis.mesh.dim(), places.shape[1]
    vector = "^" in basis.elem.dofnames[0]
    if vector and components != dim:
        raise InputError(
            f"basis: expected a scalar field or one with {dim} components, got {components}"
        )
    p = basis.mesh.p[:, : places.shape[2]]
    centred = p - p.mean(axis=1, keepdims=True)
    size = np.abs(centred).max()

    def linear(component: int, direction: int | None = None) -> Array:
        x = np.zeros(basis.N)
        if direction is None:
            x[places[0, component]] = 1.0
        else:
            x[places[0, component]] = centred[direction] / size
            x[places[1 + direction, component]] = 1.0 / size
        return x

    modes = [linear(c) for c in range(components)]
    if vector:
        modes += [linear(i, j) - linear(j, i) for i, j in combinations(range(dim), 2)]
    else:
        modes += [linear(0, j) for j in range(dim)]
    vertex = np.empty(basis.N, dtype=np.int64)
    vertex[places] = np.arange(places.shape[2])
    return _restricted(np.array(modes).T, vertex, dofs)


def _restricted(modes: Array, vertex: Indices, dofs: Any) -> NearNullSpace:
    """Return the functions in the unknowns of the system."""
    if dofs is None:
        return NearNullSpace(modes, vertex)
    if sparse.issparse(dofs):
        T = sparse.csc_array(cast(Any, dofs))
        if T.shape[0] != len(vertex):
            raise InputError(f"dofs: expected a matrix with {len(vertex)} rows, got {T.shape}")
        finite_numbers("dofs: T", T.data, T.data.shape)
        # A column of T belongs to the vertex of its largest entry.
        strongest = np.asarray(abs(T).argmax(axis=0)).ravel()
        return NearNullSpace(_pseudo_inverse(T, modes), vertex[strongest])
    chosen = array_of("dofs", dofs)
    whole = chosen.ndim == 1 and chosen.dtype.kind in "iu" and chosen.size > 0
    if not whole or chosen.min() < 0 or chosen.max() >= len(vertex):
        raise InputError(f"dofs: expected dof numbers from 0 to {len(vertex) - 1} or a matrix T")
    return NearNullSpace(modes[chosen], vertex[chosen])


def _pseudo_inverse(T: Any, modes: Array) -> Array:
    """Return the z with T z nearest to the modes; columns of T may overlap at hanging vertices."""
    return factorize(T.T @ T).solve(T.T @ modes)
