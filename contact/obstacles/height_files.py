"""Heights from files: arrays of NumPy, tables of numbers, and images."""

from __future__ import annotations

from os import PathLike, fspath
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError

Array = NDArray[np.float64]

TABLES = (".txt", ".csv", ".dat", ".asc")
FORMATS = (".npy", *TABLES, ".png")


def read_heights(path: str | PathLike[str]) -> Array:
    """The numbers of a file: first index along the first axis of the surface.

    Raises
    ------
    InputError
        No such file, another format, no numbers in it.
    """
    try:
        place = Path(fspath(path))
    except TypeError as error:
        raise InputError(f"path={path!r}: expected the name of a file ({error})") from None
    kind = place.suffix.lower()
    if kind not in FORMATS:
        raise InputError(f"path={path!r}: heights are read from {', '.join(FORMATS)} files")
    if not place.is_file():
        raise InputError(f"path={path!r}: there is no such file")
    try:
        if kind == ".npy":
            return np.asarray(np.load(place, allow_pickle=False), dtype=float)
        return _table(place) if kind in TABLES else _image(place)
    except (OSError, TypeError, ValueError) as error:
        raise InputError(f"path={path!r}: not readable as {kind} ({error})") from error


def _table(place: Path) -> Array:
    """One row of numbers a line, between blanks, commas or semicolons; # begins a comment."""
    text = place.read_text().replace(",", " ").replace(";", " ")
    lines = [line for line in text.splitlines() if line.partition("#")[0].strip()]
    if not lines:
        raise ValueError("it holds no numbers")
    rows = np.loadtxt(lines, ndmin=2)
    return np.asarray(rows[:, 0] if rows.shape[1] == 1 else rows)


def _image(place: Path) -> Array:
    """Grey values between 0 and 1, the mean of the colours; rows of pixels run downwards."""
    from matplotlib.image import imread

    pixels = np.asarray(imread(place), dtype=float)
    grey = pixels[..., :3].mean(axis=2) if pixels.ndim == 3 else pixels
    return np.ascontiguousarray(grey[::-1].T)
