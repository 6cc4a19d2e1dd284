"""Convex quadratic programs.

In: a matrix, a vector, bounds, equality and inequality rows; one problem or many.
Out: `QPResult` with residuals recomputed from the problem.
Start: `solve_qp`: plain boxes go to `active_set`, others to `interior_point`.
"""
