"""Certificates of solutions of a Riccati equation and of the stability of its loop.

In: a problem with a gain or a value.
Out: residuals, poles or bounds for them, refined solutions.
Start: `closed_loop`, then `refinement`.
"""
