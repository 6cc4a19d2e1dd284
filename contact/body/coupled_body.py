"""A body whose dofs may be linked by linear equations."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from contact.body.boundary_names import select_components, select_facets
from contact.body.material import MaterialBody
from contact.body.multipoint import Coupling
from contact.body.periodicity import periodic_equations, tied_equations
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
