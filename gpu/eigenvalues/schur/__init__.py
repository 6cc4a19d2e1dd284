"""Schur forms of small projected matrices, in a wanted order.

In: a small matrix, and which eigenvalues come first.
Out: its ordered Schur form.
Start: `ordered_schur`.
"""
