"""Equations of periodicity, and of boundaries that move as one."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse

from contact.body.axisymmetry import check_shift
from contact.body.facet_dofs import dofs_on_facets
from contact.body.rigid_modes import dof_kinds, dof_lengths, rigid_field
from contact.errors import InputError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NEAR = 1e-8  # of the extent of the mesh: places closer than this are the same


def periodic_equations(
    body: Any, facets: Index, other: Index, jump: list[float | None]
) -> tuple[sparse.csr_array, Array]:
    """C and c of ``u(facets) - u(other) = jump``; components with None take no part.

    Raises
    ------
    InputError
        The boundaries are not congruent by a translation.
    """
    mesh, basis = body.mesh, body.basis
    near = _NEAR * float(np.ptp(mesh.p, axis=1).max())
    here, there = (np.unique(mesh.facets[:, f]) for f in (facets, other))
    low, high = (mesh.p[:, v].min(axis=1) + mesh.p[:, v].max(axis=1) for v in (here, there))
    shift = 0.5 * (high - low)
    if body.is_ring:
        check_shift(shift)
    if np.linalg.norm(shift) < near:
        raise InputError("other: the two boundaries lie at the same place; name opposite ones")
    for own, partner, move, name in (
        (here, there, shift, "other"),
        (there, here, -shift, "boundary"),
    ):
        far, _ = scipy.spatial.KDTree(mesh.p[:, partner].T).query(
            (mesh.p[:, own] + move[:, None]).T
        )
        if np.any(far > near):
            k = own[np.argmax(far > near)]
            raise InputError(
                f"{name}: has no vertex where vertex {k} at {mesh.p[:, k].tolist()} arrives by the "
                f"translation {move.tolist()}; the boundaries must be congruent, vertex by vertex"
            )
    mine, its = (dofs_on_facets(basis, f) for f in (facets, other))
    kind, component = dof_kinds(basis), np.arange(basis.N) % body.dim
    pairs, sides = [], []
    for c, step in enumerate(jump):
        for what in np.unique(kind) if step is not None else ():
            a, b = (d[(component[d] == c) & (kind[d] == what)] for d in (mine, its))
            if not a.size:
                continue
            far, place = scipy.spatial.KDTree(basis.doflocs[:, b].T).query(
                basis.doflocs[:, a].T + shift
            )
            if a.size != b.size or np.any(far > near) or np.unique(place).size != a.size:
                raise InputError("other: its dofs do not lie where those of boundary arrive")
            pairs.append(np.stack([a, b[place]]))
            sides.append(np.full(a.size, step if what == -1 else 0.0))
    first, second = np.hstack(pairs)
    n = first.size
    data = np.repeat([1.0, -1.0], n)
    entries = data, (np.tile(np.arange(n), 2), np.r_[first, second])
    return sparse.coo_array(entries, shape=(n, basis.N)).tocsr(), np.concatenate(sides)


def tied_equations(
    body: Any, facets: Index, held: sparse.csr_array, components: list[int], rigid: bool
) -> sparse.csr_array:
    """C of ``C u = 0`` where the boundary is translated as one, or moves as a rigid body.

    What a support prescribes on the boundary equals what the motion gives there; the amounts of
    the motion are eliminated.

    Parameters
    ----------
    held : csr_array, shape (ndofs, n)
        Orthonormal columns, the free unknowns if the boundary were fixed.
    """
    basis, of_dof = body.basis, dof_lengths(body)
    H = sparse.csr_array(sparse.eye_array(basis.N) - held @ held.T)
    H.data[np.abs(H.data) < 1e-14] = 0.0
    H.eliminate_zeros()
    on = np.flatnonzero(np.diff(H.indptr))
    middle = body.mesh.p[:, np.unique(body.mesh.facets[:, facets])].mean(axis=1)
    field = rigid_field(body, middle)
    result = []
    motions = [1] if body.is_ring else list(range(field.shape[1]))
    for chosen in [motions] if rigid else [[c] for c in components]:
        rows = on if rigid else on[on % body.dim == chosen[0]]
        motion = of_dof[rows, None] * (H[rows] @ field[:, chosen])
        motion /= np.linalg.norm(motion, axis=0)
        U, s, _ = np.linalg.svd(motion, full_matrices=False)
        U = U[:, s > 1e-10 * s[0]]
        own = sparse.csr_array(sparse.diags_array(of_dof[rows]) @ H[rows])
        left = own[:, rows].toarray()
        left -= U @ (U.T @ left)
        left[np.abs(left) < 1e-15 * of_dof[rows]] = 0.0
        left = left[np.linalg.norm(left / of_dof[rows], axis=1) > 1e-12]
        number, place = np.indices(left.shape)
        entries = left.ravel(), (number.ravel(), rows[place.ravel()])
        result.append(sparse.coo_array(entries, shape=(left.shape[0], basis.N)))
    C = sparse.csr_array(sparse.vstack(result))
    C.eliminate_zeros()
    return C
