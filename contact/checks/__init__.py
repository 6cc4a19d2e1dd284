"""Independent checks of a result: by other solvers, and by a search for other solutions.

In: a problem and its result.
Out: `CrossCheck`: the difference to an independent solver; `Uniqueness`: a proof, or the other
solutions that were found.
Start: `cross_check`, then `uniqueness`.
"""
