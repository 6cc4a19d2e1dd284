"""Contact and friction on the condensed problem: which point is open, sticks or slips.

In: a `BoundaryProblem`, a friction law, a start.
Out: `Forces` that satisfy the laws, with the history of the iteration.
Start: `methods` chooses the algorithm; `friction` has the laws, `zones` decides at an iterate which
point sticks or slips; `semismooth_newton` and `active_set` are the main algorithms.
"""
