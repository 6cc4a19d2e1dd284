"""The one door to numba: kernel modules are plain Python that this compiles when first used.

Kernel modules use a small part of Python (numbers, flat arrays, if, for, tuples of results), so
that `cip.engines.cuda_source` can translate the same functions to C for the device. They are
imported inside the functions that use them, so `import cip` does not import numba.
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

# Types of the kernel language: integers, numbers in the working precision, flat arrays of these.
# An `Out` is written, an `Array` only read; `Widths` are the cell widths, an array that becomes a
# constant on the device if the grid is uniform.
Index = int
Real = float
Array = Any
Out = Any
Widths = Any

# Allow fused multiply-add, as on the device, but no other change of floating-point operations.
_MATH = {"contract"}

# A part of the name of every kernel from generated source, and how many of their cache files are
# left on disk: those of about a hundred formulas.
_GENERATED = "_generated_"
_KEPT = 600


def kernel(function: Function) -> Function:
    """Compile a function of one node or cell, to be inlined into the loops that call it.

    It is called from compiled loops only. Without the wrappers for calls from Python and C,
    compilation takes two thirds of the time.
    """
    return _kept(function, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def loop(function: Function) -> Function:
    """Compile a loop over nodes; it releases the interpreter lock, so threads share the nodes."""
    return _kept(function, nogil=True)


@cache
def loop_over(function: Callable[..., Any], **kernels: Any) -> Any:
    """Compile a copy of a loop in which the given names stand for the given kernels.

    If kernels were arguments of the loop, their types would differ in every process, and the
    compiled loop would never be found in the cache on disk. Here they are globals of a copy of the
    loop, which is cached under their names.

    Parameters
    ----------
    function : callable
        Plain Python, whose kernels are undefined globals.
    **kernels : compiled functions
        By their names in the loop. Each ``__name__`` must identify the kernel's code, because it is
        part of the name in the cache.
    """
    name = "_".join([function.__name__, *(part.__name__ for part in kernels.values())])
    copy = FunctionType(function.__code__, {**function.__globals__, **kernels}, name)
    copy.__qualname__, copy.__module__ = name, function.__module__
    return loop(copy)


_BEYOND = 10_000


def generated(source: str, names: Sequence[str], namespace: dict[str, Any], home: str) -> Any:
    """Compile kernels from generated source and cache them on disk under the hash of the source.

    Parameters
    ----------
    source : str
    names : sequence of str
        The functions in the source; each may call those before it.
    namespace : dict
        Their globals.
    home : str
        File of the module beside which numba puts its cache.

    Returns
    -------
    compiled function
        The last of `names`.
    """
    label = sha256(source.encode()).hexdigest()[:20]
    # Numbers of lines that `home` does not have: numba would take its lines for the source, and
    # Python 3.12 refuses to read lines that begin in the middle of a string.
    exec(compile("\n" * _BEYOND + source, home, "exec"), namespace)
    for name in names:
        function = namespace[name]
        function.__name__ = function.__qualname__ = f"{name}{_GENERATED}{label}"
        function.__module__ = __name__
        namespace[name] = kernel(function)
    return namespace[names[-1]]


def _kept(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function at its first call; cache the result on disk if a folder is writable."""
    from numba import njit

    function.__qualname__ += f"_{_state_of_the_package()}"
    options.update(error_model="numpy", fastmath=_MATH)
    try:
        compiled = njit(cache=True, **options)(function)
    except RuntimeError:  # neither the package's nor the user's cache folder can be written
        return njit(**options)(function)
    if _GENERATED in function.__name__:
        _forget_old(Path(compiled._cache.cache_path))
    return compiled


@cache
def _state_of_the_package() -> str:
    """A hash of the package's code, part of all names in the cache.

    Without it, numba would reuse a cached function although a kernel that it calls has changed.
    """
    state = sha256()
    for module in sorted(Path(__file__).parent.glob("**/*.py")):
        state.update(module.read_bytes())
    return state.hexdigest()[:12]


def _forget_old(folder: Path) -> None:
    """Delete all cache files of generated kernels except the newest, as formulas may be many."""
    with suppress(OSError):
        files = sorted(folder.glob(f"*{_GENERATED}*.nb?"), key=lambda file: file.stat().st_mtime)
        for file in files[:-_KEPT]:
            file.unlink(missing_ok=True)


def pointer() -> Any:
    """The intrinsic that takes the address of an array.

    Kernels index bare addresses. Reference counts and negative indices of numba's arrays would cost
    ten times the arithmetic of a node in every call.
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
    """The intrinsic that reserves `count` numbers of an array's type on the stack.

    The compiler knows that no other pointer refers to them. Loops that copy parts of large arrays
    there can therefore be vectorized.
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
