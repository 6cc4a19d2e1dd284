"""The methods that find a gain: doubling, Newton-Kleinman, Hamiltonian, reduced.

In: an `LQRProblem`.
Out: a candidate, `Found`: a gain, perhaps a value, not yet certified.
Start: `doubling` for dense problems, `reduced` for large ones.
"""
