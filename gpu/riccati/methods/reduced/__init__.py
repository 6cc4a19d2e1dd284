"""The Riccati equation on a small basis that grows (Algorithm 7).

In: a large `LQRProblem` with few inputs and a weight of any rank.
Out: a gain whose loop is proved stable, without a dense matrix of full order.
Start: `reduced`.
"""
