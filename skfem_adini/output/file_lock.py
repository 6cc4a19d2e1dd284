"""An exclusive file lock that is released when its process ends."""

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
        Descriptor of a file opened for writing, as network file systems require.

    Returns
    -------
    bool or None
        True if the file is now locked; False if another descriptor holds the lock, in this process,
        another one or another container; None if the system or file system has no such locks.
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
