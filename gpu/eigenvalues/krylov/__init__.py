"""Krylov-Schur iteration, and the challenge that looks for what it missed.

In: an operator and a first vector.
Out: a partial Schur form.
Start: `krylov_schur`, then `arnoldi`.
"""
