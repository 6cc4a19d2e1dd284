"""Linear-quadratic problems as data.

In: the arguments of `lqr`, dense, diagonal, sparse or factored.
Out: an `LQRProblem`: products, shifted solves, weights, no cross term.
Start: `lqr_problem`, then `state_matrix` and `weights`.
"""
