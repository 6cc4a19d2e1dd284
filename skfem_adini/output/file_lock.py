"""An exclusive file lock that is released when its process ends."""

from __future__ import annotations

import importlib
from typing import Any

try:
    _fcntl: Any = importlib.import_module("fcntl")
except ImportError:  # not a POSIX system
    _fcntl = None


def try_lock(descriptor: int) -> bool | None:
    """Lock a file open for writing for this descriptor alone, until it or its process ends.
    True if it is locked now; False if another descriptor, process or container holds the lock;
    None without such locks in the system or file system."""
    if _fcntl is None:
        return None
    try:
        _fcntl.flock(descriptor, _fcntl.LOCK_EX | _fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True
