"""Symmetric sparse systems and eigenvalue problems.

In: a sparse matrix, and for multigrid what it must know of the mesh.
Out: factors that solve again and again, and certified eigenpairs.
Start: `factorize`, which chooses between `pardiso`, `superlu` and `multigrid`.
"""
