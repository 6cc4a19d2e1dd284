"""One step as stages: sweeps along axes, or the direct update of a plane.

In: the moments of a field (`State`), a velocity, boundary data.
Out: for each stage its feet and the other data that its kernel needs.
Start: `stage`; `walls` treats nodes whose characteristic begins on a wall.
"""
