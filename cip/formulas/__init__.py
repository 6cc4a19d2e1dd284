"""Functions of space and time with exact derivatives.

In: a text, a callable or arrays.
Out: `Formula`, `Velocity` and `Source`, and straight-line code for NumPy and for kernels.
Start: `formula`, which traces a callable into the graphs of `expression`.
"""
