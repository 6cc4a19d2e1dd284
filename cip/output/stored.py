"""Checksummed text files (JSON) that store named values without loss."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from cip.errors import InputError
from skfem_adini.ground.files import write_text


def write_words(path: str | Path, form: str, parts: Mapping[str, Any]) -> None:
    """Write values and arrays by name, with the name of their format."""
    told = {"format": form, **parts}
    write_text(Path(path), _text(told | {"checksum": _digest(told)}))


def read_words(path: str | Path, form: str, names: Iterable[str]) -> dict[str, Any]:
    """Read a file of `write_words`, arrays as lists; older formats have no checksum."""
    told = json.loads(Path(path).read_text(encoding="utf-8"))
    if not isinstance(told, dict) or told.get("format") != form:
        raise ValueError(f"expected the format {form!r}")
    if told.pop("checksum", None) not in (None, _digest(told)):
        raise InputError(f"path: {path} is damaged, it was changed since it was written")
    if missing := set(names) - told.keys():
        raise InputError(f"path: {path} is damaged, it has no {min(missing)!r}")
    return told


@contextmanager
def reading(path: str | Path, what: str) -> Iterator[None]:
    """Re-raise errors in the content of a file as the `InputError` of the package."""
    try:
        yield
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"path: {path} is no file of {what} ({error})") from error


def fields_from(kind: Any, told: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a dataclass among the values of a file: lists become tuples or arrays again."""
    found = {field.name: told[field.name] for field in fields(kind) if field.name in told}
    for field in fields(kind):
        if isinstance(found.get(field.name), list):
            again: Any = tuple if str(field.type).startswith("tuple") else np.array
            found[field.name] = again(found[field.name])
    return found


def _text(told: Mapping[str, Any], **options: Any) -> str:
    return json.dumps(told, default=np.ndarray.tolist, **options)


def _digest(told: Mapping[str, Any]) -> str:
    return sha256(_text(told, sort_keys=True).encode()).hexdigest()
