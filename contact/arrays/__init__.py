"""Dense algebra of a contact boundary on NumPy or CuPy, its BLAS threads, and pairs of numbers.

In: dense arrays of either module.
Out: factorisations and products, with one interface for both; on the host, sums in twice the
working precision.
Start: `dense_arrays`; `pairs` for the precision.
"""
