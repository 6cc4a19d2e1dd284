"""Linear algebra with the same functions for the host and a device.

In: dense or sparse arrays.
Out: products, factors and triangular solves where the arrays are stored.
Start: `dense`, then `sparse_factor`.
"""
