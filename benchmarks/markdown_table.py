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


def every_other(rows: Sequence[Any]) -> Sequence[Any]:
    """Return each second row, the last one included."""
    return rows[::-2][::-1]


def source(
    script: str, record: Record, *packages: str, device: str = "", count: str = "one"
) -> str:
    """Return where the figures come from: script, machine, commit, versions of packages."""
    machine = record["machine"]
    versions = machine["versions"]
    listed = "".join(
        f"; {name} {versions[name.lower()]}" for name in packages if name.lower() in versions
    )
    cores = f"{machine['cores']} core" + "s" * (machine["cores"] > 1)
    processor = machine["processor"].replace("(R)", "").replace(" Processor", "")
    where = f"{cores} ({processor})"
    if device:
        where = f"{count} {device}, {machine['cores']} host cores"
    changed = machine.get("changed_files", 0)
    commit = f"commit {machine['commit']}" + (f" and {changed} changed files" if changed else "")
    return f"*`benchmarks/{script}.py`, {where}, {commit}{listed}.*"
