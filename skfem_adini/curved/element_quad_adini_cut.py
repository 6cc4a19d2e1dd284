"""The dissertation's element for cut cells, kept as a baseline."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from skfem.element import DiscreteField, ElementH1
from skfem.refdom import RefQuad

from skfem_adini.curved.cut_domain import axis_parallel_cells
from skfem_adini.curved.quadrature.level_set import as_level_set
from skfem_adini.errors import InputError
from skfem_adini.ground.errors import warn

Array = NDArray[np.float64]
Indices = NDArray[np.integer]

# Exponents of the monomials: quadratic, then cubic ones, then Adini's x^3 y and x y^3.
_POWERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]
_POWERS += [(3, 1), (1, 3)]


class UnisolvenceWarning(UserWarning):
    """The matrix of a cut cell is nearly singular.

    The coefficients of that cell lose about log10(``unisolvence``) digits. Use `AdiniExtension`
    instead, which needs no such matrix, or move the mesh a little.

    Examples
    --------
    A boundary that is straight but for a curvature of 1e-7:

    >>> import warnings
    >>> import numpy as np
    >>> from skfem import MeshQuad
    >>> c, s = np.cos(0.2), np.sin(0.2)
    >>> def nearly_straight(x):
    ...     u, v = x[0] - 0.4, x[1] - 0.5
    ...     return c * u + s * v + 5e-8 * (u**2 + v**2)
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     element = ElementQuadAdiniCut(MeshQuad(), nearly_straight)
    >>> found[0].category.__name__
    'UnisolvenceWarning'
    """


class ElementQuadAdiniCut(ElementH1):
    r"""The 2012 construction: fewer monomials and points of the curve in cells that are cut.

    The conditions of a cell with k vertices inside are u, u_x, u_y at these and u at points of the
    curve: at its crossings alpha, beta with the two cut sides and at points delta (and eta) between
    them, where it meets the perpendiculars to the chord at its middle (at its thirds).

    ===  =============  ============================  ======
     k   space          points of the curve           count
    ===  =============  ============================  ======
     4   Adini          none                          12
     3   Adini          alpha, beta, delta            9 + 3
     2   cubics         alpha, beta, delta, eta       6 + 4
     1   quadratics     alpha, beta, delta            3 + 3
    ===  =============  ============================  ======

    The element serves as a baseline and is not recommended. Its functions jump across cut sides (a
    cubic trace has four parameters there, and three conditions), u = 0 holds at a few points only,
    and with two vertices inside it is singular exactly when these vertices and the four points lie
    on one conic: always for a straight cut and for an arc that is symmetric in the cell, nearly so
    for a smooth curve of curvature c on a fine mesh, where the inverse grows like 1 / (c h).
    Eigenvalues converge with order one; with `AdiniExtension` the order is six.

    Parameters
    ----------
    mesh
        `MeshQuad` of axis-parallel rectangles; bases must use this mesh.
    level_set
        Smooth function, negative inside, of points (2, cells, points).

    Attributes
    ----------
    unisolvence
        One over the least singular value of each cell's matrix, in coordinates and derivatives
        scaled to the unit square, shape (cells,); NaN for cells without a vertex inside.
    inside
        Which vertices are inside, shape (vertices,).
    crossings
        The point where the curve crosses each cut facet, shape (2, facets), else NaN.

    Raises
    ------
    InputError
        Two vertices inside that are opposite, a curve that leaves the cell between alpha and beta,
        or a matrix that is singular, such as that of a straight cut between two vertices.

    Warns
    -----
    UnisolvenceWarning
        `unisolvence` above 1e8 somewhere.

    References
    ----------
    Section 5.1.3 of the 2012 dissertation.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 9)] * 2)
    >>> disk = lambda x: (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - 0.411**2
    >>> element = ElementQuadAdiniCut(mesh, disk)
    >>> int(element.dirichlet_dofs(Basis(mesh, element, intorder=1)).size / 3)
    37
    """

    nodal_dofs = 3
    facet_dofs = 1
    interior_dofs = 2
    maxdeg = 4
    dofnames = ["u", "u_x", "u_y", "u_crossing", "u_delta", "u_eta"]  # noqa: RUF012
    doflocs = np.array(
        [
            *np.repeat([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], 3, axis=0),
            [0.5, 0.0], [1.0, 0.5], [0.5, 1.0], [0.0, 0.5], [0.5, 0.5], [0.5, 0.5],
        ]
    )  # fmt: skip
    refdom = RefQuad

    def __init__(self, mesh: Any, level_set: Callable[[Array], Any]) -> None:
        self.lower, upper = axis_parallel_cells(mesh)
        self.size = upper - self.lower
        self.mesh = mesh
        level_set = as_level_set(level_set)
        values = level_set.evaluate(mesh.p[:, :, None], np.arange(mesh.nvertices))[:, 0]
        self.inside: NDArray[np.bool_] = values < 0
        self.crossings = _crossings(mesh, self.inside, level_set)
        cells = mesh.t.shape[1]
        self.coefficients: Array = np.zeros((cells, 12, 18))
        self.unisolvence: Array = np.full(cells, np.nan)
        self.used: NDArray[np.bool_] = np.zeros((cells, 18), dtype=bool)
        for cell in np.flatnonzero(self.inside[mesh.t].any(axis=0)).tolist():
            self._solve(cell, level_set)
        worst = np.nanmax(self.unisolvence, initial=0.0)
        if worst > 1e8:  # for entries of order 1: eight digits remain
            warn(
                f"the matrix of a cut cell is nearly singular (1 / sigma_min = {worst:.1e}): the "
                "boundary is almost straight between two vertices, or almost meets one; "
                "AdiniExtension does not mind",
                UnisolvenceWarning,
            )

    def gbasis(
        self, mapping: Any, X: Array, i: int, tind: Indices | None = None
    ) -> tuple[DiscreteField]:
        """Return function i and its gradient; functions without a condition in a cell vanish."""
        if mapping.mesh is not self.mesh:
            raise InputError("mesh: the element belongs to the mesh it was made for")
        if not 0 <= i < 18:
            self._index_error()
        cells = slice(None) if tind is None else tind
        size = self.size[:, cells, None]
        s, t = (np.asarray(mapping.F(X, tind)) - self.lower[:, cells, None]) / size
        value, s_part, t_part = np.zeros((3, *s.shape))
        for c, (a, b) in zip(self.coefficients[cells, :, i].T, _POWERS, strict=True):
            if not c.any():
                continue
            c = c[:, None]
            value += c * s**a * t**b
            if a:
                s_part += c * a * s ** (a - 1) * t**b
            if b:
                t_part += c * b * s**a * t ** (b - 1)
        return (DiscreteField(value, np.array([s_part, t_part]) / size),)

    def __repr__(self) -> str:
        cells = self.mesh.nelements
        return f"{type(self).__name__}({cells} cells, {self.inside.sum()} vertices inside)"

    def lbasis(self, X: Array, i: int) -> Any:
        """Raise an error: there is no reference function, as every cell has its own functions."""
        raise NotImplementedError("ElementQuadAdiniCut has no functions on the reference cell")

    def dirichlet_dofs(self, basis: Any) -> Indices:
        """Return the dofs that stay free for u = 0 on the curve: those of vertices inside."""
        return np.unique(basis.dofs.nodal_dofs[:, self.inside])

    def neumann_dofs(self, basis: Any) -> Indices:
        """Return the dofs that stay free without conditions on the curve: all that are used."""
        dofs = basis.dofs.element_dofs
        return np.unique(dofs[self.used.T])

    def _solve(self, cell: int, level_set: Callable[[Array], Any]) -> None:
        """Invert the matrix of the conditions of a cell."""
        vertices = self.mesh.t[:, cell]
        inside = self.inside[vertices]
        count = int(inside.sum())
        size, lower = self.size[:, cell], self.lower[:, cell]
        if count == 2 and inside[0] == inside[2]:
            raise self._refusal(cell, "two opposite vertices are inside; refine the mesh there")
        # Three conditions for each vertex inside, one for each point on the arc, ends included.
        powers = _POWERS[: {1: 6, 2: 10, 3: 12, 4: 12}[count]]
        rows, places, scales = [], [], []
        for k in np.flatnonzero(inside).tolist():
            p = (self.mesh.p[:, vertices[k]] - lower) / size
            for d, derivative in enumerate(((0, 0), (1, 0), (0, 1))):
                rows.append(_condition(p, powers, derivative))
                places.append(3 * k + d)
                scales.append(1.0 if d == 0 else size[d - 1])
        if count < 4:
            facets = self.mesh.t2f[:, cell]
            sides = ((0, 1), (1, 2), (2, 3), (0, 3))
            cut = [k for k, (a, b) in enumerate(sides) if inside[a] != inside[b]]
            ends = [self.crossings[:, facets[k]] for k in cut]
            arc = _points_between(ends[0], ends[1], {1: 1, 2: 2, 3: 1}[count], level_set)
            if arc is None:
                raise self._refusal(cell, "the curve strays from its chord; refine the mesh there")
            for point, place in zip([*ends, *arc], [*(12 + k for k in cut), 16, 17], strict=False):
                rows.append(_condition((point - lower) / size, powers, (0, 0)))
                places.append(place)
                scales.append(1.0)
        V = np.array(rows)
        self.unisolvence[cell] = 1 / max(np.linalg.svd(V, compute_uv=False)[-1], 1e-300)
        if not self.unisolvence[cell] <= 1e12:  # for entries of order 1: four digits remain
            raise self._refusal(
                cell,
                f"its matrix is singular (1 / sigma_min = {self.unisolvence[cell]:.1e}), as always "
                "when the boundary is straight between two vertices inside; use AdiniExtension",
            )
        self.coefficients[cell][: len(powers), places] = np.linalg.inv(V) * scales
        self.used[cell, places] = True

    def _refusal(self, cell: int, why: str) -> InputError:
        x, y = self.lower[:, cell] + self.size[:, cell] / 2
        return InputError(f"level_set: in the cell at ({x:.6g}, {y:.6g}) {why}")


def _condition(p: Array, powers: list[tuple[int, int]], derivative: tuple[int, int]) -> list[float]:
    """Return the monomials, or first derivatives of them, at a point of the unit square."""
    row = []
    for power in powers:
        factor = 1.0
        for x, a, d in zip(p, power, derivative, strict=True):
            factor *= (a * x ** (a - 1) if a else 0.0) if d else x**a
        row.append(factor)
    return row


def _crossings(mesh: Any, inside: NDArray[np.bool_], level_set: Callable[[Array], Any]) -> Array:
    """Return where the curve crosses facets of which one end is inside."""
    result = np.full((2, mesh.facets.shape[1]), np.nan)
    for facet in np.flatnonzero(inside[mesh.facets[0]] != inside[mesh.facets[1]]).tolist():
        a, b = mesh.p[:, mesh.facets[:, facet]].T
        result[:, facet] = a + (b - a) * scipy.optimize.brentq(
            _along(a, b - a, level_set), 0, 1, xtol=1e-15, rtol=1e-14
        )
    return result


def _points_between(
    a: Array, b: Array, count: int, level_set: Callable[[Array], Any]
) -> list[Array] | None:
    """Return points of the curve on perpendiculars to the chord, or None if one has none."""
    found = []
    normal = np.array([a[1] - b[1], b[0] - a[0]])
    for k in range(1, count + 1):
        f = _along(a + (b - a) * k / (count + 1), normal, level_set)
        reach = 1e-9  # half width of the bracket, in chord lengths, widened up to .6
        while not f(-reach) * f(reach) <= 0:
            reach *= 4
            if reach > 0.6:
                return None
        root = scipy.optimize.brentq(f, -reach, reach, xtol=1e-16, rtol=1e-14)
        found.append(a + (b - a) * k / (count + 1) + root * normal)
    return found


def _along(p: Array, step: Array, level_set: Callable[[Array], Any]) -> Callable[[float], float]:
    def value(t: float) -> float:
        return float(np.asarray(level_set((p + t * step)[:, None, None])).item())

    return value
