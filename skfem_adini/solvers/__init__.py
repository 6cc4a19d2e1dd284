"""Symmetric sparse systems and eigenvalue problems.

In: a sparse matrix, and for multigrid its near-null space.
Out: factors that solve for any number of loads, and certified eigenpairs.
Start: `factorize`, which chooses between PARDISO, SuperLU and `multigrid`.
"""
