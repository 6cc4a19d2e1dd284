"""Contact beside closed forms and published values: the validation scripts in numbers.

python benchmarks/validation.py             # some minutes; writes both files
python benchmarks/validation.py --periodic  # results/validation_periodic.json alone
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from machine import describe
from reproduction_runs import example

RESULTS = Path(__file__).parent / "results"
Found = dict[str, Any]


def line(folder: str) -> Found:
    """Hertz' line contact and NAFEMS CGS-1."""
    cells = (4, 8, 16)
    found = example("validation_hertz_line").main(["--cells", *map(str, cells), "--output", folder])
    errors = [abs(row["pressure"]) for row in found.rows]
    return {
        "hertz line": {
            "cells": cells[-1],
            "pressure": float(errors[-1]),
            "half-width": float(abs(found.rows[-1]["half_width"])),
            "order": float(-np.polyfit(np.log(cells), np.log(errors), 1)[0]),
        },
        "NAFEMS CGS-1": {"a": float(found.cgs1[0]), "p": float(found.cgs1[1])},
    }


def punch(folder: str) -> Found:
    """The flat punch."""
    found = example("validation_flat_punch").main(["--output", folder])
    return {"flat punch": {name: float(row[-1]) for name, row in found.items()}}


def sphere(folder: str) -> Found:
    """Hertz' sphere."""
    found = example("validation_hertz_sphere").main(["--output", folder])
    return {"hertz sphere": {"p0": float(found.p0), "a": float(found.a)}}


def cattaneo(folder: str) -> Found:
    """Cattaneo and Mindlin's load history."""
    found = example("validation_cattaneo").main(["--steps", "8", "--output", folder])
    steps = len(found.rms) // 4  # four quarters of the history
    return {
        "cattaneo": {
            "instants": len(found.rms),
            "worst": float(found.rms.max()),
            "turns": float(found.rms[[steps - 1, 3 * steps - 1]].max()),
            "edge": float(np.abs(found.edge).max()),
        }
    }


def far_field(_: str) -> Found:
    """Stresses far below the contact."""
    script = example("validation_far_field")
    lines, points = script.line([5.0, 15.0, 40.0]), script.point([5.0, 7.5], cells=3, growth=1.15)
    return {
        "far field": {
            "line": float(max(errors[-1] for errors in lines.values())),
            "point": float(max(errors[-1] for errors in points.values())),
        }
    }


def order(folder: str) -> Found:
    """Orders of convergence at the end of contact."""
    found = example("validation_order").main(["--output", folder])
    return {"order": {name: float(value) for name, value in found.items()}}


def membrane(folder: str) -> Found:
    """The membrane over a staircase."""
    ours, reference = example("validation_membrane").main(["--output", folder])
    apart = np.sum(ours.close != reference.close) / np.sum(reference.close)
    return {
        "membrane": {
            "force": float(abs(ours.force / reference.force - 1)),
            "contact set": float(apart),
        }
    }


def cylinders(folder: str) -> Found:
    """Two elastic cylinders and NAFEMS CGS-1 with both bodies meshed."""
    found = example("validation_two_cylinders").main(["--output", folder])
    middle = {name: lines[1] for name, lines in found.lines.items()}  # of three meshes
    return {
        "two cylinders": {
            "cells": 16,
            "rms": {name: line.rms for name, line in middle.items()},
            "peak": {name: abs(line.peak) for name, line in middle.items()},
            "order": {name: float(order) for name, order in found.orders.items()},
        },
        "two meshes CGS-1": {
            "curved" if curved else "straight": {"a": pair.a, "p": pair.p}
            for curved, pair in found.cgs1.items()
        },
    }


def shrink(folder: str) -> Found:
    """A ring shrunk onto another, beside Lame's pressure."""
    facets = (8, 16, 32)
    arguments = ["--facets", *map(str, facets), "--output", folder]
    found = example("shrink_fit").main(arguments)
    return {
        "shrink fit": {
            "facets": facets[-1],
            "rms": {name: float(errors[-1]) for name, errors in found.errors.items()},
            "order": {name: float(order) for name, order in found.orders.items()},
        }
    }


def ties(folder: str) -> Found:
    """Orders of tied meshes, of the displacement and of its gradient, at the worse of two ends."""
    found = example("tied_meshes").main(["--output", folder])
    orders: Found = {}
    for (name, _), pair in found.orders.items():
        before = orders.get(name, [np.inf, np.inf])
        orders[name] = [min(float(o), b) for o, b in zip(pair, before, strict=True)]
    return {"ties": orders}


def cut(folder: str) -> Found:
    """Hertz' line contact on a boundary that cuts the cells."""
    rows = example("cut_hertz").main(["--output", folder]).rows
    return {
        "cut hertz": [
            {"h": float(row.h), "half-width": float(row.half_width), "peak": float(row.peak)}
            for row in rows
        ]
    }


def periodic(folder: str) -> Found:
    """Waves on half planes, blocks and layers, a ball, and coatings, by transforms."""
    cases = example("validation_periodic").main(["--output", folder]).cases
    return {
        "cases": {
            name: {
                "points": list(case.sizes),
                "errors": case.errors.tolist(),
                "orders": case.orders.tolist(),
            }
            for name, case in cases.items()
        }
    }


def main(argv: list[str] | None = None) -> None:
    """Run all, and write after each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--periodic", action="store_true", help="by transforms alone")
    options = parser.parse_args(argv)
    matplotlib.use("Agg")
    files: Found = {"validation_periodic": (periodic,)}
    if not options.periodic:
        files["validation"] = (
            *(line, punch, far_field, membrane, cut, cylinders, shrink, ties),
            *(sphere, cattaneo, order),
        )
    with tempfile.TemporaryDirectory() as folder:
        for name, cases in files.items():
            record: Found = {"machine": describe()}
            for case in cases:
                record |= case(folder)
                text = json.dumps(record, indent=1) + "\n"
                (RESULTS / f"{name}.json").write_text(text)


if __name__ == "__main__":
    main()
