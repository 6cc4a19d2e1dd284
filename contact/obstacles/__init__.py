"""Rigid obstacles: shapes, signed distances, motion, and checks of their position.

In: points of a boundary and the body's outward normals there.
Out: the gap along each normal (`evaluate_gap`); the motions that an obstacle may make.
Start: `shapes`, then `rigid`.
"""
