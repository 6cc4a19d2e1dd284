"""A finite element space whose cells and dofs are spread over processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, Mesh
from skfem.assembly import Dofs
from skfem.element import Element

from skfem_adini.assembly.assemble import assemble
from skfem_adini.distributed.communicator import Communicator, total, world
from skfem_adini.distributed.distributed_matrix import DistributedMatrix
from skfem_adini.distributed.pieces import Piece, TensorGrid, own_piece, strip_of, whole_mesh
from skfem_adini.errors import InputError
from skfem_adini.kept_functions import without_functions

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class DistributedBasis:
    """A finite element space on the processes of a run.

    Each process has its own cells and a layer of cells around them. A dof belongs to the first
    process that has a cell which touches it; since it has all cells around the dof, that process
    assembles its row of a matrix completely, without communication. Vectors are local: they hold
    the values of all dofs of the process's cells, the owned ones and copies of others (its halo),
    which `update` renews.

    Parameters
    ----------
    mesh : Mesh, callable () -> Mesh, or TensorGrid
        The same mesh on all processes; or a function that makes it, called on the first process
        alone; or a grid of which each process builds its own strip.
    element : Element, or callable Mesh -> Element
    comm : mpi4py.MPI.Comm, optional
        The processes; default: all of the run.
    **options
        For `skfem.Basis`, such as ``intorder``.

    Attributes
    ----------
    basis : skfem.Basis
        On the cells of this process and those around them.
    N : int
        Number of dofs of the whole space.
    owned : ndarray of int
        Local dofs that belong to this process, in the order of their numbers.
    first : int
        Number of the first of them; all are numbered consecutively.
    numbers : ndarray, shape (basis.N,)
        Number of every local dof.

    Raises
    ------
    InputError
        No mesh, no element, or fewer cells than processes.

    Examples
    --------
    The same script runs as ``python script.py`` and as ``mpiexec -n 4 python script.py``:

    >>> from skfem import MeshQuad
    >>> from skfem.models.poisson import laplace
    >>> from skfem_adini import ElementQuadAdini
    >>> from skfem_adini.distributed import DistributedBasis
    >>> space = DistributedBasis(MeshQuad().refined(3), ElementQuadAdini())
    >>> K = space.assemble(laplace)
    >>> space.N, K.shape
    (243, (243, 243))
    """

    def __init__(
        self,
        mesh: Mesh | TensorGrid | Callable[[], Mesh],
        element: Any,
        comm: Communicator | None = None,
        **options: Any,
    ) -> None:
        self.comm: Any = world() if comm is None else comm
        self.piece: Piece = own_piece(mesh, self.comm)
        self._mesh = mesh
        # Elements may store results for one mesh.
        own = isinstance(element, Element)
        on_cells = without_functions(deepcopy(element)) if own else element(self.piece.mesh)
        self.basis = Basis(self.piece.mesh, on_cells, **options)
        self._refuse_orientation()
        self._number()
        self.halo = Halo(self.comm, self.numbers, self.first, self.owned)

    def __repr__(self) -> str:
        of = type(self.basis.elem).__name__
        return (
            f"DistributedBasis({of}, {self.N} dofs, process {self.comm.rank} of {self.comm.size})"
        )

    @property
    def mesh(self) -> Any:
        """The cells of this process and those around them."""
        return self.basis.mesh

    @property
    def own_cells(self) -> Indices:
        """Local cells that belong to this process."""
        return np.flatnonzero(self.piece.owner == self.comm.rank)

    def _number(self) -> None:
        """Number the dofs: those of one process after those of the one before it."""
        comm, dofs = self.comm, self.basis.element_dofs
        owner = np.full(self.basis.N, comm.size, dtype=np.int64)
        np.minimum.at(owner, dofs, np.broadcast_to(self.piece.owner, dofs.shape))
        surrounded = np.zeros(self.basis.N, dtype=bool)  # by all the cells that touch them
        surrounded[dofs[:, self.own_cells]] = True
        self.owned = np.flatnonzero(surrounded & (owner == comm.rank))
        counts = np.array(comm.allgather(self.owned.size))
        self.first, self.N = int(counts[: comm.rank].sum()), int(counts.sum())
        self.numbers = np.full(self.basis.N, -1, dtype=np.int64)
        self.numbers[self.owned] = self.first + np.arange(self.owned.size)
        # First each process receives the numbers of all dofs of its own cells from the processes
        # that have them in their halo; then it sends them to those that have its cells in theirs.
        self._pass_on(self._halo_cells())
        if np.any(self.numbers[dofs[:, self.own_cells]] < 0):
            raise AssertionError("a dof of an own cell has no number")
        self._pass_on(self._asked_for())

    def _halo_cells(self) -> list[Indices]:
        """Local cells that belong to each process."""
        ranks = range(self.comm.size)
        return [np.flatnonzero(self.piece.owner == r) for r in ranks]

    def _asked_for(self) -> list[Indices]:
        """Own local cells in the halo of each process."""
        theirs = self._halo_cells()
        theirs[self.comm.rank] = theirs[self.comm.rank][:0]
        asked = self.comm.alltoall([self.piece.cells[cells] for cells in theirs])
        return [np.searchsorted(self.piece.cells, cells) for cells in asked]

    def _pass_on(self, cells: list[Indices]) -> None:
        """Send the numbers of the dofs of local cells to processes that have these cells."""
        dofs = self.basis.element_dofs
        sent = [(self.piece.cells[c], self.numbers[dofs[:, c]]) for c in cells]
        sent[self.comm.rank] = (np.zeros(0, dtype=np.int64), np.zeros((len(dofs), 0), np.int64))
        for which, known in self.comm.alltoall(sent):
            local = dofs[:, np.searchsorted(self.piece.cells, which)]
            self.numbers[local] = np.maximum(self.numbers[local], known)

    def _refuse_orientation(self) -> None:
        """Refuse dofs on facets whose sign depends on both cells, together with dofs at vertices.
        Rows of dofs at vertices have columns of facets where a piece ends; its outward normal there
        may be opposite to that of the whole mesh."""
        element = self.basis.elem
        at_facets = element.dofnames[element.nodal_dofs :][: element.facet_dofs]
        if element.nodal_dofs and any(n.split("^")[0] != "u" for n in at_facets):
            raise InputError(
                f"element: {type(element).__name__} has dofs {sorted(set(at_facets))} on facets, "
                "whose sign depends on the facet's orientation; it cannot be distributed"
            )

    def update(self, x: Array) -> Array:
        """Copy the values of dofs from the processes to which they belong; returns a new vector.

        Parameters
        ----------
        x : ndarray, shape (basis.N,) or (basis.N, k)

        Returns
        -------
        ndarray
            The same values where the dofs are owned.
        """
        return self.halo.update(x)

    def extended(self, own: Array) -> Array:
        """A local vector from the values of owned dofs, shape (owned.size,)."""
        x = np.zeros((self.basis.N, *own.shape[1:]), dtype=own.dtype)
        x[self.owned] = own
        return self.halo.update(x)

    def dot(self, x: Array, y: Array) -> float:
        """Inner product of two vectors, the same bits on all processes."""
        return float(total(self.comm, x[self.owned] @ y[self.owned]))

    def assemble(self, form: Any, **parameters: Any) -> Any:
        """Assemble a bilinear or linear form over the cells.

        Parameters
        ----------
        form : BilinearForm, LinearForm or function
            For the cells; see `skfem_adini.assemble`.
        **parameters
            Numbers, and arrays over the local cells, as for `skfem_adini.assemble`.

        Returns
        -------
        DistributedMatrix or ndarray of shape (basis.N,)

        Raises
        ------
        InputError
            As for `skfem_adini.assemble`.
        """
        whole: Any = None
        cells = self.basis.nelems
        step = 100_000  # cells assembled at once: a brick of degree three takes 300 kB
        for start in range(0, cells, step):
            if cells <= step:
                part = assemble(form, self.basis, **parameters)
            else:
                some = np.arange(start, min(start + step, cells))
                part = assemble(form, self.basis.with_elements(some), **parameters)
            whole = part if whole is None else whole + part
        if isinstance(whole, np.ndarray):
            return self.update(whole)
        return DistributedMatrix(self, sparse.csr_array(whole)[self.owned])

    def boundary_dofs(self, *names: str, skip: Any = None) -> Indices:
        """Local dofs on named boundaries, those of the halo included.

        Parameters
        ----------
        *names : str
        skip : list of str, optional
            Names of dofs that are left out, as for ``basis.get_dofs``.

        Raises
        ------
        InputError
            No process has such a boundary.
        """
        here = self.mesh.boundaries or {}
        known = set().union(*self.comm.allgather(set(here)))
        for name in names:
            if name not in known:
                raise InputError(f"names: no boundary {name!r}; there are {sorted(known)}")
        mask = np.zeros(self.basis.N)
        facets = [here[name] for name in names if name in here]
        if facets:
            mask[self.basis.get_dofs(np.concatenate(facets), skip=skip).flatten()] = 1.0
        return np.flatnonzero(self.update(mask))

    def strip(self, names: Sequence[str]) -> tuple[Any, Indices]:
        """All cells that touch boundaries, as a mesh that every process has, and their numbers.

        Parameters
        ----------
        names : sequence of str

        Raises
        ------
        InputError
            No such boundary.
        """
        return strip_of(self._mesh, names, self.comm)

    def gather(self, x: Array) -> Array | None:
        """All values in scikit-fem's own numbering of the whole mesh, on the first process.

        Parameters
        ----------
        x : ndarray, shape (basis.N,)

        Returns
        -------
        ndarray of shape (N,) on the first process, None on the others

        Notes
        -----
        The numbering is that of ``skfem.Basis(mesh, element)`` on the whole mesh, which the first
        process makes for it.
        """
        serial = self.serial_numbers()
        own = self.comm.gather((self.numbers[self.owned], x[self.owned]))
        if own is None or serial is None:
            return None
        values = np.empty(self.N, dtype=x.dtype)
        for numbers, part in own:
            values[serial[numbers]] = part
        return values

    def serial_numbers(self) -> Indices | None:
        """The dof in scikit-fem's numbering for each number, on the first process, which builds the
        whole mesh for it; else None."""
        own = self.own_cells
        entry = self.comm.gather(
            (self.piece.cells[own], self.numbers[self.basis.element_dofs[:, own]])
        )
        if entry is None:
            return None
        dofs = Dofs(whole_mesh(self._mesh), deepcopy(self.basis.elem)).element_dofs
        serial = np.empty(self.N, dtype=np.int64)
        for cells, numbers in entry:
            serial[numbers] = dofs[:, cells]
        return serial


class Halo:
    """The values that each process copies from other processes.
    `numbers` (n,) are those of the local dofs in the whole space, `owned` the local dofs that
    belong to this process, by number from `first` without gaps."""

    def __init__(self, comm: Any, numbers: Indices, first: int, owned: Indices) -> None:
        self._comm = comm
        firsts = np.array(comm.allgather(first))
        copied = np.ones(numbers.size, dtype=bool)
        copied[owned] = False
        others = np.flatnonzero(copied)
        # Processes without dofs share their first number with the next one, the owner.
        owner = np.searchsorted(firsts, numbers[others], side="right") - 1
        self._received = [others[owner == rank] for rank in range(comm.size)]
        asked = comm.alltoall([numbers[place] for place in self._received])
        self._sent = [owned[number - first] for number in asked]

    def update(self, x: NDArray[Any]) -> NDArray[Any]:
        """A new vector, or matrix of columns, with the values of their owners."""
        fresh = x.copy()
        if self._comm.size == 1:
            return fresh
        parts = self._comm.alltoall([x[place] if place.size else None for place in self._sent])
        for place, values in zip(self._received, parts, strict=True):
            if place.size:
                fresh[place] = values
        return fresh
