"""A layered block with a mesh: in space, between periodic sides, or of another element."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import MeshHex, MeshQuad

from contact.body.elastic_body import ElasticBody
from contact.body.layers.lateral_sides import Sides, odd_unknowns, of_both, read_sides
from contact.body.layers.layers import (
    Layer,
    flat_plane,
    named_by_place,
    read_columns,
    read_layers,
    read_lengths,
)
from contact.body.rigid_modes import dof_kinds
from contact.errors import InputError
from skfem_adini import ElementQuadAdini
from skfem_adini.ground.arguments import numbers


class MeshedBlock(ElasticBody):
    """The `ElasticBody` that `LayeredBlock` makes if it needs a mesh, with lateral transforms.
    Contact on its "bottom" is condensed by transforms where its sides allow it, else by a sparse
    factorisation. In space "front" is y = 0 and "back" opposite."""

    widths: tuple[float, ...]  # in the lateral directions
    cells: tuple[int, ...]  # cells in the lateral directions
    layers: list[Layer]
    sides: Any  # as given to `LayeredBlock`, like path
    path: str | None
    lateral: Sides | None  # side conditions that transforms diagonalise, if any
    _made_of: Any  # material of the layers as passed

    def __repr__(self) -> str:
        size = " x ".join(map(str, (*self.cells, sum(layer.cells for layer in self.layers))))
        name = type(self.element).__name__
        return f"LayeredBlock({self.dim}-D, {size} cells, {self.f.size} unknowns of {name})"

    def elastic(self) -> ElasticBody:
        """The same body without transforms, to be condensed by a sparse factorisation."""
        plain = ElasticBody.__new__(ElasticBody)
        own = set(MeshedBlock.__annotations__)
        plain.__dict__.update({k: v for k, v in vars(self).items() if k not in own})
        plain.f = self.f.copy()
        return plain


def meshed_block(
    lengths: Any,
    layers: Any,
    sides: Any,
    top: str | None,
    columns: Any = None,
    *,
    plane: str | None = "strain",
    cells: Any,
    element: Any,
    path: str | None,
) -> MeshedBlock:
    """The block with a mesh; arguments as for `LayeredBlock`."""
    if columns is not None and cells is not None:
        raise InputError(f"columns={columns!r}: cells={cells!r} says the same; leave it out")
    found = read_layers(layers)
    widths, count = _read_grid(lengths, columns if cells is None else cells, found)
    dim = len(widths) + 1
    flat_plane(plane, dim)
    lateral = _read_lateral(sides, dim, path)
    kind = MeshQuad if dim == 2 else MeshHex
    mesh, of = meshed(kind, widths, count, found)
    if element is None:
        element = ElementQuadAdini() if dim == 2 else kind.elem()
    E, nu = (np.array([getattr(layer, key) for layer in found])[of] for key in ("E", "nu"))
    body = MeshedBlock.from_mesh(mesh, element, E=E, nu=nu, plane=plane if dim == 2 else "strain")
    body.widths, body.cells, body.layers = widths, count, found
    body.sides, body.path, body.lateral = sides, path, lateral
    body._made_of = body._material
    if top is not None:
        body.fix("top", top)
    if lateral is not None and path == "fourier":
        supported(body, lateral)
    else:
        _support(body, sides)
    return body


def _support(body: MeshedBlock, sides: Any) -> None:
    """Fix or tie the sides, without the derivatives that vanish by symmetry."""
    for entry, count in zip(
        (sides,) if isinstance(sides, str) else sides or (), body.cells, strict=False
    ):
        if entry == "periodic" and count < 2:
            raise InputError(f"cells={count}: expected two or more along periodic sides")
    if body.dim == 2 and sides not in ("periodic", ["periodic"], ("periodic",)):
        pair = sides if isinstance(sides, tuple | list) else (sides, sides)
        if len(pair) != 2:
            raise InputError(f"sides={sides!r}: expected components, None, or a pair of these")
        if "periodic" in pair:
            raise InputError(f"sides={sides!r}: 'periodic' is said of both sides at once")
        for name, components in zip(SIDES[0], pair, strict=True):
            if components is not None:
                body.fix(name, components)
        return
    entries = (sides,) * (body.dim - 1) if sides is None or sides == "periodic" else sides
    if not isinstance(entries, tuple | list) or len(entries) != body.dim - 1:
        raise InputError(f"sides={sides!r}: expected 'periodic', None, or an entry for each of the "
                         "directions x and y, such as ('periodic', 'y')")  # fmt: skip
    for names, components in zip(SIDES, entries, strict=False):
        if components is not None and components != "periodic":
            body.fix(list(names), components)
    for names, components in zip(SIDES, entries, strict=False):
        if components == "periodic":
            body.periodic(names[1], names[0])


def _read_lateral(sides: Any, dim: int, path: str | None) -> Sides | None:
    try:
        return read_sides(of_both(sides) if dim == 2 else sides, dim)
    except InputError:
        if path == "fourier":
            raise
        return None


def _read_grid(lengths: Any, cells: Any, layers: list[Layer]) -> tuple[Any, tuple[int, ...]]:
    given = numbers("lengths", lengths)
    try:
        count = np.atleast_1d(1 if cells is None else cells)
    except ValueError:  # sequences of unequal length
        count = np.zeros(0)
    if count.shape not in ((1,), (2,)) or count.dtype.kind not in "iu" or np.any(count < 1):
        raise InputError(f"cells={cells!r}: expected a whole number, or two in space")
    if count.size == 1:
        width, _ = read_lengths(lengths, layers)
        return (width,), (read_columns(cells, width, layers[0]),)
    if given.shape != (2,) or not np.all(np.isfinite(given) & (given > 0)):
        raise InputError(f"lengths={lengths!r}: expected two positive numbers, the widths along x "
                         "and y")  # fmt: skip
    return tuple(given.tolist()), tuple(map(int, count))


SIDES = (("left", "right"), ("front", "back"))  # across x and across y


def meshed(
    kind: Any, lengths: Sequence[float], shape: Sequence[int], layers: Sequence[Layer]
) -> tuple[Any, NDArray[np.int64]]:
    """Tensor mesh with the boundaries "bottom", "top" and those of `SIDES`, and the layer of
    each cell."""
    dim = len(lengths) + 1
    ticks = [np.linspace(0, length, n + 1) for length, n in zip(lengths, shape, strict=True)]
    levels = np.concatenate(
        [
            np.linspace(layer.bottom, layer.bottom + layer.height, layer.cells + 1)[k > 0 :]
            for k, layer in enumerate(layers)
        ]
    )
    mesh = kind.init_tensor(*ticks, levels)
    ends = {"bottom": (dim - 1, 0.0), "top": (dim - 1, levels[-1])}
    for axis, length in enumerate(lengths):
        ends |= {SIDES[axis][0]: (axis, 0.0), SIDES[axis][1]: (axis, length)}
    mesh = named_by_place(mesh, ends)
    middle = mesh.p[-1][mesh.t].mean(axis=0)
    tops = [layer.bottom + layer.height for layer in layers[:-1]]
    return mesh, np.searchsorted(tops, middle)


def supported(body: ElasticBody, sides: Sides) -> None:
    """Tie the sides of a body on such a mesh, or fix the unknowns that are odd about them."""
    nodal = body.basis.nodal_dofs
    odd = odd_unknowns(sides, np.asarray(dof_kinds(body.basis)[nodal[:, 0]]))
    vanishing = np.zeros(body.basis.N, dtype=bool)
    for axis, (fixed, parity) in enumerate(zip(sides, odd, strict=True)):
        if parity is not None:
            for component in fixed or ():
                body.fix(list(SIDES[axis]), "xyz"[component])
            place = body.mesh.p[axis]
            ends = np.abs(place - np.mean(place)) > (0.5 - 1e-9) * np.ptp(place)
            vanishing[nodal[np.ix_(parity, ends)]] = True
    left = np.flatnonzero(vanishing & (np.diff(body.constraint[0].indptr) > 0))
    for axis, fixed in enumerate(sides):
        if fixed is None:
            body.periodic(SIDES[axis][1], SIDES[axis][0])
    if left.size:
        body.constrain(sparse.eye_array(body.basis.N, format="csr")[left])
