"""A lock that goes with the process that holds it."""

from __future__ import annotations

import importlib
from typing import Any

try:
    _fcntl: Any = importlib.import_module("fcntl")
except ImportError:  # not a POSIX system
    _fcntl = None


def try_lock(descriptor: int) -> bool | None:
    """Lock an open file for this descriptor alone, until it is closed or its process ends.

    Parameters
    ----------
    descriptor : int
        Of a file opened for writing, which file systems on a network ask for.

    Returns
    -------
    bool or None
        False where another descriptor holds it, of this process, another one or another container;
        None where the system or its file system has no such locks.
    """
    if _fcntl is None:
        return None
    try:
        _fcntl.flock(descriptor, _fcntl.LOCK_EX | _fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True
