"""Primal-dual active sets for strictly convex programs.

In: a factored program and a start.
Out: the solution of its active set, or word that the sets went in circles.
Start: `box`; `whitened` takes inequality rows too.
"""
