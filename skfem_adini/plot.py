"""Pictures of elements and matrices; every function takes ``ax=None`` and returns the axes."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree
from skfem import CellBasis
from skfem.refdom import RefQuad

from skfem_adini.curved.adini_extension import AdiniExtension
from skfem_adini.curved.cut_domain import CutDomain
from skfem_adini.elements.straight_cells import reference_points
from skfem_adini.elements.vertex_dofs import scalar_element
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import finite_numbers
from skfem_adini.ground.errors import optional

_LABELS = {"u": "$u$", **{f"u_{k}": f"$u_{{{k}}}$" for k in ("x", "y", "z", "xy")}}


def plot_shape_function(element: Any, i: int, ax: Any = None) -> Any:
    """Draw shape function i of an element on the reference square as a surface.

    Parameters
    ----------
    element
        Element of quadrilaterals with ``lbasis``, for instance `ElementQuadAdini`.
    i
        Number of the function: all dofs of the first vertex, then of the second.
    ax
        matplotlib axes with ``projection="3d"``; new ones by default.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    InputError
        An element of other cells, or axes that are flat.
    ValueError
        There is no function of this number.
    MissingDependency
        matplotlib is not installed.

    Examples
    --------
    >>> from skfem_adini import ElementQuadAdini
    >>> ax = plot_shape_function(ElementQuadAdini(), 1)
    >>> ax.name
    '3d'
    """
    if getattr(element, "refdom", None) is not RefQuad or not hasattr(element, "lbasis"):
        raise InputError(
            f"element: expected an element of quadrilaterals with lbasis, got "
            f"{type(element).__name__}"
        )
    count = 25  # points in each direction, enough for a smooth cubic
    ticks = np.linspace(0, 1, count)
    X, Y = np.meshgrid(ticks, ticks, indexing="ij")
    values = element.lbasis(np.array([X.ravel(), Y.ravel()]), i)[0].reshape(X.shape)
    ax = _axes(ax, subplot_kw={"projection": "3d"})
    if not hasattr(ax, "plot_surface"):
        raise InputError('ax: expected 3-D axes; make them with projection="3d"')
    ax.computed_zorder = False  # otherwise the surface may hide the vertex
    ax.plot_surface(X, Y, values, cmap="viridis", rcount=count, ccount=count, lw=0)
    x, y = element.doflocs[i]
    height = float(element.lbasis(np.array([[x], [y]]), i)[0][0])
    ax.plot([x], [y], [height], "o", color="#d1495b", zorder=10)
    name = element.dofnames[i % len(element.dofnames)]
    ax.set_title(f"{_LABELS.get(name, name)} at ({x:g}, {y:g})", fontsize=10)
    ax.set(xticks=[0, 1], yticks=[0, 1])
    ax.tick_params(labelsize=7, pad=-2)
    return ax


def plot_matrix(A: Any, basis: Any, ax: Any = None) -> Any:
    r"""Draw the size of the entries of a matrix, with rows and columns grouped by kind of dof.

    The vertices of each group go along the last axis first, so that a uniform grid shows its
    bands. Entries are those of the scaled matrix :math:`a_{ij} / \sqrt{a_{ii} a_{jj}}`, in powers
    of ten; white ones vanish.

    Parameters
    ----------
    A
        Square sparse matrix of all dofs with a positive diagonal, shape (basis.N, basis.N).
    basis
        Basis of an element that has all its dofs at the vertices.
    ax
        matplotlib axes; new ones by default.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    InputError
        More than 2000 dofs (the structure of a coarser mesh is the same), dofs elsewhere than at
        the vertices, a wrong shape, or a diagonal that is not positive.
    MissingDependency
        matplotlib is not installed.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad().refined(2), ElementQuadAdini())
    >>> ax = plot_matrix(laplace.assemble(basis), basis)
    >>> len(ax.images)
    1
    """
    names, dofs = _grouped_dofs(basis)
    if not sparse.issparse(A):
        raise InputError(f"A: expected a sparse matrix, got {type(A).__name__}")
    A = cast(Any, A)
    if A.shape != (basis.N, basis.N):
        raise InputError(f"A: expected shape ({basis.N}, {basis.N}), got {A.shape}")
    if basis.N > 2000:  # a picture has no more pixels
        raise InputError(
            f"A: {basis.N} rows are too many to see; draw a coarser mesh with at most 2000"
        )
    finite_numbers("A", A.data, A.data.shape)
    dense = A.toarray()[np.ix_(dofs.ravel(), dofs.ravel())]
    diagonal = dense.diagonal()
    if not (diagonal > 0).all():
        raise InputError("A: an entry of the diagonal is not positive")
    size = np.abs(dense) / np.sqrt(np.outer(diagonal, diagonal))
    size[size < 1e-13] = np.nan  # rounding of entries that vanish

    ax = _axes(ax)
    image = ax.imshow(np.log10(size), cmap="viridis", vmin=-3, vmax=0, interpolation="nearest")
    ax.figure.colorbar(image, ax=ax, shrink=0.8, label=r"$\log_{10} |a_{ij}|$, scaled")
    edges = dofs.shape[1] * np.arange(1, len(names)) - 0.5
    for edge in edges:
        ax.axhline(edge, color="0.3", lw=0.8)
        ax.axvline(edge, color="0.3", lw=0.8)
    middles = dofs.shape[1] * (np.arange(len(names)) + 0.5) - 0.5
    labels = [_LABELS.get(name, name) for name in names]
    ax.set_xticks(middles, labels)
    ax.set_yticks(middles, labels)
    ax.tick_params(length=0)
    return ax


def _grouped_dofs(basis: Any) -> tuple[list[str], Any]:
    """Return the names of the dofs of a vertex, and the dofs as (names, vertices in order)."""
    element = scalar_element(basis)
    names, nodal = list(basis.elem.dofnames), basis.nodal_dofs
    if nodal.size != basis.N:
        raise InputError(
            f"basis: {type(element).__name__} has dofs elsewhere than at the vertices; expected "
            "an element such as ElementQuadAdini"
        )
    order = np.lexsort(basis.mesh.p[::-1, : nodal.shape[1]])
    return names, nodal[:, order]


def _axes(ax: Any, **figure: Any) -> Any:
    """The given axes, or those of a new figure."""
    if ax is not None:
        return ax
    remedy = "plots need matplotlib: pip install 'matplotlib>=3.10.7'"
    pyplot = optional("matplotlib.pyplot", remedy)
    return pyplot.subplots(**figure)[1]


def plot_cut_domain(
    domain: CutDomain, extension: AdiniExtension | None = None, points: bool = True, ax: Any = None
) -> Any:
    """Draw the cells of a cut domain: full, cut and, with an extension, those that follow others.

    Parameters
    ----------
    domain
        The cut domain.
    extension
        Colours cut cells that are not good, and draws arrows from the good cells to the vertices
        that follow them.
    points
        Draw quadrature points inside cut cells and on the boundary.
    ax
        matplotlib axes; new ones by default.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    InputError
        No cut domain.
    MissingDependency
        matplotlib is not installed.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from skfem_adini import CutDomain
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> ax = plot_cut_domain(CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.81))
    >>> ax.get_aspect()
    1.0
    """
    if not isinstance(domain, CutDomain):
        raise InputError(f"domain: expected a CutDomain, got {type(domain).__name__}")
    ax = _axes(ax, figsize=(6, 6))
    from matplotlib.collections import LineCollection, PolyCollection

    mesh, rule = domain.mesh, domain.quadrature
    kinds = {"full": domain.full, "cut": domain.cut}
    if extension is not None:
        bad = np.setdiff1d(domain.cut, extension.good)
        kinds = {"full": domain.full, "cut": np.setdiff1d(domain.cut, bad), "aggregated": bad}
    for (name, cells), colour in zip(
        kinds.items(), ("#dbe7f3", "#a9c8e6", "#f3c9a5"), strict=False
    ):
        squares = mesh.p[:, mesh.t[:, cells]].transpose(2, 1, 0)
        ax.add_collection(PolyCollection(squares, facecolor=colour, edgecolor="0.6", label=name))
    sides = mesh.p[:, mesh.facets[:, domain.ghost_facets]].transpose(2, 1, 0)
    ax.add_collection(LineCollection(sides, color="C3", lw=1.2, label="ghost facets"))
    if points:
        ax.plot(*rule.points, ".", color="C0", ms=1, label="points inside")
        ax.plot(*rule.boundary_points, ".", color="k", ms=2, label="points on the boundary")
    if extension is not None and extension.outside.size:
        tail = mesh.p[:, mesh.t[:, extension.roots]].mean(axis=1)
        step = mesh.p[:, extension.outside] - tail
        ax.quiver(
            *tail, *step, angles="xy", scale_units="xy", scale=1, width=2e-3, color="C1",
            label="extension",
        )  # fmt: skip
    ax.autoscale()
    ax.set_aspect("equal")
    ax.set(xlabel="x", ylabel="y")
    ax.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3)
    return ax


def plot_cut_field(
    domain: CutDomain, element: Any, x: Any, exact: Any = None, ax: Any = None
) -> Any:
    """Draw a scalar field, or its error, on cells and their parts inside.

    Parameters
    ----------
    domain
        The cut domain.
    element
        Scalar element of the field.
    x
        Dofs, shape (dofs,).
    exact
        Function of points (2, cells, points); the logarithm of the error's size is drawn then.
    ax
        matplotlib axes; new ones by default.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    InputError
        No cut domain, or dofs of wrong shape, complex or not finite.
    MissingDependency
        matplotlib is not installed.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import CutDomain, ElementQuadAdini
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> domain = CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.81)
    >>> x = Basis(mesh, ElementQuadAdini()).project(lambda x: x[0] * x[1])
    >>> ax = plot_cut_field(domain, ElementQuadAdini(), x)
    >>> ax.get_aspect()
    1.0
    """
    if not isinstance(domain, CutDomain):
        raise InputError(f"domain: expected a CutDomain, got {type(domain).__name__}")
    x = finite_numbers("x", x, (domain.basis(element)[0].N,))
    ax = _axes(ax, figsize=(6, 5))
    found = []
    for basis, triangles in _drawn_cells(domain, element):
        where, field = np.asarray(basis.global_coordinates()), np.asarray(basis.interpolate(x))
        if exact is not None:
            field = np.log10(np.maximum(np.abs(field - exact(where)), 1e-17))
        used, corner = np.unique(triangles, return_inverse=True)
        x_y, field = where.reshape(2, -1)[:, used], field.ravel()[used]
        found.append((*x_y, corner.reshape(-1, 3), field))
    low, high = (pick([pick(field) for *_, field in found]) for pick in (np.min, np.max))
    style = {"cmap": "viridis", "vmin": low, "vmax": high, "shading": "gouraud"}
    drawn = [ax.tripcolor(*one, **style) for one in found]
    label = "$u$" if exact is None else r"$\log_{10} |u_h - u|$"
    ax.figure.colorbar(drawn[0], ax=ax, shrink=0.8, label=label)
    ax.set(aspect="equal", xlabel="x", ylabel="y")
    return ax


def _drawn_cells(domain: CutDomain, element: Any) -> list[tuple[CellBasis, NDArray[np.int64]]]:
    """Bases on lattices of the full and of the cut cells, and triangles (n, 3) of their points.
    In cut cells points outside are moved onto the tangent of the curve at its closest point."""
    n = 6  # points of a cell in each direction, between which the field is drawn linearly
    lattice = np.indices((n, n)).reshape(2, -1) / (n - 1)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    halves = (corner[:, None, None] + np.array([[0, 1, n], [1, n, n + 1]])).reshape(-1, 3)
    rule, found = domain.quadrature, list[tuple[CellBasis, NDArray[np.int64]]]()
    for cells, whole in ((domain.full, True), (domain.cut, False)):
        if not cells.size:
            continue
        low, high = rule.lower[:, cells, None], rule.upper[:, cells, None]
        x = low + (high - low) * lattice[:, None]
        triangles = (n**2 * np.arange(cells.size)[:, None, None] + halves).reshape(-1, 3)
        if not whole:
            near = KDTree(rule.boundary_points.T).query(np.moveaxis(x, 0, -1))[1]
            normals = rule.normals[:, near]
            off = np.sum((x - rule.boundary_points[:, near]) * normals, axis=0)
            x -= np.maximum(off, 0.0) * normals
            triangles = triangles[(off.ravel()[triangles] < 0.0).any(axis=1)]
        X = reference_points(domain.mesh, cells, x)
        weights = np.ones((cells.size, n**2))
        basis = CellBasis(domain.mesh, element, quadrature=(X, weights), elements=cells)
        found.append((basis, triangles))
    return found
