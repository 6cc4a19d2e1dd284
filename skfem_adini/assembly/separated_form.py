"""Integrands of forms as sums of products: a number of each cell times what the cells share.

A form with a coefficient k that is constant in each cell often is

.. math:: a(u, v; k) = \\sum_m c_m(k) \\, a_m(u, v).

Then the local matrices of congruent cells are combinations of those of the :math:`a_m`. Here the
form itself shows these terms: it is called with a `CellNumbers` for each coefficient, which
computes whatever the form makes of coefficients alone, such as k**3, 1 / k or a threshold, for all
cells, and becomes a `Separated` where it meets a function. Nothing is guessed from values; any
other operation raises `NotSeparated`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from numbers import Number
from typing import Any, NoReturn

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

Array = NDArray[Any]
Term = tuple[Any, Array]  # number of each cell, or 1.0; an array over (..., rows, points)

_MOST_TERMS = 16  # more cost about as much as the integrand at the points of each cell


class NotSeparated(Exception):
    """A form uses a coefficient in an operation that has no rule here."""


def _refuse(*_: Any, **__: Any) -> NoReturn:
    raise NotSeparated


class _Symbol(NDArrayOperatorsMixin):
    """Base of `CellNumbers` and `Separated`, which are no arrays, truth values or lists."""

    __array__ = __bool__ = __len__ = __contains__ = __setitem__ = __float__ = _refuse

    def __getattr__(self, name: str) -> Any:
        raise NotSeparated(name)


class CellNumbers(_Symbol):
    """Numbers of each cell, values over (..., cells)."""

    def __init__(self, values: Array) -> None:
        self.values = values
        wide = np.result_type(values, np.float64)
        self.factors = values.astype(wide, copy=False)  # products of small integers overflow

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options or ufunc.nout != 1 or ufunc.signature:
            _refuse()
        if all(isinstance(each, CellNumbers | Number | np.generic) for each in inputs):
            return CellNumbers(ufunc(*map(_values, inputs)))
        return _separated(ufunc, *inputs)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        alone = all(isinstance(each, CellNumbers | Number | np.generic) for each in args)
        if alone and function in (np.where, np.clip) and not options and len(args) == 3:
            return CellNumbers(function(*map(_values, args)))
        return _termwise(function, args, options)

    def __getitem__(self, key: Any) -> CellNumbers:
        return CellNumbers(self.values[_leading(key, self.values.ndim - 1)])

    def __iter__(self) -> Iterator[CellNumbers]:
        return (self[i] for i in range(len(self.values) if self.values.ndim > 1 else _refuse()))


class Separated(_Symbol):
    """A sum of products."""

    def __init__(self, terms: list[Term]) -> None:
        if len(terms) > _MOST_TERMS:
            _refuse()
        self.terms = terms

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            _refuse()
        return _separated(ufunc, *inputs)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        return _termwise(function, args, options)

    def __getitem__(self, key: Any) -> Separated:
        return self._each(lambda a: a[_leading(key, a.ndim - 2)])

    def __iter__(self) -> Iterator[Separated]:
        first = self.terms[0][1]
        return (self[i] for i in range(len(first) if first.ndim > 2 else _refuse()))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape over (..., rows, points)."""
        return np.broadcast_shapes(*(a.shape for _, a in self.terms))

    def sum(self, axis: Any = None) -> Separated:
        """Return the sum over a leading axis."""
        return self._each(lambda a: np.sum(a, axis=_axis(axis, a.ndim)))

    def _each(self, linear: Callable[[Array], Array]) -> Separated:
        return Separated([(c, linear(a)) for c, a in self.terms])


def of_integrand(density: Any) -> Separated:
    """Return what a form gave as a sum of products."""
    return _terms(density)


def _values(each: Any) -> Any:
    return each.values if isinstance(each, CellNumbers) else each


def _leading(key: Any, axes: int) -> Any:
    """Return a key that chooses along leading axes, and not cells or points."""
    keys = key if isinstance(key, tuple) else (key,)
    if len(keys) > axes or not all(isinstance(k, int | np.integer | slice) for k in keys):
        _refuse()
    return key


def _axis(axis: Any, axes: int) -> int:
    if not isinstance(axis, int) or not 0 <= axis < axes - 2:
        _refuse()
    return axis


def _terms(each: Any) -> Separated:
    """Return a function, numbers of cells or a number as a sum of products."""
    if isinstance(each, Separated):
        return each
    if not isinstance(each, CellNumbers):
        return Separated([(1.0, np.asarray(each))])
    leading = each.values.shape[:-1]
    if not leading:
        return Separated([(each.factors, np.ones((1, 1)))])
    units = np.eye(int(np.prod(leading))).reshape(-1, *leading, 1, 1)
    places = np.ndindex(*leading)
    return Separated([(each.factors[i], one) for i, one in zip(places, units, strict=True)])


def _separated(ufunc: Any, *inputs: Any) -> Separated:
    """Apply a rule of arithmetic to sums of products."""
    if ufunc in (np.negative, np.positive):
        return _terms(inputs[0])._each(ufunc)
    if len(inputs) != 2:
        _refuse()
    left, right = inputs
    if ufunc in (np.add, np.subtract):
        return _added(_terms(left), _terms(right), ufunc)
    if ufunc is np.multiply:
        pairs = [(one, two) for one in _terms(left).terms for two in _terms(right).terms]
        return Separated([(_product(c, d), a * b) for (c, a), (d, b) in pairs])
    if ufunc is np.true_divide and isinstance(right, CellNumbers) and right.values.ndim == 1:
        return Separated([(c / right.factors, a) for c, a in _terms(left).terms])
    if ufunc is np.true_divide and not isinstance(right, _Symbol):
        return _terms(left)._each(lambda a: a / right)
    _refuse()


def _product(c: Any, d: Any) -> Any:
    """Return c d, c itself if d is one: terms with the same numbers are recognised by identity."""
    return c if isinstance(d, float) else d if isinstance(c, float) else c * d


def _added(left: Separated, right: Separated, ufunc: Any) -> Separated:
    shape = np.broadcast_shapes(*(a.shape for _, a in left.terms + right.terms))
    sums = {id(c): (c, np.broadcast_to(a, shape)) for c, a in left.terms}
    for c, a in right.terms:
        known = sums.get(id(c))
        wide = np.broadcast_to(a, shape)
        sums[id(c)] = (c, ufunc(known[1], wide) if known else ufunc(0, wide))
    return Separated(list(sums.values()))


def _termwise(function: Any, args: Any, options: Any) -> Separated:
    """Apply a linear function of one sum of products to each term."""
    if function is np.sum and len(args) == 1 and set(options) <= {"axis"}:
        return _terms(args[0]).sum(**options)
    symbols = [i for i, each in enumerate(args) if isinstance(each, _Symbol)]
    if function is not np.einsum or options or not isinstance(args[0], str) or len(symbols) != 1:
        _refuse()
    subscripts = args[0].replace(" ", "")
    inputs, arrow, output = subscripts.partition("->")
    labels, place = inputs.split(","), symbols[0]
    own = labels[place - 1]
    contracted = all(inputs.count(letter) == 2 for letter in inputs if letter.isalpha())
    if not all(one.endswith("...") or "..." not in one for one in labels) or not (
        output.endswith("...") if arrow else contracted
    ):
        _refuse()
    if not own.endswith("..."):
        _refuse()
    axes = len(own) - 3

    def each(a: Array) -> Array:
        if a.ndim != axes + 2:
            _refuse()
        return np.asarray(
            np.einsum(subscripts, *(a if i == place else b for i, b in enumerate(args) if i))
        )

    return _terms(args[place])._each(each)
