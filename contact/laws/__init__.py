"""Contact and friction on the condensed problem: which point is open, sticks or slips.

In: a `BoundaryProblem`, a friction law, an initial guess.
Out: `Forces` that satisfy the laws, and the history of the iteration.
Start: `methods` chooses the algorithm; `law` has the zones, residual and linearisation of contact
and friction, `newton` the iteration, `condensed_newton` and `primal_newton` its linear systems;
`methods` also solves box quadratic programs.
"""
