r"""Mass of elastic bodies without that of contact nodes; bodies with the stiffness of a time step.

Inertia of contact nodes makes the pressure of an implicit time step oscillate. Their velocity is
therefore taken to be that of the nearest other node, in all components: :math:`M = E^T M_\rho E`
has no entries for contact nodes. The density is multiplied by a quadratic :math:`1 + O(h^2)` that
keeps the total mass and its first and second moments, hence the motion of a rigid body; on meshes
so coarse that it would not be positive, by a linear or a constant one (massless contact nodes:
H. B. Khenous, P. Laborde and Y. Renard, Eur. J. Mech. A/Solids 27 (2008), 918-932).
"""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import Any, ClassVar, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTriP1

from contact.body.elastic_body import ElasticBody
from contact.body.material import of_each_cell
from contact.body.rigid_modes import dof_kinds, rigid_field
from contact.errors import InputError
from skfem_adini import factorize
from skfem_adini.ground.arguments import numbers

Array = NDArray[np.float64]
LUMPED = (ElementTriP1, ElementQuad1, ElementTetP1, ElementHex1)
_VALUE = -1  # a value dof in `dof_kinds`


class Mass:
    """Mass of a body as a matrix of its scalar functions, the same for each component.
    Where `massless` (ndofs,) holds, the nodes have none; `form` is "consistent" or "lumped". Raises
    InputError for a density that is not positive, and where the rest cannot carry the mass."""

    def __init__(
        self, body: Any, density: ArrayLike, form: str, massless: NDArray[np.bool_]
    ) -> None:
        if type(body) is not ElasticBody:
            raise InputError(
                f"body: dynamics takes an ElasticBody, not a {type(body).__name__}"
                + (": block.elastic() is the same body" if hasattr(body, "elastic") else "")
            )
        if form == "lumped" and not isinstance(body.element, LUMPED):
            raise InputError(
                f"mass='lumped': {type(body.element).__name__} has nodes without positive mass; "
                "take mass='consistent'"
            )
        self.body = body
        self._rho = checked_density(density, body.mesh.nelements)
        basis, dim = body.basis, body.dim
        value = [np.asarray(basis.basis[dim * k][0])[0] for k in range(basis.Nbfun // dim)]
        self._dx = np.asarray(body.measure)
        self._value = np.array([np.broadcast_to(v, self._dx.shape) for v in value])
        self._dofs = np.asarray(basis.element_dofs[::dim]) // dim
        self._bare = massless.reshape(-1, dim).any(axis=1)
        self._nearest = self._nearest_with_mass()
        weight = self._rho[:, None] * self._dx
        if form == "lumped":
            masses = self._on_others(self._gram(weight) @ np.ones(self._bare.size))
            self.matrix = sparse.csr_array(sparse.diags_array(masses))
        elif self._bare.any():
            self.matrix = self._on_functions(weight)
        else:
            self.matrix = self._gram(weight)

    def _nearest_with_mass(self) -> NDArray[np.int64]:
        """The dof that each scalar function with a massless node takes the velocity of, (n,)."""
        basis, dim = self.body.basis, self.body.dim
        kind, x = dof_kinds(basis)[::dim], basis.doflocs[:, ::dim].T
        found = np.arange(kind.size)
        for one in np.unique(kind[self._bare]):
            gone, kept = (np.flatnonzero((kind == one) & m) for m in (self._bare, ~self._bare))
            if not kept.size:
                raise _no_mass()
            found[gone] = kept[scipy.spatial.KDTree(x[kept]).query(x[gone])[1]]
        return found

    def _gram(self, weight: Array) -> sparse.csr_array:
        """Integrals of products of functions, weighted in the quadrature points (ncells, n)."""
        value, count = self._value, self._bare.size
        local = (value * weight).transpose(1, 0, 2) @ value.transpose(1, 2, 0)
        row, column = np.broadcast_arrays(self._dofs.T[:, :, None], self._dofs.T[:, None, :])
        place = row.ravel(), column.ravel()
        return sparse.csr_array(sparse.coo_array((local.ravel(), place), shape=(count, count)))

    def _linear(self) -> tuple[Array, Array]:
        """The functions 1 and x by their dofs (1 + dim, n), in units of the body, and its middle
        with its size (dim, 2)."""
        basis, dim = self.body.basis, self.body.dim
        kind, x = dof_kinds(basis)[::dim], basis.doflocs[:, ::dim]
        p = self.body.mesh.p
        unit = np.column_stack((p.mean(axis=1), np.ptp(p, axis=1)))
        of_x = (kind == _VALUE) * (x - unit[:, :1]) + (kind == np.arange(dim)[:, None])
        return np.vstack(((kind == _VALUE) * 1.0, of_x / unit[:, 1:])), unit

    def _on_functions(self, weight: Array) -> sparse.csr_array:
        """The consistent matrix without the massless functions."""
        functions, unit = self._linear()
        x = np.asarray(self.body.basis.global_coordinates())
        place = ((x - unit[:, :1, None]) / unit[:, 1:, None]).reshape(len(unit), -1)
        at = [
            np.einsum("kcq,akc->acq", self._value, f[:, self._dofs]).reshape(len(f), -1)
            for f in (functions, functions[:, self._nearest])
        ]
        share = moment_factor(place, weight.ravel(), *at).reshape(weight.shape)
        n = self._nearest.size
        E = sparse.csr_array((np.ones(n), self._nearest, np.arange(n + 1)), shape=(n, n))
        return sparse.csr_array(E.T @ self._gram(weight * share) @ E)

    def _on_others(self, masses: Array) -> Array:
        """Lumped masses of the nodes with those of massless ones given to the others."""
        if not self._bare.any():
            return masses
        functions, _ = self._linear()
        share = moment_factor(functions[1:], masses, functions, functions[:, self._nearest])
        return np.bincount(self._nearest, masses * share, masses.size).astype(float)

    def field(self, name: str, given: Any) -> Array:
        """A displacement or velocity (ndofs,) given as such, as a vector (dim,), or as a function
        x -> (dim, ...), which is projected by its mean square."""
        body = self.body
        if callable(given):
            other = body.snapshot()
            other.f = np.zeros_like(body.f)
            load = other._load_vector(body.basis, given, name).reshape(-1, body.dim)
            found: Array = factorize(self._gram(self._dx)).solve(load)
            return found.ravel()
        values = numbers(name, given)
        if values.shape == (body.dim,) and body.ndofs != body.dim:
            values = rigid_field(body, np.zeros(body.dim))[:, : body.dim] @ values
        if values.shape != body.f.shape or not np.all(np.isfinite(values)):
            raise InputError(
                f"{name}: expected {body.dim} finite numbers, one for each of {body.ndofs} dofs, "
                f"or a function of the place; got shape {numbers(name, given).shape}"
            )
        return values


def checked_density(density: ArrayLike, cells: int) -> Array:
    """Density of each cell, (ncells,), from one number or one a cell; positive."""
    rho = of_each_cell("density", density, cells)
    wrong = rho[~(np.isfinite(rho) & (rho > 0))]
    if wrong.size:
        raise InputError(f"density={wrong.flat[0]:.6g}: expected a positive mass per volume")
    return np.broadcast_to(rho, cells)


def moment_factor(x: Array, weight: Array, functions: Array, moved: Array) -> Array:
    """Quadratic q(x), (n,), with which `moved` have the moments of `functions`, both (1 + dim, n);
    linear or constant, with fewer moments, where it would not be positive. x (dim, n) are the
    places of the weights (n,). Raises InputError if `moved` are linearly dependent."""
    pairs = list(combinations_with_replacement(range(len(functions)), 2))
    monomial = np.vstack((np.ones(x.shape[1]), x))
    terms = np.array([monomial[i] * monomial[j] for i, j in pairs])
    matrix = np.array([terms @ (weight * moved[i] * moved[j]) for i, j in pairs])
    wanted = np.array([weight @ (functions[i] * functions[j]) for i, j in pairs])
    left, whole = (np.linalg.matrix_rank((f * weight) @ f.T, 1e-10) for f in (moved, functions))
    if left < whole:
        raise _no_mass()
    for k in (len(pairs), len(functions), 1):  # all moments, mass and centre, mass
        found = np.linalg.lstsq(matrix[:k, :k], wanted[:k], rcond=1e-10)[0]
        missed = np.abs(matrix[:k, :k] @ found - wanted[:k]).max()
        q: Array = found @ terms[:k]
        if missed <= 1e-8 * np.abs(wanted).max() and np.all(q > 0.0):
            break
    return q


def _no_mass() -> InputError:
    return InputError(
        "mesh: without its contact nodes the rest of the body cannot carry its mass, as in a layer "
        "one element thick; refine it across, or take scheme='stabilised', which keeps the mass of "
        "contact nodes"
    )


class StepBody(ElasticBody):
    """A body whose stiffness is the matrix of a time step, which has no rigid motions."""

    _slender: ClassVar[bool] = False  # type: ignore[misc]

    @classmethod
    def of(cls, body: ElasticBody, matrix: sparse.csr_array) -> Self:
        """The body with another matrix, shape (ndofs, ndofs)."""
        body.check_unchanged()
        _ = body.constraint, body.lengths
        other = cls.__new__(cls)
        anew = ("_kept", "_slender", "takes_strains")
        other.__dict__.update({name: v for name, v in vars(body).items() if name not in anew})
        nothing = np.zeros((body.ndofs, 0))
        fresh = {"stiffness": matrix, "_material": dict(body._material), "_rigid": nothing}
        other.__dict__.update(fresh)
        other.thermal = None
        return other

    @property
    def translations(self) -> NDArray[np.bool_]:
        """None is without forces."""
        return np.zeros(self.dim, dtype=bool)
