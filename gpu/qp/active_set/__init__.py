"""Primal-dual active sets for strictly convex programs.

In: a factored program and a start.
Out: the solution of its active set, or an error if the sets cycle.
Start: `box`; `whitened` takes inequality rows too.
"""
