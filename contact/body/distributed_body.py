"""An elastic body whose cells are spread over the processes of a run."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Sequence
from copy import copy, deepcopy
from functools import partial
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import Basis

from contact.body.anisotropic import Anisotropic
from contact.body.axisymmetry import AXISYMMETRIC
from contact.body.elastic_body import ElasticBody, Field
from contact.body.spread_solid import SpreadSolid
from contact.body.vector_element import DEFAULT_ELEMENT, vector_element
from contact.errors import InputError
from contact.settled import settled
from skfem_adini.distributed import DistributedBasis, has_petsc
from skfem_adini.ground.arguments import choice

Array = NDArray[np.float64]
_log = logging.getLogger(__name__)


class ContactStrip(ElasticBody):
    """The cells around the contact boundary, which every process has."""

    offered: tuple[str, ...] = ()

    def whole_facets(self, boundary: Any) -> NDArray[np.int64]:
        """Facets of boundaries that were named as those of contact."""
        names = [boundary] if isinstance(boundary, str) else boundary
        if not isinstance(names, list | tuple) or any(n not in self.offered for n in names):
            raise InputError(
                f"boundary={boundary!r}: a DistributedBody offers {self.offered} for contact; "
                "name others as DistributedBody(..., contact=...)"
            )
        return super().whole_facets(boundary)


@settled("make a new DistributedBody", "space", "contact", "plane")
class DistributedBody(SpreadSolid):
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
        "mumps" condenses the body onto its contact boundary by one parallel factorisation: a dense
        matrix of that boundary is held by every process. "krylov" makes the contact rows unknowns
        and solves each Newton step by multigrid; no dense matrix exists. It refuses contact points
        of which supports move one tangential component and leave the other free. "auto" takes
        "krylov" in space from 100,000 unknowns on, or where the factor would fill more than half of
        the memory, and logs why.
    multigrid : {"gamg", "hypre"}
        For "krylov": PETSc's smoothed aggregation, or BoomerAMG.
    intorder : int, optional
        Order of quadrature, as for `skfem.Basis`. Its default takes 64 points in a trilinear brick,
        which fill the memory beyond some 10^5 of them; 2, with 8 points, is exact if the bricks are
        rectangular.
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
            Of this body, such as ``result.u``.

        Returns
        -------
        ndarray or None
        """
        return self.space.gather(self.to_local(u))

    def chosen_backend(self, rows: int) -> str:
        """The back end for a number of contact rows; that of "auto" is logged with its reason.

        Parameters
        ----------
        rows : int
            Contact rows, of all components.
        """
        if self.backend != "auto":
            return self.backend
        found, why = choose_backend(self.space.N, rows, self.dim, self.comm.size)
        _log.info("%s: %s", found, why)
        return found

    def _has(self, boundary: Any) -> tuple[list[str], bool, bool]:
        """Names of a boundary; whether it has facets in the local piece, and in the strip."""
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
                present = [n for n in names if np.size((body.mesh.boundaries or {}).get(n, ()))]
                body.fix(present, components, value, smooth)
        self._supports = [*self._supports, (tuple(names), components)]
        for derived in ("constraint", "unknowns", "lengths"):
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
            present = [n for n in names if np.size((self.space.mesh.boundaries or {}).get(n, ()))]
            body.load(present, traction)
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
            present = [n for n in names if np.size((self.space.mesh.boundaries or {}).get(n, ()))]
            moved = self.local.support_motion(present, components, value)
        return self.of_owned(moved)

    def _unloaded(self) -> ElasticBody:
        body = copy(self.local)
        body.f = np.zeros(self.space.basis.N)
        return body

    def __reduce__(self) -> NoReturn:
        raise InputError(
            "body: a DistributedBody lives on its processes and cannot be copied to others or to "
            "a file; gather its results, or write them with skfem_adini.distributed.save_pvtu"
        )


def _element(given: Any, mesh: Any) -> Any:
    """The vector element on a mesh, the default one if none was given."""
    kind = type(mesh).__name__
    if given is None and kind not in DEFAULT_ELEMENT:
        raise InputError(f"element: no default for {kind}; pass one")
    return vector_element(DEFAULT_ELEMENT[kind]() if given is None else deepcopy(given), mesh)


def _of_cells(name: str, value: Any, cells: NDArray[np.int64], total: int) -> Any:
    """A number, or those of some cells of the whole mesh."""
    if value is None or np.ndim(value) == 0:
        return value
    if np.shape(value) != (total,):
        raise InputError(
            f"{name}: expected a number or one for each of the {total} cells of the whole mesh, "
            f"got shape {np.shape(value)}"
        )
    return np.asarray(value)[cells]


# Unknowns in space from which Newton's steps by multigrid beat a factorisation.
LARGE_IN_SPACE = 100_000
_PLANE = 2.5e3 / 18.6  # bytes of MUMPS's factors over n log2 n, from 396,294 unknowns
_SPACE = 1.8e9 / 107_811 ** (4 / 3)  # bytes over n^(4/3), from 107,811 unknowns
_DENSE = 3.0 * 8.0  # bytes: complement, its factor and compliance, on each process


def factor_memory(unknowns: int, rows: int, dim: int, processes: int) -> float:
    """Estimate the bytes that the condensation needs on all processes; `rows` are in contact."""
    n = float(max(unknowns, 2))
    sparse = _SPACE * n ** (4 / 3) if dim == 3 else _PLANE * n * math.log2(n)
    return sparse + _DENSE * processes * float(rows) ** 2


def choose_backend(unknowns: int, rows: int, dim: int, processes: int) -> tuple[str, str]:
    """The back end, "mumps" or "krylov", and the reason."""
    if processes == 1 and not has_petsc():
        return "mumps", "one process without PETSc takes the sparse solvers of other bodies"
    need, there = factor_memory(unknowns, rows, dim, processes), physical_memory()
    gigabytes = f"the factor would take about {need / 1e9:.1f} of {there / 1e9:.1f} GB"
    if need > 0.5 * there:
        return "krylov", gigabytes
    if dim == 3 and unknowns >= LARGE_IN_SPACE:
        return "krylov", f"{unknowns} unknowns in space are solved faster by multigrid"
    return "mumps", gigabytes


def physical_memory() -> float:
    """Bytes of memory of this machine; infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return float("inf")
