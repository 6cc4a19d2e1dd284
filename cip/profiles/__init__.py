"""Profiles: the function within a cell that the moments at its nodes determine.

In: moments at the nodes of a cell, a foot in it.
Out: moments at the foot; kernels of one node for the CPU and the device.
Start: `catalogue`, then `line_profiles` and `line_kernels`.
"""
