"""What numba compiles, for tests that it compiles nothing."""

from contextlib import contextmanager


@contextmanager
def compilations():
    """The names of all functions that numba compiles in the block, known at its end."""
    from numba.core import event

    names = []
    with event.install_recorder("numba:compile") as recorder:
        yield names
    names += [e.data["dispatcher"].py_func.__name__ for _, e in recorder.buffer if e.is_start]
