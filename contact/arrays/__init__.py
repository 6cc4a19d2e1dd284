"""Dense algebra of a contact boundary on NumPy or CuPy, and its BLAS threads.

In: dense arrays of either module.
Out: factorisations and products, by the same names for both.
Start: `dense_arrays`.
"""
