"""Ghost penalty: jumps of normal derivatives across the facets of cut cells."""

from __future__ import annotations

from math import factorial
from typing import Any, Literal

import numpy as np
from scipy import sparse
from skfem import BilinearForm, Dofs, InteriorFacetBasis, asm
from skfem.element import DiscreteField, ElementVector
from skfem.helpers import dot

from skfem_adini.curved.cut_domain import CutDomain
from skfem_adini.curved.unresolved_features import warn_of_unresolved_features
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.vertex_dofs import full_name
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import choice, positive_number


def ghost_penalty(
    domain: CutDomain,
    elem: Any,
    gamma: float = 0.02,
    matrix: Literal["stiffness", "mass"] = "stiffness",
) -> Any:
    r"""Return the matrix of the jumps across the facets of cut cells.

    .. math::
        g(u, v) = \gamma \sum_F \sum_{j=1}^{3} \frac{h^{2j-1}}{(j!)^2} \int_F
        [\partial_n^j u] [\partial_n^j v]

    over the facets F between two active cells of which at least one is cut; h is the mean extent of
    the two cells across F. Adini's functions are cubics across an edge, so higher derivatives
    vanish. For a mass matrix the sum is multiplied with :math:`10^{-3} h^2`: a larger factor would
    bring spurious eigenvalues at :math:`\gamma / (\gamma_M h^2)` into the range of interest.

    Parameters
    ----------
    domain
        The cut domain.
    elem
        `ElementQuadAdini` or `ElementVector` of it.
    gamma
        Positive weight, without unit for the Laplacian; multiply by the conductivity or by
        2 mu + lambda for other stiffness matrices, by the density for mass matrices. With
        beta = 50 in `nitsche` 0.01 is too little for some cuts.
    matrix
        Which matrix it stabilises.

    Returns
    -------
    sparse matrix (dofs, dofs)
        To be added to the stiffness or mass matrix. Rows of dofs outside are empty, see
        `domain.active_dofs`.

    Raises
    ------
    InputError
        Another element, a weight that is not positive, an unknown matrix, or a hanging vertex on
        a facet of a cut cell.

    Warns
    -----
    UnresolvedWarning
        As in `AdiniExtension`.

    References
    ----------
    E. Burman, Ghost penalty, Comptes Rendus Mathematique 348 (2010), 1217-1220.

    S. Sticko and G. Kreiss, Higher order cut finite elements for the wave equation, Journal of
    Scientific Computing 80 (2019), 1867-1887.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> domain = CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.81)
    >>> G = ghost_penalty(domain, ElementQuadAdini())
    >>> cubic = np.zeros(G.shape[0])
    >>> cubic[::3], cubic[1::3] = mesh.p[0] ** 3, 3 * mesh.p[0] ** 2
    >>> bool(abs(cubic @ G @ cubic) < 1e-12)
    True
    """
    if not isinstance(domain, CutDomain):
        raise InputError(f"domain: expected a CutDomain, got {type(domain).__name__}")
    vector = isinstance(elem, ElementVector)
    scalar = elem.elem if vector else elem
    if not isinstance(scalar, ElementQuadAdini):
        raise InputError(f"elem: expected ElementQuadAdini, got {full_name(scalar)}")
    gamma = positive_number("gamma", gamma)
    choice("matrix", matrix, ("stiffness", "mass"))
    _refuse_hanging(domain)
    warn_of_unresolved_features(domain)
    facets = domain.ghost_facets
    if facets.size == 0:
        raise InputError("domain: no facet lies between two active cells one of which is cut")
    mesh = domain.mesh
    third = ElementQuadAdini(derivatives=3)  # the functions are cubics across an edge
    sides = [
        InteriorFacetBasis(mesh, third, facets=facets, side=side, intorder=6) for side in (0, 1)
    ]
    ends = mesh.p[:, mesh.facets[:, facets]]
    across = np.argmin(np.abs(ends[:, 1] - ends[:, 0]), axis=0)
    sizes = [np.ptp(mesh.p[:, mesh.t[:, cells]], axis=1) for cells in mesh.f2t[:, facets]]
    extent = sum(size[across, np.arange(len(facets))] for size in sizes) / 2
    power = 2 if matrix == "mass" else 0
    weight = gamma * (1e-3 if matrix == "mass" else 1.0)

    def jumps(u: Any, v: Any, w: Any) -> Any:
        n = w.n
        normal = [
            (dot(f.grad, n), np.einsum("ij...,i...,j...", f.hess, n, n),
             np.einsum("ijk...,i...,j...,k...", f.grad3, n, n, n))
            for f in (u, v)
        ]  # fmt: skip
        sign = 1.0 if w.idx[0] == w.idx[1] else -1.0
        total = 0.0
        for j, (first, last) in enumerate(zip(*normal, strict=True), start=1):
            total = total + w.size ** (2 * j - 1 + power) / factorial(j) ** 2 * first * last
        return weight * sign * total

    field = DiscreteField(np.repeat(extent[:, None], sides[0].X.shape[-1], axis=1))
    G = asm(BilinearForm(jumps), sides, sides, size=field)
    return _for_components(G, elem, domain) if vector else G


def _refuse_hanging(domain: CutDomain) -> None:
    """Raise InputError if a hanging vertex divides a facet of a cut cell."""
    mesh = domain.mesh
    sides = mesh.t2f[:, domain.cut]
    single = np.setdiff1d(sides[mesh.f2t[1, sides] < 0], domain.outer_facets)
    if single.size:
        x, y = mesh.p[:, mesh.facets[:, single[0]]].mean(axis=1)
        raise InputError(
            f"domain: a cut cell has a hanging vertex at its side at ({x:.6g}, {y:.6g}); refine "
            "the cells around the boundary alike (refined_at_boundary), or use AdiniExtension"
        )


def _for_components(G: Any, elem: ElementVector, domain: CutDomain) -> Any:
    """Return the matrix that acts on each component of a vector field."""
    scalar = Dofs(domain.mesh, elem.elem).nodal_dofs
    dofs = Dofs(domain.mesh, elem)
    result = sparse.csr_array((dofs.N, dofs.N))
    for c in range(elem.dim):
        rows = dofs.nodal_dofs[c :: elem.dim]
        place = (rows.ravel(), scalar.ravel())
        into = sparse.csr_array((np.ones(rows.size), place), shape=(dofs.N, G.shape[0]))
        result = result + into @ G @ into.T
    return result
