"""Local matrices and vectors of a few cells, with all entries from one call of the form."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from numbers import Number
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray
from skfem import MeshHex, MeshQuad
from skfem.element import (
    DiscreteField,
    Element,
    ElementComposite,
    ElementDG,
    ElementGlobal,
    ElementVector,
)
from skfem.mapping import MappingAffine, MappingIsoparametric

from skfem_adini.assembly.congruence_classes import Classes
from skfem_adini.assembly.form_parameters import FormParameters
from skfem_adini.assembly.pointwise_check import check_pointwise, not_pointwise
from skfem_adini.elements.element_hex_adini import ElementHexAdini
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.element_quad_bfs import ElementQuadBFS
from skfem_adini.errors import InputError, NotSupported

Array = NDArray[Any]
Integers = NDArray[np.integer]


class _Limits(NamedTuple):  # sizes of calls of a form
    points: int = 2**15  # quadrature points of a call: arrays of 256 kB stay in the L2 cache
    values: int = 2**20  # functions x cells x points prepared at a time: 8 MB a component
    cells: int = 256  # from so many cells on, each entry has a separate call without gathering
    classes: int = 4  # number for each shape from which on the form is separated into terms


LIMITS = _Limits()


# Value, gradient, ... of all functions, (..., functions * cells, points), for each component.
Fields = list[list[Array | None]]


@dataclass(frozen=True)
class Space:
    """Shape functions of an element in the cells, with a quadrature rule."""

    element: Any
    mapping: Any
    X: Array  # reference points, shape (dim, points)
    W: Array  # weights, shape (points,)

    def on(self, cells: Integers) -> tuple[Any, Integers]:
        """Return a new mapping for some cells, without cached values, and their numbers in it.
        Straight quadrilaterals and bricks get a separate mesh, because their mapping and the
        elements of this package compute on the whole mesh first."""
        mesh = self.mapping.mesh
        if isinstance(self.mapping, MappingAffine):
            return MappingAffine(mesh, tind=cells), cells
        if type(mesh) in (MeshQuad, MeshHex) and not oriented(self.element):
            p = mesh.doflocs
            used, t = np.unique(mesh.t[:, cells], return_inverse=True)
            # Elements scale their rounding tolerance by the largest coordinate: keep its vertex.
            far = np.abs(p).max(axis=0).argmax()
            mesh = type(mesh)(p.take(np.append(used, far), axis=1), t.reshape(-1, len(cells)))
            mesh.part_of = self.mapping.mesh  # messages in the log are issued once for these cells
            cells = np.arange(len(cells))
        return MappingIsoparametric(mesh, self.mapping.elem, self.mapping.bndelem), cells

    def measures(self, cells: Integers) -> Array:
        """Return the weights of the quadrature points, shape (cells, points)."""
        return self._measures(cells, *self.on(cells))

    def _measures(self, cells: Integers, mapping: Any, own: Integers) -> Array:
        try:
            with np.errstate(divide="ignore", invalid="ignore"):
                volume = np.abs(mapping.detDF(self.X, tind=own))
        except Exception as error:  # scikit-fem has no separate error type for a zero determinant
            raise InputError(f"mesh: a cell is degenerate ({error})") from error
        if not (volume > 0).all():
            bad = cells[~(volume > 0).all(axis=1)]
            raise InputError(f"mesh: cell {bad[0]} has no volume")
        return volume * self.W

    def fields(self, cells: Integers, functions: int) -> Fields:
        """Return the shape functions in some cells."""
        mapping, cells = self.on(cells)
        return _fields(self.element, mapping, self.X, cells, functions)

    def functions(
        self, cells: Integers, count: int
    ) -> tuple[Array, list[tuple[DiscreteField, ...]]]:
        """Return the weights and the shape functions one by one, as in scikit-fem."""
        mapping, own = self.on(cells)
        dx = self._measures(cells, mapping, own)
        if isinstance(mapping, MappingIsoparametric):
            twin = MappingIsoparametric(mapping.mesh, mapping.elem, mapping.bndelem)
            twin._cache = mapping._cache  # Jacobians, of `dx`
            inverses: list[Array] = []

            def inverse(X: Array, tind: Integers | None = None) -> Array:
                if not inverses:  # once for all functions, whose other derivatives are not used
                    inverses.append(twin.invDF(X, tind))
                return inverses[0]

            mapping.invDF = inverse
        found = [self.element.gbasis(mapping, self.X, i, tind=own) for i in range(count)]
        for field in (field for each in found for field in each):
            for part in (field, *vars(field).values()):
                if isinstance(part, np.ndarray):
                    locked(part)
        return dx, found


class Coefficients(NamedTuple):
    """The parameters of a form."""

    numbers: dict[str, Any]  # those that are the same for all cells
    fields: dict[str, list[Array | None]]  # field and derivatives, (..., cells, points or 1)
    withheld: set[str]  # names of those that vary inside a cell


def local_tensors(
    form: Any,
    spaces: Sequence[Space],
    sizes: Sequence[int],
    shapes: Classes,
    classes: Classes,
    cells: Integers,
    coefficients: Coefficients,
) -> Array:
    """Return the local tensor of each class, shape (classes, test functions(, trial functions)).
    `shapes` partition the cells by shape, `classes` by shape and coefficients; `spaces` and
    `sizes` hold the trial space, for bilinear forms, and then the test space."""
    rows = _Rows(form, spaces, sizes, shapes, classes, cells, coefficients)
    local = np.zeros((len(classes.representatives), *reversed(sizes)), dtype=form.dtype)
    flat = local.reshape(len(local), -1)

    def check() -> None:
        check_pointwise(rows, flat, sizes, rows.coefficients_of_classes(), len(cells))

    if coefficients.fields and len(local) >= LIMITS.classes * len(shapes.representatives):
        try:
            rows.combine(flat)
            check()
            return local
        except NotSupported:
            pass  # the form mixes cells, or its coefficients enter otherwise
    for some, entries, density in rows.all_densities():
        flat[some, entries] = np.sum(density, axis=1)
    check()
    return local


class _Rows:
    """Integrands of chosen entries of the local tensors of chosen classes."""

    def __init__(
        self, form: Any, spaces: Sequence[Space], sizes: Sequence[int], shapes: Classes,
        classes: Classes, cells: Integers, coefficients: Coefficients,
    ) -> None:  # fmt: skip
        self._form, self._spaces, self._sizes = form, spaces, sizes
        self._cells, self._coefficients, self._shapes = cells, coefficients, shapes
        self._of_shapes, self._of_classes = shapes.representatives, classes.representatives
        self.shape_of = shapes.labels[classes.representatives]
        self._entries = int(np.prod(sizes))
        self._needed: Integers = np.empty(0, dtype=int)

    def coefficients_of_classes(self) -> Array:
        """Return the coefficients as numbers, shape (numbers, classes)."""
        numbers = [np.zeros((0, len(self._of_classes)))]
        for parts in self._coefficients.fields.values():
            for part in parts:
                if part is not None:
                    chosen = part[..., self._of_classes, 0].reshape(-1, len(self._of_classes))
                    numbers += [chosen.real, chosen.imag] if np.iscomplexobj(chosen) else [chosen]
        return np.concatenate(numbers)

    def combine(self, flat: Array) -> None:
        """Write the local tensors as combinations of terms from a symbolic call of the form."""
        numbers, fields, withheld = self._coefficients
        symbols = {
            name: CellNumbers(parts[0][..., self._of_classes, 0])
            for name, parts in fields.items()
            if parts[0] is not None
        }
        known = Coefficients(numbers | symbols, {}, withheld)
        shapes = _Rows(
            self._form, self._spaces, self._sizes, self._shapes, self._shapes, self._cells, known
        )
        terms: list[tuple[Any, Array]] = []
        for some, entries, density in shapes.all_densities():
            found = of_integrand(density).terms
            if not terms:
                size = len(self._of_shapes), self._entries
                terms = [(c, np.zeros(size, dtype=a.dtype)) for c, a in found]
            if len(terms) != len(found):
                raise not_pointwise("its terms are not the same for all entries")
            for (_, table), (_, a) in zip(terms, found, strict=True):
                table[some, entries] = np.sum(a, axis=1)
        step = max(1, LIMITS.points // self._entries)
        for begin in range(0, len(flat), step):
            part = slice(begin, begin + step)
            shape = self.shape_of[part]
            flat[part] = sum(
                table[shape] * (c if np.ndim(c) == 0 else c[part, None]) for c, table in terms
            )

    def all_densities(self) -> Iterator[tuple[Integers, Any, Any]]:
        """Yield classes, entries and their integrands, until all entries are done."""
        points = self._spaces[0].W.size
        order = np.argsort(self.shape_of, kind="stable")
        step = max(1, LIMITS.points // points)
        if min(step, len(order)) >= LIMITS.cells:
            for some in _pieces(order, step, len(self._cells)):
                yield from self._entry_by_entry(some)
            return
        step = max(1, LIMITS.values // (max(self._sizes) * points))
        for begin in range(0, len(order), step):
            some = order[begin : begin + step]
            self.prepare(some)
            for rows in _batches(
                len(some), self._entries, max(1, LIMITS.points // points), len(self._cells)
            ):
                member, entries = np.divmod(rows, self._entries)
                yield some[member], entries, self.densities(some[member], entries)

    def _entry_by_entry(self, some: Integers) -> Iterator[tuple[Integers, int, Any]]:
        """Yield all entries of some classes, each from a separate call, as scikit-fem does."""
        needed, place = np.unique(self.shape_of[some], return_inverse=True)
        at = self._cells[self._of_shapes[needed]]
        one_each = len(needed) == len(some)  # and then in this order
        found = {
            id(space): space.functions(at, n)
            for space, n in zip(self._spaces, self._sizes, strict=True)
        }
        dx = found[id(self._spaces[0])][0]
        functions: list[Any] = [found[id(space)][1] for space in self._spaces]
        if not one_each:
            dx = dx[place]
            functions = [
                [[_at(_wide(f, len(at)), place) for f in each] for each in one] for one in functions
            ]
        w = self._parameters(some)
        for entry in range(self._entries):
            indices = (entry,) if len(functions) == 1 else divmod(entry, self._sizes[0])[::-1]
            arguments = [
                field for one, i in zip(functions, indices, strict=True) for field in one[i]
            ]
            yield some, entry, _density(self._form, arguments, w, dx)

    def prepare(self, classes: Integers) -> None:
        """Evaluate the functions in the cells of some classes."""
        needed = np.unique(self.shape_of[classes])
        if np.array_equal(needed, self._needed):
            return
        at = self._cells[self._of_shapes[needed]]
        spaces, sizes = self._spaces, self._sizes
        self._dx = spaces[0].measures(at)
        self._fields = [spaces[0].fields(at, sizes[0])]
        if len(spaces) == 2:
            same = spaces[1] is spaces[0]
            self._fields.append(self._fields[0] if same else spaces[1].fields(at, sizes[1]))
        self._needed = needed

    def densities(self, classes: Integers, entry: Integers) -> Any:
        """Return integrand times weight of each (class, number of the entry), shape (rows, points).
        The form is called once; the classes must be among those prepared."""
        # Entries are numbered row by row: rows are test functions, columns trial functions.
        indices = (entry,) if len(self._sizes) == 1 else np.divmod(entry, self._sizes[0])[::-1]
        place = np.searchsorted(self._needed, self.shape_of[classes])
        arguments = [
            argument
            for field, index in zip(self._fields, indices, strict=True)
            for argument in rows_of(field, index * len(self._needed) + place)
        ]
        return _density(self._form, arguments, self._parameters(classes), self._dx[place])

    def _parameters(self, classes: Integers) -> FormParameters:
        values = self._of_classes[classes]
        fields = self._coefficients.fields.items()
        return FormParameters(
            self._coefficients.numbers | {name: _at(parts, values) for name, parts in fields},
            self._coefficients.withheld,
        )


def _density(form: Any, arguments: list[Any], w: FormParameters, dx: Array) -> Any:
    try:
        density = form.form(*arguments, w) * dx
    except Exception as error:
        raise w._refused or not_pointwise(repr(error)) from error
    if w._refused:
        raise w._refused
    separated = isinstance(density, Separated)
    shape = density.shape if separated else np.shape(density)
    if shape != dx.shape:
        raise not_pointwise(f"it returned an array of shape {shape}")
    return density if separated else np.asarray(density)


def _pieces(order: Integers, step: int, cells: int) -> Iterator[Integers]:
    """Yield parts of about equal size, none with as many members as there are cells."""
    count = max(-(-len(order) // step), 1 + (len(order) == cells))
    yield from np.array_split(order, count)


def _batches(members: int, entries: int, step: int, cells: int) -> Iterator[Integers]:
    """Yield the numbers of entries to compute together, never as many as there are cells.
    A form that reads an array over the cells from outside its arguments then fails by its shape."""
    for begin in range(0, members * entries, step):
        batch = np.arange(begin, min(begin + step, members * entries))
        yield np.append(batch, batch[-1]) if len(batch) == cells != 1 else batch


def _fields(element: Any, mapping: Any, X: Array, cells: Integers, functions: int) -> Fields:
    if type(element) is ElementVector:
        dim = element.dim
        inner = _fields(element.elem, mapping, X, cells, functions // dim)[0]
        return [[None if part is None else _vectors(part, dim, len(cells)) for part in inner]]
    basis = [element.gbasis(mapping, X, i, tind=cells) for i in range(functions)]
    found: Fields = []
    for component in zip(*basis, strict=True):
        parts: list[Array | None] = []
        for several in zip(*(field.astuple for field in component), strict=True):
            if several[0] is None:
                parts.append(None)
                continue
            last = (len(cells), X.shape[1])
            wide = [np.broadcast_to(part, (*part.shape[:-2], *last)) for part in several]
            stacked = np.stack(wide, axis=-3)
            parts.append(stacked.reshape(*stacked.shape[:-3], -1, last[1]))
        found.append(parts)
    return found


def _vectors(part: Array, dim: int, cells: int) -> Array:
    """Return the vector fields e_n phi for all functions phi and components n, n fastest."""
    split = part.reshape(*part.shape[:-2], -1, 1, cells, part.shape[-1])
    shape = (dim, *split.shape[:-3], dim, *split.shape[-2:])
    vectors = np.zeros(shape, dtype=part.dtype)
    for n in range(dim):
        vectors[n, ..., n : n + 1, :, :] = split
    return vectors.reshape(dim, *part.shape[:-2], -1, part.shape[-1])


def rows_of(fields: Fields, rows: Integers) -> list[DiscreteField]:
    """Return functions in cells, chosen by their row numbers, as a form receives them."""
    return [
        DiscreteField(
            *(None if part is None else locked(part.take(rows, axis=-2)) for part in parts)
        )
        for parts in fields
    ]


def _wide(field: DiscreteField, cells: int) -> list[Array | None]:
    """Return the parts of a function with an axis of all cells."""
    return [
        None if p is None else np.broadcast_to(p, (*p.shape[:-2], cells, p.shape[-1]))
        for p in field.astuple
    ]


def _at(parts: Sequence[Array | None], cells: Integers) -> DiscreteField:
    """Return a coefficient in the cells of a batch."""
    return DiscreteField(
        *(
            None if part is None else locked(np.ascontiguousarray(part[..., cells, :]))
            for part in parts
        )
    )


def locked(part: Array) -> Array:
    """Make an array read-only: scikit-fem would pass what a form writes there to its next call."""
    part.flags.writeable = False
    return part


def leaves(element: Any) -> list[Any]:
    """Return the elements that an element is composed of, itself if it is not composed."""
    if type(element) in (ElementVector, ElementDG):
        return leaves(element.elem)
    if type(element) is ElementComposite:
        return [leaf for part in element.elems for leaf in leaves(part)]
    return [element]


def why_not_element(element: Any) -> str | None:
    """Return why an element's functions may depend on more than shape and orientation, or None.
    Elements of scikit-fem use only the mapping's derivative and ``orient``, except for global
    functionals; the ``gbasis`` of another package may use anything."""
    ours = ElementQuadAdini, ElementHexAdini, ElementQuadBFS
    for leaf in leaves(element):
        author = type(leaf).gbasis.__module__
        known = type(leaf) in ours or author.startswith("skfem.element.")
        if not known or isinstance(leaf, ElementGlobal) or "gbasis" in vars(leaf):
            return f"functions of {type(leaf).__name__} may depend on the place of a cell"
    return None


def why_not_mapping(mapping: Any, mesh: Any) -> str | None:
    """Return why a mapping may depend on more than differences of a cell's nodes, or None."""
    standard = type(mapping) in (MappingAffine, MappingIsoparametric)
    if not standard or getattr(mapping, "tind", None) is not None:
        return f"the mapping is a {type(mapping).__name__} that is not the usual one"
    if mapping.mesh is not mesh and mapping.mesh.t.shape[1] != mesh.t.shape[1]:
        return "the mapping has other cells than the mesh"
    return None


def oriented(element: Any) -> list[Any]:
    """Return the leaves whose functions depend on the orientation of facets or edges."""
    return [leaf for leaf in leaves(element) if type(leaf).orient is not Element.orient]


def orientations(elements: Iterable[Any], mapping: Any) -> NDArray[np.uint64]:
    """Return the signs of the facets or edges of each cell as bits, shape (cells, words)."""
    signs = [
        np.asarray(leaf.orient(mapping, i)) > 0
        for element in elements
        for leaf in oriented(element)
        for i in range(int(leaf._bfun_counts().sum()))
    ]
    words = np.zeros((mapping.mesh.t.shape[1], -(-len(signs) // 64)), dtype=np.uint64)
    for i, sign in enumerate(signs):
        words[:, i // 64] |= sign.astype(np.uint64) << np.uint64(i % 64)
    return words


# Integrands of forms as sums of products: a number of each cell times what the cells share.
#
# A form with a coefficient k that is constant in each cell often is
#
# .. math:: a(u, v; k) = \sum_m c_m(k) \, a_m(u, v).
#
# Then the local matrices of congruent cells are combinations of those of the :math:`a_m`. Here the
# form itself shows these terms: it is called with a `CellNumbers` for each coefficient, which
# computes operations of the form on coefficients alone, such as k**3, 1 / k or a threshold, for
# all cells, and becomes a `Separated` where it meets a function. Nothing is guessed from values;
# any other operation raises `NotSupported`.


Term = tuple[Any, Array]  # number of each cell, or 1.0; an array over (..., rows, points)


def _refuse(*_: Any, **__: Any) -> NoReturn:
    raise NotSupported


class _Symbol(NDArrayOperatorsMixin):
    """Base of `CellNumbers` and `Separated`, which are no arrays, truth values or lists."""

    __array__ = __bool__ = __len__ = __contains__ = __setitem__ = __float__ = _refuse

    def __getattr__(self, name: str) -> Any:
        raise NotSupported(name)


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
        if len(terms) > 16:  # they would cost about as much as the integrand at all points
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
    """Return the result of a form as a sum of products."""
    return _terms(density)


def _values(each: Any) -> Any:
    return each.values if isinstance(each, CellNumbers) else each


def _leading(key: Any, axes: int) -> Any:
    """Return an index for leading axes only, not for cells or points."""
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
