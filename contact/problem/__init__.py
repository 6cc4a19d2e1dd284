"""The contact problem as a user states it, solved and certified.

Input: body, boundary, obstacle, friction law, method.
Output: a certified `ContactResult`, or an error that names the cause.
Start: `contact_problem`, then `solve_system`; the other modules have initial guesses, second
attempts and warnings.
"""
