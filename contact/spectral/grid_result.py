"""The solution of contact on a grid, with its certificate."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skfem
from numpy.typing import NDArray

from contact.errors import InputError, NotConverged
from contact.laws.adhesion import Adhesion
from contact.laws.friction import Friction, Tresca, lengths
from contact.laws.iteration import Iteration
from contact.laws.status import Status
from contact.laws.surface_law import SurfaceLaw, SurfaceState
from contact.output.archive import (
    Kinds,
    from_arrays,
    head,
    loosened,
    named_archive,
    proving,
    to_arrays,
    unproved,
)
from contact.output.tables import grid_dataset
from contact.spectral.contact_edge import ContactEdge, contact_edge
from contact.spectral.grid_case import GridCase
from contact.spectral.grid_compliance import GridCompliance
from contact.spectral.grid_problem import Grid, GridProblem, residuals
from contact.spectral.half_space import HalfSpace
from contact.spectral.periodic_layers import PeriodicLayers
from contact.spectral.slices import FieldsInside, image_data
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from skfem_adini.ground.archives import read_arrays, reading, words, write_arrays
from skfem_adini.ground.arguments import integer, numbers
from skfem_adini.ground.arrays import host

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class GridResult(FieldsInside):
    """Pressure, shear and displacement of a surface grid, on the host.

    Fields on a device are copied when first accessed.

    Attributes
    ----------
    compliance : GridCompliance
    pressure : ndarray, shape (nx[, ny])
        Positive in compression.
    shear : ndarray, shape (dim - 1, nx[, ny])
        Traction that acts on the body, along the coordinate axes of the surface in their order.
    u : ndarray, shape (dim, nx[, ny])
        Displacement of the points, relative to its mean in components in which the body is free.
    opening : ndarray, shape (nx[, ny])
        Gap in the deformed state.
    slip : ndarray, shape (dim - 1, nx[, ny])
        Tangential displacement relative to the obstacle, from the beginning of a history.
    status : ndarray of int, shape (nx[, ny])
        Values of `Status`.
    motion : ndarray, shape (dim,)
        Motion of the obstacle, relative to the body's mean where the body is free; zero where it
        has no effect.
    kkt : dict
        Residuals, recomputed from the problem, with the names of `ContactResult.kkt`; ``obstacle``
        is the force balance of an obstacle driven by a force.
    history : tuple of Iteration
    forces : ndarray, shape (dim, nx[, ny])
        Multipliers (mu, t); forces on the body are their opposites.
    indentation : ndarray, shape (nx[, ny])
        Permanent indentation by the hardness, up to this step.
    worn : ndarray, shape (2, nx[, ny])
        Depths worn off the body and off the obstacle, up to this step.
    jump : str
        With adhesion "pull-off" or "contact" if the step passed such an instability, else empty.

    Examples
    --------
    >>> from contact import GridContact, HalfSpace, Parabola, Rigid
    >>> ball = Rigid(Parabola((0.5, 0.5, 0.0), radius=2.0), force=(0.0, 0.0, 1e-3))
    >>> result = GridContact(HalfSpace((1.0, 1.0), (64, 64), E=1.0, nu=0.3), ball).solve()
    >>> result
    GridResult(64 x 64 points, 169 in contact; resultant (0, 0, 0.001))
    >>> round(float(np.pi * (0.75 * 1e-3 * 2.0 * 0.91) ** (2 / 3)), 4)  # Hertz
    0.0387
    >>> print(round(result.area, 4), round(result.corrected_area, 4))
    0.0413 0.0395
    """

    compliance: GridCompliance
    motion: Array
    kkt: dict[str, float]
    history: tuple[Iteration, ...]
    _fields: dict[str, Grid]  # on their device until accessed
    _proof: tuple[GridCase, Array, float] | None = None  # case, computed motions, tolerance
    jump: str = ""

    def __getattr__(self, name: str) -> Any:
        """A field, copied to the host on first access."""
        fields = self.__dict__.get("_fields", {})
        if name not in fields:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self.__dict__[name] = host(fields.pop(name))
        return self.__dict__[name]

    def to_host(self) -> None:
        """Copy all fields to the host, which frees the memory of a device."""
        for name in list(self._fields):
            getattr(self, name)

    def save(self, path: str | Path) -> Path:
        """Write the result, problem included, to one compressed file; see `load`.

        Parameters
        ----------
        path : str or Path
            Ends in .npz, which is added to a name that has no suffix, or only a number as suffix.

        Returns
        -------
        Path
            The file, complete and on the disk.

        Raises
        ------
        InputError
            Another suffix; a compliance or an element that cannot be stored; a result that no
            `GridContact` made.
        """
        if self._proof is None:
            raise InputError("result: it does not know its problem; GridContact.solve returns one")
        case, a, tol = self._proof
        return write(GridState(case, self.forces, np.asarray(a), tol, self.history), path)

    @classmethod
    def load(cls, path: str | Path, xp: Any = np) -> GridResult:
        """Read a file written by `save`: nothing is lost, and the certificate is computed anew.

        The compliance is built from its arguments in the file, and all fields are computed from it
        and the contact forces, so that the residuals show whether problem and solution still belong
        together. A checksum covers other data, such as gaps of open points. A history may continue
        from the result as from the one that was saved. Functions are not stored: the file has the
        values of obstacle and friction.

        Parameters
        ----------
        path : str or Path
        xp : module
            `numpy`, or `cupy` for a compliance on a device.

        Returns
        -------
        GridResult

        Raises
        ------
        InputError
            The file does not exist, is damaged, changed or of another kind, or its solution does
            not solve its problem.

        Examples
        --------
        >>> import tempfile
        >>> from contact import GridContact, HalfSpace, Parabola, Rigid
        >>> ball = Rigid(Parabola((0.5, 0.5, 0.0), radius=2.0), force=(0.0, 0.0, 1e-3))
        >>> result = GridContact(HalfSpace((1.0, 1.0), (32, 32), E=1.0, nu=0.3), ball).solve()
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     again = GridResult.load(result.save(f"{folder}/ball"))
        >>> bool((again.pressure == result.pressure).all())
        True
        """
        case, forces, a, tol, history = read(path, xp)
        problem = case.problem()
        law = case.friction_law(problem.xp)
        state = problem.xp.asarray(forces), a
        with proving(unproved(path)):
            result = certified(
                problem, law, state, case.motion, loosened(tol), history, case.travel,
                case.surface_law(problem),
            )  # fmt: skip
        return replace(result, _proof=(case, a, tol))

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.pressure.shape))
        touching = int(np.count_nonzero(self.pressure))
        whole = self.resultant
        small = 1e-12 * float(np.abs(whole).max())  # rounding of a zero sum
        total = ", ".join(f"{v if abs(v) > small else 0.0:.6g}" for v in whole)
        return f"GridResult({size} points, {touching} in contact; resultant ({total}))"

    @property
    def cell(self) -> float:
        """Area (2-D: length) of one point; points on a mirrored side have half of it."""
        return float(np.prod(self.compliance.spacing))

    @property
    def _weights(self) -> Array:
        return host(getattr(self.compliance, "weights", np.ones(self.pressure.shape)))

    @property
    def _mirrored(self) -> tuple[bool, ...]:
        return tuple(getattr(self.compliance, "mirrored", [False] * self.pressure.ndim))

    @property
    def resultant(self) -> Array:
        """Sum of the contact forces on the body, shape (dim,)."""
        normal = np.asarray(self.compliance.normal)
        total = -normal * self.forces[0].sum()
        total[normal == 0] = -self.forces[1:].reshape(normal.size - 1, -1).sum(axis=1)
        return np.asarray(total)

    @property
    def area(self) -> float:
        """Contact area (2-D: length), from the number of points under pressure; with adhesion of
        those without a gap."""
        return float((self._weights * self._touching).sum() * self.cell)

    @property
    def _touching(self) -> NDArray[np.bool_]:
        proof = self._proof
        adheres = proof is not None and getattr(proof[0].surface, "adhesion", None) is not None
        return self.status != Status.OPEN if adheres else self.pressure > 0

    @property
    def worn_volume(self) -> Array:
        """Volumes worn off the body and off the obstacle, shape (2,); for a profile areas."""
        return np.asarray((self.worn * self._weights).reshape(2, -1).sum(axis=1) * self.cell)

    @property
    def perimeter(self) -> float:
        """Length of the edges between cells in contact and others (2-D: the number of ends)."""
        return perimeter(self.pressure > 0, self.compliance.spacing, self._mirrored)

    @property
    def corrected_area(self) -> float:
        """Contact area, corrected for whole cells counted along its edge.

        Raises
        ------
        InputError
            A profile: the correction is known for surfaces.
        """
        return corrected_area(self.pressure > 0, self.compliance.spacing, self._mirrored)

    def edge(self) -> ContactEdge:
        """Edge of frictionless contact between the points, and the pressure next to it.

        Forces over the area of a point are not accurate pressures next to an edge, where the
        pressure falls as a square root. It is fitted to pressures and gaps farther away, which
        requires about ten points across the contact, a few in the gap, and a surface smooth at this
        scale. The lowest layer should be several points thick.

        Returns
        -------
        ContactEdge

        Raises
        ------
        InputError
            Friction, which changes the square root; a compliance without `contact_modulus`.

        Examples
        --------
        >>> from contact import GridContact, HalfSpace, Rigid
        >>> x = (np.arange(64) + 0.3) / 64  # Westergaard's sinusoid, half in contact
        >>> ground = HalfSpace(1.0, 64, E=1.0, nu=0.3)
        >>> wave = Rigid(1e-3 * (1 - np.cos(2 * np.pi * x)), force=(None, 5e-4 * np.pi / 0.91))
        >>> result = GridContact(ground, wave).solve()
        >>> print((result.edge().places + 0.3 / 64).round(3), result.area)
        [[0.25 0.75]] 0.5
        """
        modulus = getattr(self.compliance, "contact_modulus", None)
        if modulus is None:
            raise InputError(
                "edge: the compliance does not tell its modulus; give it an attribute "
                "contact_modulus, E / (1 - nu^2)"
            )
        if np.any(self.shear):
            raise InputError("edge: known for frictionless contact; leave friction")
        return contact_edge(
            self.pressure, self.opening, self.compliance.spacing, modulus, self._mirrored
        )

    def spectrum(self) -> tuple[Array, Array]:
        """Wave vectors and the power spectral density of the pressure, as in `Rough.spectrum`.

        Returns
        -------
        q : ndarray, shape (dim - 1, nx[, ny])
        C : ndarray, shape (nx[, ny])

        Raises
        ------
        InputError
            The surface is not periodic.
        """
        from contact.obstacles.rough import power_spectrum

        if any(self._mirrored):
            raise InputError("spectrum: the surface is not periodic; take one with such sides")
        shape, spacing = self.pressure.shape, self.compliance.spacing
        lengths = [m * h for m, h in zip(shape, spacing, strict=True)]
        return power_spectrum(self.pressure, lengths)

    def histogram(self, bins: int = 50) -> tuple[Array, Array]:
        """Probability density of the pressure on the whole surface, without its open part.

        Parameters
        ----------
        bins : int

        Returns
        -------
        density : ndarray, shape (bins,)
            Its integral is the share of the surface in contact.
        edges : ndarray, shape (bins + 1,)

        Raises
        ------
        InputError
            `bins` is not a whole number from 1.
        """
        count = integer("bins", bins, 1)
        loaded, weights = self.pressure > 0, self._weights
        top = float(self.pressure[loaded].max(initial=0.0)) or 1.0
        area, edges = np.histogram(
            self.pressure[loaded], bins=count, range=(0.0, top), weights=weights[loaded]
        )
        return area / (np.diff(edges) * weights.sum()), edges

    def to_xarray(self) -> Any:
        """The surface as a dataset with pressure, gap, status, shear, slip and displacement.

        Returns
        -------
        xarray.Dataset
            Over the coordinates of the surface; the residuals are its attributes.

        Raises
        ------
        MissingDependency
            xarray is not installed.
        """
        return grid_dataset(self)

    def to_pyvista(self) -> Any:
        """The surface as image data, with pressure, shear, status, displacement and gap.

        Returns
        -------
        pyvista.ImageData
            Its first axes are those of the surface.

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        image = image_data(self._lateral())
        for name in ("pressure", "opening", "status", "indentation"):
            image.point_data[name] = getattr(self, name).ravel(order="F")
        for name in ("shear", "u"):
            rows = [part.ravel(order="F") for part in getattr(self, name)]
            blank = [np.zeros_like(rows[0])] * (3 - len(rows))
            image.point_data[name] = np.column_stack(rows + blank)
        image.field_data["directions"] = np.array([self.pressure.ndim])
        return image


def certified(
    problem: GridProblem,
    law: Friction,
    state: tuple[Grid, Any],
    given: Array,
    tol: float,
    history: tuple[Iteration, ...],
    travel: Array | None = None,
    surface: SurfaceLaw | None = None,
) -> GridResult:
    """The result for forces and motions; raises `NotConverged` if a residual exceeds tol. `given`
    are prescribed motions of the obstacle, else NaN, `travel` is the path of its shape."""
    (l, a), xp = state, problem.xp
    pressed, bound = problem.W(l), law.bound(l[0])
    v = problem.v0 - pressed + problem.moved(a)
    kkt = residuals(problem, l, v, bound, surface)
    missed = {name: value for name, value in kkt.items() if not value <= tol}
    if missed:
        found = ", ".join(f"{name} {value:.1e}" for name, value in missed.items())
        raise NotConverged(
            f"the solution fails its certificate at tolerance {tol:.1e}: {found}", history
        )
    u = problem.compliance.initial - problem.turned_back(pressed)
    # Rounding of a displacement is not slip, as in `ContactResult.status`.
    moves = xp.sqrt((v[1:] ** 2).sum(axis=0)) > 1e-10 * max(float(xp.abs(u).max()), 1e-300)
    slips = moves & (xp.sqrt((l[1:] ** 2).sum(axis=0)) >= bound * (1 - 1e-9))
    rubs = xp.where(slips, int(Status.SLIP), int(Status.STICK))
    if problem.at_rest is not None:
        open_ = problem.at_rest.all(axis=0) & (bound > 0)
        rubs = xp.where(open_, int(Status.UNDETERMINED), rubs)
    touches = (l[0] > 0) | ((bound > 0) & isinstance(law, Tresca))
    lost: dict[str, Grid] = {
        "indentation": xp.zeros_like(l[0]),
        "worn": xp.zeros((2, *l[0].shape)),
    }
    if surface is not None and surface.surface is not None:
        through = xp.where(problem.can_touch, v[0] - problem.gap, -np.inf)
        now = l[0], problem.scale_normal * through, lengths(v[1:])
        touches = touches | surface.at(*now).touches
        indented, worn = surface.left(*now)
        lost = {
            "indentation": xp.asarray(surface.surface.indented) + indented,
            "worn": xp.asarray(surface.surface.worn) + worn,
        }
    order, sign = problem.order
    motion = np.empty(len(order))
    motion[order] = -np.asarray(a) * np.array([sign] + [1.0] * (len(order) - 1))
    motion = np.where(np.isnan(given), motion, given)
    across = order[1:]
    moved = (motion if travel is None else motion + travel)[across]
    relative = u[across] - xp.asarray(moved).reshape((-1,) + (1,) * (u.ndim - 1))
    area = float(np.prod(problem.compliance.spacing))
    if hasattr(problem.compliance, "weights"):
        area = area * problem.compliance.weights
    return GridResult(
        compliance=problem.compliance,
        motion=motion,
        kkt=kkt,
        history=history,
        _fields={
            "pressure": l[0] / area,
            "shear": -l[1:] / area,
            "u": u,
            "opening": problem.gap - v[0],
            "slip": relative,
            "status": xp.where(touches, rubs, int(Status.OPEN)),
            "forces": l,
            **lost,
        },
    )


def perimeter(
    touching: NDArray[np.bool_],
    spacing: tuple[float, ...],
    mirrored: tuple[bool, ...] = (False, False),
) -> float:
    """Length of the edges between cells in contact and others, halved on a mirrored side; for a
    profile the number of ends."""
    cell, length = float(np.prod(spacing)), 0.0
    for axis, h in enumerate(spacing):
        share = shares(touching.shape, mirrored)
        if mirrored[axis]:
            edges = np.diff(touching, axis=axis)
            share = np.take(share, [1], axis=axis)
        else:
            edges = touching != np.roll(touching, 1, axis)
        length += float(np.sum(edges * share)) * cell / h
    return length


def shares(shape: tuple[int, ...], mirrored: tuple[bool, ...]) -> NDArray[np.float64]:
    """Area of each point in units of a cell."""
    whole = np.ones(shape)
    for axis in np.flatnonzero(mirrored[: len(shape)]):
        np.moveaxis(whole, axis, 0)[[0, -1]] *= 0.5
    return whole


def corrected_area(
    touching: NDArray[np.bool_],
    spacing: tuple[float, ...],
    mirrored: tuple[bool, ...] = (False, False),
) -> float:
    r"""Area of the cells in contact minus :math:`(\pi - 1 + \ln 2) / 24` times their perimeter and
    spacing: V. A. Yastrebov, G. Anciaux, J.-F. Molinari, Tribology International 114 (2017) 161.
    """
    if touching.ndim != 2:
        raise InputError("corrected_area: the correction is known for surfaces, not for profiles")
    counted = float((touching * shares(touching.shape, mirrored)).sum() * np.prod(spacing))
    excess = (np.pi - 1 + np.log(2)) / 24 * perimeter(touching, spacing, mirrored)
    return counted - excess * float(np.sqrt(np.prod(spacing)))


_FORMAT = 1
_SURFACE = ("hardness", "wear", "indented", "worn")
_OF_CASE = ("gap", "friction", "motion", "force", "slip_from", "travel")
_ELEMENTS = Kinds(
    *(skfem.ElementQuad1, skfem.ElementHex1, ElementQuadAdini, ElementHexAdini, ElementQuadBFS)
)


class GridState(NamedTuple):
    """A problem and its solution: multipliers, computed motions, tolerance of the certificate."""

    case: GridCase
    forces: Array  # (dim, nx[, ny]), normal first
    a: Array  # (dim,)
    tol: float
    history: tuple[Iteration, ...]


def write(state: GridState, path: str | Path) -> Path:
    """Write a result; see `contact.GridResult.save`."""
    file, case = named_archive(path), state.case
    about = {
        "kind": "GridResult",
        "format": _FORMAT,
        "compliance": _words(case.compliance),
        "law": case.law,
        "tol": float(state.tol),
        "history": [asdict(line) for line in state.history],
    }
    parts = {name: getattr(case, name) for name in _OF_CASE}
    if case.surface is not None:
        parts |= case.surface.stored(np.maximum(state.forces[0], 0.0) / host(case.areas))
        about["adhesion"] = asdict(case.surface.adhesion) if case.surface.adhesion else None
    parts |= {"forces": state.forces, "a": state.a, "about": words(about)}
    return write_arrays(file, to_arrays(parts))


def read(path: str | Path, xp: Any) -> GridState:
    """Read what `write` wrote, without a certificate; see `contact.GridResult.load`."""
    file = named_archive(path)
    arrays, checksum = read_arrays(file)
    with reading(file):
        formats, beside = ((), "without") if checksum is None else ((_FORMAT,), "with")
        about = head(arrays, "GridResult", formats, beside, f"format {_FORMAT}, with one")
        return _state(arrays, about, xp)


def _state(arrays: dict[str, Any], about: dict[str, Any], xp: Any) -> GridState:
    compliance = _compliance(about["compliance"], xp)
    shape, dim = compliance.shape, len(compliance.shape) + 1
    expected = {
        "gap": shape, "friction": shape, "motion": (dim,), "force": (dim,),
        "forces": (dim, *shape), "a": (dim,), "slip_from": (dim - 1, *shape),
        "travel": (dim,), "hardness": shape, "wear": (2, *shape), "indented": shape,
        "worn": (2, *shape),
    }  # fmt: skip
    found = {name: numbers(name, part) for name, part in from_arrays(arrays, expected).items()}
    for name, value in found.items():
        if value.shape != expected[name]:
            raise InputError(f"{name}: expected shape {expected[name]}, got {value.shape}")
    for name in ("forces", "a", "friction", "slip_from", "travel"):
        if not np.all(np.isfinite(found.get(name, 0.0))):
            raise InputError(f"{name}: holds numbers that are not finite")
    if np.any(np.isnan(found["gap"])) or np.any(found["friction"] < 0):
        raise InputError("gap, friction: hold NaN, or a negative coefficient")
    for name in _SURFACE:
        if not np.all(found.get(name, np.zeros(1)) >= 0):
            raise InputError(f"{name}: holds NaN, or negative values")
    if not np.all(np.isnan(found["motion"]) != np.isnan(found["force"])):
        raise InputError("motion, force: for each component one of the two must be NaN")
    if about["law"] not in ("coulomb", "tresca") or not 0 < about["tol"] < 1:
        raise InputError(f"law {about['law']!r} or tolerance {about['tol']!r} out of range")
    given: dict[str, Any] = {name: found.get(name) for name in _OF_CASE}
    if "adhesion" in about:
        glue = None if about["adhesion"] is None else Adhesion(**about["adhesion"])
        given["surface"] = SurfaceState(glue, **{name: found.get(name) for name in _SURFACE})
    case = GridCase(compliance=compliance, law=about["law"], **given)
    lines = tuple(Iteration(**line) for line in about["history"])
    return GridState(case, found["forces"], found["a"], about["tol"], lines)


def _words(compliance: Any) -> dict[str, Any]:
    """The arguments that a compliance is built from."""
    if type(compliance) is HalfSpace:
        return {
            "class": "HalfSpace", "lengths": compliance.lengths, "shape": compliance.shape,
            "E": compliance.E, "nu": compliance.nu, "normal": compliance.normal.tolist(),
        }  # fmt: skip
    if type(compliance) is not PeriodicLayers:
        raise InputError(
            f"result: a compliance of {type(compliance).__name__} cannot be saved; a file holds "
            "HalfSpace and PeriodicLayers. Save the fields with numpy.savez, and solve again"
        )
    given = {
        "class": "PeriodicLayers", "lengths": compliance.lengths, "cells": compliance.cells,
        "layers": [layer[:4] for layer in compliance.layers], "sides": compliance.sides,
        "element": _ELEMENTS.name(compliance.element), "interfaces": compliance.interfaces,
    }  # fmt: skip
    if compliance.base is not None:
        return given | {"base": compliance.base}
    top = "".join("xyz"[i] for i in np.flatnonzero(compliance.held))
    return given | {"top": top, "motion": compliance.motion.tolist(), "plane": compliance.plane}


def _compliance(given: dict[str, Any], xp: Any) -> HalfSpace | PeriodicLayers:
    given = dict(given)
    kind = given.pop("class")
    if kind == "HalfSpace":
        return HalfSpace(**given, xp=xp)
    if kind != "PeriodicLayers":
        raise InputError(f"compliance {kind!r}: expected HalfSpace or PeriodicLayers")
    element = _ELEMENTS.kind("element", given["element"])()
    return PeriodicLayers(**given | {"element": element}, xp=xp)
