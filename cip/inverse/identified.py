"""The velocity that data led to, with its deviations."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError
from cip.formulas.velocity import Velocity
from cip.grid import Grid
from cip.inverse.identifiability import Identifiability
from cip.inverse.problem import field, field_slopes
from cip.output.whole_file import write_whole

Array = NDArray[np.float64]


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

    Deviations are those of the linear problem at the estimate, with the seminorm as prior
    knowledge (Tarantola, Inverse Problem Theory, 2005, section 3.2): the noise and what the
    seminorm allows beyond it. They do not know of errors of the scheme below the noise, of other
    minima, nor of bounds.

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
        """Why the misfit is larger than the noise explains; what to do.

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
        from cip.inverse.plot_identified import plot_identified

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
        seen = self.identifiability
        content = {
            "format": _FORMAT,
            "parameters": self.parameters,
            "edges": [line.tolist() for line in self.grid.edges],
            "periodic": list(self.grid.periodic),
            "identifiability": {
                "singular_values": seen.singular_values.tolist(),
                "vectors": seen.vectors.tolist(),
                "patterns": seen.patterns.tolist(),
                "deviations": seen.deviations.tolist(),
                "seen": seen.seen.tolist(),
                "unseen": list(seen.unseen),
            },
            **{name: np.asarray(getattr(self, name)).tolist() for name in _ARRAYS},
            **{name: getattr(self, name) for name in _PLAIN},
        }
        write_whole(Path(path), json.dumps(content))

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
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(f"path: {path} was not written by save: {error}") from error
        if not isinstance(content, dict) or content.get("format") != _FORMAT:
            raise InputError(f"path: {path} was not written by save")
        missing = {*_OTHERS, *_ARRAYS, *_PLAIN} - content.keys()
        if missing:
            raise InputError(f"path: {path} is damaged, it has no {min(missing)!r}")
        if not isinstance(velocity, Velocity) or list(velocity.parameters) != list(
            content["parameters"]
        ):
            raise InputError(
                "velocity: expected one with the parameters "
                f"{', '.join(list(content['parameters'])[:8])}"
            )
        seen: dict[str, Any] = {
            name: tuple(value) if name == "unseen" else np.array(value)
            for name, value in content["identifiability"].items()
        }
        plain: dict[str, Any] = {name: content[name] for name in _PLAIN}
        plain |= {name: np.array(content[name], dtype=float) for name in _ARRAYS}
        plain["at_bounds"] = tuple(plain["at_bounds"])
        periodic: list[bool] = content["periodic"]
        lines = dict(zip("xyz", content["edges"], strict=False))
        grid = Grid.from_coordinates(**lines, periodic=periodic)
        return cls(
            velocity=velocity.with_parameters(**content["parameters"]),
            grid=grid,
            identifiability=Identifiability(**seen),
            **plain,
        )


def _occurs(directions: Array) -> NDArray[np.bool_]:
    """Which entries any of some directions changes, beyond rounding."""
    return np.asarray(np.any(np.abs(directions) > 1e-8, axis=0))


_FORMAT = "identified velocity 1"
_OTHERS = ("parameters", "edges", "periodic", "identifiability")
_ARRAYS = ("covariance", "misfit")
_PLAIN = (
    "t", "reduced_chi_square", "explained", "weight", "regularization", "at_bounds",
    "degrees_of_freedom", "runs",
)  # fmt: skip
