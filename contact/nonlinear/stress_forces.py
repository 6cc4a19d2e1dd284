"""Forces from a stress function of the deformation gradient, and pressures that follow it."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementHex2, ElementQuad2, LinearForm

from contact.body.axisymmetry import AXISYMMETRIC
from contact.errors import InputError
from contact.facet_basis import facet_basis
from contact.nonlinear.cell_forces import (
    CellForces,
    Forces,
    State,
    checked_state,
    cofactor,
    det,
    spread,
)
from skfem_adini.ground.arguments import evaluated
from skfem_adini.ground.arrays import on_device

Array = NDArray[np.float64]
CHUNK = 200_000  # numbers of an array of some cells that stays in the cache of a processor
DEVICE_CHUNK = 50_000_000  # of one that fills a device


class StressForces(CellForces):
    r"""Forces from the first Piola-Kirchhoff stress as a function of F (3, 3, ncells, npoints).

    With mean dilatation the energy is that of :math:`\bar F = (\theta / J)^{1/3} F`, with the
    projection :math:`\theta` of J onto constants in each cell, in quadratic quadrilaterals and
    hexahedra onto linear functions: a pressure of as many unknowns, eliminated (J. C. Simo, R. L.
    Taylor and K. S. Pister, Comput. Methods Appl. Mech. Engrg. 51 (1985), 177-208)."""

    def __init__(
        self, basis: Basis, stress: Callable[..., Any], state: Any, mean: bool, plane: str | None
    ) -> None:
        self.basis, self.stress, self.mean = basis, stress, mean
        self._ring, self._flat = plane == AXISYMMETRIC, plane == "stress"
        self.rest = spread(state, basis)
        dim = basis.mesh.dim()
        ring, x = self._ring, np.asarray(basis.global_coordinates())
        self._dx = basis.dx * (2.0 * np.pi * x[0] if ring else 1.0)
        values, self._slope = functions_of(basis)
        self._hoop = values / x[0] if ring else None
        self._strains = [(i, j) for i in range(dim) for j in range(dim)] + [(2, 2)] * ring
        linear = isinstance(basis.elem.elem, ElementQuad2 | ElementHex2)
        self._modes = _orthonormal(x if linear else x[:0], self._dx)
        self._known: tuple[tuple[Array, Array], ...] = ()  # the last two displacements and their F

    def on_device(self, xp: Any) -> StressForces:
        """The same forces by arrays of CuPy, for Newton's method alone.
        Raises InputError if the stress does not take them."""
        other = copy(self)
        other.xp, other.device, other._known = xp, True, ()
        for name in ("_dofs", "_pattern"):
            vars(other).pop(name, None)
        for name in ("_dx", "_slope", "_hoop", "_modes"):
            if getattr(self, name) is not None:
                setattr(other, name, xp.asarray(getattr(self, name)))
        try:
            other.at(np.zeros(self.basis.N), self.rest, 1.0)
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"device: the stress does not take arrays of CuPy ({error}); let it call NumPy's "
                "functions of F alone, or take device='cpu'"
            ) from error
        return other

    def least_volume(self, u: Array) -> float:
        """Smallest det F at the quadrature points."""
        return float(det(self.gradient(self.of_cells(u))).min())

    def gradient(self, dofs: Any) -> Any:
        """F at the quadrature points, shape (3, 3, ncells, npoints), which is not to be changed."""
        for known, F in self._known:
            if np.array_equal(known, dofs):
                return F
        F = deformed(dofs, self._slope, self._hoop)
        if isinstance(F, np.ndarray):
            F.flags.writeable = False
        self._known = ((dofs, F), *self._known[:1])
        return F

    def _called(self, F: Any, state: State, dt: float) -> Any:
        """Stress at F, and the new state or None."""
        F = self.thinned(F, state, dt)
        if not getattr(F.flags, "writeable", False):
            F = F.copy()  # a stress function may write into its argument
        found = self.stress(F, state, dt) if self.rest else (self.stress(F), None)
        if np.shape(found[0]) != F.shape:
            raise InputError(
                f"stress: expected P of the shape {F.shape} of F, got {np.shape(found[0])}"
                + ("; with a state: P, new state" if self.rest else "")
            )
        return found

    def thinned(self, F: Any, state: State, dt: float) -> Any:
        """F with the F_33 of plane stress, by Newton's method for P_33 = 0; else F itself.
        Imaginary parts follow by the derivative of that equation. NaN where it has no solution."""
        if not self._flat:
            return F
        way = _unit((2, 2), F)

        def normal(G: Any) -> Any:
            return (self.stress(G, state, dt)[0] if self.rest else self.stress(G))[2, 2]

        G = np.real(F).copy()
        G[2, 2] = np.clip(1.0 / np.maximum(det(G), 0.1), 0.3, 3.0)
        for _ in range(50):
            change = -normal(G) / self.slope(normal, G, way, 1e-6)
            G[2, 2] += np.clip(change, -0.5 * G[2, 2], G[2, 2])
            if not np.abs(change).max() > 1e-13 * G[2, 2].max():
                break
        G[2, 2, ~(np.abs(change) <= 1e-9 * G[2, 2])] = np.nan
        if not np.iscomplexobj(F):
            return G
        change = -np.imag(normal(G + 1j * np.imag(F))) / self.slope(normal, G, way, 1e-6)
        return G + 1j * (np.imag(F) + way * change)

    def _projected(self, values: Any) -> Any:
        """Values (ncells, npoints) as sums of the modes of the volume change."""
        parts = np.einsum("eaq,eq->ea", self._modes, values * self._dx)
        return np.einsum("eaq,ea->eq", self._modes, parts)

    def _averaged(self, F: Any) -> Any:
        """F with its mean dilatation, or F itself."""
        if not self.mean:
            return F
        J = det(F)
        return (self._projected(J) / J) ** (1 / 3) * F

    def _slopes(self, F: Any, theta: Any, state: State, dt: float) -> tuple[Any, Any]:
        """Derivatives of the energy in F and in theta, both at the other one fixed."""
        if theta is None:
            return self._called(F, state, dt)[0], None
        J = det(F)
        s = (theta / J) ** (1 / 3)
        P = s * self._called(s * F, state, dt)[0]
        work = (P * F).sum(axis=(0, 1)) / 3.0
        return P - work / J * cofactor(F), work / theta

    def stresses(self, dofs: Any, state: State, dt: float) -> Any:
        """First Piola-Kirchhoff stress that is work-conjugate to F, (3, 3, ncells, npoints)."""
        F = self.gradient(dofs)
        theta = self._projected(det(F)) if self.mean else None
        P, pressure = self._slopes(F, theta, state, dt)
        return P if pressure is None else P + self._projected(pressure) * cofactor(F)

    def forces(self, dofs: Any, state: State, dt: float) -> Any:
        """Forces of the cells' dofs."""
        P = self.stresses(dofs, state, dt) * self._dx
        dim = self._slope.shape[1]
        found = np.einsum("cjeq,kjeq->kce", P[:dim, :dim], self._slope)
        if self._hoop is not None:
            found[:, 0] += np.einsum("eq,keq->ke", P[2, 2], self._hoop)
        return found.reshape(-1, found.shape[2])

    def tangent(self, u: Array, state: State, dt: float) -> Any:
        """Derivative of the forces by that of the stress in F at each point."""
        F, state = self.gradient(self.of_cells(u)), self.placed(state)
        theta = self._projected(det(F)) if self.mean else None
        pressure = self._slopes(F, theta, state, dt)[1]
        pressure = pressure if pressure is None else self._projected(pressure)

        def slopes(G: Any, mean: Any = theta) -> Any:
            """Components of P that may vary, then the derivative in theta."""
            P, p = self._slopes(G, mean, state, dt)
            if p is not None:
                P = P + pressure * cofactor(G)
            found = [P[strain] for strain in self._strains]
            return np.stack(found if p is None else [*found, p])

        m = len(self._strains)
        rate = np.empty_like(F, shape=(m, m + self.mean, *self._dx.shape))
        for k, strain in enumerate(self._strains):
            rate[k] = self.slope(slopes, F, _unit(strain, F), 1e-6)
        rate *= self._dx
        blocks = self._summed(rate[:, :m])
        if self.mean:
            rise: Any = self.slope(lambda v: slopes(F, v), theta, np.ones_like(F[0, 0]), 1e-6)
            of_theta = self._dx * rise
            C = self._dx * cofactor(F)
            g = self._tested([C[strain] for strain in self._strains])
            right = self._tested(rate[:, m]).swapaxes(1, 2)
            inner = np.einsum("eaq,ebq,eq->eab", self._modes, self._modes, of_theta[m])
            right += inner @ g.swapaxes(1, 2)
            blocks += self._tested(of_theta[:m]) @ g.swapaxes(1, 2) + g @ right
        return self.matrix(blocks)

    def _strain(self, cells: slice) -> Array:
        """Components of F by the cells' dofs, shape (ncells, npoints, nstrains, ndofs)."""
        slope = self._slope[:, :, cells]
        size, dim = slope.shape[:2]
        B = np.zeros_like(slope, shape=(*slope.shape[2:], len(self._strains), size * dim))
        for s, (i, j) in enumerate(self._strains):
            values = slope[:, j] if j < dim else self._hoop[:, cells]  # type: ignore[index]
            B[:, :, s, (i if j < dim else 0) :: dim] = np.moveaxis(values, 0, -1)
        return B

    def _chunks(self) -> list[slice]:
        cells, points = self._dx.shape
        room = DEVICE_CHUNK if on_device(self._dx) else CHUNK
        step = max(1, room // (points * len(self._strains) * self.basis.Nbfun))
        return [slice(a, a + step) for a in range(0, cells, step)]

    def _summed(self, rate: Array) -> Array:
        """Matrices of the cells from weighted dP/dF, (nstrains, nstrains, ncells, npoints)."""
        n = self.basis.Nbfun
        found = np.empty_like(rate, shape=(len(self._dx), n, n))
        for cells in self._chunks():
            B = self._strain(cells)
            X = rate[:, :, cells].transpose(2, 3, 1, 0) @ B
            found[cells] = B.reshape(len(B), -1, n).swapaxes(1, 2) @ X.reshape(len(B), -1, n)
        return found

    def _tested(self, P: Any) -> Array:
        """Forces of the cells' dofs by weighted stresses times modes, (ncells, ndofs, nmodes)."""
        P = np.stack(list(P))
        found = np.empty_like(P, shape=(len(self._dx), self.basis.Nbfun, self._modes.shape[1]))
        for cells in self._chunks():
            B = self._strain(cells)
            sums = np.einsum("eaq,seq->eaqs", self._modes[cells], P[:, cells])
            flat = sums.reshape(len(B), sums.shape[1], -1) @ B.reshape(len(B), -1, B.shape[-1])
            found[cells] = flat.swapaxes(1, 2)
        return found

    def updated(self, u: Array, state: State, dt: float) -> State:
        """The state after a step."""
        if not self.rest:
            return {}
        F = self._averaged(self.gradient(u[self.basis.element_dofs]))
        return checked_state(self._called(F, state, dt)[1], self.rest)

    def recomputed(self, u: Array, state: State, dt: float) -> Array:
        """Forces on all dofs by a scikit-fem form."""
        P, ring = self.stresses(u[self.basis.element_dofs], state, dt), self._ring

        def work(v: Any, w: Any) -> Any:  # P as it is: a parameter of a form is copied at each use
            dim, slope = len(v), np.asarray(v.grad)
            density = sum(P[c, j] * slope[c, j] for c in range(dim) for j in range(dim))
            hoop = P[2, 2] * v[0] / w.x[0] if ring else 0.0
            return (density + hoop) * (2.0 * np.pi * w.x[0] if ring else 1.0)

        return np.asarray(LinearForm(work).assemble(self.basis))

    def energy(self, u: Array) -> float:
        """Stored energy, of a stress with a method `energy`; NaN without."""
        density = getattr(self.stress, "energy", None)
        if density is None:
            return np.nan
        F = self._averaged(self.gradient(u[self.basis.element_dofs]))
        return float(np.sum(density(self.thinned(F, self.rest, 0.0).copy()) * self._dx))


class FollowerPressure(Forces):
    r"""A pressure p on the deformed boundary, the force :math:`-p \operatorname{cof} F N` per
    undeformed area with the outward normal N there."""

    def __init__(self, body: Any, boundary: Any, pressure: Any) -> None:
        facets, element = body.whole_facets(boundary), body.basis.elem
        order = 2 * element.maxdeg + 2 * body.is_ring
        dofs = body.basis.dofs
        self.basis = facet_basis(body.mesh, element, facets, intorder=order, dofs=dofs)
        x = np.asarray(self.basis.global_coordinates())
        value = evaluated("pressure", pressure, x)
        if value.shape not in ((), x.shape[1:]) or not np.all(np.isfinite(value)):
            raise InputError(
                f"pressure: expected a finite number, or one for each of the points "
                f"{x.shape[1:]}, got {f'shape {value.shape}' if value.ndim else value}"
            )
        values, self._slope = functions_of(self.basis)
        self._hoop = values / x[0] if body.is_ring else None
        self._values = values * (self.basis.dx * body.depth(x) * value)
        self._normals = np.asarray(self.basis.normals)

    def forces(self, dofs: Any, state: State, dt: float) -> Any:
        """Forces of the facets' dofs."""
        dim = len(self._normals)
        C = cofactor(deformed(dofs, self._slope, self._hoop))[:dim, :dim]
        along = np.einsum("cjeq,jeq->ceq", C, self._normals)
        found = -np.einsum("ceq,keq->kce", along, self._values)
        return found.reshape(-1, found.shape[2])


def functions_of(basis: Any) -> tuple[Array, Array]:
    """Values (k, ncells, npoints) and slopes (k, dim, ncells, npoints) of the scalar functions."""
    dim = basis.mesh.dim()
    functions = [basis.basis[dim * k][0] for k in range(basis.Nbfun // dim)]
    slopes = np.array([np.asarray(f.grad)[0] for f in functions])
    return np.array([np.asarray(f)[0] for f in functions]), slopes


def deformed(dofs: Any, slope: Array, hoop: Array | None) -> Any:
    """F (3, 3, ncells, npoints) by the dofs of the cells, see `functions_of`."""
    dim = slope.shape[1]
    own = dofs.reshape(-1, dim, dofs.shape[1])
    F = np.zeros_like(dofs, shape=(3, 3, *slope.shape[2:]))
    F[:dim, :dim] = np.einsum("kce,kjeq->cjeq", own, slope)
    if hoop is not None:
        F[2, 2] = np.einsum("ke,keq->eq", own[:, 0], hoop)
    for i in range(3):
        F[i, i] += 1.0
    return F


def _unit(component: tuple[int, int], like: Any) -> Any:
    """The tensor (3, 3, 1, 1) that has one component."""
    found = np.zeros_like(np.real(like), shape=(3, 3, 1, 1))
    found[component] = 1.0
    return found


def _orthonormal(x: Array, dx: Array) -> Array:
    """One and the coordinates x (k, ncells, npoints), made orthonormal in each cell by its weights
    dx, shape (ncells, k + 1, npoints)."""
    middle = x - x.mean(axis=2, keepdims=True)
    functions = np.stack([np.ones_like(dx), *middle], axis=1)
    gram = np.einsum("eaq,ebq,eq->eab", functions, functions, dx)  # weights may be negative
    return np.asarray(np.linalg.solve(np.linalg.cholesky(gram), functions))
