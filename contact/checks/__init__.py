"""Results doubted from outside: by other solvers, and by a search for other solutions.

In: a problem or a result.
Out: `CrossCheck`: the difference to an independent solver; `Uniqueness`: a proof or a find.
Start: `cross_check`, then `uniqueness`.
"""
