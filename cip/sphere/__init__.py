"""Transport on the sphere, where a pole is a point like others.

In: a `Sphere`, a velocity of longitude, latitude and time.
Out: the `State` after a step, with its mass, or the `Trajectory` of a run.
Start: `solver`; `paths` follows points in space, `remap` makes means in cells from line
integrals along the edges that the flow brings.
"""
