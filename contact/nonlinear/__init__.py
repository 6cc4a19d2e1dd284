"""Bodies of large strain and nonlinear materials, and their histories in contact.

In: a stress or weak form of the user on a scikit-fem Basis, and a `ContactProblem`.
Out: `NonlinearHistory`, steps that are certified on the current configuration.
"""
