"""An identified velocity and its standard deviations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError
from cip.formulas.velocity import Velocity
from cip.grid import Array, Grid
from cip.inverse.identifiability import Identifiability
from cip.inverse.problem import field, field_slopes
from cip.output.stored import fields_from, read_words, reading, write_words


class MisfitWarning(UserWarning):
    """The model does not fit the data within the noise.

    Either the noise is larger than given, or the velocity has no parameters for what is seen, or
    the errors of the scheme exceed the noise, or the estimate is a local minimum. Deviations are
    enlarged by the root of the reduced chi-square, which does not mend any of these.

    Examples
    --------
    A noise that is ten times too small:

    >>> import warnings
    >>> import numpy as np
    >>> from cip import Grid, Solver, Velocity, identify_velocity
    >>> shift = Velocity.from_expression("a", parameters={"a": 1.0})
    >>> solver = Solver(Grid((0, 1), 64, periodic=True), shift)
    >>> start = solver.state("sin(2*pi*x1)")
    >>> u = solver.run(start, 0.2, dt=0.02).final["u"]
    >>> u = u + 0.01 * np.random.default_rng(1).standard_normal(64)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     found = identify_velocity(solver, start, {0.2: u}, dt=0.02, noise=0.001)
    >>> found.explained, len(caught)
    (False, 1)
    """


@dataclass(frozen=True, eq=False)
class IdentifiedVelocity:
    """An estimate of a velocity from data.

    Deviations are those of the linear problem at the estimate, with the seminorm as prior knowledge
    (Tarantola, Inverse Problem Theory, 2005, section 3.2): the noise and what the seminorm allows
    beyond it. They do not include errors of the scheme below the noise, other minima, or bounds.

    Attributes
    ----------
    velocity : Velocity
    grid : Grid
    t : float
        Half way from the start to the last data; unsteady velocities are shown there.
    covariance : ndarray, shape (P, P)
        Of the parameters, without directions that change no data (`Identifiability.lost`).
    misfit : ndarray
        Predicted minus given data, in the unit of the field.
    reduced_chi_square : float or None
        Mean square of the misfit over the noise, by the degrees of freedom left; None where the
        noise is unknown or 0.
    explained : bool
        Whether the noise explains the misfit.
    weight : float
        Of the seminorm's square beside the sum of squares of misfit over noise.
    regularization : str or None
    at_bounds : tuple of str
        Parameters at their bounds.
    degrees_of_freedom : float
        How many parameters the data have determined.
    runs : int
        Runs of the model.
    identifiability : Identifiability
    feet_on_edges : int
        Feet on edges of cells at the estimate, over all steps, as everywhere at rest: derivatives
        of the scheme may jump there, and the covariance takes the mean of both sides.

    Examples
    --------
    >>> from cip import Grid, Solver, Velocity, identify_velocity
    >>> shift = Velocity.from_expression("a", parameters={"a": 1.0})
    >>> solver = Solver(Grid((0, 1), 64, periodic=True), shift)
    >>> start = solver.state("sin(2*pi*x1)")
    >>> end = Solver(solver.grid, 1.25).run(start, 0.2, dt=0.02).final
    >>> found = identify_velocity(solver, start, {0.2: end["u"]}, dt=0.02, noise=0.01)
    >>> print(f"{found.parameters['a']:.3f}, deviation {found.deviations['a']:.4f}")
    1.250, deviation 0.0014
    """

    velocity: Velocity
    grid: Grid
    t: float
    covariance: Array
    misfit: Array
    reduced_chi_square: float | None
    explained: bool
    weight: float
    regularization: str | None
    at_bounds: tuple[str, ...]
    degrees_of_freedom: float
    runs: int
    identifiability: Identifiability
    feet_on_edges: int = 0

    def __repr__(self) -> str:
        return (
            f"IdentifiedVelocity({len(self.covariance)} parameters, {self.misfit.size} data, "
            f"misfit {self.root_mean_square:.3g}, {len(self.identifiability.unseen)} directions "
            "unseen)"
        )

    @property
    def parameters(self) -> dict[str, float]:
        """The estimates by names."""
        return self.velocity.parameters

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the parameters by names; infinite where no data change."""
        roots = np.sqrt(np.diag(self.covariance))
        lost = self.identifiability.vectors[self.identifiability.lost]
        roots[_occurs(lost / np.abs(lost).max(axis=1, keepdims=True))] = np.inf
        return dict(zip(self.parameters, map(float, roots), strict=True))

    @property
    def root_mean_square(self) -> float:
        """Root mean square of the misfit, in the unit of the field."""
        return float(np.sqrt(np.mean(self.misfit**2)))

    @property
    def values(self) -> Array:
        """The velocity at the nodes, shape (components,) + nodes."""
        found = field(self.velocity, self.grid, self.t)
        return found.reshape(-1, *self.grid.nodes)

    @property
    def value_deviations(self) -> Array:
        """Standard deviations of `values`, each by itself, of the same shape."""
        slopes = field_slopes(self.velocity, self.grid, self.t, tuple(self.parameters))
        flat = slopes.reshape(len(slopes), -1)
        found = np.sqrt(np.maximum(np.einsum("pn,pq,qn->n", flat, self.covariance, flat), 0.0))
        lost = self.identifiability.patterns[self.identifiability.lost]
        found[_occurs(lost.reshape(len(lost), flat.shape[1]))] = np.inf
        return found.reshape(-1, *self.grid.nodes)

    def misfit_message(self) -> str:
        """Why the misfit exceeds the noise, and what to do.

        Returns
        -------
        str
        """
        return (
            f"data: the misfit {self.root_mean_square:.3g} has a reduced chi-square of "
            f"{self.reduced_chi_square:.3g}, more than the noise explains: noise too small, too "
            "few parameters, a grid or steps too coarse, or a local minimum"
        )

    def summary(self) -> str:
        """The estimate in a few lines.

        Returns
        -------
        str
        """
        seen = self.identifiability
        lines = [repr(self)]
        deviations = self.deviations
        shown = list(self.parameters.items())[:8]
        lines += [f"  {name} = {value:.6g} +- {deviations[name]:.2g}" for name, value in shown]
        if len(deviations) > len(shown):
            lines.append(f"  and {len(deviations) - len(shown)} more")
        if self.regularization:
            lines.append(
                f"  {self.regularization} seminorm with weight {self.weight:.3g}; the data "
                f"determine {self.degrees_of_freedom:.1f} of {len(deviations)} parameters"
            )
        if self.reduced_chi_square is not None:
            verdict = "explained by the noise" if self.explained else "NOT explained by the noise"
            lines.append(f"  reduced chi-square {self.reduced_chi_square:.3g}: {verdict}")
        if self.at_bounds:
            lines.append(f"  at their bounds: {', '.join(self.at_bounds)}")
        lines.append(f"  singular values: largest over smallest {seen.condition:.3g}")
        if seen.unseen:
            lines.append(f"  {seen.message()}")
        return "\n".join(lines)

    def plot(self, ax: Any = None) -> Any:
        """Draw the velocity with two deviations: a curve on lines, a map of the speed in planes.

        Parameters
        ----------
        ax : matplotlib Axes, optional

        Returns
        -------
        matplotlib Axes
        """
        from cip.output.plot import plot_identified

        return plot_identified(self, ax)

    def save(self, path: str | Path) -> None:
        """Write everything but the form of the velocity to a text file (JSON), without loss.

        Parameters
        ----------
        path : path

        Raises
        ------
        OSError
            No space left, or no permission to write.
        """
        parts: dict[str, Any] = {name: getattr(self, name) for name in _PLAIN}
        parts |= {"parameters": self.parameters, "identifiability": vars(self.identifiability)}
        parts |= {"edges": list(self.grid.edges), "periodic": list(self.grid.periodic)}
        write_words(path, _FORMAT, parts)

    @classmethod
    def load(cls, path: str | Path, velocity: Velocity) -> IdentifiedVelocity:
        """Read what `save` wrote.

        Parameters
        ----------
        path : path
        velocity : Velocity
            Of the same form as the one that was identified; its parameters get the stored values.

        Returns
        -------
        IdentifiedVelocity

        Raises
        ------
        InputError
            Another file, or a velocity with other parameters.
        """
        with reading(path, "an identified velocity"):
            others = "parameters", "edges", "periodic", "identifiability"
            told = read_words(path, _FORMAT, (*_PLAIN[:-1], *others))
            told.setdefault("feet_on_edges", 0)  # older files do not have it
            names = list(told["parameters"])
            if not isinstance(velocity, Velocity) or list(velocity.parameters) != names:
                raise InputError(
                    f"velocity: expected one with the parameters {', '.join(names[:8])}"
                )
            seen = Identifiability(**fields_from(Identifiability, told["identifiability"]))
            lines = dict(zip("xyz", told["edges"], strict=False))
            return cls(
                velocity=velocity.with_parameters(**told["parameters"]),
                grid=Grid.from_coordinates(**lines, periodic=told["periodic"]),
                **fields_from(cls, told | {"identifiability": seen}),
            )


def _occurs(directions: Array) -> NDArray[np.bool_]:
    """Which entries are nonzero, beyond rounding, in any of some directions."""
    return np.asarray(np.any(np.abs(directions) > 1e-8, axis=0))


_FORMAT = "identified velocity 1"
_PLAIN = (
    "t", "covariance", "misfit", "reduced_chi_square", "explained", "weight", "regularization",
    "at_bounds", "degrees_of_freedom", "runs", "feet_on_edges",
)  # fmt: skip
