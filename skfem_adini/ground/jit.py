"""The only interface to numba: kernels are plain Python and are compiled when first used.

numba keeps machine code beside the package or in the user's folder and notices a change of the
function itself, but none of what it calls. So the name of cached code contains the state of the
whole package. Where no folder is writable, or its files cannot be used, every process compiles for
itself.

Kernels of `cip` use a small part of Python (numbers, flat arrays, if, for, tuples of results), so
that the same functions can be translated to C for a device. Modules of kernels decorate theirs by
`kernel` and `loop` and are imported inside the functions that use them, so that no package imports
numba.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple, TypeVar

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

# Types of the kernel language: integers, numbers in the working precision, flat arrays of these.
# An `Out` is written, an `Array` only read; `Widths` are the cell widths, an array that becomes a
# constant on the device if the grid is uniform.
Index = int
Real = float
Array = Any
Out = Any
Widths = Any

# Of kernels: allow fused multiply-add, as on the device, and no other change of operations.
_ARITHMETIC = {"error_model": "numpy", "fastmath": {"contract"}}
# Of dense algebra: sums in any order as well.
_REORDERED = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}}


class _Generated(NamedTuple):  # kernels from generated source in the cache on disk
    mark: str = "_generated_"  # part of the names of these kernels
    kept: int = 600  # newest files that are kept: those of about a hundred formulas


GENERATED = _Generated()


class _Interpreted(NamedTuple):  # calls of kernels that may run as plain Python
    entries: int = 400_000  # of all arrays in a call, above which a kernel is compiled at once
    seconds: float = 1.0  # of all its calls, after which a kernel is compiled: what that takes


INTERPRETED = _Interpreted()


def compiled_later(
    function: Callable[..., Any], parts: Iterable[Callable[..., Any]] = ()
) -> Callable[..., Any]:
    """As `compiled`; but where no machine code is on disk, calls with few entries run as plain
    Python until they have taken the time of a compilation. The results are the same to the bit."""
    return later(function, cache(lambda: compiled(function, parts)))


def later(
    plain: Callable[..., Any], machine: Callable[[], Any], entries: int = INTERPRETED.entries
) -> Callable[..., Any]:
    """The same of plain Python and what makes its compiled form; it writes no argument, or the
    machine code writes all of them anew."""
    left = [INTERPRETED.seconds]

    def call(*given: Any) -> Any:
        if left[0] > 0 and _small(given, entries) and not _is_on_disk(machine()):
            begin = time.perf_counter()
            # Machine code divides by zero; numbers of Python do not.
            with np.errstate(all="ignore"), suppress(ZeroDivisionError):
                found = plain(*given)
                left[0] -= time.perf_counter() - begin
                return found
        left[0] = 0.0
        return machine()(*given)

    return call


def plain_function(module: Any, name: str) -> Callable[..., Any]:
    """A compiled function of a module as plain Python, as are those that it calls."""
    space = dict(vars(module))
    for key, found in vars(module).items():
        if hasattr(found, "py_func"):
            space[key] = FunctionType(found.py_func.__code__, space, key)
    made: Callable[..., Any] = space[name]
    return made


def _small(given: Iterable[Any], entries: int) -> bool:
    """Whether all arrays, also those in tuples, have few entries together."""
    flat = [a for one in given for a in (one if isinstance(one, tuple) else (one,))]
    return sum(a.size for a in flat if isinstance(a, np.ndarray)) <= entries


def _is_on_disk(machine: Any) -> bool:
    """Whether numba has kept machine code of a kernel; so it has not without a folder for it."""
    with suppress(AttributeError):
        return Path(machine._cache._cache_file._index_path).exists()
    return False


def compiled(
    function: Callable[..., Any], parts: Iterable[Callable[..., Any]] = (), **options: Any
) -> Callable[..., Any]:
    """Compile a copy of a function without the interpreter lock; the original is unchanged.

    `parts` are plain functions that it calls, to be compiled into it: a call counts the references
    to each array that is passed, which can take as long as the work of a small function. The
    options are those of `numba.njit`.
    """
    import numba

    inside = {part.__name__: numba.njit(inline="always")(part) for part in parts}
    copy = FunctionType(function.__code__, function.__globals__ | inside, function.__name__)
    copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
    found: Callable[..., Any] = _kept(copy, nogil=True, **options)
    return found


def kernel(function: Function) -> Function:
    """Compile a function of one node or cell, to be inlined into the compiled loops that call it.
    Without the wrappers for calls from Python and C, this takes two thirds of the time."""
    inlined = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    found: Function = _kept(function, **inlined, **_ARITHMETIC)
    return found


def loop(function: Function) -> Function:
    """Compile a loop over nodes; it releases the interpreter lock, so threads share the nodes."""
    found: Function = _kept(function, nogil=True, **_ARITHMETIC)
    return found


def summing(function: Function) -> Function:
    """Compile a function of dense algebra: sums in any order; infinite numbers are data."""
    found: Function = _kept(function, nogil=True, no_cfunc_wrapper=True, **_REORDERED)
    return found


def summing_part(function: Function) -> Function:
    """The same for a function that is called from compiled ones only."""
    plain = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    found: Function = _kept(function, nogil=True, **plain, **_REORDERED)
    return found


@cache
def loop_over(function: Callable[..., Any], **kernels: Any) -> Any:
    """Compile a copy of a loop whose undefined globals are compiled kernels of the given names.
    Their ``__name__``, which must identify the code, is part of the name in the cache on disk,
    where kernels as arguments, whose types differ in every process, would never be found."""
    name = "_".join([function.__name__, *(part.__name__ for part in kernels.values())])
    copy = FunctionType(function.__code__, {**function.__globals__, **kernels}, name)
    copy.__qualname__, copy.__module__ = name, function.__module__
    return loop(copy)


def generated(source: str, names: Sequence[str], namespace: dict[str, Any], home: str) -> Any:
    """Compile kernels from generated source, cached on disk under its hash beside the module
    `home`; the last one is returned. Each of the functions `names` may call those before it;
    `namespace` are their globals."""
    label = sha256(source.encode()).hexdigest()[:20]
    # Numbers of lines that `home` does not have: numba would take its lines for the source, and
    # Python 3.12 refuses to read lines that begin in the middle of a string.
    exec(compile("\n" * 10_000 + source, str(sys.modules[home].__file__), "exec"), namespace)
    for name in names:
        function = namespace[name]
        function.__name__ = function.__qualname__ = f"{name}{GENERATED.mark}{label}"
        function.__module__ = home
        namespace[name] = kernel(function)
    return namespace[names[-1]]


def _kept(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function at its first call; cache the code on disk if possible."""
    import numba

    function.__qualname__ += f"_{state_of(function.__module__.partition('.')[0])}"
    result: Any = numba.njit(**options)(function)
    # No folder is writable; or numba is disabled and returned the function itself.
    with suppress(RuntimeError, AttributeError):
        result.enable_caching()
        _forgive(result._cache)
        if GENERATED.mark in function.__name__:
            _forget_old(Path(result._cache.cache_path))
    return result


@cache
def state_of(package: str) -> str:
    """A hash of the code of `ground` and of one of our packages, by default `skfem_adini`."""
    state = sha256()
    for name in (__package__, package if package in ("contact", "cip", "gpu") else "skfem_adini"):
        for module in sorted(Path(str(sys.modules[name].__file__)).parent.glob("**/*.py")):
            state.update(module.read_bytes())
    return state.hexdigest()[:12]


def _forgive(kept: Any) -> None:
    """Treat a full disk, or unreadable files, as an empty folder."""
    load, save, clear = kept.load_overload, kept.save_overload, kept.flush

    def load_or_compile(signature: Any, target: Any) -> Any:
        try:
            found = load(signature, target)
        except Exception:  # a damaged pickle may raise anything
            with suppress(OSError):
                clear()
            return None
        # Two processes that start at the same time may give two versions the same file.
        own = tuple(getattr(signature, "args", signature))
        return found if found is None or tuple(found.signature.args) == own else None

    def save_if_possible(signature: Any, code: Any) -> None:
        with suppress(OSError):
            save(signature, code)

    kept.load_overload, kept.save_overload = load_or_compile, save_if_possible


def _forget_old(folder: Path) -> None:
    """Delete all cache files of generated kernels except the newest, as formulas may be many."""
    with suppress(OSError):
        files = sorted(folder.glob(f"*{GENERATED.mark}*.nb?"), key=lambda f: f.stat().st_mtime)
        for file in files[: -GENERATED.kept]:
            file.unlink(missing_ok=True)


def pointer() -> Any:
    """The intrinsic that takes the address of an array. In every call, reference counts and
    negative indices of numba's arrays would cost ten times the arithmetic of a node."""
    import numba
    from numba.extending import intrinsic

    types: Any = numba.types

    @intrinsic
    def address(_context: Any, array: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return context.make_array(signature.args[0])(context, builder, args[0]).data

        return types.CPointer(array.dtype)(array), generate

    return address


def shift() -> Any:
    """The intrinsic that moves an address of `pointer` by a number of entries."""
    import numba
    from numba.extending import intrinsic

    types: Any = numba.types

    @intrinsic
    def shifted(_context: Any, place: Any, count: Any) -> Any:
        def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return builder.gep(args[0], [args[1]])

        return place(place, types.intp), generate

    return shifted


def room(count: int) -> Any:
    """The intrinsic that reserves `count` numbers of an array's type on the stack. As no other
    pointer refers to them, loops that copy parts of large arrays there can be vectorized."""
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
