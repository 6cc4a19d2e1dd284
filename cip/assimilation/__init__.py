"""Data assimilation: states and parameters of a run from sensors, and where to put the sensors.

In: a solver, a background state with its covariance, `Sensors`.
Out: an analysis with its deviations; sensor places with an upper bound over all choices.
Start: `four_d_var` and `place_sensors`; `assimilation_window` is the model and its derivative.
"""
