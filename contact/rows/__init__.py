"""Contact functionals: the displacement of a boundary, and the gap, at contact points.

In: the trace of a body on one or several boundaries, and the obstacles opposite.
Out: `ContactRows` (sparse normal and tangential rows, weights, frames) and a `GapRule`.
Start: `discretise`; `functionals` and `shares` define the value at a contact point, `gap_rule`
averages the gap in the same way.
"""
