"""Check that a form may be assembled on a cut domain, where cells come in padded batches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import BilinearForm, CellBasis, LinearForm
from skfem.assembly.form.form import Form, FormExtraParams
from skfem.element import DiscreteField

from skfem_adini.assembly.local_tensors import rows_of
from skfem_adini.assembly.pointwise_check import TRIED, check_pointwise, not_pointwise
from skfem_adini.elements.field_on_demand import existing_parts
from skfem_adini.errors import InputError, NotSupported

Array = NDArray[Any]
Integers = NDArray[np.integer]
Parts = list[Array | None]  # value, gradient, ... over (..., cells, points)


class CutSample:
    """A few functions at a few points in a few cells of each batch, for tests of a form."""

    def __init__(self, form: Form) -> None:
        self._form = form
        self._rng = np.random.default_rng(0)
        self._which: list[int] = []
        self._functions: list[list[list[Parts]]] = []
        self._fields: list[dict[str, Parts]] = []
        self._others: dict[str, Any] = {}

    def add(self, basis: CellBasis, parameters: dict[str, Any]) -> None:
        """Add cells of a batch: those with extreme coordinates or parameters, and random others.
        Derivatives that the form did not use are not computed."""
        if not self._which:
            self._which = sorted(self._rng.permutation(basis.Nbfun)[: TRIED.functions])
        cells, points = shape = basis.dx.shape
        fields = {**basis.default_parameters(), **parameters}
        for name, value in list(fields.items()):
            if not (isinstance(value, DiscreteField) and value.shape[-2:] == shape):
                self._others[name] = fields.pop(name)
        numbers = _first_points([[np.asarray(field)] for field in fields.values()])
        chosen = np.unique([*numbers.argmin(axis=1), *numbers.argmax(axis=1),
                            *self._rng.permutation(cells)[:TRIED.cells]])  # fmt: skip
        some = np.linspace(0, points - 1, TRIED.points).astype(int)

        def sampled(field: DiscreteField) -> Parts:
            return [
                None
                if p is None
                else np.broadcast_to(p, (*p.shape[:-2], *shape))[..., chosen[:, None], some]
                for p in existing_parts(field)
            ]

        self._functions.append([[sampled(part) for part in basis.basis[i]] for i in self._which])
        self._fields.append({name: sampled(field) for name, field in fields.items()})

    def check(self) -> None:
        """Compare integrands from batches of different cells and numbers of points."""
        rows = _Rows(self._form, self._functions, self._fields, self._others)
        classes, entries = (part.ravel() for part in np.indices(rows.shape))
        try:
            with np.errstate(all="ignore"):  # statistics of equal numbers divide by zero
                there = rows.densities(classes, entries)
                padded = rows.densities(
                    classes, entries, np.append(np.arange(TRIED.points), [0, 0, 0])
                )
            found = there.sum(axis=1).reshape(rows.shape)
            check_pointwise(rows, found, rows.sizes, rows.coefficients, len(classes))
            limit = TRIED.rounding * np.abs(there).max()
            if not np.allclose(
                padded[:, : TRIED.points], there, rtol=0, atol=limit, equal_nan=True
            ):
                raise not_pointwise("it gives other numbers where a point comes several times")
        except NotSupported as error:
            raise InputError(
                f"form: {str(error).removeprefix('the form ')}. On a cut domain cells come in "
                "several batches, with points of weight zero: compute such numbers beforehand and "
                "hand them over, as in assemble(form, elem, largest=...)"
            ) from error


class _Rows:
    """Integrands at the points of a sample, for `check_pointwise`."""

    def __init__(
        self, form: Form, functions: list[list[list[Parts]]], fields: list[dict[str, Parts]],
        others: dict[str, Any],
    ) -> None:  # fmt: skip
        self._form, self._others = form, others
        self._fields = {name: _joined([batch[name] for batch in fields]) for name in fields[0]}
        each = zip(*functions, strict=True)
        self._functions = [
            _joined(component)
            for component in zip(*(part for function in each for part in function), strict=True)
        ]
        self.coefficients = _first_points(list(self._fields.values()))
        self._arguments = 2 * isinstance(form, BilinearForm) or int(isinstance(form, LinearForm))
        self.sizes = (len(functions[0]),) * self._arguments or (1,)
        self.shape = self.coefficients.shape[1], int(np.prod(self.sizes))

    def prepare(self, classes: Integers) -> None:
        """Do nothing: the functions of the sample are already evaluated."""

    def densities(
        self, classes: Integers, entry: Integers, points: Integers | None = None
    ) -> Array:
        """Return the integrands without weights, shape (rows, points)."""
        indices = np.divmod(entry, self.sizes[0])[::-1] if self._arguments == 2 else (entry,)
        arguments = [
            field
            for index in indices[: self._arguments]
            for field in rows_of(self._functions, index * self.shape[0] + classes)
        ]
        fields = rows_of(list(self._fields.values()), classes)
        if points is not None:
            arguments, fields = ([_at(f, points) for f in some] for some in (arguments, fields))
        parameters = {**self._others, **dict(zip(self._fields, fields, strict=True))}
        width = TRIED.points if points is None else len(points)
        try:
            density = self._form.form(*arguments, FormExtraParams(parameters))
            return np.asarray(density * np.ones((len(classes), width)))
        except Exception as error:
            raise not_pointwise(repr(error)) from error


def _at(field: DiscreteField, points: Integers) -> DiscreteField:
    return DiscreteField(*(None if p is None else p[..., points] for p in field.astuple))


def _joined(several: Sequence[Parts]) -> Parts:
    """Return several fields as one, concatenated along the cells."""
    return [
        None if parts[0] is None else np.concatenate(parts, axis=-2)
        for parts in zip(*several, strict=True)
    ]


def _first_points(fields: Sequence[Parts]) -> Array:
    """Return the values at the first point of each cell, shape (numbers, cells)."""
    first = [np.asarray(parts[0])[..., 0].real for parts in fields]
    return np.concatenate([values.reshape(-1, values.shape[-1]) for values in first])
