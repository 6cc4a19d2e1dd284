"""Rigid obstacles: shapes, signed distances, motion, and whether they are placed with sense.

In: points of a boundary and the body's outward normals there.
Out: the gap along each normal; the motions that an obstacle may make.
Start: `shapes`, then `rigid`.
"""
