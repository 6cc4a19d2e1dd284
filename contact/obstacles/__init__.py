"""Rigid obstacles: shapes, signed distances, surface meshes, rough surfaces, and their motion.

In: points of a boundary and the body's outward normals there.
Out: the gap along each normal; the motions that an obstacle may make.
Start: `shapes`, whose `evaluate_gap` measures the gap at points, then `rigid`.
"""
