"""NumPy or CuPy: the array module of arguments, and linear algebra for the host and a device.

In: dense or sparse arrays.
Out: products, factors and triangular solves on the side on which the arrays are.
Start: `namespace`, then `dense` and `sparse_factor`.
"""
