"""Contact functionals: how forces at contact points meet the displacement of a boundary.

In: the trace of a body on one or several boundaries, and obstacles before them.
Out: `ContactRows` (sparse normal and tangential rows, weights, frames) and a `GapRule`.
Start: `discretise`; `functionals` and `shares` say what a contact point reads.
"""
