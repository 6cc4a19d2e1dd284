"""The one module that imports numba: kernels are plain Python, compiled when first used."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from types import FunctionType
from typing import Any


def compiled(
    function: Callable[..., Any], parts: Iterable[Callable[..., Any]] = (), **options: Any
) -> Callable[..., Any]:
    """Compile a function without the global interpreter lock; keep the code on disk if possible.
    numba notices a change of the function, not of what it calls: the cached name holds the state
    of the package. Its `parts` are inlined, as a call counts references to each array."""
    import numba

    inside = {part.__name__: numba.njit(inline="always")(part) for part in parts}
    copy = FunctionType(function.__code__, function.__globals__ | inside, function.__name__)
    copy.__qualname__ = f"{function.__qualname__}_{_STATE}"
    copy.__module__ = function.__module__
    result: Any = numba.njit(nogil=True, **options)(copy)
    # No folder to write to; or numba is told not to compile, and gave the function back.
    with suppress(RuntimeError, AttributeError):
        result.enable_caching()
        _forgive(result._cache)
    found: Callable[..., Any] = result
    return found


def _state_of_the_package() -> str:
    """A hash of all its code."""
    state = sha256()
    for module in sorted(Path(__file__).parent.glob("**/*.py")):
        state.update(module.read_bytes())
    return state.hexdigest()[:12]


# Taken when the package is imported: its files may change before the first kernel is compiled.
_STATE = _state_of_the_package()


def _forgive(kept: Any) -> None:
    """Treat a full disk, or cache files that cannot be read, as an empty cache."""
    load, save, clear = kept.load_overload, kept.save_overload, kept.flush

    def load_or_compile(signature: Any, target: Any) -> Any:
        try:
            found = load(signature, target)
        except Exception:  # a damaged pickle may raise anything
            with suppress(OSError):
                clear()
            return None
        # Two processes that start at one time may give two versions the same file.
        own = tuple(getattr(signature, "args", signature))
        return found if found is None or tuple(found.signature.args) == own else None

    def save_if_possible(signature: Any, code: Any) -> None:
        with suppress(OSError):
            save(signature, code)

    kept.load_overload, kept.save_overload = load_or_compile, save_if_possible
