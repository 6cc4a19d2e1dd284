"""NumPy or CuPy: where an array lies, and the algebra that serves either side.

In: dense or sparse arrays.
Out: products, factors and triangular solves where the arrays lie.
Start: `namespace`, then `dense` and `sparse_factor`.
"""
