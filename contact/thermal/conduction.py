r"""Heat conduction in one body, with the scalar element of its displacement.

With conductivity k, heat capacity c per volume, sources Q, inflow q and convection a,

.. math::
    \int c \dot T v + \int k \nabla T \cdot \nabla v + \int_{\Gamma_a} a (T - T_a) v
    = \int Q v + \int_{\Gamma_q} q v,

integrated around the axis in a ring (H. S. Carslaw and J. C. Jaeger, Conduction of Heat in Solids,
2nd ed., Oxford 1959, chapter 1).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, BilinearForm

from contact.body.cut_body import CutBody
from contact.body.deferred_basis import dofs_on_facets
from contact.body.elastic_body import ElasticBody
from contact.body.thermal_strain import quadratic_element
from contact.body.vector_element import GRADIENT_DOFS
from contact.errors import InputError
from contact.facet_basis import facet_basis
from contact.histories.load_program import Factor, value_at
from skfem_adini import essential_constraints
from skfem_adini.ground.arguments import evaluated, numbers

Array = NDArray[np.float64]
Csr = sparse.csr_array


def steady(t: float) -> float:
    """The factor of conditions that do not vary in time."""
    return 1.0


def field_at(name: str, value: Any, x: Array, least: float = -np.inf) -> Array:
    """A number, or function of places x (dim, ...), as an array of shape x.shape[1:]."""
    found = evaluated(name, value, x)
    if found.shape not in ((), x.shape[1:]) or not np.all(np.isfinite(found)):
        raise InputError(
            f"{name}: expected a finite number, or a function of the places x that returns finite "
            f"numbers of shape x.shape[1:], got shape {found.shape}"
        )
    if np.any(found < least):
        raise InputError(f"{name}: must not be below {least:g}, got {found.min():g}")
    return np.broadcast_to(found, x.shape[1:])


@dataclass
class Conduction:
    """Matrices and conditions of heat in one body; loads come with their factors of time."""

    body: Any
    conductivity: Any
    capacity: Any
    held: list[tuple[NDArray[np.int64], Any, Factor]] = field(default_factory=list)
    loads: list[tuple[str, Array, Factor]] = field(default_factory=list)
    convective: Any = None  # matrix of the convection, shape (n, n)

    def __post_init__(self) -> None:
        if not isinstance(self.body, ElasticBody) or isinstance(self.body, CutBody):
            raise InputError(
                f"problem: heat is conducted in bodies with a mesh of their own (ElasticBody), not "
                f"in a {type(self.body).__name__}"
            )
        if any(link.name.startswith("periodic") for link in self.body._couplings):
            raise InputError(
                "problem: the temperature of a periodic body would not be periodic; model a cell "
                "whose sides are planes of symmetry, where no heat passes"
            )
        self.convective = Csr(self.stiffness.shape)

    @cached_property
    def basis(self) -> Any:
        """Basis of the temperature: the scalar element of the displacement."""
        body, element = self.body, self.body.element
        order = 2 * element.maxdeg + 2 * body.is_ring
        return Basis(body.mesh, element, body.basis.mapping, intorder=order, dofs=body.scalar_dofs)

    @cached_property
    def values(self) -> Array:
        """The dofs of temperature one everywhere: 1 for values, 0 for derivatives."""
        return np.asarray(self.body.are_values[:: self.body.dim], dtype=float)

    @cached_property
    def stiffness(self) -> Csr:
        """``int k grad T . grad v``, shape (n, n)."""
        k = self._conductivities()

        @BilinearForm
        def conducted(T: Any, v: Any, w: Any) -> Any:
            flux = np.einsum("ij...,j...->i...", k, T.grad)
            return np.sum(flux * v.grad, axis=0) * self.body.depth(np.asarray(w.x))

        return Csr(conducted.assemble(self.basis))

    @cached_property
    def mass(self) -> Csr:
        """``int c T v``, shape (n, n)."""
        x = np.asarray(self.basis.global_coordinates())
        c = field_at("capacity", self._of_cells(self.capacity), x)
        if not np.all(c > 0):
            raise InputError("capacity: expected density times specific heat, positive")

        @BilinearForm
        def stored(T: Any, v: Any, w: Any) -> Any:
            return c * T * v * self.body.depth(np.asarray(w.x))

        return Csr(stored.assemble(self.basis))

    def _of_cells(self, value: Any) -> Any:
        """One value a cell as a function of the quadrature points; anything else as it is."""
        cells = self.body.mesh.nelements
        if callable(value) or np.shape(value) != (cells,):
            return value
        return lambda x: np.broadcast_to(numbers("values", value)[:, None], x.shape[1:])

    def _conductivities(self) -> Array:
        """Tensors (dim, dim, ncells, nq), or (dim, dim, 1, 1) if constant."""
        given, dim = self.conductivity, self.body.dim
        if not callable(given) and np.shape(given) == (dim, dim):
            k = numbers("conductivity", given)
            if not np.array_equal(k, k.T) or not np.linalg.eigvalsh(k).min() > 0:
                raise InputError("conductivity: a tensor must be symmetric and positive")
            return k[..., None, None]
        x = np.asarray(self.basis.global_coordinates())
        k = field_at("conductivity", self._of_cells(given), x)
        if not np.all(k > 0):
            raise InputError("conductivity: expected positive numbers")
        return np.eye(dim)[..., None, None] * k

    def on_facets(self, boundary: Any) -> tuple[Any, Array, Array]:
        """Facet basis of a boundary, its places, and its measures."""
        body, element = self.body, self.body.element
        degree = 2 * element.maxdeg + 2 * body.is_ring
        facets = body.whole_facets(boundary)
        basis = facet_basis(body.mesh, element, facets, intorder=degree, dofs=body.scalar_dofs)
        x = np.asarray(basis.global_coordinates())
        return basis, x, np.asarray(basis.dx) * body.depth(x)

    def convect(self, boundary: Any, coefficient: Any, ambient: Any, factor: Factor) -> None:
        """Add the convection ``a (T_a - T)`` into the body."""
        basis, x, dx = self.on_facets(boundary)
        a = field_at("coefficient", coefficient, x, 0.0)
        outside = field_at("ambient", ambient, x)
        trace = trace_of(basis)
        measured = (a * dx).ravel()
        self.convective = Csr(self.convective + trace.T @ sparse.diags_array(measured) @ trace)
        self.loads.append(("convection", trace.T @ (measured * outside.ravel()), factor))

    def inflow(self, boundary: Any, flux: Any, factor: Factor) -> None:
        """Add a heat flux into the body through a boundary."""
        basis, x, dx = self.on_facets(boundary)
        flow = trace_of(basis).T @ (field_at("flux", flux, x) * dx).ravel()
        self.loads.append(("sources", flow, factor))

    def generate(self, power: Any, factor: Factor) -> None:
        """Add a heat source per volume."""
        basis = self.basis
        x = np.asarray(basis.global_coordinates())
        dx = np.asarray(basis.dx) * self.body.depth(x)
        flow = trace_of(basis).T @ (field_at("power", self._of_cells(power), x) * dx).ravel()
        self.loads.append(("sources", flow, factor))

    def load(self, kind: str, t: float) -> Array:
        """The loads of one kind at a time, shape (n,)."""
        parts = [value_at(factor, t) * flow for name, flow, factor in self.loads if name == kind]
        return np.sum([np.zeros(self.basis.N), *parts], axis=0)

    def interpolated(self, name: str, value: Any) -> Array:
        """Dofs of a given temperature, shape (n,), by projection in L2."""
        return np.asarray(self.basis.project(lambda x: field_at(name, value, np.asarray(x))))

    def prescribed(self, t: float) -> tuple[Csr, Array]:
        """P and T0 of ``T = P z + T0`` under the prescribed temperatures of a time."""
        if not self.held:
            return sparse.eye_array(self.basis.N, format="csr"), np.zeros(self.basis.N)
        if isinstance(self.body.element, GRADIENT_DOFS):
            P, T0 = essential_constraints(
                self.basis,
                [
                    (facets, _scaled(value, value_at(factor, t)))
                    for facets, value, factor in self.held
                ],
                smooth=[not callable(value) for _, value, _ in self.held],
            )
            return Csr(P), np.asarray(T0)
        T0 = np.full(self.basis.N, np.nan)
        for facets, value, factor in self.held:
            dofs = dofs_on_facets(self.basis, facets)
            found = field_at("temperature", value, self.basis.doflocs[:, dofs])
            T0[dofs] = value_at(factor, t) * found
        free = np.isnan(T0)
        unit = sparse.eye_array(self.basis.N, format="csr")
        return Csr(unit[:, free]), np.where(free, 0.0, T0)

    @cached_property
    def _at_nodes(self) -> list[Array]:
        """Functions at the nodes where the thermal strain of a cell is kept, (1 or ncells, k)."""
        X = quadratic_element(self.body).doflocs.T
        mapping, element = self.basis.mapping, self.body.element
        return [np.asarray(element.gbasis(mapping, X, i)[0]) for i in range(self.basis.Nbfun)]

    def heat(self, body: Any, change: Array, expansion: Any) -> None:
        """Add to a body the thermal strain of a change of temperature, given by dofs (n,)."""
        tables = zip(self._at_nodes, self.basis.element_dofs, strict=True)
        nodal = sum((N * change[dofs][:, None] for N, dofs in tables), start=np.zeros(()))
        body.heat(lambda x: nodal, expansion)


def trace_of(basis: Any) -> Csr:
    """Values of all functions at the quadrature points, shape (nelements * nq, n)."""
    shape = np.asarray(basis.dx).shape
    row = np.arange(shape[0] * shape[1])
    parts = [
        (np.broadcast_to(np.asarray(basis.basis[i][0]), shape).ravel(), np.repeat(dofs, shape[1]))
        for i, dofs in enumerate(basis.element_dofs)
    ]
    data, column = (np.concatenate(part) for part in zip(*parts, strict=True))
    place = np.tile(row, len(parts)), column
    return Csr(sparse.coo_array((data, place), shape=(row.size, basis.N)))


def _scaled(value: Any, factor: float) -> Any:
    """A number or function of the places times a factor."""
    return (lambda x: factor * np.asarray(value(x))) if callable(value) else factor * value
