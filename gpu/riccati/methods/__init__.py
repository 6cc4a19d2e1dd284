"""The methods that find a gain: doubling, Newton-Kleinman, Hamiltonian, reduced.

In: an `LQRProblem`.
Out: what a method has found: a gain, perhaps a value.
Start: `doubling` for dense problems, `reduced` for large ones.
"""
