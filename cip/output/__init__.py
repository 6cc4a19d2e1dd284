"""Results of a run: snapshots, diagnostics, samples, pictures.

In: states at the output times.
Out: `Trajectory`; values between the nodes, files, animations.
Start: `trajectory`.
"""
