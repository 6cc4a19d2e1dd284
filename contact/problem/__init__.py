"""The contact problem as a user states it, solved and certified.

In: body, boundary, obstacle, friction law, method.
Out: a certified `ContactResult`, or an error that names the cause.
Start: `contact_problem`, then `solve_system`; the other modules have initial guesses, second
attempts and warnings.
"""
