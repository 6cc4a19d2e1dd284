"""A body whose dofs may be linked by linear equations."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any, ClassVar, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from contact.body.axisymmetry import check_shift
from contact.body.boundary_names import select_components, select_facets
from contact.body.deferred_basis import dofs_on_facets
from contact.body.material import MaterialBody
from contact.body.multipoint import Coupling
from contact.body.rigid_modes import dof_kinds, dof_lengths, rigid_field
from contact.errors import InputError, numbers

Boundary = str | Sequence[str] | ArrayLike


class CoupledBody(MaterialBody):
    """Periodic boundaries, tied boundaries and multipoint constraints of a body with a Basis."""

    _COUPLES: ClassVar[bool] = True

    def periodic(
        self, boundary: Boundary, other: Boundary, jump: ArrayLike | Sequence[float | None] = 0.0
    ) -> Self:
        """Let the displacement on one boundary be that on another one, plus a jump.

        All dofs on the two boundaries are linked where they lie: of the elements with derivatives
        these too, which are equal. The body stays free to be translated; it cannot rotate, unless
        supports and other conditions say otherwise. Contact points on both boundaries, as where
        a contact boundary ends at a periodic one, share their unknowns: only the sum of their
        forces is determined, and a result with contact there is refused.

        Parameters
        ----------
        boundary, other : str, list of str or array of facet numbers
            Boundaries that a translation takes vertex by vertex into each other.
        jump : float or sequence of float or None, one a component
            ``u(boundary) - u(other)``; None does not link the component.

        Returns
        -------
        Self
            Itself, for chaining.

        Raises
        ------
        InputError
            An unknown boundary, one that no translation takes into the other, or a jump that is
            not finite.

        Examples
        --------
        A cell of a plate that is stretched by one per cent:

        >>> from skfem import MeshQuad
        >>> from contact import ElasticBody
        >>> mesh = MeshQuad().refined(2).with_defaults()
        >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3)
        >>> body = body.periodic("right", "left", (0.01, 0.0)).fix("bottom", "y")
        >>> P, u0 = body.constraint
        >>> bool(abs(u0).max() > 0.004)
        True
        """
        facets, its = select_facets(self.mesh, boundary), select_facets(self.mesh, other)
        given = np.asarray(jump, dtype=object)
        if given.shape not in ((), (self.dim,)):
            raise InputError(f"jump={jump!r}: expected a number or {self.dim} of them")
        steps = [_step(one) for one in np.broadcast_to(given, (self.dim,))]
        if all(one is None for one in steps):
            raise InputError("jump: None for every component links nothing")
        C, c = periodic_equations(self, facets, its, steps)
        return self._couple(C, c, f"periodic {_named(boundary)}")

    def tie(
        self,
        boundary: Boundary,
        components: str | int | Sequence[int] | None = None,
        rigid: bool = False,
    ) -> Self:
        """Let all points of a boundary share one displacement, which is unknown.

        A load on the boundary then acts by its resultant. With Adini elements the tangential
        derivatives follow, as for `fix`.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        components : "x", "y", "z", "xy", ..., numbers, or None for all
            Components that are the same at all points of the boundary.
        rigid : bool
            The boundary moves as a rigid body instead: it is translated, and turned by small
            angles. In all components only.

        Returns
        -------
        Self
            Itself, for chaining.

        Raises
        ------
        InputError
            An unknown boundary or component, components of a rigid boundary, or a rigid one of an
            axisymmetric body.

        Examples
        --------
        The side of a block stays plane while it is pulled:

        >>> from skfem import MeshQuad
        >>> from contact import ElasticBody
        >>> mesh = MeshQuad().refined(2).with_defaults()
        >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("left", "xy")
        >>> free = body.constraint[0].shape[1]
        >>> body.tie("right", "x").constraint[0].shape[1] - free
        -8
        """
        facets, chosen = select_facets(self.mesh, boundary), select_components(self.dim, components)
        if not isinstance(rigid, bool):
            raise InputError(f"rigid={rigid!r}: expected True or False")
        if rigid and self.is_ring:
            raise InputError(
                "rigid=True: a rigid part of an axisymmetric body moves along its axis only; take "
                "fix(boundary, 'x') and tie(boundary, 'y')"
            )
        if rigid and len(chosen) < self.dim:
            raise InputError("components: a rigid boundary moves in all of them; leave them out")
        self._check_couples("tie")
        probe: Any = copy(self)
        probe._supports, probe._couplings = [], ()
        held = probe.fix(facets, chosen)._supported()[0]
        C = tied_equations(self, facets, held, chosen, rigid)
        return self._couple(C, np.zeros(C.shape[0]), f"tie {_named(boundary)}")

    def constrain(self, C: Any, c: ArrayLike = 0.0) -> Self:
        """Prescribe linear equations between dofs, ``C u = c``.

        Parameters
        ----------
        C : sparse or dense array, shape (k, ndofs)
            Redundant equations are found and count once.
        c : float or ndarray, shape (k,)

        Returns
        -------
        Self
            Itself, for chaining. Equations that contradict each other or the supports are refused
            where the unknowns are first needed, in `constraint`.

        Raises
        ------
        InputError
            Arrays of the wrong shape, not finite, or an equation without entries.

        Examples
        --------
        >>> import numpy as np
        >>> from skfem import MeshQuad
        >>> from contact import ElasticBody
        >>> body = ElasticBody.from_mesh(MeshQuad().refined(1), E=1.0, nu=0.3)
        >>> C = np.zeros((1, body.basis.N))
        >>> C[0, [0, 3]] = 1.0, -2.0
        >>> P, u0 = body.constrain(C, 0.3).constraint
        >>> bool(abs(C @ u0 - 0.3) < 1e-12), bool(abs(C @ P).max() < 1e-12)
        (True, True)
        """
        n = self.basis.N
        given: Any = C if sparse.issparse(C) else numbers("C", C)
        if given.ndim != 2 or given.shape[1] != n:
            raise InputError(f"C: expected the shape (k, {n}), a column a dof, got {given.shape}")
        matrix: Any = sparse.csr_array(given, copy=True).astype(float)
        matrix.sum_duplicates()
        matrix.eliminate_zeros()
        right = numbers("c", c)
        if right.shape not in ((), (matrix.shape[0],)):
            raise InputError(f"c: expected a number or {matrix.shape[0]}, got {right.shape}")
        if not (np.all(np.isfinite(matrix.data)) and np.all(np.isfinite(right))):
            raise InputError("C, c: hold values that are not finite")
        if not matrix.shape[0] or np.any(np.diff(matrix.indptr) == 0):
            raise InputError("C: an equation without entries constrains nothing; leave it out")
        return self._couple(matrix, np.broadcast_to(right, matrix.shape[0]).copy(), "constrain")

    def _check_couples(self, name: str) -> None:
        if not self._COUPLES:
            raise InputError(
                f"{name}: a {type(self).__name__} ends inside cells, where dofs are no unknowns of "
                "its own; take a mesh that fits the boundary (ElasticBody)"
            )

    def _couple(self, C: sparse.csr_array, c: NDArray[np.float64], name: str) -> Self:
        self._check_couples(name)
        self._couplings = (*self._couplings, Coupling(C, c, name))
        for derived in ("constraint", "lengths"):
            self.__dict__.pop(derived, None)
        return self


def _step(value: Any) -> float | None:
    if value is None:
        return None
    number = numbers("jump", value)
    if number.shape != () or not np.isfinite(number):
        raise InputError(f"jump={value!r}: expected finite numbers, or None")
    return float(number)


def _named(boundary: Any) -> str:
    if isinstance(boundary, str):
        return repr(boundary)
    names = isinstance(boundary, list | tuple) and all(isinstance(b, str) for b in boundary)
    return ", ".join(repr(b) for b in boundary) if names else "of the given facets"


Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NEAR = 1e-8  # of the extent of the mesh: places closer than this are the same


def periodic_equations(
    body: Any, facets: Index, other: Index, jump: list[float | None]
) -> tuple[sparse.csr_array, Array]:
    """C and c of ``u(facets) - u(other) = jump``; components with None take no part.
    The boundaries must be congruent by a translation."""
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
    What a support prescribes on it equals the motion there, whose amounts are eliminated; the
    columns of `held` (ndofs, n) are orthonormal, the free unknowns if the boundary were fixed."""
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
