"""Profiles: the function within a cell that the moments around it stand for.

In: moments at the nodes of a cell, a foot in it.
Out: moments there; kernels of one node for the CPU and the device.
Start: `catalogue`, then `line_profiles` and `line_kernels`.
"""
