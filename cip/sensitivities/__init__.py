"""Derivatives of whole runs of the discrete schemes: tangent-linear and adjoint.

In: a solver, one of its runs.
Out: a SciPy LinearOperator from the start and the parameters of the solver to the end.
Start: `window`; then `node_derivatives` for the moments, `path_adjoint` and
`path_tangent` for the feet.
"""
