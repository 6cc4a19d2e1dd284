"""A few eigenvalues or singular values of a large matrix.

In: a matrix or operator, a mass matrix or shift, which values are wanted and how many.
Out: values and vectors whose residuals are recomputed from the matrices.
Start: `eigs`, then `krylov.krylov_schur`.
"""
