"""Krylov-Schur iteration, and the challenge: a search for missed eigenvalues.

In: an operator and a first vector.
Out: a partial Schur form.
Start: `krylov_schur`, then `arnoldi`.
"""
