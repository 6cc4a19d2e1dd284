"""The body condensed onto its contact boundary.

In: a body and its contact rows.
Out: a `BoundaryProblem`: a few dense arrays, all that the contact laws see.
Start: `condense` goes by the type of the body: `sparse` takes one factorisation, `layers` slab doubling.
"""
