"""Programs of any kind: presolve, interior point, polish, proofs of infeasibility.

In: a `StandardQP`.
Out: a solution to the accuracy of the arithmetic, or a proof that there is none.
Start: `minimise`, which calls the others in turn.
"""
