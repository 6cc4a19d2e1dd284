"""Discrete extension: dofs of outer vertices are values of the polynomial of a cell inside."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import NDArray

from skfem_adini.conditions.hanging_constraints import hanging_constraints
from skfem_adini.curved.cut_domain import CutDomain
from skfem_adini.curved.unresolved_features import components, warn_of_unresolved_features
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.straight_cells import reference_points
from skfem_adini.elements.vertex_dofs import full_name, scalar_element, vertex_dofs
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import finite_numbers, positive_number
from skfem_adini.solvers.factorize import Solver, SuperLUFactor, factorize

Array = NDArray[np.float64]
Indices = NDArray[np.integer]


class _Limits(NamedTuple):  # limits of the extension
    farthest: float = 2.0  # cells of extrapolation: a cubic grows with the third power
    share: float = 0.05  # least share inside of a good cell, which determines its polynomial
    rounding: float = 1e-12  # difference below which a share or weight equals one or a threshold
    pivot: float = 1e-10  # of a matrix of unit diagonal: smaller pivots are rounding


LIMITS = _Limits()


class AdiniExtension:
    r"""Parametrisation :math:`x = P z + x_0` of the dofs of a cut domain that is always stable.

    A cell is good when its share inside is at least the threshold. Vertices of good cells keep
    their dofs; every other vertex of an active cell takes u, u_x and u_y of the polynomial of the
    nearest good cell of the same component, evaluated there. The remaining space is continuous and
    contains the cubics and the local space. The energy of its functions is controlled by that on
    good cells, so stiffness and mass matrices :math:`P^T A P` are conditioned like those of a
    fitted mesh, for any cut.

    Parameters
    ----------
    basis
        Basis of the whole mesh or a part of it, with `ElementQuadAdini` or `ElementVector` of it.
    domain
        The cut domain.
    threshold
        Least share of a good cell, above 0, at most 1. It is halved, down to 0.05, in a component
        of the domain in which some vertex has no good cell within two cells.
    essential
        (T, x0) of `essential_constraints` on axis-parallel mesh lines, for the part of the boundary
        that does not cut cells. The extension applies to the parameters that these leave free.

    Attributes
    ----------
    P
        Sparse matrix (dofs, free parameters); each column has a free dof of its own.
    x0
        Vector (dofs,), zero unless `essential` holds data.
    threshold
        The least threshold that was used.
    good
        Good cells.
    outside
        The vertices of active cells that no good cell holds, shape (n,).
    roots
        The good cell whose polynomial gives the dofs of each of these, shape (n,).

    Raises
    ------
    InputError
        Another element, a threshold out of range, slanted essential conditions, or a part of the
        domain too thin for the mesh.

    Warns
    -----
    UnresolvedWarning
        The domain has a gap, a hole or a strip narrower than the cells: both sides of a gap are
        coupled, and the solution is not to be trusted there.

    Notes
    -----
    Vertices that hang in the mesh are joined as by `hanging_constraints`.

    References
    ----------
    S. Badia, F. Verdugo and A. F. Martin, The aggregated unfitted finite element method for
    elliptic problems, Computer Methods in Applied Mechanics and Engineering 336 (2018), 533-553.

    E. Burman, P. Hansbo and M. G. Larson, CutFEM based on extended finite element spaces,
    Numerische Mathematik 152 (2022), 331-369.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace, mass
    >>> from skfem_adini import lowest_eigenpairs, nitsche
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 17)] * 2)
    >>> domain = CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.81)
    >>> element = ElementQuadAdini()
    >>> extension = AdiniExtension(Basis(mesh, element), domain)
    >>> B, _ = nitsche(domain.boundary(element), extension=extension)
    >>> A = domain.assemble(laplace, element) + B
    >>> M = domain.assemble(mass, element)
    >>> values, _ = lowest_eigenpairs(*extension.apply(A, M), 1)
    >>> print(np.round(values * 0.81, 4))  # square of the first zero of J_0
    [5.7832]
    """

    def __init__(
        self,
        basis: Any,
        domain: CutDomain,
        threshold: float = 0.5,
        essential: tuple[Any, Array] | None = None,
    ) -> None:
        elem = scalar_element(basis)
        if not isinstance(elem, ElementQuadAdini):
            raise InputError(f"basis: expected ElementQuadAdini, got {full_name(elem)}")
        if not isinstance(domain, CutDomain):
            raise InputError(f"domain: expected a CutDomain, got {type(domain).__name__}")
        if basis.mesh is not domain.mesh:
            raise InputError("basis, domain: they need the same mesh object")
        threshold = positive_number("threshold", threshold, most=1)
        dofs = vertex_dofs(basis, weighted=True)
        self.domain = domain
        T, x0 = hanging_constraints(basis, essential)
        ends = _ends(hanging_constraints(basis)[0], dofs)
        self.threshold, self.good, self.outside, self.roots = _roots(domain, threshold, ends)
        warn_of_unresolved_features(domain)
        follow = _following(basis, dofs, elem, self.outside, self.roots)
        active = np.unique(dofs[:, :, domain.mesh.t[:, domain.active]])
        self.P, self.x0 = _resolved(sp.csr_array(T), x0, follow, active)

    def apply(self, *matrices: Any) -> tuple[sp.csr_array, ...]:
        r"""Return :math:`P^T A P` for each of the matrices.

        Parameters
        ----------
        *matrices
            Sparse matrices of all dofs, shape (dofs, dofs), real or complex.

        Returns
        -------
        tuple of csr_array
            Shape (free, free) each; symmetric where the given one is.

        Raises
        ------
        InputError
            One is of another size, or holds NaN.
        """
        for A in matrices:
            self._check_matrix(A)
        return tuple(self._symmetric(sp.csr_array(self.P.T @ (A @ self.P))) for A in matrices)

    def load(self, b: Array, A: Any | None = None) -> Array:
        r"""Return :math:`P^T (b - A x_0)`; A is needed when x0 is not zero.

        Parameters
        ----------
        b
            Load vector of all dofs, shape (dofs,).
        A
            Matrix of the problem, shape (dofs, dofs).

        Returns
        -------
        ndarray
            Shape (free,).

        Raises
        ------
        InputError
            b or A is of another size or not finite, or A is missing.
        """
        if A is None and self.x0.any():
            raise InputError("A: needed because the essential conditions hold data")
        b = finite_numbers("b", b, (len(self.x0),), complex_too=True)
        if A is not None:
            self._check_matrix(A)
        return np.asarray(self.P.T @ (b if A is None else b - A @ self.x0))

    def expand(self, z: Array) -> Array:
        """Return the dofs (dofs,) or (dofs, n) for free parameters; x0 is added to solutions only.

        The columns of a matrix, such as eigenvectors, belong to homogeneous conditions, without x0.

        Parameters
        ----------
        z
            Free parameters, shape (free,) or (free, n).

        Returns
        -------
        ndarray
            Shape (dofs,) or (dofs, n).

        Raises
        ------
        InputError
            z has another number of rows, or is not finite.
        """
        columns = np.shape(z)[1:] if isinstance(z, np.ndarray) and z.ndim == 2 else ()
        z = finite_numbers("z", z, (self.P.shape[1], *columns), complex_too=True)
        return np.asarray(self.P @ z + (self.x0 if z.ndim == 1 else 0))

    def solve(self, A: Any, b: Array, definite: bool = True, solver: Solver = "auto") -> Array:
        """Return the dofs that solve A x = b among those of the extension.

        Parameters
        ----------
        A
            Symmetric sparse matrix of all dofs, shape (dofs, dofs).
        b
            Load vector of all dofs, shape (dofs,).
        definite, solver
            As for `factorize`.

        Returns
        -------
        ndarray
            Shape (dofs,).

        Raises
        ------
        InputError
            Wrong sizes, NaN, or a matrix that `factorize` refuses; whether it is singular or
            indefinite is said, with the remedy.
        """
        (reduced,) = self.apply(A)
        load = self.load(b, A)
        try:
            factors = factorize(reduced, definite=definite, solver=solver)
        except InputError as error:
            raise _cause(reduced, error) from error
        return self.expand(factors.solve(load))

    def _check_matrix(self, A: Any) -> None:
        size = len(self.x0)
        if not sp.issparse(A):
            A = sp.csr_array(finite_numbers("A", A, (size, size), complex_too=True))
        if A.shape != (size, size):
            raise InputError(f"A: expected a matrix of shape {(size, size)}, got {A.shape}")
        entries = sp.csr_array(A).data
        finite_numbers("A", entries, entries.shape, complex_too=True)

    @staticmethod
    def _symmetric(A: sp.csr_array) -> sp.csr_array:
        """Return the symmetric part of a product that is symmetric up to rounding, else itself.
        Rounding is taken to be below 1e-10 of the largest entry."""
        return sp.csr_array((A + A.T) / 2) if abs(A - A.T).max() < 1e-10 * abs(A).max() else A


def _cause(A: sp.csr_array, error: InputError) -> InputError:
    """Return the error of a matrix that was not factored, with the cause if its pivots show it."""
    diagonal = A.diagonal()
    if abs(A - A.T).max() > LIMITS.pivot * abs(A).max() or not (diagonal > 0).all():
        return error
    scale = sp.diags_array(1 / np.sqrt(diagonal))
    # Shift the matrix slightly, so that all pivots exist.
    shifted = scale @ A @ scale + LIMITS.pivot / 10 * sp.eye_array(len(diagonal))
    try:
        pivots = SuperLUFactor(shifted, "MMD_AT_PLUS_A", 0.0).factors.U.diagonal()
    except RuntimeError:
        return error
    negative = np.count_nonzero(pivots < -LIMITS.pivot)
    if negative:
        return InputError(
            f"A: the matrix is indefinite, {negative} of its {len(diagonal)} eigenvalues are "
            "negative. If it holds a condition by nitsche, the penalty is too small for this "
            "extension: nitsche(..., extension=extension) takes it from the trace inequality. "
            "definite=False solves with an indefinite matrix"
        )
    return InputError(
        "A: the matrix is singular: some function of the extension has no energy, as constants and "
        "rigid motions have without conditions by nitsche or essential=, or the domain is too "
        "small for the cells to tell its functions apart (UnresolvedWarning)"
    )


def _ends(T: Any, dofs: Indices) -> sp.csr_array:
    """Return a matrix with a non-zero where a hanging vertex (row) depends on a vertex (column)."""
    vertices = dofs.shape[2]
    of_dof = np.empty(dofs.size, dtype=np.int64)
    of_dof[dofs] = np.arange(vertices)
    T = sp.csr_array(T)
    mixed = np.diff(T.indptr) > 1
    rows, columns = T.nonzero()
    # The row of a dof that does not hang has a single entry, in the column of the dof.
    owner = np.full(T.shape[1], -1)
    single = ~mixed[rows]
    owner[columns[single]] = of_dof[rows[single]]
    hangs = mixed[rows] & (owner[columns] >= 0)
    place = of_dof[rows[hangs]], owner[columns[hangs]]
    return sp.csr_array((np.ones(hangs.sum()), place), shape=(vertices, vertices))


def _roots(
    domain: CutDomain, threshold: float, ends: sp.csr_array
) -> tuple[float, Indices, Indices, Indices]:
    """Return the threshold, the good cells, the vertices outside, and the root cell of each."""
    part = components(domain)
    of_cell = part[domain.mesh.t[0, domain.active]]
    found = [
        _roots_of_component(domain, domain.active[of_cell == number], threshold, ends)
        for number in np.unique(of_cell)
    ]
    least, *arrays = zip(*found, strict=True)
    good, outside, roots = (np.concatenate(pieces) for pieces in arrays)
    return min(least), np.sort(good), outside, roots


def _roots_of_component(
    domain: CutDomain, active: Indices, threshold: float, ends: sp.csr_array
) -> tuple[float, Indices, Indices, Indices]:
    mesh = domain.mesh
    corners = mesh.p[:, mesh.t]
    centre = corners.mean(axis=1)
    size = np.ptp(corners, axis=1)
    vertices = np.unique(mesh.t[:, active])
    while True:
        good = active[domain.fractions[active] >= threshold * (1 - LIMITS.rounding)]
        outside = np.setdiff1d(vertices, mesh.t[:, good])
        roots, reach = np.zeros(0, dtype=np.int64), np.full(min(1, outside.size), np.inf)
        # A cell whose hanging vertex depends on an outer one would be extrapolated from itself.
        follows = np.zeros(mesh.nvertices)
        follows[outside] = 1
        sound = good[((ends @ follows) == 0)[mesh.t[:, good]].all(axis=0)]
        if sound.size and outside.size:
            count = min(12, sound.size)  # number of nearest cells that are tried for each vertex
            _, near = scipy.spatial.KDTree(centre[:, sound].T).query(mesh.p[:, outside].T, k=count)
            cells = sound[np.asarray(near).reshape(len(outside), count)]
            steps = np.abs(mesh.p[:, outside, None] - centre[:, cells]) / size[:, cells]
            # Sort by the cells of extrapolation; a small share of the distance breaks ties.
            rank = steps.max(axis=0) + 1e-3 * np.hypot(*steps)
            best = np.arange(len(outside)), rank.argmin(axis=1)
            roots, reach = cells[best], steps.max(axis=0)[best] - 0.5
        if (reach <= LIMITS.farthest).all():
            return threshold, good, outside, roots
        if threshold <= LIMITS.share:
            x, y = mesh.p[:, outside[reach.argmax()]]
            raise InputError(
                f"domain: no cell lies inside by a share of {threshold:.2g} within "
                f"{LIMITS.farthest:.0f} cells of ({x:.6g}, {y:.6g}); the domain is too thin for "
                "this mesh, refine it there"
            )
        threshold = max(threshold / 2, LIMITS.share)


def _following(
    basis: Any, dofs: Indices, elem: ElementQuadAdini, outside: Indices, roots: Indices
) -> sp.csr_array:
    """Return the matrix that computes the dofs of outer vertices by their roots' polynomials."""
    mesh, mapping = basis.mesh, basis.mapping
    rows: list[Any] = []
    columns: list[Any] = []
    entries: list[Any] = []
    if outside.size:
        X = reference_points(mesh, roots, mesh.p[:, outside][:, :, None])
        linear = ElementQuadAdini(derivatives=1)
        names, per_vertex = len(dofs), elem.nodal_dofs
        for i in range(4 * per_vertex):
            field = linear.gbasis(mapping, X, i, tind=roots)[0]
            values = np.concatenate([np.asarray(field)[None], field.grad])[..., 0]
            source = dofs[i % per_vertex][:, mesh.t[i // per_vertex, roots]]
            for name in range(names):
                rows.append(dofs[name][:, outside].ravel())
                columns.append(source.ravel())
                entries.append(np.broadcast_to(values[name], source.shape).ravel())
    none = np.zeros(0, dtype=np.int64)
    place = (np.concatenate([none, *rows]), np.concatenate([none, *columns]))
    data = np.concatenate([np.zeros(0), *entries])
    matrix = sp.csr_array((data, place), shape=(dofs.size, dofs.size))
    matrix.eliminate_zeros()
    return matrix


def _resolved(
    T: sp.csr_array, x0: Array, follow: sp.csr_array, active: Indices
) -> tuple[sp.csc_array, Array]:
    """Combine x = T z + x0 with the extension; `follow` contains its rows at outer dofs. A column
    of T belongs to the dof whose row in T is its unit vector. If that dof is outside, its row of
    `follow` replaces the parameter, until only free parameters are left."""
    count = T.shape[1]
    single = np.flatnonzero(np.diff(T.indptr) == 1)
    unit = single[np.abs(T.data[T.indptr[single]] - 1) < LIMITS.rounding]
    owner = np.full(count, -1)
    owner[T.indices[T.indptr[unit]][::-1]] = unit[::-1]
    if (owner < 0).any():
        raise InputError(
            "essential: it has conditions on slanted edges; the mesh is axis-parallel, so impose "
            "conditions on its lines and use nitsche on the curve"
        )
    is_outside = np.diff(follow.indptr)[owner] > 0
    is_active = np.isin(owner, active)
    # A hanging vertex needs the ends of its edge even where these have no active cell.
    needed = np.zeros(count, dtype=bool)
    needed[np.unique(T[active].indices)] = True
    kept = np.flatnonzero((is_active | needed) & ~is_outside)
    step = sp.diags_array((~is_outside).astype(float)) + (
        sp.diags_array(is_outside.astype(float)) @ (follow[owner] @ T)
    )
    shift = np.where(is_outside, follow[owner] @ x0, 0.0)
    step = sp.csr_array(step)
    for _ in range(60):  # each squaring doubles the length of the chains that are resolved
        if not step[:, np.flatnonzero(is_outside)].count_nonzero():
            break
        step, shift = sp.csr_array(step @ step), step @ shift + shift
        step.data[np.abs(step.data) < 1e-300] = 0
        step.eliminate_zeros()
    else:
        raise InputError("domain: the vertices outside depend on each other; refine the mesh there")
    P = sp.csc_array(T @ step[:, kept])
    P.eliminate_zeros()
    return P, T @ shift + x0
