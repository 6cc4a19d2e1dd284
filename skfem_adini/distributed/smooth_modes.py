"""Functions of low energy on a distributed space, for multigrid."""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.distributed.communicator import largest, total
from skfem_adini.distributed.distributed_basis import DistributedBasis
from skfem_adini.errors import InputError

Array = NDArray[np.float64]


def smooth_modes(space: DistributedBasis) -> Array:
    """Constants of a scalar field, rigid motions of a displacement field, at the local dofs.

    Parameters
    ----------
    space : DistributedBasis
        With an element whose dofs are values and derivatives of its functions, or `ElementVector`
        of one.

    Returns
    -------
    ndarray, shape (space.basis.N, modes)

    Raises
    ------
    InputError
        An element with other dofs.

    Examples
    --------
    >>> from skfem import ElementVector, MeshQuad
    >>> from skfem.models.elasticity import linear_elasticity
    >>> from skfem_adini import ElementQuadAdini
    >>> from skfem_adini.distributed import DistributedBasis, smooth_modes
    >>> space = DistributedBasis(MeshQuad().refined(2), ElementVector(ElementQuadAdini()))
    >>> K = space.assemble(linear_elasticity(1.0, 1.0))
    >>> bool(abs(K.rows @ smooth_modes(space)).max() < 1e-12)
    True
    """
    component, derivative = _kinds(space)
    x = space.basis.doflocs
    own = x[:, space.owned]
    centre = total(space.comm, own.sum(axis=1)) / space.N
    size = largest(space.comm, float(np.abs(own - centre[:, None]).max(initial=0.0))) or 1.0
    away = (x - centre[:, None]) / size
    dim, count = x.shape[0], int(component.max()) + 1
    modes = [np.where((component == c) & (derivative < 0), 1.0, 0.0) for c in range(count)]
    if count == dim and dim > 1:
        for i, j in combinations(range(dim), 2):  # u_i = -x_j, u_j = x_i
            mode = np.zeros(x.shape[1])
            for c, along, sign in ((i, j, -1.0), (j, i, 1.0)):
                of = component == c
                values, slopes = of & (derivative < 0), of & (derivative == along)
                mode[values], mode[slopes] = sign * away[along, values], sign / size
            modes.append(mode)
    return np.column_stack(modes)


def _kinds(space: DistributedBasis) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Component of each dof, and the axis of its derivative: -1 a value, 9 a higher derivative."""
    dofs, names = space.basis.dofs, list(space.basis.elem.dofnames)
    component = np.zeros(space.basis.N, dtype=np.int64)
    derivative = np.full(space.basis.N, -1, dtype=np.int64)
    rows: list[Any] = []
    for part in (dofs.nodal_dofs, dofs.facet_dofs, dofs.edge_dofs, dofs.interior_dofs):
        rows += list(np.atleast_2d(part)) if np.size(part) else []
    for name, numbers in zip(names, rows, strict=False):
        kind = re.match(r"u(_[xyz]+)?(?:\^(\d))?$", name)
        if kind is None:
            raise InputError(
                f"space: dofs called {name!r} of {type(space.basis.elem).__name__} are neither "
                "values nor derivatives of its functions; pass near_null, or take a direct solver"
            )
        along = kind.group(1)
        component[numbers] = int(kind.group(2) or 1) - 1
        if along:
            derivative[numbers] = "xyz".index(along[1]) if len(along) == 2 else 9
    return component, derivative
