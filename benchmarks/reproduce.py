"""The dissertation's experiments repeated, for the tables of docs/reproduction.md.

    python benchmarks/reproduce.py --run    # compute results/reproduce.json, in some minutes
    python benchmarks/reproduce.py          # write the page's tables from results/*.json

What `eigs.py`, `qp.py` and `lqr.py` measure is read from their files.
"""

from __future__ import annotations

import argparse
import json

import performance_tables
from errata import CHECKS
from machine import describe
from markdown_table import Record
from reproduction_runs import RUNS


def run() -> Record:
    """Compute everything."""
    record: Record = {"machine": describe()}
    for experiment in RUNS:
        print(experiment.__name__, flush=True)
        record |= experiment()
    record["errata"] = {name: [float(error) for error in check()] for name, check in CHECKS.items()}
    return record


def main() -> None:
    """Compute if asked to, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--run", action="store_true", help="compute results/reproduce.json")
    if parser.parse_args().run:
        path = performance_tables.RESULTS / "reproduce.json"
        path.write_text(json.dumps(run(), indent=1) + "\n")
    page = performance_tables.ROOT / "docs" / "reproduction.md"
    page.write_text(performance_tables.regenerated(page.read_text()))


if __name__ == "__main__":
    main()
