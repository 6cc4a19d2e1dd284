"""Nitsche's method for Dirichlet conditions on boundaries that cut cells."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from skfem import Basis, BilinearForm, CellBasis, FacetBasis, LinearForm
from skfem.assembly.form.form import FormExtraParams
from skfem.element import DiscreteField, ElementVector
from skfem.helpers import div, dot, grad, mul, sym_grad

from skfem_adini.conditions.boundary_edges import Value, sample
from skfem_adini.curved.adini_extension import AdiniExtension
from skfem_adini.curved.boundary_basis import BoundaryBasis
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.vertex_dofs import scalar_element
from skfem_adini.errors import InputError, UnresolvedWarning
from skfem_adini.ground.arguments import pointwise, positive_number

Array = NDArray[np.float64]
Coefficient = float | Callable[[Array], Any]


def nitsche(
    boundary: Any,
    value: Value = 0.0,
    beta: float = 50.0,
    coefficient: Coefficient = 1.0,
    lame: tuple[Coefficient, Coefficient] | None = None,
    extension: AdiniExtension | None = None,
) -> tuple[Any, Array]:
    r"""Return matrix and load that impose u = g weakly and symmetrically.

    For :math:`-\nabla \cdot k \nabla u`, to be added to stiffness matrix and load,

    .. math::
        B(u, v) = \int_\Gamma \gamma k u v - k \, \partial_n u \, v - u \, k \,
        \partial_n v, \quad
        b(v) = \int_\Gamma g (\gamma k v - k \, \partial_n v);

    for elasticity, with :math:`t(u) = \sigma(u) n`,

    .. math::
        B(u, v) = \int_\Gamma \gamma \big(2 \mu \, u \cdot v + \lambda (u \cdot n)
        (v \cdot n)\big) - t(u) \cdot v - u \cdot t(v)

    and the load likewise. Only the penalty of the normal part contains lambda, so the tangential
    displacement of nearly incompressible bodies is not penalised with the bulk modulus.

    The penalty is :math:`\gamma = \max(\beta / h, 2 \lambda_K)` with the constants of the trace
    inequality, :math:`\sum_K \lambda_K^{-1} \int_{\Gamma_K} k |\partial_n u|^2 \le a(u, u)`, from
    an eigenproblem in each cell K of the boundary. So the sum with the stiffness matrix is positive
    definite on the functions of the extension, for every cut, cell and material.

    Parameters
    ----------
    boundary
        From `CutDomain.boundary`, or a scikit-fem `FacetBasis`.
    value
        The data g: a number, a callable of points (2, cells, points) that returns (cells, points)
        or (2, cells, points), or a sequence with one of these for each component.
    beta
        Least penalty, without unit: pieces of the boundary that are far smaller than a cell have
        hardly any flux, and the condition would be lost there. It decides alone where
        :math:`\lambda_K` is not known: for elements other than Adini's in cut cells.
    coefficient
        The conductivity k, a positive number or function of points, also of those inside, where it
        is that of the stiffness matrix. Scalar fields only.
    lame
        Lame's constants (lambda, mu) for elasticity, numbers or functions of points.
        Functions act on each point alone: points of weight zero lie among the others.
    extension
        The one that the matrix will be reduced by. By default that with the threshold 0.5 and
        without essential conditions, which is computed here. On a `FacetBasis` the default is none.

    Returns
    -------
    matrix, load
        Sparse (dofs, dofs) and (dofs,).

    Notes
    -----
    Measured on the disk of radius 0.411, relative errors at n = 32 (``benchmarks/curved.py
    --parts materials``, table `materials` of ``results/curved.json``).

    *Nearly incompressible*, plane strain, the pressure neither zero nor growing:

    ======== ======= ======= =======================
    nu       L2      H1      eigenvalue of torsion
    ======== ======= ======= =======================
    .3       2.1e-7  1.4e-5  6.3e-8
    .49      2.9e-7  1.6e-5  5.6e-7
    .499     1.1e-6  4.6e-5  4.5e-6
    .4999    5.8e-6  1.6e-4  2.7e-5
    .49999   3.0e-5  4.1e-4  1.7e-4
    ======== ======= ======= =======================

    The orders 4 and 3 are kept. Up to nu = .49 hardly any accuracy is lost in L2 and H1, at .499 a
    factor of 5 in L2. Beyond that the element locks, not the boundary conditions: on a fitted
    square with strong conditions the errors grow likewise (by a factor of 16 in L2 at .4999, on the
    cut disk by 28), and a ghost penalty of weight 2 mu + lambda gives the same errors as the
    extension to within a quarter.

    The constants are those of the whole boundary of the domain, of which `boundary` may hold a
    part: calls for different parts add up to the one call for both.

    A ghost penalty may take the place of the extension. The proof does not cover it.

    *Conductivities* that vary smoothly, by factors of 1e3 and 1e6 over the disk, do not change
    orders and errors. A *jump* does: the gradient of the solution jumps with it, but that of
    Adini's functions is single-valued at the vertices, so the orders are 1 in L2 and 1/2 in H1,
    whether the jump lies on a grid line or inside cells. Smooth the transition over a few cells, or
    treat the two sides as separate domains.

    Raises
    ------
    InputError
        A penalty that is not positive; a function that reduces over the points; constants that are
        missing, not finite, or negative; data of the wrong shape; the extension of another domain
        or element.

    References
    ----------
    J. Nitsche, Ueber ein Variationsprinzip zur Loesung von Dirichlet-Problemen bei Verwendung von
    Teilraeumen, die keinen Randbedingungen unterworfen sind, Abhandlungen aus dem Mathematischen
    Seminar der Universitaet Hamburg 36 (1971), 9-15.

    P. Hansbo and M. G. Larson, Discontinuous Galerkin methods for incompressible and nearly
    incompressible elasticity by Nitsche's method, Computer Methods in Applied Mechanics and
    Engineering 191 (2002), 1895-1908.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from skfem_adini import CutDomain, ElementQuadAdini
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> domain = CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.81)
    >>> element = ElementQuadAdini()
    >>> extension = AdiniExtension(Basis(mesh, element), domain)
    >>> B, b = nitsche(domain.boundary(element), lambda x: x[0], extension=extension)
    >>> B.shape, b.shape
    ((243, 243), (243,))
    """
    if not isinstance(boundary, BoundaryBasis | FacetBasis):
        raise InputError(
            f"boundary: expected what CutDomain.boundary(element) gives, or a FacetBasis, got "
            f"{type(boundary).__name__}"
        )
    beta = positive_number("beta", beta)
    vector = isinstance(boundary.elem, ElementVector)
    if vector != (lame is not None):
        raise InputError(
            "lame: give Lame's constants (lambda, mu) for vector fields, and only for them; got "
            f"{lame!r} for {type(boundary.elem).__name__}"
        )
    if isinstance(boundary, BoundaryBasis):
        value, coefficient, lame = (
            _pointwise(*named)
            for named in (("value", value), ("coefficient", coefficient), ("lame", lame))
        )
    if lame is not None and (not isinstance(lame, tuple | list) or len(lame) != 2):
        raise InputError(f"lame: expected (lambda, mu), got {lame!r}")
    x = np.asarray(boundary.global_coordinates())
    data = sample(value, x, len(x) if vector else 1)
    material = partial(_material, coefficient, lame)
    fields = {"g": DiscreteField(data if vector else data[0]), **material(boundary)}
    parts = (_traction_parts, _strain_parts) if vector else (_flux_parts, _gradient_parts)
    h = np.asarray(boundary.default_parameters()["h"])
    # Definite above the trace constant; above twice that, .29 of energy and penalty remain.
    penalty = np.maximum(beta / h, 2.0 * _constants(boundary, extension, material, *parts))
    fields["penalty"] = DiscreteField(penalty * np.ones(x.shape[1:]))
    pair = _elastic() if vector else _scalar()
    matrix, load = (form.assemble(boundary, **fields) for form in pair)
    return matrix, load


def _constants(
    boundary: Any, extension: AdiniExtension | None, material: Any, flux: Any, energy: Any
) -> Array:
    """Return the constants of the trace inequality, shape (cells, 1), 0 where they are unknown."""
    domain = getattr(boundary, "domain", None)
    if extension is not None:
        _check_extension(boundary, extension)
        domain = extension.domain
    elif isinstance(boundary, BoundaryBasis):
        extension = None if domain is None else _extension_of(domain, boundary.elem)
        if extension is None:
            return np.zeros((boundary.tind.size, 1))

    def groups(cells: Any) -> Any:
        if domain is not None:
            return domain.groups(boundary.elem, cells=cells)
        return [CellBasis(boundary.mesh, boundary.elem, boundary.mapping, elements=cells)]

    cells, found = trace_constants(_whole(boundary), groups, material, flux, energy, extension)
    return np.asarray(found[np.searchsorted(cells, boundary.tind), None])


def _check_extension(boundary: Any, extension: Any) -> None:
    if not isinstance(extension, AdiniExtension):
        raise InputError(f"extension: expected an AdiniExtension, got {type(extension).__name__}")
    other = getattr(boundary, "domain", None) not in (None, extension.domain)
    if other or extension.domain.mesh is not boundary.mesh:
        raise InputError("extension: it belongs to another domain than the boundary")
    if len(extension.x0) != boundary.N:
        raise InputError(
            f"extension: made for a basis of {len(extension.x0)} dofs, the boundary has "
            f"{boundary.N}; give both the same element"
        )


def _extension_of(domain: Any, elem: Any) -> AdiniExtension | None:
    """Return the extension with the default threshold, or None if it does not exist."""
    basis = Basis(domain.mesh, elem, intorder=1)
    if not isinstance(scalar_element(basis), ElementQuadAdini):
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnresolvedWarning)
        try:
            return AdiniExtension(basis, domain)
        except InputError:
            return None


def _whole(boundary: Any) -> Any:
    """Return the basis on the whole boundary in the cells; the given one may be a part."""
    if isinstance(boundary, BoundaryBasis):
        domain = boundary.domain
        points = np.count_nonzero(boundary.quadrature[1])
        if domain is None or points == domain.quadrature.boundary_weights.size:
            return boundary
        return domain.boundary(boundary.elem)
    outer = boundary.mesh.boundary_facets()
    outer = outer[np.isin(boundary.mesh.f2t[0, outer], boundary.tind)]
    if type(boundary) is not FacetBasis or np.isin(outer, boundary.find).all():
        return boundary
    return FacetBasis(
        boundary.mesh,
        boundary.elem,
        boundary.mapping,
        quadrature=boundary.quadrature,
        facets=np.union1d(outer, boundary.find),
    )


def _pointwise(name: str, data: Any) -> Any:
    """Return the data; functions are wrapped so that they raise an error if they mix points."""
    if isinstance(data, list | tuple):
        return type(data)(_pointwise(name, part) for part in data)
    return pointwise(name, data) if callable(data) else data


def _material(coefficient: Coefficient, lame: Any, basis: Any) -> dict[str, DiscreteField]:
    """Return the constants at the points of a basis."""
    x = np.asarray(basis.global_coordinates())
    if lame is None:
        return {"k": _field("coefficient", coefficient, x)}
    bulk, mu = lame
    return {
        "bulk": _field("lame: lambda", bulk, x, zero=True),
        "mu": _field("lame: mu", mu, x),
    }


def _flux_parts(u: Any, w: Any) -> list[Any]:
    return [np.sqrt(w.k) * dot(grad(u), w.n)]


def _gradient_parts(u: Any, w: Any) -> list[Any]:
    return [np.sqrt(w.k) * slope for slope in grad(u)]


def _traction(u: Any, w: Any) -> Any:
    return w.bulk * div(u) * w.n + 2 * w.mu * mul(sym_grad(u), w.n)


def _traction_parts(u: Any, w: Any) -> list[Any]:
    """Return the parts of the traction, in the inverse of the penalty's metric."""
    t = _traction(u, w)
    along = dot(t, w.n)
    return [along / np.sqrt(2 * w.mu + w.bulk), *((t - along * w.n) / np.sqrt(2 * w.mu))]


def _strain_parts(u: Any, w: Any) -> list[Any]:
    strain = sym_grad(u)
    shear = np.sqrt(2 * w.mu)
    return [np.sqrt(w.bulk) * div(u), *(shear * part for row in strain for part in row)]


def _scalar() -> tuple[BilinearForm, LinearForm]:
    def flux(u: Any, w: Any) -> Any:
        return w.k * dot(grad(u), w.n)

    def matrix(u: Any, v: Any, w: Any) -> Any:
        return w.penalty * w.k * u * v - flux(u, w) * v - flux(v, w) * u

    def load(v: Any, w: Any) -> Any:
        return w.g * (w.penalty * w.k * v - flux(v, w))

    return BilinearForm(matrix), LinearForm(load)


def _elastic() -> tuple[BilinearForm, LinearForm]:
    def penalty(u: Any, v: Any, w: Any) -> Any:
        return w.penalty * (2 * w.mu * dot(u, v) + w.bulk * dot(u, w.n) * dot(v, w.n))

    def matrix(u: Any, v: Any, w: Any) -> Any:
        return penalty(u, v, w) - dot(_traction(u, w), v) - dot(_traction(v, w), u)

    def load(v: Any, w: Any) -> Any:
        return penalty(w.g, v, w) - dot(_traction(v, w), w.g)

    return BilinearForm(matrix), LinearForm(load)


def _field(name: str, coefficient: Coefficient, x: Array, zero: bool = False) -> DiscreteField:
    try:
        data = sample(coefficient, x, 1)[0]
    except InputError as error:
        raise InputError(str(error).replace("value:", f"{name}:")) from error
    if data.min() < 0 or (data.min() == 0 and not zero):
        raise InputError(f"{name}: expected positive values, got {data.min():.3g}")
    return DiscreteField(data)


Indices = NDArray[np.integer]
# Components of a density, the sum of their squares, at points of a basis, (cells, points) each.
Parts = Callable[[Any, Any], list[Array]]


def trace_constants(
    boundary: Any,
    groups: Callable[[Indices], Iterator[Any]],
    fields: Callable[[Any], dict[str, Any]],
    flux: Parts,
    energy: Parts,
    extension: AdiniExtension | None,
) -> tuple[Indices, Array]:
    r"""Return cells K and :math:`\lambda_K` of a trace inequality of fluxes t and energy a(u, u).

    :math:`\lambda_K` is the largest eigenvalue of :math:`\int_{\Gamma_K} |t|^2` against
    :math:`\sum_T a_T / m_T` over the cells T of the patch of K, where T is in :math:`m_T`
    patches: so :math:`\sum_K \int_{\Gamma_K} |t|^2 / \lambda_K \le a(u, u)` for any cut, grading
    and material. A good cell is its own patch; to another one belong the good cells at its
    vertices and the roots of those outside. Without an extension every cell is good."""
    dofs = boundary.dofs.element_dofs
    owners = np.unique(boundary.tind)
    patches: tuple[Indices, Indices] = (np.arange(owners.size), owners)
    if extension is None:
        P = sp.eye_array(boundary.N, format="csr")
    else:
        P = sp.csr_array(extension.P)
        patches = _patches(owners, extension, P, dofs)
    count = np.bincount(patches[1])
    cells = np.flatnonzero(count)
    energies = np.empty((cells.size, len(dofs), len(dofs)))
    for basis in groups(cells):
        F = _factors(basis, fields(basis), energy)
        energies[np.searchsorted(cells, basis.tind)] = F @ F.swapaxes(1, 2)
    energies /= count[cells, None, None]
    F = _factors(boundary, fields(boundary), flux)
    stacked = _joined(F, np.searchsorted(owners, boundary.tind))
    fluxes = np.asarray(np.linalg.qr(stacked, mode="r"))

    Q, first = _parameters(patches, P, dofs)
    A = Q.T @ (_blocks(energies[np.searchsorted(cells, patches[1])]) @ Q)
    own = np.flatnonzero(patches[1] == owners[patches[0]])
    B = _blocks(fluxes) @ Q[(own[:, None] * len(dofs) + np.arange(len(dofs))).ravel()]
    return owners, _largest_eigenvalues(sp.coo_array(A), sp.coo_array(B), first)


def _factors(basis: Any, fields: dict[str, Any], parts: Parts) -> Array:
    """Return F (cells, functions, numbers), with F F^T the integrals of products of the parts."""
    parameters: Any = {**basis.default_parameters(), **fields}
    w: Any = FormExtraParams(parameters)
    root = np.sqrt(basis.dx)
    rows = [np.hstack([root * part for part in parts(function[0], w)]) for function in basis.basis]
    return np.stack(rows, axis=1)


def _joined(F: Array, owner: Indices) -> Array:
    """Return, for each owner, the rows of all its pieces, (owners, numbers, functions)."""
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], owner[order])
    slot = np.arange(owner.size) - start
    found = np.zeros((owner.max() + 1, slot.max() + 1, F.shape[2], F.shape[1]))
    found[owner[order], slot] = F[order].swapaxes(1, 2)
    return found.reshape(len(found), -1, F.shape[1])


def _patches(
    owners: Indices, extension: AdiniExtension, P: Any, dofs: Indices
) -> tuple[Indices, Indices]:
    """Return pairs (index in `owners`, cell of its patch), ascending."""
    mesh, good = extension.domain.mesh, extension.good
    vertices, cells = mesh.nvertices, mesh.t.shape[1]
    holders = _ones(
        np.append(mesh.t[:, good].ravel(), extension.outside),
        np.append(np.tile(good, 4), extension.roots),
        (vertices, cells),
    )
    places, bad = np.arange(owners.size), np.flatnonzero(~np.isin(owners, good))
    corners = _ones(np.tile(bad, 4), mesh.t[:, owners[bad]].ravel(), (owners.size, vertices))
    members = corners @ holders + _ones(places, owners, (owners.size, cells))
    rows = np.tile(np.arange(cells), len(dofs))
    depends = sp.csr_array(_ones(rows, dofs.ravel(), (cells, P.shape[0])) @ abs(P))
    for _ in range(4):  # at most four layers of good cells are added to disconnected patches
        apart = _apart(members, depends, good)
        if not apart.size:
            break
        near = _ones(apart, apart, (owners.size, owners.size)) @ (members @ depends)
        members = members + near @ (_ones(good, good, (cells, cells)) @ depends).T
    pairs = sp.csr_array(members).nonzero()
    order = np.lexsort(pairs[::-1])
    return pairs[0][order], pairs[1][order]


def _apart(members: Any, depends: sp.csr_array, good: Indices) -> Indices:
    """Return the patches whose parameters are not connected by good cells.
    A common parameter connects two of these, rigid motions included."""
    place, cell = sp.csr_array(members).nonzero()
    rows = sp.coo_array(depends[cell])
    pair, column = rows.coords
    owner = place[pair]
    keys, node = np.unique(owner * depends.shape[1] + column, return_inverse=True)
    holds = np.isin(cell, good)[pair]
    size = cell.size + keys.size
    graph = _ones(pair[holds], cell.size + node[holds], (size, size))
    label = connected_components(graph, directed=False)[1][cell.size :]
    of_key = keys // depends.shape[1]
    mixed = (np.diff(of_key) == 0) & (np.diff(label) != 0)
    return np.unique(of_key[1:][mixed])


def _ones(rows: Indices, columns: Indices, shape: tuple[int, int]) -> sp.csr_array:
    return sp.csr_array((np.ones(rows.size), (rows, columns)), shape=shape)


def _blocks(local: Array) -> sp.bsr_array:
    """Return a block diagonal matrix."""
    place = np.arange(len(local) + 1)
    shape = len(local) * local.shape[1], len(local) * local.shape[2]
    return sp.bsr_array((local, place[:-1], place), shape=shape)


def _parameters(
    patches: tuple[Indices, Indices], P: sp.csr_array, dofs: Indices
) -> tuple[sp.csr_array, Indices]:
    """Return the dofs of all pairs by the parameters of each patch, and the start of each patch."""
    place, cell = patches
    rows = sp.coo_array(P[dofs[:, cell].T.ravel()])
    row, column = rows.coords
    keys, node = np.unique(
        place[row // len(dofs)] * np.int64(P.shape[1]) + column, return_inverse=True
    )
    Q = sp.csr_array((rows.data, (row, node)), shape=(rows.shape[0], keys.size))
    first = np.searchsorted(keys, np.arange(place[-1] + 2) * np.int64(P.shape[1]))
    return Q, first


def _largest_eigenvalues(A: sp.coo_array, B: sp.coo_array, first: Indices) -> Array:
    """Return the largest eigenvalue of B^T B against A for each block of their columns."""
    found = np.zeros(first.size - 1)
    if not A.shape[0]:
        return found
    height = B.shape[0] // found.size
    diagonal = A.diagonal()
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    block = np.repeat(np.arange(found.size), np.diff(first))
    sizes = np.diff(first)
    for size in np.unique(sizes[sizes > 0]).tolist():
        same = np.flatnonzero(sizes == size)
        for start in range(0, same.size, 1000):  # eigenproblems at a time, about 20 kB each
            chosen = same[start : start + 1000]
            slot = np.full(found.size, -1)
            slot[chosen] = np.arange(chosen.size)
            a, b = np.zeros((chosen.size, size, size)), np.zeros((chosen.size, height, size))
            for matrix, dense, rows in ((A, a, None), (B, b, height)):
                row, column = matrix.coords
                at = slot[block[column]]
                kept = at >= 0
                values = matrix.data[kept] * scale[column[kept]]
                begin = first[block[column[kept]]]
                if rows is None:
                    values, local = values * scale[row[kept]], row[kept] - begin
                else:
                    local = row[kept] % rows
                dense[at[kept], local, column[kept] - begin] = values
            a[:, range(size), range(size)] += 1e-12  # above rounding, below the least eigenvalue
            gram = b @ np.linalg.solve(a, b.swapaxes(1, 2))
            found[chosen] = np.linalg.eigvalsh((gram + gram.swapaxes(1, 2)) / 2)[:, -1]
    return found
