"""Each public name tells what goes in and out, what can fail and whence it comes, and shows it."""

import ast
import dataclasses
import enum
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from typing import Any

import public_names

Sections = dict[str, str]


def _sections(doc: str) -> Sections:
    """A numpydoc docstring by the headings that are underlined; "" is what stands before them."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}$", inspect.cleandoc(doc), flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def _entries(section: str) -> list[str]:
    """The names that a section describes: what begins a line, without stars, up to a colon."""
    heads = [line.split(" : ")[0] for line in section.splitlines() if re.match(r"[\w*]", line)]
    return [name.strip().lstrip("*") for head in heads for name in head.split(",")]


def _parameters(function: Any) -> list[str]:
    try:
        found = inspect.signature(function).parameters
    except ValueError:
        return []
    return [name for name in found if name not in ("self", "cls")]


def _named(sections: Sections, section: str, wanted: list[str]) -> Iterator[str]:
    described = _entries(sections.get(section, ""))
    for name in wanted:
        if name not in described:
            yield f"{section} lack {name}"
    for name in described:
        if name not in wanted:
            yield f"{section} describe {name}, which is none"


def _raised(function: Any) -> set[str]:
    """The errors of ours that the body of a function or of a constructor raises."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError):
        return set()
    calls = [node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise)]
    names = {ast.unparse(call.func).split(".")[-1] for call in calls if isinstance(call, ast.Call)}
    return names & public_names.ERRORS


def _errors(sections: Sections, function: Any) -> Iterator[str]:
    told = sections.get("Raises", "")
    for name in sorted(_raised(function)):
        if name not in told:
            yield f"Raises lack {name}"


def _of_function(function: Any, sections: Sections) -> Iterator[str]:
    yield from _named(sections, "Parameters", _parameters(function))
    returned = inspect.signature(function).return_annotation
    if returned not in ("None", "Self") and not {"Returns", "Yields"} & set(sections):
        yield "Returns are missing"
    yield from _errors(sections, function)


def _of_class(kind: type, sections: Sections) -> Iterator[str]:
    fields = (
        [f.name for f in dataclasses.fields(kind) if not f.name.startswith("_")]
        if (dataclasses.is_dataclass(kind))
        else []
    )
    if issubclass(kind, Warning):
        return
    if issubclass(kind, BaseException):
        extra = [name for name in _parameters(kind) if name not in ("message", "args", "kwargs")]
        yield from _named(sections, "Attributes", extra)
    elif issubclass(kind, enum.Enum):
        for member in kind:
            if f"{member.name}" not in sections.get("Attributes", ""):
                yield f"Attributes lack {member.name}"
    elif "Parameters" in sections or not fields:
        yield from _named(sections, "Parameters", _parameters(kind))
        yield from _errors(sections, kind.__init__)
    else:
        told = _entries(sections.get("Attributes", ""))
        yield from (f"Attributes lack {name}" for name in fields if name not in told)


def _gaps(name: str, thing: Any) -> Iterator[str]:
    sections = _sections(thing.__doc__ or "")
    kind = thing if isinstance(thing, type) else None
    yield from _of_class(kind, sections) if kind else _of_function(thing, sections)
    if ">>> " not in sections.get("Examples", ""):
        yield "Examples are missing"
    if kind and issubclass(kind, Exception):
        if len(sections[""].strip().splitlines()) < 3:
            yield "what to do when it is met is missing"
    elif "References" not in sections and name not in public_names.OURS:
        yield "References are missing, and it is not listed as ours"
    elif "References" in sections and name in public_names.OURS:
        yield "has References, and is listed as ours"


def _methods() -> dict[str, Callable[..., Any]]:
    """The methods that users call, as functions."""
    found = {}
    for name, listed in public_names.METHODS.items():
        kind = public_names.all_of_them()[name]
        for key in listed or [key for key in vars(kind) if not key.startswith("_")]:
            method = inspect.getattr_static(kind, key)
            if isinstance(method, classmethod | staticmethod):
                method = method.__func__
            if inspect.isfunction(method):
                found[f"{name}.{key}"] = method
    return found


def _of_method(method: Callable[..., Any]) -> Iterator[str]:
    yield from _of_function(method, _sections(method.__doc__ or ""))


def _report(gaps: dict[str, list[str]], of: int) -> str:
    lines = [f"{name}: {'; '.join(found)}" for name, found in gaps.items()]
    return "\n".join([f"{len(gaps)} of {of} docstrings have gaps", *lines])


def test_public_names_are_documented_with_an_example() -> None:
    names = public_names.all_of_them()
    gaps = {name: list(_gaps(name, thing)) for name, thing in names.items()}
    gaps = {name: found for name, found in gaps.items() if found}
    assert not gaps, _report(gaps, len(names))


def test_methods_of_the_main_classes_are_documented() -> None:
    methods = _methods()
    gaps = {name: list(_of_method(method)) for name, method in methods.items()}
    gaps = {name: found for name, found in gaps.items() if found}
    assert not gaps, _report(gaps, len(methods))


def test_what_is_listed_as_ours_is_public() -> None:
    assert public_names.OURS.keys() <= public_names.all_of_them().keys()
    assert public_names.METHODS.keys() <= public_names.all_of_them().keys()


def test_gaps_are_seen() -> None:
    def bad(a: int, b: int) -> int:
        """Do.

        Parameters
        ----------
        a, c : int
        """
        raise public_names.InputError("no")

    assert list(_gaps("bad", bad)) == [
        "Parameters lack b",
        "Parameters describe c, which is none",
        "Returns are missing",
        "Raises lack InputError",
        "Examples are missing",
        "References are missing, and it is not listed as ours",
    ]
