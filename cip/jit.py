"""The one door to numba: kernel modules are plain Python that this compiles when first used.

Kernel modules keep to a small part of Python (numbers, flat arrays, if, for, tuples of results), so
that `cip.device_source` can translate the very same functions to C for the device. They are
imported where they are used, never by `import cip`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

# Types of the kernel language: whole numbers, numbers of the working precision, flat arrays of
# these. An `Out` is written, an `Array` only read.
Index = int
Real = float
Array = Any
Out = Any

# Multiply-add in one rounding, as on the device; nothing else is reordered.
_MATH = {"contract"}


def kernel(function: Function) -> Function:
    """Compile a function of one node or cell, to be inlined into the loops that call it."""
    from numba import njit

    compiled: Function = njit(cache=True, error_model="numpy", fastmath=_MATH, forceinline=True)(
        function
    )
    return compiled


def loop(function: Function) -> Function:
    """Compile a loop over nodes without the global interpreter lock: threads share the nodes."""
    from numba import njit

    compiled: Function = njit(nogil=True, cache=True, error_model="numpy", fastmath=_MATH)(function)
    return compiled


def loop_of_functions(function: Function) -> Function:
    """As `loop`, for loops whose first arguments are compiled functions; never kept on disk.

    Functions are other types in every process, so what is kept is never found again; the index
    grows with each run, and reading it fails once a function in it has been forgotten.
    """
    from numba import njit

    compiled: Function = njit(nogil=True, error_model="numpy", fastmath=_MATH)(function)
    return compiled


def pointer() -> Any:
    """The intrinsic that takes the address of an array.

    Kernels index addresses: numba's arrays carry a reference count and negative indices through
    every call, which costs ten times the arithmetic of a node.
    """
    import numba
    from numba.extending import intrinsic

    types: Any = numba.types

    @intrinsic
    def address(_context: Any, array: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return context.make_array(signature.args[0])(context, builder, args[0]).data

        return types.CPointer(array.dtype)(array), generate

    return address


def room(count: int) -> Any:
    """The intrinsic that gives room for so many numbers of an array's type on the stack.

    The compiler knows that nothing else points there, which loops over parts of large arrays need
    to become vector instructions.
    """
    import numba
    from numba.extending import intrinsic

    types: Any = numba.types

    @intrinsic
    def stack(_context: Any, array: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            import llvmlite.ir as ir  # type: ignore[import-untyped]

            kind = context.get_value_type(array.dtype)
            with builder.goto_entry_block():
                place = builder.alloca(ir.ArrayType(kind, count))
                place.align = 64
            return builder.bitcast(place, kind.as_pointer())

        return types.CPointer(array.dtype)(array), generate

    return stack
