"""Files that appear under their name only when they are complete.

`cip` does not depend on the other packages of this project, so it has its own writer.
"""

from __future__ import annotations

import os
from pathlib import Path
from secrets import token_hex


def write_whole(path: Path, text: str) -> None:
    """Write a temporary file in the same directory, then rename it to `path`.

    Its random name and exclusive creation keep other threads and processes, in other containers
    too, from writing into it, and no symbolic link is followed. If writing fails, a file that
    already existed at `path` is unchanged.

    Raises
    ------
    OSError
        No space left, or no permission to write.
    """
    temporary = path.with_name(f"tmp{token_hex(16)}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
    descriptor = os.open(temporary, flags, 0o666)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(descriptor)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
