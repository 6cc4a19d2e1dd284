"""Files that appear under their name once they are whole; cip imports no other package here."""

from __future__ import annotations

import os
from pathlib import Path
from secrets import token_hex


def write_whole(path: Path, text: str) -> None:
    """Write a file beside its place, under a random name of its own, and move it there.

    Neither another thread nor another container can write into it, and no link that lies there is
    followed. A failure leaves what lay under the name before.

    Raises
    ------
    OSError
        No space left, or no right to write.
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
