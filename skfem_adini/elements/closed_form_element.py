"""Base of the closed-form elements of this package: the pull-back and the chain rule."""

from __future__ import annotations

import logging
import weakref
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import combinations_with_replacement, product
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from skfem.element import DiscreteField, ElementH1

from skfem_adini.elements.field_on_demand import DERIVATIVE_NAMES, FieldOnDemand
from skfem_adini.elements.hermite_factors import Function, derivatives, exponents
from skfem_adini.elements.straight_cells import GEOMETRY, HexCells, QuadCells
from skfem_adini.errors import InputError

Array = NDArray[np.float64]
Cells = QuadCells | HexCells


class ClosedFormElement(ElementH1):
    r"""Element with u and physical derivatives at vertices, in closed form on the reference cell.
    The function of :math:`\partial u/\partial x_i` at the vertex k is :math:`\sum_j DF_{ij}(k)
    H_j` with its reference functions :math:`H_j`. An instance may serve many meshes."""

    reference: ClassVar[tuple[Function, ...]]  # of the dofs of the vertex at the origin
    cells: ClassVar[type[QuadCells] | type[HexCells]]

    def __init__(self, derivatives: int = 2) -> None:
        whole = np.ndim(derivatives) == 0 and not isinstance(derivatives, bool | np.bool_)
        most = len(DERIVATIVE_NAMES) - 1
        if not whole or derivatives not in range(most + 1):
            raise InputError(f"derivatives: expected 0 to {most}, got {derivatives!r}")
        self.derivatives = int(derivatives)

    def _parameters(self) -> dict[str, Any]:
        """Return the arguments that the element was made with."""
        return {"derivatives": self.derivatives}

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other) or not isinstance(other, ClosedFormElement):
            return False
        return self._parameters() == other._parameters()

    def __hash__(self) -> int:
        return hash((type(self), *self._parameters().values()))

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={value!r}" for name, value in self._parameters().items())
        return f"{type(self).__name__}({given})"

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Return reference function i and its gradient at the reference points X, (dim, ...)."""
        function = [self.reference[self._locate(i)]]
        value, gradient = (derivatives(function, self.doflocs[i], X, order) for order in (0, 1))
        return value[0], gradient

    def gbasis(
        self, mapping: Any, X: Array, i: int, tind: NDArray[np.integer] | None = None
    ) -> tuple[DiscreteField]:
        """Return shape function i and its derivatives in the cells `tind`.

        Parameters
        ----------
        mapping
            A scikit-fem mapping; its mesh gives the cells.
        X
            Reference points, shape (dim, points) or (dim, cells, points).
        i
            Local number of the function: all dofs of the first vertex, then of the second.
        tind
            Cell numbers, all by default.

        Returns
        -------
        tuple of DiscreteField
            One field: value (cells, points), grad (dim, cells, points), and hess (dim, dim, cells,
            points) and so on, up to `derivatives`, made when they are first used.
        """
        self._locate(i)
        cells = self.cells.from_mapping(mapping, tind)
        if i == 0:
            self._check(cells, mapping, X)
        if self.derivatives > 2 and not cells.affine:
            raise InputError(
                f"derivatives: {self.derivatives} orders need {cells.affine_name} cells; "
                f"use {type(self).__name__}(derivatives=2) on this mesh"
            )
        value = self._evaluate(cells, X, i, 0)
        gradient = self._evaluate(cells, X, i, 1) if self.derivatives > 0 else None
        make = partial(self._demanded, mapping, X, i, tind)
        return (FieldOnDemand(value, gradient, self.derivatives, make),)

    def _demanded(
        self, mapping: Any, X: Array, i: int, tind: NDArray[np.integer] | None, order: int
    ) -> Array:
        """Return the derivatives of one order if requested in `derivatives`."""
        if order > self.derivatives:
            raise InputError(
                f"derivatives: {DERIVATIVE_NAMES[order]} is not there, the element was made with "
                f"derivatives={self.derivatives}; use {type(self).__name__}(derivatives={order})"
            )
        return self._evaluate(self.cells.from_mapping(mapping, tind), X, i, order)

    def _evaluate(self, cells: Any, X: Array, i: int, order: int) -> Array:
        """Return the derivatives of one order of function i."""
        vertex = self.doflocs[i]
        functions, weights = self._pull_back(cells, vertex, self._locate(i))
        rows = derivatives(functions, vertex, X, order)
        if order == 0:
            return _combine(weights, rows)
        G = cells.inverse_jacobian(X)
        field = _push_forward(weights, rows, G, order)
        if order == 2 and not cells.affine:
            gradient = _push_forward(weights, derivatives(functions, vertex, X, 1), G, 1)
            field -= _twist_hessian(cells.second_derivatives(X), gradient, G)
        return field

    def _check(self, cells: Any, mapping: Any, X: Array) -> None:
        twist = cells.check()
        log_twist(twist, cells, mapping, X)

    def _pull_back(
        self, cells: Any, vertex: Array, dof: int
    ) -> tuple[Sequence[Function], list[Array]]:
        """Return reference functions and the weights (cells, 1) that make the dof physical."""
        if dof == 0:
            return self.reference[:1], [np.ones((cells.count, 1))]
        tangents = cells.tangents(*vertex)
        return self.reference[1 : 1 + len(vertex)], [t[dof - 1, :, None] for t in tangents]

    def _locate(self, i: int) -> int:
        """Return the number of function i among the dofs of its vertex."""
        if not 0 <= i < len(self.doflocs):
            self._index_error()
        return i % self.nodal_dofs


def _combine(coefficients: Sequence[Array], functions: Array) -> Array:
    """Return the sum of coefficient times function, as (cells, points)."""
    if functions.ndim > 2 or coefficients[0].shape[1] > 1:
        return sum(
            (c * f for c, f in zip(coefficients, functions, strict=True)), start=np.zeros(())
        )
    # On axis-parallel cells most coefficients vanish.
    used = [k for k, c in enumerate(coefficients) if c.any()] or [0]
    if len(used) == 1:
        return coefficients[used[0]] * functions[used[0]]
    return np.einsum("cr,rp->cp", np.hstack([coefficients[k] for k in used]), functions[used])


def _push_forward(weights: Sequence[Array], functions: Array, G: Array, order: int) -> Array:
    r"""Return all derivatives of one order m, by the chain rule of an affine map.
    With :math:`G = DF^{-1}`, :math:`\prod_r \partial_{i_r}` in x is :math:`\prod_r \sum_j G_{j
    i_r} \partial_{X_j}`."""
    dim = len(G)
    alphas = exponents(dim, order)
    affine = G.shape[-1] == 1
    if not affine:
        terms = [_combine(weights, functions[k :: len(alphas)]) for k in range(len(alphas))]
        functions = np.array(terms)
    partial = {}
    for directions in combinations_with_replacement(range(dim), order):
        operator = {(0,) * dim: np.ones((1, 1))}
        for i in directions:
            operator = _times_partial(operator, G[:, i])
        powers = [operator[alpha] for alpha in alphas]
        coefficients = [w * power for w in weights for power in powers] if affine else powers
        partial[directions] = _combine(coefficients, functions)
    field = np.array([partial[tuple(sorted(index))] for index in product(range(dim), repeat=order)])
    return field.reshape((dim,) * order + field.shape[1:])


def _times_partial(operator: dict[tuple[int, ...], Array], g: Array) -> dict[Any, Array]:
    r"""Multiply a polynomial in the reference derivatives by :math:`\sum_j g_j \partial_{X_j}`."""
    result: dict[tuple[int, ...], Array] = {}
    for alpha, coefficient in operator.items():
        for j, factor in enumerate(g):
            beta = (*alpha[:j], alpha[j] + 1, *alpha[j + 1 :])
            term = factor * coefficient
            result[beta] = result[beta] + term if beta in result else term
    return result


def _twist_hessian(
    second: Iterable[tuple[tuple[int, int], Array]], gradient: Array, G: Array
) -> Array:
    r"""Return the correction to the Hessian of an affine map, which is to be subtracted.
    It is the sum over i < j of :math:`(\nabla u \cdot \partial_{X_i} \partial_{X_j} F)` times
    the symmetric product of rows i and j of :math:`DF^{-1}`."""
    total = np.zeros(())
    for (i, j), c in second:
        along = sum((part * g for part, g in zip(c, gradient, strict=True)), start=np.zeros(()))
        outer = G[i][:, None] * G[j][None, :]
        total = total + along * (outer + outer.transpose(1, 0, 2, 3))
    return total


_logger = logging.getLogger(__name__)
# The meshes for which a message was logged, by their addresses.
_spoken_of: weakref.WeakValueDictionary[int, Any] = weakref.WeakValueDictionary()


def log_twist(twist: float, cells: Any, mapping: Any, X: NDArray[np.float64]) -> None:
    """Log, once for a mesh, that the largest twist of its cells over their sides is not negligible.
    Points X with a cell axis belong to facets or probes, for which nothing is logged."""
    mesh = getattr(mapping.mesh, "part_of", mapping.mesh)
    if twist <= GEOMETRY.twist or X.ndim > 2 or _spoken_of.get(id(mesh)) is mesh:
        return
    _spoken_of[id(mesh)] = mesh
    _logger.warning(
        "the cells are not %ss (twist t = %.2g of the longest side). The error gains terms of size "
        "t^2 h^2 and t h^3: if t stays constant under refinement, the orders fall from 4 to 2 in "
        "L2 and from 3 to 1 in H1; if t falls like h, as in uniform refinement of a coarse %s "
        "mesh, orders 4 and 3 are kept",
        cells.affine_name,
        twist,
        cells.general_name,
    )
