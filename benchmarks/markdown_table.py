"""A table in Markdown, and the line below it that says where its figures come from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

Record = dict[str, Any]


def rows_of(header: str, rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table; the header's columns are separated by bars."""
    columns = header.split(" | ")
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def source(
    script: str, record: Record, *packages: str, device: str = "", count: str = "one"
) -> str:
    """Return where the figures come from: script, machine, commit, versions."""
    machine = record["machine"]
    versions = {"Python": machine["python"], **machine["versions"]}
    listed = ", ".join(
        f"{name} {versions[name.lower()] if name != 'Python' else versions[name]}"
        for name in ("Python", "NumPy", "SciPy", *packages)
        if name == "Python" or name.lower() in versions
    )
    cores = f"{machine['cores']} core" + "s" * (machine["cores"] > 1)
    where = f"{cores} ({machine['processor']})"
    if device:
        where = f"{count} {device}, {machine['cores']} host cores"
    changed = machine.get("changed_files", 0)
    commit = f"commit {machine['commit']}" + (f" and {changed} changed files" if changed else "")
    return f"*`benchmarks/{script}.py`, {where}, {commit}; {listed}.*"
