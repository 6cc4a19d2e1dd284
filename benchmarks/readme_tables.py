"""Write the README's tables from benchmarks/results/*.json."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"


def contact_block(record: dict[str, Any]) -> str:
    """Ratios of the contact solve, one row a size."""
    lines = [
        "| cells | unknowns | factoriser | factor + solve | whole contact solve | ratio "
        "| next load step | assembly |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {row['n']} x {row['n']} | {row['unknowns']:,} | "
        f"{'PARDISO' if row['solver'] == 'pardiso' else 'SuperLU'} | {row['base']:.2f} s | "
        f"{row['total']:.2f} s | **{row['ratio']:.2f}** | "
        f"{100 * row['next_step_over_total']:.1f} % | {row['assembly']:.2f} s |"
        for row in record["rows"]
    ]
    for row in record["rows"]:
        if "peers" in row:
            rivals = "; ".join(
                f"{name} {rival['seconds']:.1f} s ({rival['over_ours']:.1f} x)"
                for name, rival in row["peers"].items()
            )
            lines += ["", f"The same problem at {row['n']} x {row['n']} by others: {rivals}."]
    machine = record["machine"]
    versions = machine["versions"]
    lines += [
        "",
        f"`benchmarks/contact_block.py`, median of {record['repeats']} interleaved repeats on "
        f"{machine['cores']} cores ({machine['processor']}), SciPy {versions['scipy']}, "
        f"MKL {versions.get('mkl', '-')}.",
    ]
    return "\n".join(lines)


TABLES = {"contact_block": contact_block}


def regenerated(text: str) -> str:
    """The README with every table replaced by what its JSON file says."""
    for name, table in TABLES.items():
        path = RESULTS / f"{name}.json"
        if path.exists():
            body = table(json.loads(path.read_text()))
            pattern = rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)"
            text = re.sub(pattern, lambda m, body=body: m[1] + body + "\n" + m[2], text, flags=re.S)
    return text


if __name__ == "__main__":
    readme = ROOT / "README.md"
    readme.write_text(regenerated(readme.read_text()))
