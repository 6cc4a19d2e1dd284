"""What all four packages stand on; it knows NumPy and SciPy alone.

In: arguments of any kind, array modules, functions to compile, files to write.
Out: the same checked, an error that names the argument, machine code, files that are complete.
Start: `errors`, then `arguments`.
"""
