"""Domains given by level sets, and their intersections, unions and complements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from skfem.assembly.basis.abstract_basis import AbstractBasis

from skfem_adini.curved.quadrature.polygon import Polygon
from skfem_adini.elements.straight_cells import reference_points
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of, finite_numbers, function_of_places

Array = NDArray[np.float64]


class LevelSet:
    r"""The domain where a function is negative.

    ``a & b`` is the intersection, max(a, b); ``a | b`` the union, min(a, b); ``~a`` the complement,
    -a; ``a - b`` is ``a & ~b``. The smooth functions are separate, so corners where their zero
    lines cross are resolved exactly, and :math:`\min` and :math:`\max` cost no accuracy. Plain
    functions may be composed with a level set; a `Polygon` may not.

    Parameters
    ----------
    function
        Smooth function phi with non-zero gradient where it vanishes. Takes points of shape
        (2, cells, points) and returns (cells, points).
    gradient
        Returns the gradient of phi at such points, shape (2, cells, points). Without it normals
        are those of an interpolant of degree 8.

    Raises
    ------
    InputError
        The function or the gradient is not callable; a `Polygon` in a composition.

    Examples
    --------
    >>> disk = LevelSet(lambda x: x[0] ** 2 + x[1] ** 2 - 1)
    >>> half = disk & LevelSet(lambda x: x[0])
    >>> half(np.array([[[-0.5, 0.5]], [[0.0, 0.0]]])).tolist()
    [[-0.5, 0.5]]
    """

    def __init__(
        self,
        function: Callable[[Array], Any],
        gradient: Callable[[Array], Any] | None = None,
    ) -> None:
        if not callable(function):
            raise InputError(
                f"level_set: expected a function of points (2, cells, points), a LevelSet or a "
                f"Polygon, got {type(function).__name__}"
            )
        function_of_places("level_set", function)
        if gradient is not None and not callable(gradient):
            raise InputError(f"gradient: expected a function, got {type(gradient).__name__}")
        self.function = function
        self.gradient = gradient

    @property
    def leaves(self) -> list[LevelSet]:
        """The smooth level sets, each once."""
        return [self]

    def inside(self, leaf: dict[int, bool]) -> bool:
        """Return whether a point is inside, from the set of leaves (by id) that contain it."""
        return leaf[id(self)]

    def __call__(self, x: Array) -> Array:
        """Return the function at points of shape (2, ...)."""
        return np.asarray(self.function(x))

    def evaluate(self, x: Array, cells: NDArray[np.integer]) -> Array:
        """Return the function at points of shape (2, len(cells), points), checked."""
        return returned("level_set", self._values(x, cells), x.shape[1:])

    def evaluate_gradient(self, x: Array, cells: NDArray[np.integer]) -> Array | None:
        """Return the gradient at points of shape (2, len(cells), points), checked, or None."""
        if self.gradient is None:
            return None
        found = self.gradient(x)
        if isinstance(found, list | tuple):
            parts = (array_of("gradient", part) for part in found)
            found = np.array([np.broadcast_to(part, x.shape[1:]) for part in parts])
        return returned("gradient", found, x.shape)

    def _values(self, x: Array, cells: NDArray[np.integer]) -> Any:
        return self.function(x)

    def __and__(self, other: LevelSet) -> LevelSet:
        return _Composition("and", (self, as_level_set(other)))

    def __rand__(self, other: Any) -> LevelSet:
        return as_level_set(other) & self

    def __ror__(self, other: Any) -> LevelSet:
        return as_level_set(other) | self

    def __rsub__(self, other: Any) -> LevelSet:
        return as_level_set(other) - self

    def __or__(self, other: LevelSet) -> LevelSet:
        return _Composition("or", (self, as_level_set(other)))

    def __sub__(self, other: LevelSet) -> LevelSet:
        return self & ~as_level_set(other)

    def __invert__(self) -> LevelSet:
        return _Composition("not", (self,))


class FieldLevelSet(LevelSet):
    """The domain where a finite element function is negative.

    Parameters
    ----------
    basis
        Scalar scikit-fem basis on the mesh that is cut.
    x
        Dofs of a continuous function, shape (basis.N,).

    Raises
    ------
    InputError
        The vector does not fit the basis, or holds NaN or infinity.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad().refined(3), ElementQuadAdini())
    >>> x = basis.project(lambda x: x[0] ** 2 + x[1] ** 2 - 0.5)
    >>> level_set = FieldLevelSet(basis, x)
    """

    def __init__(self, basis: Any, x: Array) -> None:
        if not isinstance(basis, AbstractBasis):
            raise InputError(f"basis: expected a scikit-fem Basis, got {type(basis).__name__}")
        x = finite_numbers("x", x, (basis.N,))
        super().__init__(basis.interpolator(x))
        self.basis, self.x = basis, x

    def _values(self, x: Array, cells: NDArray[np.integer]) -> Any:
        basis = self.basis
        X = reference_points(basis.mesh, cells, x)
        total = np.zeros(x.shape[1:])
        for i in range(basis.Nbfun):
            field = np.asarray(basis.elem.gbasis(basis.mapping, X, i, tind=cells)[0])
            total += self.x[basis.dofs.element_dofs[i, cells]][:, None] * field
        return total


class _Composition(LevelSet):
    def __init__(self, rule: Literal["and", "or", "not"], parts: Sequence[LevelSet]) -> None:
        self.rule, self.parts = rule, tuple(parts)
        self.gradient = None

    @property
    def leaves(self) -> list[LevelSet]:
        found = {id(leaf): leaf for part in self.parts for leaf in part.leaves}
        return list(found.values())

    def inside(self, leaf: dict[int, bool]) -> bool:
        truths = [part.inside(leaf) for part in self.parts]
        if self.rule == "not":
            return not truths[0]
        return all(truths) if self.rule == "and" else any(truths)

    def __call__(self, x: Array) -> Array:
        values = [part(x) for part in self.parts]
        if self.rule == "not":
            return -values[0]
        return np.maximum(*values) if self.rule == "and" else np.minimum(*values)


@dataclass(frozen=True)
class TruthTable:
    """The truth table of a composed domain, in terms of its leaves.
    A leaf of which only the complement is used enters with its sign changed, so that a zero line
    on a grid line is the boundary of the cells inside."""

    leaves: list[LevelSet]  # the smooth level sets
    signs: Array  # 1, or -1 for leaves with changed sign
    table: NDArray[np.uint8]  # inside or not, shape (2^leaves,); leaf k has the bit 2^k

    @classmethod
    def of(cls, level_set: LevelSet) -> TruthTable:
        """Tabulate a level set of any composition."""
        leaves = level_set.leaves
        count = len(leaves)
        if count > 16:  # the truth table has 2^count entries
            raise InputError(
                f"level_set: {count} functions are composed, at most 16 can be; "
                "give straight-sided domains as a Polygon"
            )
        keys = [id(leaf) for leaf in leaves]
        bits = np.array(list(product((False, True), repeat=count)), dtype=bool)[:, ::-1]
        table = np.array(
            [level_set.inside(dict(zip(keys, row, strict=True))) for row in bits.tolist()],
            dtype=np.uint8,
        )
        signs = np.ones(count)
        index = np.arange(2**count)
        for k in range(count):
            without = table[index & ~(1 << k)]
            within = table[index | (1 << k)]
            if (without >= within).all() and (without > within).any():
                signs[k] = -1
                table = table[index ^ (1 << k)]
        return cls(leaves, signs, table)


def as_level_set(level_set: Any, gradient: Callable[[Array], Any] | None = None) -> LevelSet:
    """Return a level set from itself or from a function and its gradient."""
    if isinstance(level_set, LevelSet):
        if gradient is not None:
            raise InputError("gradient: give it to LevelSet(function, gradient) instead")
        return level_set
    if isinstance(level_set, Polygon):
        raise InputError(
            "level_set: a Polygon is not composed with level sets; compose its sides, half planes "
            "as LevelSet(lambda x: ...), instead"
        )
    return LevelSet(level_set, gradient)


def returned(name: str, values: Any, shape: tuple[int, ...]) -> Array:
    """Return what a caller's function returned, as finite real numbers of this shape."""
    values = array_of(name, values)
    if values.dtype.kind not in "fiub":
        raise InputError(f"{name}: expected real numbers, got an array of {values.dtype}")
    if values.shape not in (shape, ()):
        raise InputError(
            f"{name}: the function returned shape {values.shape} where {shape} was expected"
        )
    values = np.broadcast_to(values.astype(float), shape)
    if not np.isfinite(values).all():
        raise InputError(
            f"{name}: the function returned NaN or infinity; it must be finite on all "
            "cells of the mesh"
        )
    return values
