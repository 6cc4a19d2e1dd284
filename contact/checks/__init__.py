"""Independent checks of a result: by other solvers, in other arithmetic, for other solutions.

In: a problem and its result.
Out: `CrossCheck`: the difference to an independent solver; the residuals in pairs of numbers;
`Uniqueness`: a proof, or the other solutions that were found.
Start: `cross_check`, then `recheck` and `uniqueness`.
"""
