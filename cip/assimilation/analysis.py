"""The analysis of a window: states and parameters given the reports, with standard deviations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cip.formulas.velocity import Velocity
from cip.grid import Array
from cip.stages.state import State
from cip.stages.state_dataset import state_dataset


@dataclass(frozen=True, eq=False)
class Analysis:
    """The most probable states of a window, given reports of sensors.

    `four_d_var` returns it. Deviations are those of the problem linearised in the last outer
    iteration, with the combinations of reports that were used: an upper bound of those from all
    reports, exact if `complete` is true.

    Attributes
    ----------
    states : tuple of State
        At the background's time and at each later time of the sensors.
    deviations : ndarray
        Posterior standard deviation of the nodal values at the start, shape ``grid.nodes``.
    velocity : Velocity
        With the estimated parameters.
    parameters : dict
        Estimates of the solver's parameters that vary, by name.
    parameter_deviations : dict
        Their posterior standard deviations.
    amplitudes : tuple of ndarray
        For each interval the numbers, of prior variance 1, of its model error: with
        `Covariance.patterns` the strengths of the patterns in units of their deviations; empty
        where the model is exact.
    amplitude_deviations : tuple of ndarray
        Their posterior deviations.
    singular_values : ndarray
        Of the directions that the reports determine: the change of all reports, in their
        deviations, for a change by one prior deviation. Those above 1 are seen rather than assumed.
    cost : float
        Half the sum of squares of residuals and control numbers, over their deviations.
    reports : int
        Number of reports.
    gradient : float
        Norm of the gradient of the cost at the analysis, by the discrete adjoint, relative to that
        at the background.
    outer_iterations : int
    complete : bool

    References
    ----------
    O. Talagrand, A posteriori evaluation and verification of analysis and assimilation algorithms,
    in: Proc. ECMWF Workshop on Diagnosis of Data Assimilation Systems (1999), 17-28.

    Examples
    --------
    >>> from cip import Covariance, Grid, Sensors, Solver, four_d_var
    >>> grid = Grid((0, 1), 32, periodic=True)
    >>> solver = Solver(grid, 1.0)
    >>> B = Covariance.diffusion(grid, "cubic", deviation=1.0, length=0.15)
    >>> sensors = Sensors([0.3, 0.6], [0.1, 0.3], [[0.9, -0.6], [0.2, 0.9]], 0.1)
    >>> found = four_d_var(solver, solver.state(0.0), B, sensors, dt=0.05)
    >>> found.complete, bool(found.deviations.min() < 0.2), bool(found.deviations.max() < 1)
    (True, True, True)
    """

    states: tuple[State, ...]
    deviations: Array
    velocity: Velocity
    parameters: dict[str, float]
    parameter_deviations: dict[str, float]
    amplitudes: tuple[Array, ...]
    amplitude_deviations: tuple[Array, ...]
    singular_values: Array
    cost: float
    reports: int
    gradient: float
    outer_iterations: int
    complete: bool

    def __repr__(self) -> str:
        return (
            f"Analysis({len(self.states)} states from t = {self.states[0].t:.6g} to "
            f"{self.states[-1].t:.6g}, {self.reports} reports, chi-square "
            f"{2.0 * self.cost:.4g}, {self.degrees_of_freedom:.1f} degrees of freedom seen)"
        )

    def to_xarray(self) -> Any:
        """An xarray.Dataset: each moment over t and the coordinates, and what is estimated.

        ``deviation`` is that of the values at the start; ``parameter_value`` and
        ``parameter_deviation`` are over the names of the parameters.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        MissingDependency
            xarray is not installed.
        """
        found = state_dataset(self.states)
        found["deviation"] = (found["u"].dims[1:], self.deviations)
        found = found.assign_coords(parameter=np.array(list(self.parameters), dtype=str))
        found["parameter_value"] = (["parameter"], list(self.parameters.values()))
        found["parameter_deviation"] = (["parameter"], list(self.parameter_deviations.values()))
        return found

    @property
    def start(self) -> State:
        """The analysis at the time of the background."""
        return self.states[0]

    @property
    def explained(self) -> bool:
        """Whether the reports are consistent with prior and noise.

        Twice the cost has the distribution of chi-square with as many degrees of freedom as reports
        where both are right (Talagrand); here it may exceed its mean by five standard
        deviations.
        """
        return bool(2.0 * self.cost <= self.reports + 5.0 * np.sqrt(2.0 * self.reports))

    @property
    def degrees_of_freedom(self) -> float:
        """How many unknowns the reports determine: the trace of the sensitivity of the fit."""
        squares = self.singular_values**2
        return float(np.sum(squares / (1.0 + squares)))
