"""Velocities from data: least squares with the tangent of the scheme, and their identifiability.

In: a solver whose velocity has parameters, its start, observations of later states.
Out: an `IdentifiedVelocity` with deviations and identifiability.
Start: `identify`; the model's values and sensitivity are in `problem`.
"""
