"""Where the characteristics come from, and the derivatives of that map.

In: a velocity, points and a time step.
Out: feet and derivatives of the flow, integrated backward together.
Start: `feet`; its equations are made by `flow_derivatives`.
"""
