"""The body condensed onto its contact boundary.

In: a body and its contact rows.
Out: a `BoundaryProblem`: the few dense arrays that the contact laws need.
Start: `condense` chooses by the body's type: `sparse` uses one factorisation, `layers` slab
doubling; `solved_body` eliminates nothing, for several devices and for many contact rows.
"""
