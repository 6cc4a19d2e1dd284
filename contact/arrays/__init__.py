"""Dense algebra of a contact boundary on NumPy or CuPy, its BLAS threads, and pairs of numbers.

In: dense arrays of either module.
Out: factorisations and products, by the same names for both; on the host, sums with twice the
digits.
Start: `dense_arrays`; `pairs` for the digits.
"""
