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
    table = rows_of(
        "where | profile | nodes | velocity | parameters | steps | run | gradient "
        "| in runs | with few states kept | dot-test",
        (
            (
                where,
                f"{row['profile']}, {row['dim']}-D",
                f"{row['nodes']:,}",
                "c(x)" if row["steady"] else "c(x, t)",
                row["parameters"],
                row["steps"],
                f"{row['run_s']:.3f} s",
                f"{row['gradient_s']:.3f} s",
                f"**{row['ratio']:.2f}**",
                f"{row['ratio_recomputed']:.2f}",
                f"{row['dot_test']:.0e}",
            )
            for where, part in _measured(record)
            for row in part["rows"]
        ),
    )
    note = f"Median of {record['repeats']} interleaved repeats."
    if "note" in record:
        note += f" {record['note']}"
    ends = _sources("adjoint", record)
    return "\n\n".join((table, f"{note} {ends[0]}", *ends[1:]))


def assimilation(record: Record) -> str:
    """Seconds of a 4D-Var window, and of its parts in units of the run."""
    table = rows_of(
        "where | cells | combinations of reports | run | tangent | adjoint "
        "| square root of the background | whole window",
        (
            (
                where,
                f"{row['cells']:,} x {row['cells']:,}",
                row["iterations"],
                f"{row['run']:.3f} s",
                *(f"{row[name] / row['run']:.1f} runs" for name in ("tangent", "adjoint", "root")),
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
    return (
        f"{table}\n\nRoot mean square of errors over deviations {record['rms']:.2f}; chance of "
        f"a distribution as far from the normal one {record['kolmogorov_smirnov_p']:.2f} "
        f"(Kolmogorov and Smirnov). {source('calibration', record)}"
    )


def assimilation_device(record: Record) -> str:
    """Seconds of a 4D-Var window on a device, and what became of the start."""
    row = record["window"]
    table = rows_of(
        "cells | steps | iterations | runs and operators | iterations in all "
        "| norm of the gradient | error of the start | memory",
        [
            (
                f"{row['cells']:,} x {row['cells']:,}",
                row["steps"],
                row["iterations"],
                f"{row['setup']:.1f} s",
                f"**{row['window']:.1f} s**",
                f"{row['gradient']:.0e} of the first",
                f"{row['error']:.0e}",
                f"{row['memory']:.0f} GB",
            )
        ],
    )
    return f"{table}\n\n{source('assimilation_device', record, device=record['device'])}"
