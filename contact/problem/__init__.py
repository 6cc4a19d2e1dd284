"""The contact problem as a user states it, solved and certified.

In: body, boundary, obstacle, friction law, method.
Out: a certified `ContactResult`, or an error that says what stands in the way.
Start: `contact_problem`, then `solve_system`; the others give it starts, second attempts, warnings.
"""
