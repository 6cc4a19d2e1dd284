"""Doctests of a single file: a module must not take the place of the function of its name.

pytest's importlib mode makes a module an attribute of its package, which for `gpu.eigs`, `gpu.lqr`
and `gpu.svds` would hide the functions. It leaves packages alone that have been imported before.
"""

import gpu  # noqa: F401
