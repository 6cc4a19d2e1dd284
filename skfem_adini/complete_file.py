"""Files that appear under their name once they are complete, or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO


@contextmanager
def complete_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a file beside its place and move it there when everything is written.

    An interruption, an error or a full disk leaves what lay there before, and nothing else.

    Parameters
    ----------
    path : Path
        An existing file is replaced.

    Raises
    ------
    OSError
        The folder is missing, or there is no space left.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> path = Path(mkdtemp()) / "steps.txt"
    >>> with complete_file(path) as file:
    ...     _ = file.write(b"one")
    >>> path.read_text()
    'one'
    """
    temporary = path.with_name(f"tmp{os.getpid()}_{path.name}")
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())  # a full disk may show only here
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
