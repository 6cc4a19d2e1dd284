"""Linear equations between dofs (multipoint constraints), and the remaining free unknowns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from contact.body.axisymmetry import check_shift
from contact.body.deferred_basis import dofs_on_facets
from contact.body.rigid_modes import dof_kinds, dof_lengths, rigid_field
from contact.body.supports import single
from contact.errors import InputError
from skfem_adini.ground.arguments import finite_number

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NOISE = 1e-14  # entries below this are rounding, in matrices with rows or columns of unit norm


@dataclass(frozen=True)
class Coupling:
    """Equations C u = c, with their name in error messages."""

    C: sparse.csr_array
    c: Array
    name: str

    def at_rest(self) -> Coupling:
        """The same equations with a zero right-hand side."""
        return Coupling(self.C, np.zeros(self.c.size), self.name)


def coupled(
    P: sparse.csr_array, u0: Array, couplings: Sequence[Coupling], of_dof: Array
) -> tuple[sparse.csr_array, Array]:
    """Free unknowns P (ndofs, nfree) and u0 of supports ``u = P y + u0`` and equations together.
    Each group of linked unknowns, scaled to displacements by `of_dof`, is solved by an SVD.
    Unlinked unknowns come first, unchanged; the other columns are orthonormal."""
    C = sparse.csr_array(sparse.vstack([each.C for each in couplings]))
    c = np.concatenate([each.c for each in couplings])
    owner = np.repeat(np.arange(len(couplings)), [each.c.size for each in couplings])
    unit = 1.0 / _norms(C @ sparse.diags_array(1.0 / of_dof))
    of_free = column_lengths(P, of_dof)
    A = sparse.csr_array(sparse.diags_array(unit) @ C @ P @ sparse.diags_array(1.0 / of_free))
    A.data[np.abs(A.data) < _NOISE] = 0.0
    A.eliminate_zeros()
    right = unit * (c - C @ u0)
    # Right-hand sides that differ by less are equal.
    allowed = 1e-9 * float(np.max(unit * (np.abs(c) + abs(C) @ np.abs(u0)), initial=0.0))
    # Derivatives of a constant prescribed value are zero up to its rounding.
    allowed = max(allowed, 1e-13 * float(np.max(of_dof * np.abs(u0), initial=0.0)))
    groups = _groups(A)
    empty = np.flatnonzero(np.diff(A.indptr) == 0)
    _refuse_contradiction(right[empty], allowed, owner[empty], couplings)
    columns, y = [], np.zeros(P.shape[1])
    largest = 4000  # limit of linked unknowns, solved as a dense matrix
    for rows, members in groups:
        if members.size > largest:
            raise InputError(
                f"{couplings[owner[rows[0]]].name}: the equations link {members.size} unknowns, "
                f"more than {largest}; tie a smaller boundary, or hold it with fix"
            )
        null, y[members], left = _solve(A[rows][:, members].toarray(), right[rows])
        _refuse_contradiction(left, allowed, owner[rows], couplings)
        place = np.repeat(members, null.shape[1])
        number = np.tile(np.arange(null.shape[1]), members.size)
        shape = P.shape[1], null.shape[1]
        columns.append(sparse.coo_array((null.ravel(), (place, number)), shape=shape))
    kept = np.setdiff1d(np.arange(P.shape[1]), np.unique(A.indices))
    before = sparse.csr_array(sparse.eye_array(P.shape[1], format="csr")[:, kept])
    if not columns:
        return sparse.csr_array(P @ before), u0
    rescaled = sparse.diags_array(1.0 / of_free)
    change = sparse.csc_array(rescaled @ sparse.hstack(columns))
    change.eliminate_zeros()
    new = sparse.csc_array(P @ change)
    one_kind = ~_mixed(new, of_dof)
    size = np.where(one_kind, _norms(sparse.csr_array(new.T)), 1.0)
    new = sparse.csc_array(new @ sparse.diags_array(1.0 / size))
    return sparse.csr_array(sparse.hstack([P @ before, new])), u0 + P @ (y / of_free)


def picked_by(P: sparse.csr_array, lengths: Callable[[], Array]) -> sparse.csr_array:
    """E with ``E^T P = I``: P itself if each column has dofs of one kind.
    `lengths` is called only if columns mix values and derivatives."""
    if single(P):
        return P
    of_dof = lengths()
    mixed = _mixed(sparse.csc_array(P), of_dof)
    if not mixed.any():
        return P
    weighted = sparse.diags_array(of_dof**2) @ P @ sparse.diags_array(mixed.astype(float))
    plain = P @ sparse.diags_array((~mixed).astype(float))
    E = sparse.csr_array(weighted + plain)
    E.eliminate_zeros()
    return E


def column_lengths(P: sparse.csr_array, of_dof: Array) -> Array:
    """Length that scales each free unknown to a displacement; 1 if its dofs have different ones."""
    if single(P):
        lengths = np.empty(P.nnz)
        entries = np.diff(P.indptr)
        alone = entries.max(initial=0) <= 1  # quick test: true without couplings
        lengths[P.indices] = of_dof[entries > 0] if alone else np.repeat(of_dof, entries)
        return lengths
    columns = sparse.csc_array(P)
    first: Array = of_dof[columns.indices[columns.indptr[:-1]]]
    return np.where(_mixed(columns, of_dof), 1.0, first)


def _mixed(columns: sparse.csc_array, of_dof: Array) -> NDArray[np.bool_]:
    """Columns whose dofs have different lengths."""
    of_entry = of_dof[columns.indices]
    start = columns.indptr[:-1]
    first = np.repeat(of_entry[start], np.diff(columns.indptr))
    owner = np.repeat(np.arange(columns.shape[1]), np.diff(columns.indptr))
    return np.asarray(np.bincount(owner, of_entry != first, columns.shape[1]) > 0)


def _groups(A: sparse.csr_array) -> list[tuple[Index, Index]]:
    """Equations and unknowns of each independent group."""
    m = A.shape[0]
    graph: Any = sparse.block_array([[None, A], [A.T, None]], format="csr")
    _, label = connected_components(graph, directed=False)
    linked = np.flatnonzero(np.isin(label, label[:m]))  # most unknowns are not linked
    order = linked[np.argsort(label[linked], kind="stable")]
    parts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return [(part[part < m], part[part >= m] - m) for part in parts if part.size > 1]


def _solve(A: Array, right: Array) -> tuple[Array, Array, Array]:
    """Orthonormal null space, least-norm solution, and its residual."""
    U, s, V = np.linalg.svd(A)
    rank = int(np.sum(s > 1e-10 * s[0]))  # smaller ones are rounding
    y = V[:rank].T @ ((U[:, :rank].T @ right) / s[:rank])
    null = V[rank:].T
    null = np.where(np.abs(null) < _NOISE, 0.0, null) * np.where(null.sum(axis=0) < 0, -1.0, 1.0)
    return null, y, right - A @ y


def _refuse_contradiction(
    left: Array, allowed: float, owner: Index, couplings: Sequence[Coupling]
) -> None:
    if not np.any(np.abs(left) > allowed):
        return
    names = sorted({couplings[k].name for k in owner})
    raise InputError(
        f"{names[0]}: its equations contradict "
        + (f"those of {', '.join(names[1:])}" if names[1:] else "each other or the supports")
        + "; change a right side, a jump or a prescribed value, or leave one of them out"
    )


def _norms(rows: sparse.csr_array) -> Array:
    return np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1), dtype=float).ravel())


def periodic_equations(
    body: Any, facets: Index, other: Index, jump: list[float | None]
) -> tuple[sparse.csr_array, Array]:
    """C and c of ``u(facets) - u(other) = jump``; components with None are not linked.
    A translation must map one boundary onto the other."""
    mesh, basis = body.mesh, body.basis
    near = 1e-8 * float(np.ptp(mesh.p, axis=1).max())  # closer points coincide
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
    """C of ``C u = 0`` for a boundary that only translates, or moves as a rigid body.
    The amplitudes of the motion are eliminated; columns of `held` (ndofs, n) are orthonormal: the
    free unknowns with the boundary fixed."""
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


def jump_of(value: Any) -> float | None:
    """The jump of a component; None if it is not linked."""
    return None if value is None else finite_number("jump", value)


def words_of(boundary: Any) -> str:
    """Name of a boundary for an error message."""
    if isinstance(boundary, str):
        return repr(boundary)
    names = isinstance(boundary, list | tuple) and all(isinstance(b, str) for b in boundary)
    return ", ".join(repr(b) for b in boundary) if names else "of the given facets"
