"""Tables of derivatives, identification and assimilation; `performance_tables.py` writes them."""

from __future__ import annotations

from markdown_table import Record, rows_of, source


def _measured(record: Record) -> list[tuple[str, Record]]:
    """Where something was measured, with the results: here, and on a device if it was."""
    found = [("processor", record)]
    if "cuda" in record:
        found.append(("device", record["cuda"]))
    return found


def _sources(script: str, record: Record) -> list[str]:
    """The lines on where the figures of `_measured` come from."""
    found = [source(script, record)]
    if "cuda" in record:
        part = record["cuda"]
        found.append(source(script, part, device=part["device"]["name"]))
    return found


def adjoint(record: Record) -> str:
    """What a gradient costs in runs, on the processor and on a device where it was measured."""
    kinds = ((True, 12), (False, 2), (False, 12))
    table = rows_of(
        "where | profile | nodes | c(x), 12 parameters | c(x, t), 2 parameters "
        "| c(x, t), 12 parameters",
        (
            (where, f"{profile}, {dim}-D", f"{nodes:,}", *(ratios.get(kind, "-") for kind in kinds))
            for where, part in _measured(record)
            for (profile, dim, nodes), ratios in _gradients(part["rows"]).items()
        ),
    )
    return "\n\n".join((table, *_sources("adjoint", record)))


def _gradients(rows: list[Record]) -> dict[tuple[str, int, int], dict[tuple[bool, int], str]]:
    """Gradient over run by profile, and there by kind of velocity and number of parameters."""
    found: dict[tuple[str, int, int], dict[tuple[bool, int], str]] = {}
    for row in rows:
        ratios = found.setdefault((row["profile"], row["dim"], row["nodes"]), {})
        ratios[row["steady"], row["parameters"]] = f"{row['ratio']:.2f}"
    return found


def assimilation(record: Record) -> str:
    """Seconds of a 4D-Var window, and of its parts in units of the run."""
    table = rows_of(
        "where | cells | run | tangent | adjoint | whole window",
        (
            (
                where,
                f"{row['cells']:,} x {row['cells']:,}",
                f"{row['run']:.3f} s",
                *(f"{row[name] / row['run']:.1f} runs" for name in ("tangent", "adjoint")),
                f"**{row['window']:.1f} s**",
            )
            for where, part in _measured(record)
            for row in [part["window"]]
        ),
    )
    return "\n\n".join((table, *_sources("assimilation", record)))


def calibration(record: Record) -> str:
    """How many of random identifications lie outside their stated deviations."""
    table = rows_of(
        f"outside | of {record['problems']} problems | expected | most with a chance of 1 : 1000",
        (
            (
                f"{size} deviation" + "s" * (size != "1"),
                found,
                f"{record['expected'][size]:.1f}",
                record["allowed"][size],
            )
            for size, found in record["outside"].items()
        ),
    )
    return f"{table}\n\n{source('calibration', record)}"


def assimilation_device(record: Record) -> str:
    """Seconds of a 4D-Var window on a device, and what became of the start."""
    row = record["window"]
    table = rows_of(
        "cells | steps | iterations | all iterations | error of the start | memory",
        [
            (
                f"{row['cells']:,} x {row['cells']:,}",
                row["steps"],
                row["iterations"],
                f"**{row['window']:.1f} s**",
                f"{row['error']:.0e}",
                f"{row['memory']:.0f} GB",
            )
        ],
    )
    return f"{table}\n\n{source('assimilation_device', record, device=record['device'])}"
