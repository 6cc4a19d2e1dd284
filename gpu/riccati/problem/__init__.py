"""Linear-quadratic problems as data.

In: the arguments of `lqr`, dense, diagonal, sparse or factored.
Out: an `LQRProblem` with products, shifted solves and weights, and its form without cross term.
Start: `lqr_problem`, then `state_matrix` and `weights`.
"""
