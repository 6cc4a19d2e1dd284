"""Check that the values of a form in a cell do not depend on the other cells of a batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from skfem_adini.errors import NotSupported

Array = NDArray[Any]
Integers = NDArray[np.integer]


class _Tried(NamedTuple):  # what is computed again to see whether a form acts point by point
    classes: int = 8  # number of cell classes: a form that mixes cells differs in nearly all
    entries: int = 4  # entries of each class
    others: int = 300  # further rows of one class in the batch: enough to change any mean
    cells: int = 4  # of a batch on a cut domain, including extreme coordinates and parameters
    points: int = 4  # of each of these cells: a form that mixes points differs at nearly all
    functions: int = 4  # of the element on these cells
    rounding: float = 1e-11  # relative to the sum of moduli: vector instructions reorder sums


TRIED = _Tried()


def not_pointwise(why: str) -> NotSupported:
    """The error of a form that fails on some cells or does not act point by point."""
    return NotSupported(f"the form does not act point by point: {why}")


class Rows(Protocol):
    """Protocol of integrands of entries of the local tensors of classes of cells."""

    def prepare(self, classes: Integers) -> None:
        """Prepare the evaluation in these classes."""
        ...

    def densities(self, classes: Integers, entry: Integers) -> Array:
        """Return the integrands, shape (rows, points), from one call of the form."""
        ...


class _Batch(NamedTuple):
    classes: Integers
    entries: Integers


def check_pointwise(
    rows: Rows, found: Array, sizes: Sequence[int], coefficients: Array, cells: int
) -> None:
    """Compute chosen entries again, in batches that differ in their cells, order and length.
    A form that uses a statistic of the cells (maximum, mean, order, number) then gives other
    numbers. No batch has the length `cells`, so that captured arrays do not fit."""
    rng = np.random.default_rng(0)
    chosen, extreme = _chosen(coefficients, rng)
    rows.prepare(chosen)
    entries = _entries(sizes, rng)
    with np.errstate(all="ignore"):  # statistics of equal numbers divide by zero
        for batch in _batches(chosen, extreme, entries, rng):
            if len(batch.classes) == cells:
                batch = _Batch(*(np.append(part, part[-1]) for part in batch))
            density = rows.densities(*batch)
            size = np.abs(density).sum(axis=1).max()
            there = found[batch.classes, batch.entries]
            if not np.allclose(
                density.sum(axis=1), there, rtol=0, atol=TRIED.rounding * size, equal_nan=True
            ):
                raise not_pointwise(
                    "it gives other numbers for a cell among other cells, as a reduction over the "
                    "cells does"
                )


def _chosen(coefficients: Array, rng: np.random.Generator) -> tuple[Integers, Integers]:
    """Return the classes to compute again, and those with extreme coefficients."""
    classes = coefficients.shape[1]
    varying = coefficients[np.ptp(coefficients, axis=1) > 0] if coefficients.size else coefficients
    extreme = np.array([varying.argmin(axis=1), varying.argmax(axis=1)]).T.ravel()
    extreme = extreme[np.sort(np.unique(extreme, return_index=True)[1])][: TRIED.classes]
    more = rng.permutation(classes)[: max(2, TRIED.classes - extreme.size)]
    return np.unique(np.append(extreme, more if varying.size else more[:2])), extreme


def _entries(sizes: Sequence[int], rng: np.random.Generator) -> Integers:
    """Return entries on the diagonal of a local matrix, and others."""
    count = int(np.prod(sizes))
    diagonal = rng.permutation(min(sizes))[: TRIED.entries // 2] * (sizes[0] + 1)
    return np.append(
        diagonal if len(sizes) == 2 else [], rng.permutation(count)[: TRIED.entries]
    ).astype(int)


def _batches(
    chosen: Integers, extreme: Integers, entries: Integers, rng: np.random.Generator
) -> Iterator[_Batch]:
    one = np.ones(3, dtype=int)
    for entry in entries[:2]:
        yield _Batch(chosen[0] * one, entry * one)
    for label in chosen:
        yield _Batch(np.full(entries.size, label), entries)
    everything = _Batch(np.repeat(chosen, entries.size), np.tile(entries, chosen.size))
    yield _Batch(everything.classes[::-1], everything.entries[::-1])
    for label in extreme:
        others = np.full(TRIED.others, label)
        order = rng.permutation(everything.classes.size + TRIED.others)
        yield _Batch(
            np.append(everything.classes, others)[order],
            np.append(everything.entries, entries[rng.integers(entries.size, size=TRIED.others)])[
                order
            ],
        )
