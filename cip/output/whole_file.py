"""Files that appear under their name only when they are complete.

`cip` does not depend on the other packages of this project, so it has its own writer.
"""

from __future__ import annotations

import os
from pathlib import Path
from secrets import token_hex


def write_whole(path: Path, text: str) -> None:
    """Write a temporary file in the same directory, then rename it to `path`; if that fails, an old
    file is unchanged. Its random name and exclusive creation keep out other processes, in other
    containers too, and no symbolic link is followed."""
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
