"""The one door to bars of progress: tqdm where it is installed, on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any


@contextmanager
def progress_bar(total: int, shown: bool, done: int = 0) -> Iterator[Callable[[], Any]]:
    """A function that counts one of `total` steps, of which some are `done`, on a bar. There is
    none without tqdm, or where standard error is no terminal."""
    if not shown or not sys.stderr.isatty() or find_spec("tqdm") is None:
        yield lambda: None
        return
    from tqdm import tqdm  # type: ignore[import-untyped]

    with tqdm(total=total, initial=done, unit="step") as bar:
        yield bar.update
