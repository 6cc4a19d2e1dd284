"""Linear algebra for the host and a device, by the same names for both.

In: dense or sparse arrays.
Out: products, factors and triangular solves on the side on which the arrays are.
Start: `dense`, then `sparse_factor`.
"""
