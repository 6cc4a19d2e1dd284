"""Constant coefficients on uniform grids, solved by sine and cosine transforms.

In: a grid, coefficients and the boundary condition.
Out: `UniformSolver`: solutions, and eigenvalues in any precision.
Start: `solver`, then `symbols`.
"""
