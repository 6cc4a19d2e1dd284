"""Checks of arguments that several parts of the package ask for.

In: a number, vector, matrix or list of dofs as a user may give it.
Out: the same as NumPy wants it, or an `InputError` that names it.
Start: `positive_number`, the shortest; the others are made like it.
"""
