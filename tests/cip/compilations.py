"""What numba compiles, for tests that it compiles nothing."""

from contextlib import contextmanager


@contextmanager
def compilations():
    """The names of all functions that numba compiles in the block."""
    from numba.core import event

    names = []

    class Listener(event.Listener):
        def on_start(self, found):
            names.append(found.data["dispatcher"].py_func.__name__)

        def on_end(self, found):
            pass

    with event.install_listener("numba:compile", Listener()):
        yield names
