"""Derivatives of results: gradients of any function of them by the data of the problem.

In: a `ContactResult`, its condensation, and the derivatives of a function by u, pressure, forces.
Out: `ContactGradient`, of a load history `HistoryGradient`: by loads, supports, moduli, friction,
gap, motions, vertices.
Start: `adjoint`, the transposed system; then `gradient`, what follows from its solution.
"""
