"""Feet of the characteristics: their starting points, and the derivatives of the map to them.

In: a velocity, points and a time step.
Out: feet and derivatives of the flow, integrated backward together.
Start: `feet`; its equations are made by `flow_derivatives`.
"""
