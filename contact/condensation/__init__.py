"""The body condensed onto its contact boundary.

In: a body and its contact rows.
Out: a `BoundaryProblem`: a few dense arrays, all that the contact laws see.
Start: `boundary_problem`; `sparse` makes it by one factorisation, `layers` by slab doubling.
"""
