"""The body condensed onto its contact boundary.

In: a body and its contact rows.
Out: a `BoundaryProblem`: a few dense arrays, all that the contact laws see.
Start: `condense` goes by the body's type: `sparse` takes one factorisation, `layers` slab doubling.
"""
