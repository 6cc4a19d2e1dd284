"""Contact and friction on the condensed problem: which point is open, sticks or slips.

In: a `BoundaryProblem`, a friction law, a start.
Out: `Forces` that satisfy the laws, with the history of the iteration.
Start: `methods` chooses the algorithm; `law` has the zones, the residual and the linearisation of
contact and friction, `newton` the iteration of all bodies, `condensed_newton` and `primal_newton`
its linear systems; `active_set` solves box quadratic programs.
"""
