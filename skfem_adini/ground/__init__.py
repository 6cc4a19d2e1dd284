"""The common base of all four packages; it needs only NumPy and SciPy.

In: arguments of any kind, arrays of NumPy or CuPy, functions to compile, data for files.
Out: numbers for NumPy or an error that names the argument, machine code, complete files, and
factors of PARDISO.
Start: `errors`, then `arguments`.
"""
