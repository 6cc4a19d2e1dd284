"""What all four packages stand on; it knows NumPy and SciPy alone.

In: arguments of any kind, arrays of NumPy or CuPy, functions to compile, data for files.
Out: numbers as NumPy wants them or an error that names the argument, machine code, complete files.
Start: `errors`, then `arguments`.
"""
