"""Several bodies as one `Solid` with concatenated dofs and block-diagonal matrices."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.solid import Solid
from contact.body.supports import unconstrained_rows
from contact.errors import InputError

Array = NDArray[np.float64]


def _largest(quantity: str) -> Any:
    def of_all(self: Bodies, vector: Array) -> float:
        return max(float(getattr(body, quantity)(own)) for body, own in self._each(vector))

    return of_all


def _one_after_the_other(quantity: str) -> Any:
    def of_all(self: Bodies, vector: Array) -> Array:
        return np.concatenate([getattr(body, quantity)(own) for body, own in self._each(vector)])

    return of_all


class Bodies(Solid):
    """The distinct bodies of a contact problem, all of one dimension, as one `Solid`.
    No matrix is copied: products are formed body by body. Loads, supports and material constants of
    the bodies may change afterwards."""

    def __init__(self, bodies: Sequence[Solid]) -> None:
        if isinstance(bodies, str) or not isinstance(bodies, Sequence) or not bodies:
            raise InputError(f"bodies: expected a list of bodies, got {bodies!r}")
        for body in bodies:
            if not isinstance(body, Solid) or isinstance(body, Bodies):
                raise InputError(
                    "bodies: expected ElasticBody, LayeredBlock or CutBody, got "
                    f"{type(body).__name__}"
                )
        if any(a is b for i, a in enumerate(bodies) for b in bodies[:i]):
            raise InputError("bodies: one of them is given twice")
        if len({body.dim for body in bodies}) > 1:
            raise InputError(
                f"bodies: of {sorted({body.dim for body in bodies})} dimensions; all need the same"
            )
        names = [body.name for body in bodies if body.name]
        if len(set(names)) < len(names):
            raise InputError(f"bodies: two are called {max(names, key=names.count)!r}")
        self._bodies = tuple(bodies)
        self.dim = bodies[0].dim
        planes = {body.plane for body in bodies}
        if len(planes) > 1 and any(body.is_ring for body in bodies):
            raise InputError("bodies: axisymmetric ones touch axisymmetric ones only")
        self.plane = planes.pop() if len(planes) == 1 else None

    def __repr__(self) -> str:
        return f"Bodies({', '.join(map(repr, self._bodies))})"

    @property
    def bodies(self) -> tuple[Any, ...]:
        """The bodies."""
        return self._bodies

    @property
    def slices(self) -> tuple[slice, ...]:
        """Slice of each body's dofs among all dofs."""
        ends = np.cumsum([body.ndofs for body in self._bodies]).tolist()
        return tuple(slice(a, b) for a, b in zip([0, *ends], ends, strict=False))

    @property
    def ndofs(self) -> int:
        """Number of dofs of all bodies."""
        return sum(body.ndofs for body in self._bodies)

    @property
    def extent(self) -> float:
        """Largest extent of a body along a coordinate axis."""
        return max(body.extent for body in self._bodies)

    @property
    def f(self) -> Array:
        """Load on every dof, shape (ndofs,)."""
        return np.concatenate([body.f for body in self._bodies])

    @f.setter
    def f(self, value: Array) -> None:
        raise InputError("f: the loads of several bodies are given to each of them")

    @property
    def _supports(self) -> list[Any]:  # type: ignore[override]
        return [support for body in self._bodies for support in body._supports]

    @property
    def _couplings(self) -> tuple[Any, ...]:  # type: ignore[override]
        return tuple(link for body in self._bodies for link in body._couplings)

    def number_of_trace(self, trace: Any) -> int:
        """Number of the body with this trace."""
        return next(k for k, own in enumerate(self._bodies) if own.trace is trace)

    def describe(self, k: int, motion: str) -> str:
        """Describe a motion of body k for an error message."""
        return f"{motion} of {self.called(k)}"

    def check_unchanged(self) -> None:
        """Raise an `InputError` if loads were edited in place to values that are not finite."""
        for body in self._bodies:
            body.check_unchanged()

    def snapshot(self) -> Self:
        """A copy for a result, which later loads and supports do not change."""
        return self._of(body.snapshot() for body in self._bodies)

    def under(self, f: Array, u0: Array) -> Self:
        """The same bodies, sharing their matrices, with other loads f and prescribed
        displacements u0."""
        return self._of(
            body.under(f[own], u0[own]) for body, own in zip(self.bodies, self.slices, strict=True)
        )

    def _of(self, bodies: Any) -> Self:
        other = copy(self)
        other._bodies = tuple(bodies)
        for name in ("constraint", "_blocks"):
            other.__dict__.pop(name, None)
        return other

    def has_stiffness_of(self, other: Solid) -> bool:
        """Whether all bodies have the same stiffness as those of `other`."""
        pairs = zip(self.bodies, other.bodies, strict=False)
        same = len(self.bodies) == len(other.bodies)
        return same and all(a.has_stiffness_of(b) for a, b in pairs)

    @property
    def materials(self) -> tuple[Any, ...]:
        """The material of each body."""
        return tuple(body._material for body in self._bodies)

    @property
    def trace(self) -> NoReturn:
        """Raise an `InputError`: each body has a trace of its own."""
        raise InputError("body: there are several, each with a mesh and a Basis of its own")

    basis = mesh = element = trace

    @cached_property
    def stiffness(self) -> Any:
        """S of all bodies as one sparse matrix, assembled for checks that need it as a whole."""
        return sparse.block_diag([body.stiffness for body in self._bodies], format="csr")

    @property
    def constraint(self) -> tuple[sparse.csr_array, Array]:
        """P and u0 of ``u = P z + u0``, all bodies."""
        each = [body.constraint for body in self.bodies]
        P = sparse.block_diag([P for P, _ in each], format="csr")
        return sparse.csr_array(P), np.concatenate([u0 for _, u0 in each])

    def embed(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """Return the rows unchanged."""
        return matrix

    def embedded(self, k: int, matrix: sparse.csr_array) -> sparse.csr_array:
        """Rows on the trace of body k, extended to all dofs of all bodies."""
        own, total = self.slices[k], self.slices[-1].stop
        rows = self._bodies[k].embed(matrix).tocsr()
        place = rows.indices + own.start
        return sparse.csr_array((rows.data, place, rows.indptr), shape=(rows.shape[0], total))

    def unconstrained(self, rows: sparse.csr_array) -> NDArray[np.bool_]:
        """Rows that the supports leave free in at least one body."""
        P, lengths = [], []
        for body in self._bodies:
            trace = body.trace
            P.append((trace.constraint[0], body.f.size - trace.f.size))
            lengths.append(trace.lengths)
        blocks = [sparse.vstack([p, sparse.csr_array((rest, p.shape[1]))]) for p, rest in P]
        of_dof = [np.r_[own, np.ones(rest)] for (own, _), (_, rest) in zip(lengths, P, strict=True)]
        of_free = [free for _, free in lengths]
        whole = sparse.csr_array(sparse.block_diag(blocks, format="csr"))
        return unconstrained_rows(rows, whole, (np.concatenate(of_dof), np.concatenate(of_free)))

    def _each(self, *vectors: Array) -> Any:
        """Each body with its part of every vector."""
        return [
            (body, *(v[own] for v in vectors))
            for body, own in zip(self._bodies, self.slices, strict=True)
        ]

    def equilibrium(
        self, u: Array, contact: Array, load: Array, moduli: Array | None = None
    ) -> tuple[float, float]:
        """Residual and sum of moduli of the body with the largest relative residual."""
        given = (u, contact, load) if moduli is None else (u, contact, load, moduli)
        found = [body.equilibrium(*own) for body, *own in self._each(*given)]
        return max(found, key=lambda pair: pair[0] / (pair[1] or 1.0))

    largest_displacement, deformation, support_error, local_displacement = map(
        _largest, ("largest_displacement", "deformation", "support_error", "local_displacement")
    )
    internal, at_supports = map(_one_after_the_other, ("internal", "at_supports"))

    def total(self, forces: Array) -> Array:
        """Resultant of forces on all dofs of all bodies, shape (dim,)."""
        return np.sum([body.total(own) for body, own in self._each(forces)], axis=0)

    def displacement(self, u: Array, points: Array) -> NoReturn:
        """Raise an `InputError`: a point may belong to several bodies."""
        raise InputError("body: there are several; choose one, as in result[body].sample(points)")

    gradient = displacement

    def law_at(self, points: Array) -> NoReturn:
        """Raise an `InputError`: a point may belong to several bodies."""
        raise InputError("body: there are several; choose one")
