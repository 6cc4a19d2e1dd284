"""One step as stages: sweeps along axes, or the direct update of a plane.

In: the moments of a field (`State`), a velocity, what is known on the walls.
Out: for each stage its feet and what its kernel needs to know.
Start: `stage`; `walls` holds nodes whose characteristic begins on a wall.
"""
