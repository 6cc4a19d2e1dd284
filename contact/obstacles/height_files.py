"""Heights from files: arrays of NumPy, tables of numbers, points of a grid, and images."""

from __future__ import annotations

import re
from os import PathLike, fspath
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError

Array = NDArray[np.float64]

TABLES = (".txt", ".csv", ".dat", ".asc")
_WHOLE = re.compile(r"[+-]?\d+(?:[eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_UNEVEN = 0.2  # differences of spacings over their mean that rounded coordinates may have
FORMATS = (".npy", *TABLES, ".xyz", ".png")


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
            return _array(place)
        if kind == ".xyz":
            return _points(place)
        return _table(place) if kind in TABLES else _image(place)
    except Exception as error:  # readers raise whatever they meet
        said = str(error) or type(error).__name__
        raise InputError(f"path={path!r}: not readable as {kind} ({said})") from error


def _array(place: Path) -> Array:
    # Mapped: a header that claims more numbers than the file holds is refused before any is read.
    found = np.load(place, mmap_mode="r", allow_pickle=False)
    kind = found.dtype if isinstance(found, np.ndarray) else type(found).__name__
    if getattr(kind, "kind", "") not in tuple("biuf"):
        raise ValueError(f"expected real numbers, not {kind}")
    return np.array(found, dtype=float)


def _table(place: Path) -> Array:
    """One row of numbers a line, between blanks, commas or semicolons; # begins a comment.

    A comma is the decimal mark where other marks part the numbers.
    """
    text = [line.partition("#")[0].strip() for line in place.read_text().splitlines()]
    lines = [line for line in text if line]
    if not lines:
        raise ValueError("it holds no numbers")
    comma = "." if _decimal_commas(lines) else " "
    rows = np.loadtxt([line.replace(",", comma).replace(";", " ") for line in lines], ndmin=2)
    return np.asarray(rows[:, 0] if rows.shape[1] == 1 else rows)


def _decimal_commas(lines: list[str]) -> bool:
    """Whether commas stand in numbers and not between them.

    Raises
    ------
    ValueError
        They may mean either.
    """
    parts = [part for line in lines for part in line.replace(";", " ").split()]
    inside = [bool(_WITH_COMMA.fullmatch(part)) for part in parts]
    if not any(inside):
        return False
    points, semicolons = (any(mark in line for line in lines) for mark in ".;")
    if points and not semicolons:
        return False
    plain = all(own or _WHOLE.fullmatch(part) for own, part in zip(inside, parts, strict=True))
    if plain and len(parts) > len(lines):
        return True
    raise ValueError(
        "its commas may be decimal marks or part the numbers; write decimal points, or a blank "
        "after each comma that parts numbers"
    )


def _points(place: Path) -> Array:
    """Lines x y height of all points of a rectangular grid, in any order."""
    found = _table(place)
    if found.ndim != 2 or found.shape[1] != 3:
        raise ValueError("expected three numbers a line: x, y and the height")
    size = np.ptp(found[:, :2], axis=0)
    index = []
    for t, length in zip(found[:, :2].T, size, strict=True):
        order = np.argsort(t)
        step = np.diff(t[order], prepend=t[order[0]]) > 1e-4 * length
        place_of = np.empty(t.size, dtype=int)
        place_of[order] = np.cumsum(step)
        apart = np.diff(t[order][np.flatnonzero(step)], prepend=t[order[0]])
        if apart.size and np.ptp(apart) > _UNEVEN * apart.mean():
            raise ValueError("the points of the grid are not equally far apart; interpolate them")
        index.append(place_of)
    shape = tuple(int(i.max()) + 1 for i in index)
    heights = np.full(shape, np.nan)
    heights[tuple(index)] = found[:, 2]
    if (
        found.shape[0] != heights.size
        or np.unique(np.ravel_multi_index(index, shape)).size < heights.size
    ):
        raise ValueError(f"{found.shape[0]} points do not fill a grid of {shape[0]} x {shape[1]}")
    return heights


def _image(place: Path) -> Array:
    """Grey values between 0 and 1, the mean of the colours; rows of pixels run downwards."""
    from matplotlib.image import imread

    pixels = np.asarray(imread(place), dtype=float)
    grey = pixels[..., :3].mean(axis=2) if pixels.ndim == 3 else pixels
    return np.ascontiguousarray(grey[::-1].T)
