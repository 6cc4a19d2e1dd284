"""The one door to numba: kernel modules are plain Python that this compiles when first used.

Kernel modules keep to a small part of Python (numbers, flat arrays, if, for, tuples of results), so
that `cip.engines.cuda_source` can translate the very same functions to C for the device. They are
imported where they are used, never by `import cip`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

# Types of the kernel language: whole numbers, numbers of the working precision, flat arrays of
# these. An `Out` is written, an `Array` only read; `Widths` of cells are an array that may become a
# constant on the device.
Index = int
Real = float
Array = Any
Out = Any
Widths = Any

# Multiply-add in one rounding, as on the device; nothing else is reordered.
_MATH = {"contract"}

# In the names of kernels from generated source; so many of their files are left on disk, those of
# about a hundred formulas.
_GENERATED = "_generated_"
_KEPT = 600


def kernel(function: Function) -> Function:
    """Compile a function of one node or cell, to be inlined into the loops that call it.

    Only those call it: without what Python and C would call, it compiles in two thirds of the time.
    """
    return _kept(function, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def loop(function: Function) -> Function:
    """Compile a loop over nodes without the global interpreter lock: threads share the nodes."""
    return _kept(function, nogil=True)


@cache
def loop_over(function: Callable[..., Any], **kernels: Any) -> Any:
    """A loop of its own for the kernels that it calls by these names.

    As arguments, kernels would have other types in every process, and what is compiled for them
    would never be found again on disk. Here they are globals of a copy of the loop, which is kept
    under their names.

    Parameters
    ----------
    function : callable
        Plain Python, whose kernels are undefined globals.
    **kernels : compiled functions
        Their names must say which code they are.
    """
    name = "_".join([function.__name__, *(part.__name__ for part in kernels.values())])
    copy = FunctionType(function.__code__, {**function.__globals__, **kernels}, name)
    copy.__qualname__, copy.__module__ = name, function.__module__
    return loop(copy)


def generated(source: str, names: Sequence[str], namespace: dict[str, Any], home: str) -> Any:
    """Kernels from generated source, kept on disk under the hash of that source.

    Parameters
    ----------
    source : str
    names : sequence of str
        Its functions; each may call those before it.
    namespace : dict
        Their globals.
    home : str
        The module beside which numba keeps what it compiles.

    Returns
    -------
    compiled function
        The last one.
    """
    label = sha256(source.encode()).hexdigest()[:20]
    exec(compile(source, home, "exec"), namespace)
    for name in names:
        function = namespace[name]
        function.__name__ = function.__qualname__ = f"{name}{_GENERATED}{label}"
        function.__module__ = __name__
        namespace[name] = kernel(function)
    return namespace[names[-1]]


def _kept(function: Callable[..., Any], **options: Any) -> Any:
    """Compile when first called; keep the result on disk where any folder can be written."""
    from numba import njit

    function.__qualname__ += f"_{_state_of_the_package()}"
    options.update(error_model="numpy", fastmath=_MATH)
    try:
        compiled = njit(cache=True, **options)(function)
    except RuntimeError:  # neither beside the package nor in the user's folder
        return njit(**options)(function)
    if _GENERATED in function.__name__:
        _forget_old(Path(compiled._cache.cache_path))
    return compiled


@cache
def _state_of_the_package() -> str:
    """A hash of all its code: numba itself does not notice when a kernel changes that is called."""
    state = sha256()
    for module in sorted(Path(__file__).parent.glob("**/*.py")):
        state.update(module.read_bytes())
    return state.hexdigest()[:12]


def _forget_old(folder: Path) -> None:
    """Of the files for generated kernels leave the newest: formulas may be many."""
    with suppress(OSError):
        files = sorted(folder.glob(f"*{_GENERATED}*.nb?"), key=lambda file: file.stat().st_mtime)
        for file in files[:-_KEPT]:
            file.unlink(missing_ok=True)


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
