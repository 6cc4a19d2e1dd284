"""Fast assembly: one local matrix for all congruent cells, scattered by a compiled kernel."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from skfem import BilinearForm, CellBasis, LinearForm, Mesh, MeshHex, MeshQuad, asm
from skfem.assembly.basis.abstract_basis import AbstractBasis
from skfem.assembly.form.form import Form
from skfem.element import DiscreteField, Element
from skfem.mapping import MappingAffine
from skfem.quadrature import get_quadrature

from skfem_adini.assembly.congruence_classes import Classes, any_alike, congruence_classes
from skfem_adini.assembly.csr_scatter import scatter_matrix, scatter_vector
from skfem_adini.assembly.dof_blocks import DofBlocks
from skfem_adini.assembly.form_parameters import (
    checked,
    constant_parts,
    wide_field,
    words_of,
)
from skfem_adini.assembly.local_tensors import (
    Coefficients,
    Space,
    local_tensors,
    locked,
    orientations,
    why_not_element,
    why_not_mapping,
)
from skfem_adini.errors import InputError, NotSupported
from skfem_adini.ground.arguments import integer

Integers = NDArray[np.integer]

_log = logging.getLogger(__name__)


class _Cells(NamedTuple):  # numbers of cells
    few: int = 9  # up to so many cells, an array over cells may also be a tensor of 3 x 3 numbers
    sample: int = 512  # compared first: if no two are equal, the others are not compared


CELLS = _Cells()


def assemble(
    form: Any,
    mesh: Any,
    element: Any = None,
    test_element: Any = None,
    *,
    mapping: Any = None,
    intorder: int | None = None,
    quadrature: Any = None,
    elements: Any = None,
    fallback: bool = True,
    verbose: bool = False,
    **parameters: Any,
) -> Any:
    r"""Return what ``skfem.asm(form, Basis(mesh, element))`` returns, without building that basis.

    The local matrix

    .. math:: A^T_{ij} = \int_T a(\phi_j, \phi_i; w) \, dx

    of a form whose integrand does not depend on the position depends on the cell T only through
    its shape, the orientation of its facets (for the elements that have one) and the coefficients
    in it. It is computed once for all cells that agree in these, up to the rounding of coordinates,
    and added into the rows of the global matrix by a compiled kernel that needs no sorting. A form
    :math:`\sum_m c_m(k) \, a_m(u, v)` of a coefficient k that is constant in each cell costs one
    local matrix for each term and shape, and a scaling for each cell.

    Parameters
    ----------
    form
        `skfem.BilinearForm` or `skfem.LinearForm`, or a function (u, v, w) or (v, w).
    mesh
        Any scikit-fem mesh, or an existing basis of cells; a second basis, that of the test
        functions, may then take the place of `element`.
    element
        Element of the trial functions (of a linear form: of the test functions).
    test_element
        Element of the test functions, if another one.
    mapping, intorder, quadrature, elements
        As for `skfem.Basis`; not together with a basis. For two elements the default order of
        integration is twice the larger `maxdeg`.
    fallback
        Let scikit-fem assemble what this function cannot (below). False raises instead, with the
        reason; use it to see that a form takes the fast path.
    verbose
        Print one line that says how the result was assembled. The same line goes to the logger
        ``skfem_adini.assembly`` on level DEBUG.
    **parameters
        Handed to the form as ``w.name``: numbers; fields over (..., cells, points), as for
        `skfem.asm`, where a single number may stand for all points; vectors with a number for
        each cell, which the form receives at all quadrature points; vectors of dofs, which
        scikit-fem interpolates. (If there are as many cells as dofs, a vector means dofs.)

    Returns
    -------
    csr_matrix or ndarray
        Matrix (test dofs, trial dofs) in canonical form, or load vector, with the type of number of
        the form. As with scikit-fem, entries to which only zeros contribute are left out.

    Raises
    ------
    InputError
        No mesh, element or form; NaN or infinity in coordinates or parameters; parameters with
        wrong shapes; degenerate cells; with ``fallback=False`` a form or mesh that needs
        scikit-fem.

    Notes
    -----
    scikit-fem assembles instead if the form uses ``w.x``, ``w.h``, ``w.idx`` or a field that is
    not constant in each cell; for elements that are not translation invariant, such as
    `skfem.ElementGlobal`, or whose ``gbasis`` neither scikit-fem nor this package wrote; for other
    forms, mappings and bases than the standard ones, and lists of bases.

    As in scikit-fem, a form must act on each quadrature point alone, or on the points of each cell.
    It is called on batches whose number of cells differs from that of the mesh, so an array over
    the cells that the form has captured, instead of receiving it as a parameter, has the wrong
    shape and leads to the slow path. So does a form whose values in a cell depend on the other
    cells, as with ``w.k / w.k.max()``: `pointwise_check` computes some entries again in batches of
    other cells.

    Cells are congruent if the differences of their coordinates agree within
    ``8 eps min(max|x|, 1024 a)``, where a is the height of a cell; all cells of a class get the
    local matrix of its first. Apart from the order of summation this is the only difference to
    `skfem.asm`, whose Jacobians have rounding errors of ``eps |x| / a`` themselves. It is below
    1e-14 of the largest entry if the coordinates do not exceed about 30 cell widths, and always
    below 1e-11 for cells that are not needles.

    If fewer than half of the cells are alike, nothing is gained, and scikit-fem assembles. With
    ``fallback=False`` every cell then is a class of its own, and cells are taken in batches.

    Examples
    --------
    >>> import numpy as np
    >>> from skfem import MeshQuad
    >>> from skfem.models.poisson import laplace
    >>> from skfem_adini import ElementQuadAdini, assemble
    >>> mesh = MeshQuad.init_tensor(np.linspace(0, 1, 65), np.linspace(0, 1, 65))
    >>> K = assemble(laplace, mesh, ElementQuadAdini())
    >>> K.shape
    (12675, 12675)

    A coefficient for each cell:

    >>> from skfem import BilinearForm
    >>> k = np.where(mesh.p[0, mesh.t].mean(axis=0) < 0.5, 1.0, 10.0)
    >>> form = BilinearForm(lambda u, v, w: w.k * (u.grad * v.grad).sum(axis=0))
    >>> K = assemble(form, mesh, ElementQuadAdini(), k=k, fallback=False)
    """
    form = _form(form)
    bases: list[Any] | None = None
    if isinstance(mesh, AbstractBasis | list):
        if any(option is not None for option in (mapping, intorder, quadrature, elements)):
            raise InputError(
                "mapping, intorder, quadrature, elements: a basis has its own; pass a mesh and "
                "elements to choose others"
            )
        bases = [basis for basis in (mesh, element, test_element) if basis is not None]
        _check_bases(bases)
    else:
        _check_mesh(mesh, element, test_element, intorder)
        if quadrature is None and test_element is not None and intorder is None:
            intorder = 2 * max(element.maxdeg, test_element.maxdeg)
    try:
        if bases is None:
            pair = [element] if test_element is None else [element, test_element]
            problem = _Problem.of_mesh(form, mesh, pair, mapping, intorder, quadrature, elements)
        else:
            problem = _Problem.of_bases(form, bases)
        result, line = problem.assemble(parameters, spare=fallback)
    except NotSupported as reason:
        line = f"assembled by scikit-fem: {reason}"
        if not fallback:
            raise InputError(f"form: needs scikit-fem, {reason}; allow fallback=True") from reason
        if bases is None:
            bases = [
                CellBasis(
                    mesh, one, mapping, intorder=intorder, elements=elements, quadrature=quadrature
                )
                for one in (element, test_element)
                if one is not None
            ]
        result = asm(form, *bases, **_for_scikit_fem(parameters, bases[0]))
    _log.debug(line)
    if verbose:
        print(line)
    return result


class _Problem:
    """A form on the cells of a mesh, with the function spaces and the blocks of dofs."""

    def __init__(
        self,
        form: Any,
        spaces: Sequence[Space],
        blocks: Sequence[DofBlocks],
        mesh: Any,
        cells: Integers | None,
    ) -> None:
        self.form, self.spaces, self.blocks, self.mesh = form, spaces, blocks, mesh
        self.some = cells
        self.cells = np.arange(mesh.t.shape[1]) if cells is None else np.asarray(cells)

    @classmethod
    def of_mesh(
        cls, form: Any, mesh: Any, pair: Sequence[Any], mapping: Any, intorder: int | None,
        quadrature: Any, elements: Any,
    ) -> _Problem:  # fmt: skip
        _check_form(form, len(pair))
        mapping = mesh.mapping() if mapping is None else mapping
        for element in pair:
            _check_invariance(element, mapping, mesh)
        if quadrature is None:
            order = 2 * pair[0].maxdeg if intorder is None else intorder
            quadrature = get_quadrature(mesh.refdom, order)
        X, W = (np.asarray(part, dtype=float) for part in quadrature)
        if X.ndim != 2 or W.shape != X.shape[1:]:
            raise InputError(
                f"quadrature: expected points (dim, n) and weights (n,), got shapes {X.shape} and "
                f"{W.shape}"
            )
        spaces = [Space(element, mapping, X, W) for element in pair]
        blocks = [DofBlocks.from_mesh(mesh, element) for element in pair]
        cells = None if elements is None else mesh.normalize_elements(elements)
        return cls(form, spaces, blocks, mesh, cells)

    @classmethod
    def of_bases(cls, form: Any, bases: Sequence[Any]) -> _Problem:
        _check_form(form, len(bases))
        first = bases[0]
        for basis in bases:
            if not isinstance(basis, CellBasis):
                raise NotSupported(f"the basis is a {type(basis).__name__}")
            _check_invariance(basis.elem, basis.mapping, basis.mesh)
            same = (basis.X, first.X), (basis.W, first.W)
            if basis.mesh is not first.mesh or not all(np.array_equal(*pair) for pair in same):
                raise NotSupported("the bases have different meshes or quadratures")
            if not np.array_equal(_cells_of(basis), _cells_of(first)):
                raise NotSupported("the bases have different cells")
        spaces = [Space(basis.elem, basis.mapping, basis.X, basis.W) for basis in bases]
        blocks = [DofBlocks.of_basis(basis) for basis in bases]
        return cls(form, spaces, blocks, first.mesh, first.tind)

    def assemble(self, parameters: dict[str, Any], spare: bool) -> tuple[Any, str]:
        """Return the result and how it was computed. With `spare`, cases in which scikit-fem is
        faster raise `NotSupported`."""
        bilinear = isinstance(self.form, BilinearForm)
        spaces = [*self.spaces, self.spaces[-1]][:2] if bilinear else self.spaces
        blocks = [self.blocks[0], self.blocks[-1]] if bilinear else self.blocks
        sizes = [int(block.local[-1]) for block in blocks]
        coefficients, words = self._coefficients(parameters, blocks[0].size)
        if len(self.cells) == 0:
            raise NotSupported("there are no cells")
        shapes = self._shapes(spare)
        classes = shapes
        if words:
            none = np.zeros((1, 0)), np.zeros((1, len(self.cells)), dtype=np.int32)
            own = [shapes.labels[:, None].astype(np.uint64), *words]
            classes = congruence_classes(*none, np.hstack(own))
        local = local_tensors(self.form, spaces, sizes, shapes, classes, self.cells, coefficients)
        rows = blocks[-1].restricted(self.some)
        columns = blocks[0].restricted(self.some)
        if bilinear:
            result = scatter_matrix(local, classes.labels, rows, columns)
        else:
            result = scatter_vector(local, classes.labels, rows)
        count = len(classes.representatives)
        return result, f"assembled from {count} classes of {len(self.cells)} cells"

    def _shapes(self, spare: bool) -> Classes:
        """Return the classes of cells with the same shape and orientation."""
        mapping = self.spaces[0].mapping
        if isinstance(mapping, MappingAffine) or type(mapping.mesh) in (MeshQuad, MeshHex):
            nodes = mapping.mesh.t
        else:
            nodes = mapping.mesh.dofs.element_dofs
        words = orientations([space.element for space in self.spaces], mapping)
        if self.some is not None:
            nodes, words = nodes[:, self.some], words[self.some]
        points, count = np.ascontiguousarray(mapping.mesh.doflocs), len(self.cells)
        unlike = "too few cells are alike"
        if spare and count > CELLS.sample:
            some = _sample(count)
            if not any_alike(points, nodes[:, some], words[some]):
                raise NotSupported(unlike)
        found = congruence_classes(points, np.ascontiguousarray(nodes), np.ascontiguousarray(words))
        if spare and count > CELLS.few and len(found.representatives) >= 0.5 * count:
            raise NotSupported(unlike)
        return found

    def _coefficients(
        self, parameters: dict[str, Any], dofs: int
    ) -> tuple[Coefficients, list[NDArray[np.uint64]]]:
        """Return the parameters by kind, and the bits of their values in each cell."""
        cells = len(self.cells)
        found = Coefficients({}, {}, {"x", "h", "idx"})
        words: list[NDArray[np.uint64]] = []
        for name, value in parameters.items():
            value = checked(name, value, cells, self.spaces[0].W.size, dofs)
            found.withheld.discard(name)
            field = isinstance(value, np.ndarray) and value.shape[-2] == cells
            if value is None:
                found.withheld.add(name)
            elif not field:
                found.numbers[name] = (
                    locked(DiscreteField(value)) if isinstance(value, np.ndarray) else value
                )
            elif cells <= CELLS.few:
                raise NotSupported(
                    f"there are too few cells to tell the field {name} from a tensor"
                )
            elif (parts := constant_parts(value, cells)) is None:
                found.withheld.add(name)
            else:
                found.fields[name] = parts
                words += [words_of(part) for part in parts if part is not None]
        return found, words


def _form(form: Any) -> Any:
    if not isinstance(form, Form) and callable(form) and hasattr(form, "__code__"):
        arguments = form.__code__.co_argcount
        if arguments in (2, 3):
            return (LinearForm if arguments == 2 else BilinearForm)(form)
    if not isinstance(form, Form) or form.form is None:
        raise InputError(
            f"form: expected a BilinearForm, a LinearForm or a function (u, v, w) or (v, w), got "
            f"{form!r}"
        )
    return form


def _check_form(form: Any, bases: int) -> None:
    if type(form) not in (BilinearForm, LinearForm):
        raise NotSupported(f"the form is a {type(form).__name__}")
    if bases > (2 if type(form) is BilinearForm else 1):
        raise InputError(f"form: a {type(form).__name__} does not take {bases} elements or bases")
    if np.dtype(form.dtype) not in (np.float32, np.float64, np.complex64, np.complex128):
        raise NotSupported(f"the form has numbers of the type {np.dtype(form.dtype)}")


def _check_bases(bases: list[Any]) -> None:
    for basis in bases:
        for one in basis if isinstance(basis, list) else [basis]:
            if not isinstance(one, AbstractBasis):
                raise InputError(
                    f"element: expected a second basis next to the first, got {type(one).__name__}"
                )


def _check_mesh(mesh: Any, element: Any, test_element: Any, intorder: Any) -> None:
    if not isinstance(mesh, Mesh):
        raise InputError(f"mesh: expected a scikit-fem mesh or basis, got {type(mesh).__name__}")
    for name, one in (("element", element), ("test_element", test_element)):
        if one is None and name == "test_element":
            continue
        if not isinstance(one, Element):
            raise InputError(f"{name}: expected a scikit-fem element, got {one!r}")
        if one.refdom is not mesh.refdom:
            raise InputError(
                f"{name}: {type(one).__name__} does not fit to the cells of {type(mesh).__name__}"
            )
    if not np.isfinite(mesh.doflocs).all():
        raise InputError("mesh: a coordinate is NaN or infinite")
    if intorder is not None:
        integer("intorder", intorder, 0)


@lru_cache
def _sample(count: int) -> Integers:
    return np.unique(np.random.default_rng(0).integers(count, size=CELLS.sample))


def _check_invariance(element: Any, mapping: Any, mesh: Any) -> None:
    reason = why_not_element(element) or why_not_mapping(mapping, mesh)
    if reason:
        raise NotSupported(reason)


def _cells_of(basis: Any) -> Integers:
    return np.arange(basis.nelems) if basis.tind is None else np.asarray(basis.tind)


def _for_scikit_fem(parameters: dict[str, Any], basis: Any) -> dict[str, Any]:
    """Return the parameters in the shapes that scikit-fem expects."""
    if isinstance(basis, list):
        basis = basis[0]
    points = basis.X.shape[-1]
    found = {}
    for name, value in parameters.items():
        field = isinstance(value, DiscreteField)
        if isinstance(value, np.ndarray) and value.ndim == 1:
            if field or len(value) == basis.nelems != basis.N:
                value = np.repeat(np.asarray(value)[:, None], points, axis=1)
        elif field and value.shape[-1] != points:
            value = DiscreteField(
                *(None if p is None else p.copy() for p in wide_field(value, points).astuple)
            )
        found[name] = value
    return found
