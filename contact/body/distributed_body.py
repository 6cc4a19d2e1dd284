"""An elastic body whose cells are spread over the processes of a run."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from copy import copy, deepcopy
from functools import cached_property, partial
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from skfem import Basis

from contact.arrays.dense_arrays import HostArrays
from contact.body.anisotropic import Anisotropic
from contact.body.axisymmetry import AXISYMMETRIC
from contact.body.cell_finder import find_cells
from contact.body.constitutive import StressLaw
from contact.body.elastic_body import ElasticBody, Field
from contact.body.material import of_each_cell
from contact.body.multipoint import column_lengths, picked_by
from contact.body.rigid_modes import dof_kinds, rigid_field
from contact.body.solid import Solid
from contact.body.space import Space
from contact.body.spread_unknowns import SpreadUnknowns
from contact.body.vector_element import vector_element
from contact.errors import InputError
from contact.settled import settled
from skfem_adini.distributed import DistributedBasis, DistributedMatrix, has_petsc, largest, total
from skfem_adini.ground.arguments import choice

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_log = logging.getLogger(__name__)


class ContactStrip(ElasticBody):
    """The cells around the contact boundary, which every process has."""

    offered: tuple[str, ...] = ()

    def whole_facets(self, boundary: Any) -> NDArray[np.int64]:
        """Facet numbers of boundaries in the constructor's `contact`."""
        names = [boundary] if isinstance(boundary, str) else boundary
        if not isinstance(names, list | tuple) or any(n not in self.offered for n in names):
            raise InputError(
                f"boundary={boundary!r}: a DistributedBody offers {self.offered} for contact; "
                "name others as DistributedBody(..., contact=...)"
            )
        return super().whole_facets(boundary)


@settled("make a new DistributedBody", "space", "contact", "plane")
class DistributedBody(Solid):
    """An elastic body on the processes of a run, started by ``mpiexec``.

    Every process has its own cells with those around them, and all have the cells around the
    contact boundary. The methods that add supports and loads, solve, or evaluate results must be
    called by all processes together. A vector of all dofs holds, on each process, the dofs of the
    contact strip, the same everywhere, and then the other dofs that belong to the process; `gather`
    brings it to the first process in scikit-fem's numbering.

    Parameters
    ----------
    mesh : Mesh, callable () -> Mesh, or TensorGrid
        See `skfem_adini.distributed.DistributedBasis`.
    element : Element, optional
        Default as for `ElasticBody.from_mesh`.
    contact : str or list of str
        Boundaries where contact may occur.
    E, nu : float or ndarray, shape (ncells,)
        Arrays over the cells of the whole mesh.
    plane, dilatation, material
        As for `ElasticBody`.
    backend : {"auto", "mumps", "krylov"}
        "mumps" condenses the body onto its contact boundary by one parallel factorisation: every
        process stores a dense matrix of that boundary. "krylov" makes the contact rows unknowns
        and solves each Newton step by multigrid; no dense matrix exists. It refuses contact points
        of which supports move one tangential component and leave the other free. "auto" takes
        "krylov" in space from 100,000 unknowns on, or where the factor would fill more than half of
        the memory, and logs why.
    multigrid : {"gamg", "hypre"}
        For "krylov": PETSc's smoothed aggregation, or BoomerAMG.
    intorder : int, optional
        Order of quadrature, as for `skfem.Basis`. Its default takes 64 points in a trilinear brick,
        too many for 10^5 bricks; 2, with 8 points, is exact for rectangular bricks.
    comm : mpi4py.MPI.Comm, optional

    Raises
    ------
    InputError
        A malformed argument, a boundary that no process has, or cells too slender.

    Examples
    --------
    This script also runs as ``mpiexec -n 4 python script.py``:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, DistributedBody
    >>> mesh = MeshQuad().refined(3).with_defaults()
    >>> body = DistributedBody(mesh, contact="bottom", E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, -0.1))
    """

    space: DistributedBasis
    comm: Any
    local: ElasticBody  # on the cells of this process and those around them
    _strip: ElasticBody
    _IDENTITY = "space"

    def __init__(
        self,
        mesh: Any,
        element: Any = None,
        *,
        contact: str | Sequence[str],
        E: ArrayLike | None = None,
        nu: ArrayLike | None = None,
        plane: str | None = "strain",
        dilatation: str = "pointwise",
        material: Anisotropic | None = None,
        backend: str = "auto",
        multigrid: str = "gamg",
        intorder: int | None = None,
        comm: Any = None,
    ) -> None:
        choice("backend", backend, ("auto", "mumps", "krylov"))
        choice("multigrid", multigrid, ("gamg", "hypre"))
        if plane == AXISYMMETRIC:
            raise InputError(
                "plane='axisymmetric': a DistributedBody has no axis yet; take an ElasticBody"
            )
        self.backend, self.multigrid = backend, multigrid
        self.contact = (contact,) if isinstance(contact, str) else tuple(contact)
        order = {} if intorder is None else {"intorder": intorder}
        self.space = DistributedBasis(mesh, partial(_element, element), comm, **order)
        self.comm: Any = self.space.comm
        given: dict[str, Any] = {"plane": plane, "dilatation": dilatation, "material": material}
        of_cells = partial(_of_cells, total=self.space.piece.total)
        cells = self.space.piece.cells
        self.local = ElasticBody(
            self.space.basis, of_cells("E", E, cells), of_cells("nu", nu, cells), **given
        )
        if any(self.comm.allgather(self.local.slender)):
            raise InputError("mesh: its cells are too slender for a DistributedBody")
        self.dim, self.plane = self.local.dim, self.local.plane
        self.element = self.local.element
        strip, cells = self.space.strip(self.contact)
        self._strip = ContactStrip(
            Basis(strip, _element(element, strip), **order),
            of_cells("E", E, cells),
            of_cells("nu", nu, cells),
            **given,
        )
        self._strip.offered = self.contact
        self._place(cells)
        self._supports: list[Any] = []
        self.f = np.zeros(self._shared + self.others.size)

    def gather(self, u: Array) -> Array | None:
        """A vector of all dofs in scikit-fem's numbering, on the first process; else None.

        Parameters
        ----------
        u : ndarray
            A vector of this body, such as ``result.u``.

        Returns
        -------
        ndarray or None
        """
        return self.space.gather(self.to_local(u))

    def chosen_backend(self, rows: int) -> str:
        """The back end for a number of contact rows, of all components; the choice of "auto" is
        logged."""
        if self.backend != "auto":
            return self.backend
        found, why = choose_backend(self.space.N, rows, self.dim, self.comm.size)
        _log.info("%s: %s", found, why)
        return found

    def _has(self, boundary: Any) -> tuple[list[str], bool, bool]:
        """Names of a boundary, and whether it has facets in the local cells and in the strip."""
        names = [boundary] if isinstance(boundary, str) else list(boundary)
        if not names or any(not isinstance(name, str) for name in names):
            raise InputError(
                f"boundary={boundary!r}: a DistributedBody takes names of boundaries; facet "
                "numbers differ from process to process"
            )
        here, strip = (m.boundaries or {} for m in (self.space.mesh, self._strip.mesh))
        known = set().union(*self.comm.allgather({k for k, v in here.items() if np.size(v)}))
        for name in names:
            if name not in known:
                raise InputError(f"boundary: no facets called {name!r}; there are {sorted(known)}")
        return (
            names,
            any(np.size(here.get(name, ())) for name in names),
            any(np.size(strip.get(name, ())) for name in names),
        )

    def fix(
        self,
        boundary: str | Sequence[str],
        components: str | int | Sequence[int] | None = None,
        value: Field = 0.0,
        smooth: bool | None = None,
    ) -> Self:
        """Prescribe displacement components on named boundaries; see `ElasticBody.fix`.

        Parameters
        ----------
        boundary : str or list of str
            Facet numbers differ from process to process.
        components, value, smooth
            As for `ElasticBody.fix`.

        Returns
        -------
        DistributedBody
            The body itself.

        Raises
        ------
        InputError
            No process has such a boundary, or as for `ElasticBody.fix`.
        """
        names, here, near = self._has(boundary)
        for body, has in ((self.local, here), (self._strip, near)):
            if has:
                body.fix(_present(names, body), components, value, smooth)
        self._supports = [*self._supports, (tuple(names), components)]
        for derived in ("constraint", "unknowns", "lengths", "vectors"):
            self.__dict__.pop(derived, None)
        return self

    def load(self, boundary: str | Sequence[str], traction: Field) -> Self:
        """Add a surface traction on named boundaries; see `ElasticBody.load`.

        Parameters
        ----------
        boundary : str or list of str
        traction : array of shape (dim,) or callable x -> array of shape (dim, ...)
            Force per area.

        Returns
        -------
        DistributedBody
            The body itself.

        Raises
        ------
        InputError
            No process has such a boundary, or another shape.
        """
        names, here, _ = self._has(boundary)
        body = self._unloaded()
        if here:
            body.load(_present(names, body), traction)
        self.f = self.f + self.of_owned(body.f)
        return self

    def body_force(self, force: Field) -> Self:
        """Add a volume force; see `ElasticBody.body_force`.

        Parameters
        ----------
        force : array of shape (dim,) or callable x -> array of shape (dim, ...)
            Force per volume.

        Returns
        -------
        DistributedBody
            The body itself.
        """
        self.f = self.f + self.of_owned(self._unloaded().body_force(force).f)
        return self

    def support_motion(self, boundary: Any, components: Any, value: Any) -> Array:
        """Displacement that one of the supports prescribes; see `Solid.support_motion`."""
        names, here, _ = self._has(boundary)
        moved = np.zeros(self.space.basis.N)
        if here:
            names = _present(names, self.local)
            moved = self.local.support_motion(names, components, value)
        return self.of_owned(moved)

    def _unloaded(self) -> ElasticBody:
        body = copy(self.local)
        body.f = np.zeros(self.space.basis.N)
        return body

    def _place(self, cells: Index) -> None:
        """Find the strip's dofs among the local ones, and the process that owns each."""
        space, dofs = self.space, self._strip.basis.element_dofs
        own = np.flatnonzero(space.piece.owner == self.comm.rank)
        here, there = np.intersect1d(space.piece.cells[own], cells, return_indices=True)[1:]
        entry = self.comm.allgather((there, space.numbers[space.basis.element_dofs[:, own[here]]]))
        self._shared = self._strip.basis.N
        numbers = np.full(self._shared, -1, dtype=np.int64)
        for which, known in entry:
            numbers[dofs[:, which]] = known
        if np.any(numbers < 0):
            raise AssertionError("a cell of the contact strip belongs to no process")
        self._strip_numbers = numbers
        order = np.argsort(space.numbers)
        found = np.searchsorted(space.numbers[order], numbers).clip(max=order.size - 1)
        local = order[found]
        known_here = space.numbers[local] == numbers
        # Local numbers of the strip's dofs: all that exist here, and the owned ones.
        self._seen = np.flatnonzero(known_here), local[known_here]
        is_owned = np.zeros(space.basis.N, dtype=bool)
        is_owned[space.owned] = True
        mine = known_here & is_owned[local]
        self._mine = np.flatnonzero(mine), local[mine]
        is_owned[local[mine]] = False
        self.others = np.flatnonzero(is_owned)

    def to_local(self, u: Array) -> Array:
        """A vector of this body on the dofs of the process's cells, the halo included."""
        x = np.zeros(self.space.basis.N)
        x[self._seen[1]] = u[self._seen[0]]
        x[self.others] = u[self._shared :]
        return self.space.update(x)

    def of_owned(self, x: Array) -> Array:
        """A vector of this body from local values, of which the owned ones are used."""
        return np.concatenate((self.shared(x), x[self.others]))

    def shared(self, x: NDArray[Any]) -> NDArray[Any]:
        """Values at the strip's dofs, on every process, from the owned local values."""
        values = np.zeros((self._shared, *x.shape[1:]), dtype=x.dtype)
        for where, part in self.comm.allgather((self._mine[0], x[self._mine[1]])):
            values[where] = part
        return values

    def counted(self, u: Array) -> Array:
        """Local owned values of a vector of this body, shape (owned dofs,), without exchange."""
        x = np.zeros(self.space.basis.N)
        x[self._mine[1]] = u[self._mine[0]]
        x[self.others] = u[self._shared :]
        own: Array = x[self.space.owned]
        return own

    def places(self) -> dict[str, Index]:
        """For each owned dof, a cell of the whole mesh and the dof's number in that cell: ``cell``
        and ``slot``, shape (owned dofs,)."""
        space = self.space
        cells = space.own_cells
        dofs = space.basis.element_dofs[:, cells]
        found = np.full((2, space.basis.N), -1, dtype=np.int64)
        found[0, dofs] = space.piece.cells[cells]
        found[1, dofs] = np.arange(dofs.shape[0])[:, None]
        return {"cell": found[0, space.owned], "slot": found[1, space.owned]}

    def from_places(
        self, parts: Iterable[dict[str, Any]], names: Sequence[str]
    ) -> dict[str, Array]:
        """Vectors `names` of this body from `parts`, values keyed as in `places` by any number of
        processes; InputError if a dof has no value."""
        space, cells = self.space, self.space.piece.cells
        local = np.zeros((len(names), space.basis.N))
        known = np.zeros(space.basis.N, dtype=bool)
        for part in parts:
            at = np.searchsorted(cells, part["cell"]).clip(max=cells.size - 1)
            here = cells[at] == part["cell"]
            dofs = space.basis.element_dofs[part["slot"][here], at[here]]
            known[dofs] = True
            for row, name in zip(local, names, strict=True):
                row[dofs] = part[name][here]
        if not known[space.owned].all():
            raise InputError("path: the files of the processes do not hold all dofs of this body")
        return {name: self.of_owned(row) for name, row in zip(names, local, strict=True)}

    @property
    def trace(self) -> ElasticBody:
        """The cells around the contact boundary with their supports; their dofs come first."""
        return self._strip

    @cached_property
    def rows(self) -> sparse.csr_array:
        """Rows of the stiffness matrix that belong to this process, in local columns."""
        rows = sparse.csr_array(self.local.stiffness[self.space.owned])
        self.local.__dict__.pop("stiffness", None)
        return rows

    @cached_property
    def absolute_rows(self) -> sparse.csr_array:
        """Entrywise ``|S|``, the scale of residuals."""
        rows = self.rows
        return sparse.csr_array((np.abs(rows.data), rows.indices, rows.indptr), shape=rows.shape)

    @property
    def stiffness(self) -> _Product:
        """S as ``S @ u`` for vectors of this body."""
        return _Product(self)

    @cached_property
    def unknowns(self) -> SpreadUnknowns:
        """The free unknowns z of ``u = P z + u0``, spread over the processes."""
        return SpreadUnknowns.of(self)

    @cached_property
    def constraint(self) -> tuple[sparse.csr_array, Array]:
        """P on the dofs and free unknowns of this process, and u0 of ``u = P z + u0``."""
        return self.unknowns.P, self.of_owned(self.unknowns.u0)

    @cached_property
    def lengths(self) -> tuple[Array, Array]:
        """Length of each local dof and of each own unknown, the same on all processes."""
        space, kind = self.space, dof_kinds(self.space.basis)
        own = space.own_cells
        size = total(self.comm, [self.local.basis.dx[own].sum(), own.size])
        cell = float(size[0] / size[1]) ** (1 / self.dim)
        of_dof = np.where(kind == -1, 1.0, np.where(kind == -2, cell**2, cell))
        return of_dof, column_lengths(self.unknowns.own, of_dof[space.owned])

    @property
    def extent(self) -> float:
        """Largest extent along a coordinate axis."""
        low, high = self._ends()
        return float((high - low).max())

    def _ends(self) -> tuple[Array, Array]:
        p = self.space.mesh.p
        ends = np.array(self.comm.allgather((p.min(axis=1), p.max(axis=1))))
        return ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)

    @cached_property
    def rigid(self) -> Array:
        """Rigid motions about the body's middle, at the local dofs."""
        return rigid_field(self.local, 0.5 * np.sum(self._ends(), axis=0))

    @cached_property
    def vectors(self) -> SpreadSpace:
        """The `Space` that computes with the owned dofs of this process."""
        return SpreadSpace(self)

    def under(self, f: Array, u0: Array, thermal: Any = None) -> Self:
        """The same body with other loads and other prescribed displacements."""
        other = copy(self)
        other.f, other.constraint = f, (self.constraint[0], u0)
        return other

    def forces_on(self, u: Array) -> Array:
        """S u on the owned dofs."""
        return np.asarray(self.rows @ self.to_local(u))

    def moduli_on(self, u: Array) -> Array:
        """``|S| |u|`` on the owned dofs."""
        return np.asarray(self.absolute_rows @ np.abs(self.to_local(u)))

    def local_displacement(self, forces: Array) -> float:
        """Largest displacement that one of the forces would cause if all other dofs were fixed."""
        own = DistributedMatrix(self.space, self.rows).diagonal()[self.space.owned]
        return self.vectors.largest(self.counted(forces) * self.vectors.lengths / own)

    def dot(self, a: Array, b: Array) -> float:
        """Inner product of two vectors of this body."""
        return float(total(self.comm, self.counted(a) @ self.counted(b)))

    def displacement(self, u: Array, points: Array) -> Array:
        """Displacement at points, by the element's own interpolation, shape (dim, npoints)."""
        x = self.to_local(u)
        return self._at(points, lambda p: self.local.displacement(x, p), (self.dim,))

    def gradient(self, u: Array, points: Array) -> Array:
        """Gradient d u_i / d x_j of the displacement at points, shape (dim, dim, npoints)."""
        x = self.to_local(u)
        return self._at(points, lambda p: self.local.gradient(x, p), (self.dim, self.dim))

    def stress_at(self, u: Array, points: Array) -> Array:
        """Cauchy stress at points, shape (dim, dim, npoints)."""
        x = self.to_local(u)
        return self._at(points, lambda p: self.local.stress_at(x, p), (self.dim, self.dim))

    def law_at(self, points: Array) -> StressLaw:
        """`StressLaw` at points, shape (dim, npoints), of a uniform body; InputError where E or nu
        differ from cell to cell."""
        if np.ndim(self.local.E) or np.ndim(self.local.nu):
            raise InputError(
                "points: E or nu differ from cell to cell, so that the stress out of the plane "
                "has no one law; take result.stress(points)"
            )
        return self.local.law.at(np.zeros(points.shape[1], dtype=np.int64))

    @property
    def basis(self) -> Any:
        """Raise an `InputError`: each process has a part of it."""
        raise self._in_pieces("basis")

    @property
    def mesh(self) -> Any:
        """Raise an `InputError`: each process has a part of it."""
        raise self._in_pieces("mesh")

    @property
    def law(self) -> Any:
        """Raise an `InputError`: each process has the law of its cells."""
        raise self._in_pieces("law")

    def _in_pieces(self, name: str) -> InputError:
        return InputError(
            f"body: a DistributedBody has no {name} of the whole mesh; each process has a piece, "
            f"body.local.{name}. For fields take result.stress(points) and result.sample(points), "
            "for files contact.save_pvtu(path, result), for everything on one process "
            "body.gather(result.u)"
        )

    def _at(self, points: Array, evaluate: Any, shape: tuple[int, ...]) -> Array:
        """Values at points, each from the first process with a cell that holds it."""
        here = self._cells_here(points)
        found = evaluate(points[:, here]) if here.any() else np.zeros((*shape, 0))
        value, missing = np.zeros((*shape, points.shape[1])), np.ones(points.shape[1], dtype=bool)
        for where, part in self.comm.allgather((np.flatnonzero(here), found)):
            new = missing[where]
            value[..., where[new]] = part[..., new]
            missing[where] = False
        if missing.any():
            k = int(np.flatnonzero(missing)[0])
            raise InputError(f"points: point {k} at {points[:, k]} lies outside the body")
        return value

    def _cells_here(self, points: Array) -> NDArray[np.bool_]:
        p = self.space.mesh.p
        size = 1e-12 * np.abs(p).max(initial=0.0)  # rounding of coordinates
        near = np.all(
            (points >= p.min(axis=1)[:, None] - size) & (points <= p.max(axis=1)[:, None] + size),
            axis=0,
        )
        inside = np.zeros(points.shape[1], dtype=bool)
        for k in np.flatnonzero(near):
            with suppress(InputError):
                find_cells(self.space.mesh, points[:, [k]])
                inside[k] = True
        return inside

    def stacked(self, rows: Array) -> Array:
        """Triangular QR factor of rows that are distributed over processes."""
        parts = self.comm.allgather(np.linalg.qr(rows, mode="r"))
        return np.asarray(np.linalg.qr(np.vstack(parts), mode="r"))

    def __reduce__(self) -> NoReturn:
        raise InputError(
            "body: a DistributedBody lives on its processes and cannot be copied to others or to "
            "a file; gather its results, or write them with skfem_adini.distributed.save_pvtu"
        )


class _Product:
    """The stiffness of a body as an operator ``S @ u``."""

    def __init__(self, body: DistributedBody) -> None:
        self._body = body

    def __matmul__(self, u: Array) -> Array:
        return self._body.internal(u)


class SpreadSpace(Space):
    """The vectors of a distributed body; each process computes with its owned dofs."""

    def __init__(self, body: DistributedBody) -> None:
        z, kind = body.unknowns, dof_kinds(body.space.basis)
        self._body, self._owned, self.arrays = body, body.space.owned, HostArrays()
        component = np.where(kind == -1, np.arange(kind.size) % body.dim, -1)
        self._component = component[self._owned]
        self.values = self._component >= 0
        self.lengths, self.free_lengths = body.lengths[0][self._owned], body.lengths[1]
        self.P, self.transposed, self.of_moduli = z.own, z.own.T, abs(z.own).T
        self.picked = picked_by(z.own, lambda: self.lengths)
        self.picks = self.picked.T

    def own(self, v: Array) -> Array:
        """The owned values of a vector of the body."""
        return self._body.counted(v)

    def returned(self, v: Array, like: Any) -> Array:
        """A vector of the body from owned values."""
        x = np.zeros(self._body.space.basis.N)
        x[self._owned] = v
        return self._body.of_owned(x)

    def largest(self, x: Array) -> float:
        """Largest modulus on all processes."""
        return largest(self._body.comm, float(np.abs(x).max(initial=0.0)))

    def strained(self, left: Array, rigid: Array) -> Array:
        """Owned values in units of `lengths` without their rigid-body part."""
        modes = rigid[self._owned] * self.lengths[:, None]
        R = self._body.stacked(np.column_stack((modes, left)))
        motion = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=None)[0]
        return np.asarray(left - modes @ motion)

    def resultant(self, forces: Array) -> Array:
        """Sum of each component on all processes, shape (dim,)."""
        here = np.bincount(self._component[self.values], forces[self.values], self._body.dim)
        return np.asarray(total(self._body.comm, here))


def _element(given: Any, mesh: Any) -> Any:
    """The vector element on a mesh; the default if none was given."""
    return vector_element(deepcopy(given), mesh)


def _present(names: list[str], body: ElasticBody) -> list[str]:
    """The boundaries that have facets on some process."""
    return [n for n in names if np.size((body.mesh.boundaries or {}).get(n, ()))]


def _of_cells(name: str, value: Any, cells: NDArray[np.int64], total: int) -> Any:
    """A scalar as it is, or the values of some cells of the whole mesh."""
    if value is None or np.ndim(value) == 0:
        return value
    return of_each_cell(name, value, total)[cells]


def factor_memory(unknowns: int, rows: int, dim: int, processes: int) -> float:
    """Estimate the bytes that condensation onto `rows` contact rows needs on all processes."""
    n = float(max(unknowns, 2))
    if dim == 3:
        sparse = 1.8e9 / 107_811 ** (4 / 3) * n ** (4 / 3)  # MUMPS's factors of 107,811 unknowns
    else:
        sparse = 2.5e3 / 18.6 * n * math.log2(n)  # and of 396,294
    return sparse + 24.0 * processes * float(rows) ** 2  # complement, its factor and compliance


def choose_backend(unknowns: int, rows: int, dim: int, processes: int) -> tuple[str, str]:
    """The back end, "mumps" or "krylov", and the reason."""
    if processes == 1 and not has_petsc():
        return "mumps", "one process without PETSc takes the sparse solvers of other bodies"
    need, there = factor_memory(unknowns, rows, dim, processes), physical_memory()
    gigabytes = f"the factor would take about {need / 1e9:.1f} of {there / 1e9:.1f} GB"
    if need > 0.5 * there:
        return "krylov", gigabytes
    if dim == 3 and unknowns >= 100_000:
        return "krylov", f"{unknowns} unknowns in space are solved faster by multigrid"
    return "mumps", gigabytes


def physical_memory() -> float:
    """Bytes of memory of this machine; infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return float("inf")
