"""What all results of contact have: tractions, forces, facts, tables and pictures of points."""

from __future__ import annotations

from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from contact.arrays.sparse_rows import transpose
from contact.output.drawn import pair_name
from contact.output.tables import points_frame
from contact.output.vtk import boundary_grid

Array = NDArray[np.float64]
Chosen = NDArray[np.bool_]


class ContactFields:
    """Quantities derived from the contact forces of a result and the rows of its system."""

    if TYPE_CHECKING:
        mu: Array
        t: Array

        @property
        def system(self) -> Any:
            """Body, rows, law and friction."""

    def summary(self) -> str:
        """The problem, the main results and the residuals, in ten lines.

        Returns
        -------
        str
        """
        return as_text(self._facts, type(self).__name__)

    def _repr_html_(self) -> str:
        return as_html(self._facts, type(self).__name__)

    @property
    def _facts(self) -> dict[str, str]:
        kept = self.__dict__.get("_kept")
        return facts(self) if kept is None else kept[1]

    @property
    def x(self) -> Array:
        """Positions of the contact points, the centroids of the functional, shape (dim, m)."""
        return np.asarray(self.system.rows.x)

    @property
    def x_nominal(self) -> Array:
        """Nominal positions of the contact points, shape (dim, m)."""
        return np.asarray(self.system.rows.x_nominal)

    @property
    def pressure(self) -> Array:
        """Contact pressure at `x`, force per area, positive in compression, shape (m,).

        Zero at bonded points, see `tie_pressure`.
        """
        return self._normal(~self.system.rows.ties)

    @property
    def shear(self) -> Array:
        """Shear traction that acts on the body at `x`, along the tangents, (m, dim - 1).

        Where supports prescribe the whole slip and it is not zero, the shear opposes it at its
        bound. Where they prescribe zero slip, the shear cannot be distinguished from their
        reactions and is reported as zero, see `Status.UNDETERMINED`. Zero at bonded points, see
        `tie_shear`.
        """
        return self._tangential(~self.system.rows.ties)

    @property
    def tie_pressure(self) -> Array:
        """Normal traction of ties at `x`, negative where they pull, shape (m,); else zero."""
        return self._normal(self.system.rows.ties)

    @property
    def tie_shear(self) -> Array:
        """Tangential traction of ties on the body at `x`, shape (m, dim - 1); else zero."""
        return self._tangential(self.system.rows.ties)

    def _normal(self, chosen: Chosen) -> Array:
        return np.where(chosen, self.mu / self.system.rows.weights, 0.0)

    def _tangential(self, chosen: Chosen) -> Array:
        return np.where(chosen[:, None], -self.t / self.system.rows.weights[:, None], 0.0)

    @property
    def part(self) -> NDArray[np.int64]:
        """Number of the contact boundary of each contact point, shape (m,)."""
        return np.asarray(self.system.rows.boundary)

    @property
    def zone(self) -> Array:
        """Bounding box of the nominal positions of loaded points, shape (dim, 2).

        NaN where nothing is in contact; bonded points do not count.
        """
        p = self.mu[~self.system.rows.ties]
        loaded = (self.mu > 1e-12 * float(p.max(initial=0.0))) & ~self.system.rows.ties
        if not loaded.any():
            return np.full((self.x.shape[0], 2), np.nan)
        where = self.x_nominal[:, loaded]
        return np.column_stack((where.min(axis=1), where.max(axis=1)))

    @cached_property
    def resultant(self) -> Array:
        """Force of the obstacle on the body, pressure and friction together, shape (dim,).

        Between bodies: the sum of the `resultants`. For ties see `tie_resultants`.
        """
        if self.system.rows.axes.size:
            return np.asarray(self.resultants.sum(axis=0))
        return np.asarray(self.system.body.total(-self.contact_forces))

    @property
    def resultants(self) -> Array:
        """The resultant of each contact boundary, shape (nboundaries, dim).

        Where two bodies meet it is the force on the one that carries the contact points; the force
        on the other is equal and opposite. Zero where they are tied, see `tie_resultants`.
        """
        return self._totals(~self.system.rows.ties)

    @property
    def tie_resultants(self) -> Array:
        """The resultant of each tied boundary, shape (nboundaries, dim)."""
        return self._totals(self.system.rows.ties)

    def _totals(self, chosen: Chosen) -> Array:
        boundaries = [chosen & (self.part == k) for k in range(self.part.max() + 1)]
        axes = self.system.rows.axes
        if not axes.size:
            return np.array([self.system.body.total(-self._forces(p)) for p in boundaries])
        on_points = -np.einsum("ma,mac->mc", np.column_stack((self.mu, self.t)), axes)
        if self.system.body.is_ring:
            on_points[:, 0] = 0.0  # radial forces cancel around the ring
        return np.array([on_points[p].sum(axis=0) for p in boundaries])

    def _forces(self, chosen: Chosen) -> Array:
        rows, t = self.system.rows, np.where(chosen[:, None], self.t, 0.0)
        if not chosen.any():
            return np.zeros(rows.G.shape[1])
        mu = np.where(chosen, self.mu, 0.0)
        return np.asarray(transpose(rows.G) @ mu + transpose(rows.T) @ t.ravel())

    @property
    def contact_force(self) -> float:
        """Sum of the normal forces of contact."""
        return float(self.mu[~self.system.rows.ties].sum())

    @property
    def tie_force(self) -> float:
        """Sum of the normal forces of ties, negative where they pull."""
        return float(self.mu[self.system.rows.ties].sum())

    @cached_property
    def contact_forces(self) -> Array:
        """``G^T mu + T^T t`` on all dofs: the contact forces with the opposite sign."""
        return self._forces(~self.system.rows.ties)

    @cached_property
    def tie_forces(self) -> Array:
        """As `contact_forces`, for the bonded points."""
        return self._forces(self.system.rows.ties)

    @property
    def centre_of_pressure(self) -> Array:
        """Point of action of the pressure resultant of each contact boundary, (nboundaries, dim).

        NaN without contact. Forces act at the nominal positions, so that moments are those on the
        body.
        """
        contact = ~self.system.rows.ties
        parts = [contact & (self.part == k) for k in range(self.part.max() + 1)]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.array([self.x_nominal[:, p] @ self.mu[p] / self.mu[p].sum() for p in parts])

    def to_frame(self) -> Any:
        """The contact points as a table: place, boundary, status, gap, pressure, shear and slip.

        Returns
        -------
        pandas.DataFrame
            One row a point, in the order of `pressure`. Bonded points have the tractions of ties.

        Raises
        ------
        MissingDependency
            pandas is not installed.

        Examples
        --------
        >>> from skfem import MeshQuad
        >>> from contact import ContactProblem, ElasticBody
        >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
        >>> body = body.fix("top", "x").fix("top", "y", -0.1)
        >>> frame = ContactProblem(body, "bottom", 0.05, friction=0.3).solve().to_frame()
        >>> print(list(frame.columns), len(frame))
        ['x', 'y', 'boundary', 'status', 'gap', 'pressure', 'shear', 'slip'] 9
        """
        return points_frame(self)

    def boundary_to_pyvista(self) -> Any:
        """Contact points as a pyvista point cloud or polyline with every contact field.

        Returns
        -------
        pyvista.PolyData

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        drawn: Any = self
        return boundary_grid(drawn)


def counts(result: Any) -> str:
    """Numbers of contact points that are open, stick, slip, and, if any, are bonded or held."""
    return _counted(result.status)


def _counted(status: Any) -> str:
    free, stick, slip, bonded, held = np.bincount(status, minlength=5)
    more = f", {bonded} bonded" if bonded else ""
    more += f", {held} undetermined" if held else ""
    return f"{status.size} points: {free} open, {stick} stick, {slip} slip{more}"


def facts(result: Any) -> dict[str, str]:
    """The most important facts of a result, by name."""
    system, kkt = result.system, result.kkt
    highest = int(np.argmax(result.pressure)) if np.any(result.pressure) else None
    worst = max(kkt, key=lambda name: kkt[name])
    law = system.law
    if law is not None:
        low, high = np.min(system.friction), np.max(system.friction)
        strength = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        law = f"{law}, " + ("friction " if law == "coulomb" else "bound as a force ") + strength
    return {
        **_bodies(system.body),
        "law": law or "without friction",
        "functional": system.rows.functional,
        "solved by": f"{result.method}, iterations: {len(result.history)}",
        "contact": counts(result),
        **_forces(result),
        "pressure": "none"
        if highest is None
        else f"at most {result.pressure[highest]:.6g}, at {vector(result.x[:, highest])}",
        "displacement": f"at most {system.body.largest_displacement(result.u):.6g}",
        "certificate": f"no residual above {kkt[worst]:.1e} ({worst})",
    }


def _bodies(body: Any) -> dict[str, str]:
    """The body, or each of several by its name or number."""
    if len(body.bodies) == 1:
        return {"body": repr(body)}
    return {one.name or f"body {k}": repr(one) for k, one in enumerate(body.bodies)}


def _forces(result: Any) -> dict[str, str]:
    """The resultant; for several bodies that of each contact and tie, with the point counts."""
    body, owner = result.system.body, result.system.rows.owner
    if len(body.bodies) == 1:
        return {"resultant": vector(result.resultant)}
    found = {}
    # Points of one pair are all bonded or all free.
    for k, force in enumerate(result.resultants + result.tie_resultants):
        own = result.part == k
        whose = body.called(int(owner[own][0]))
        found[pair_name(result, k)] = f"{_counted(result.status[own])}; {vector(force)} on {whose}"
    return found


def as_text(rows: dict[str, str], title: str) -> str:
    """Lines of names and values."""
    width = max(map(len, rows))
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in rows.items())])


def as_html(rows: dict[str, str], title: str) -> str:
    """The table that notebooks show."""
    body = "".join(
        f"<tr><th style='text-align: left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    return f"<table><caption>{escape(title)}</caption>{body}</table>"


def vector(values: Any) -> str:
    """Six digits of each component; components that are rounding errors are shown as 0."""
    rounding = 1e-12 * np.abs(values).max()
    return "(" + ", ".join("0" if abs(v) <= rounding else f"{v:.6g}" for v in values) + ")"
