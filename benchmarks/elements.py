"""Error against dofs and against time: Adini beside the elements one would take instead.

On uniform meshes, each element with the assembly of scikit-fem and the same direct solver:

* Poisson, u = 0 on the square, u = sin(pi x) sin(pi y) exp(x + y/2);
* Poisson, u = 0 on the L-shape, u = r^(2/3) sin(2 theta/3) (1 - x^2) (1 - y^2), theta from an edge
  of the re-entrant corner: u is in H^(5/3 - eps) only;
* plane elasticity on the square, held at y = 0, tractions on the other sides;
* the eigenvalues 8 pi^2 and 5 pi^2 (double, the mean) of the Laplacian with u_n = 0.

All dofs count, also the inner ones of QuadP(3) and TriP3, which one may eliminate cell by cell: of
QuadP(3) 5/9 would be left, of TriP3 7/9.

Errors are relative, in L2 and in the H1 seminorm or of the eigenvalue. Seconds are those of Basis,
assembly and solution, medians. Argyris is scikit-fem's, whose global monomials lose digits on fine
meshes: its errors grow again. The problems themselves are in `element_problems.py`.

    python benchmarks/elements.py --repeats 3
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from element_problems import FAMILIES, PROBLEMS, Eigenvalue, Family, Source
from machine import describe

TARGET = 1e-6
REFERENCE_DOFS = 8000
SIZES = [250, 500, 1000, 2000, 4000, 8000, 16000]
MARKERS = dict(zip(FAMILIES, "os^vDP", strict=True))


def sweep(problem: Source | Eigenvalue, family: Family, sizes: list[int], repeats: int) -> Any:
    """Return unknowns, seconds and errors for meshes of about the given numbers of dofs."""
    rows = []
    for size in [size for size in sizes if size <= family.most]:
        n = max(2, round(np.sqrt(size / (family.dofs * problem.components))))
        mesh, seconds = problem.mesh(family, n), []
        for _ in range(repeats):
            begin = time.perf_counter()
            solution = problem.solve(mesh, family)
            seconds.append(time.perf_counter() - begin)
        row = {"n": n, "dofs": solution[2], "seconds": statistics.median(seconds)}
        rows.append(row | problem.errors(solution))
    return rows


def before_rounding(errors: Any) -> int:
    """Return how many of the errors come before rounding makes them grow."""
    lowest = int(np.argmin(errors))
    return len(errors) if lowest == len(errors) - 1 else lowest + 1


def order(rows: list[dict[str, Any]], norm: str) -> float:
    """Return the order in h ~ dofs^(-1/2), fitted over the last meshes that rounding spares."""
    errors = np.array([row[norm] for row in rows])
    count = before_rounding(errors)
    # The lowest error of a sequence that grows again is partly rounding.
    last = count if count == len(errors) else count - 1
    chosen = slice(max(0, last - 4), last)
    dofs = np.array([row["dofs"] for row in rows])[chosen]
    return float(-2 * np.polyfit(np.log(dofs), np.log(errors[chosen]), 1)[0])


def to_reach(rows: list[dict[str, Any]], norm: str, target: float, what: str) -> float | None:
    """Return the dofs or seconds at which the error passes the target; None if it does not."""
    for above, below in pairwise(rows):
        if above[norm] > target >= below[norm]:
            share = np.log(above[norm] / target) / np.log(above[norm] / below[norm])
            return float(above[what] * (below[what] / above[what]) ** share)
    return None


def at(rows: list[dict[str, Any]], norm: str, dofs: float) -> float:
    """Return the error at a number of dofs, from its neighbours, linear in the logarithms."""
    x = np.log([row["dofs"] for row in rows])
    return float(np.exp(np.interp(np.log(dofs), x, np.log([row[norm] for row in rows]))))


def summary(problem: Source | Eigenvalue, runs: dict[str, Any]) -> dict[str, Any]:
    """Return, for each norm and element, what the table and the verdict say."""
    return {
        norm: {
            name: {
                "order": order(rows, norm),
                "error_at_reference": at(rows, norm, REFERENCE_DOFS),
                "dofs_to_target": to_reach(rows, norm, TARGET, "dofs"),
                "seconds_to_target": to_reach(rows, norm, TARGET, "seconds"),
                "grows_again": before_rounding([row[norm] for row in rows]) < len(rows),
            }
            for name, rows in runs.items()
        }
        for norm in problem.norms
    }


def verdict(figures: dict[str, Any]) -> dict[str, list[tuple[str, float]]]:
    """Return against whom Adini wins and loses at equal dofs: the ratio of the errors."""
    ours = figures["Adini"]["error_at_reference"]
    ratios = [
        (name, row["error_at_reference"] / ours) for name, row in figures.items() if name != "Adini"
    ]
    ratios.sort(key=lambda pair: -pair[1])
    return {
        "wins": [(name, ratio) for name, ratio in ratios if ratio >= 1],
        "loses": [(name, 1 / ratio) for name, ratio in ratios if ratio < 1],
    }


def report(title: str, figures: dict[str, Any]) -> None:
    """Print what was found for one problem."""
    print(f"\n{title}")
    for norm, table in figures.items():
        print(f"{norm:>10}   order   at {REFERENCE_DOFS} dofs   dofs to {TARGET:.0e}   seconds")
        for name, row in table.items():
            dofs, seconds = row["dofs_to_target"], row["seconds_to_target"]
            reached = "not reached" if dofs is None else f"{dofs:11.0f}   {seconds:10.3f}"
            note = "   (grows again)" if row["grows_again"] else ""
            error = row["error_at_reference"]
            print(f"{name:>10}{row['order']:8.2f}{error:15.2e}   {reached}{note}")
        for word, rivals in verdict(table).items():
            listed = ", ".join(f"{name} ({ratio:.1f} x)" for name, ratio in rivals)
            print(f"  per dof, Adini {word} against {listed or 'nobody'}")


def picture(runs: dict[str, Any]) -> Any:
    """Draw errors over dofs and over seconds, a row for each problem."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        len(runs), 2, figsize=(11, 3.9 * len(runs)), layout="constrained", sharey="row",
        squeeze=False,
    )  # fmt: skip
    for row, (key, families) in zip(axes, runs.items(), strict=True):
        norm = PROBLEMS[key].norms[0]
        for ax, what in zip(row, ("dofs", "seconds"), strict=True):
            for i, (name, rows) in enumerate(families.items()):
                points = [[line[what] for line in rows], [line[norm] for line in rows]]
                style = {"lw": 2.4, "zorder": 3} if name == "Adini" else {"lw": 1.2}
                ax.loglog(*points, MARKERS[name] + "-", color=f"C{i}", ms=5, label=name, **style)
            ax.minorticks_off()
            ax.grid(alpha=0.3)
            ax.set_xlabel("unknowns" if what == "dofs" else "seconds (basis, assembly, solution)")
        row[0].set_ylabel(f"relative error, {norm}")
        row[0].set_title(PROBLEMS[key].title, loc="left")
    axes[0, 0].legend(fontsize=8)
    return figure


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/elements.json and the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", choices=PROBLEMS, default=list(PROBLEMS))
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="unknowns, roughly")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--results", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    options = parser.parse_args(argv)

    record: dict[str, Any] = {
        "benchmark": "elements",
        "machine": describe(),
        "repeats": options.repeats,
        "target": TARGET,
        "reference_dofs": REFERENCE_DOFS,
    }
    problems: dict[str, Any] = record.setdefault("problems", {})
    for key in options.problems:
        problem = PROBLEMS[key]
        problem.solve(problem.mesh(FAMILIES["Adini"], 4), FAMILIES["Adini"])  # libraries loaded
        runs = {
            name: sweep(problem, family, options.sizes, options.repeats)
            for name, family in FAMILIES.items()
        }
        figures = summary(problem, runs)
        problems[key] = {
            "title": problem.title,
            "runs": runs,
            "summary": figures,
            "verdict": {norm: verdict(table) for norm, table in figures.items()},
        }
        report(problem.title, figures)

    options.results.mkdir(parents=True, exist_ok=True)
    path = options.results / "elements.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    options.output.mkdir(parents=True, exist_ok=True)
    picture({key: found["runs"] for key, found in problems.items()}).savefig(
        options.output / "elements.png", dpi=130
    )
    print(f"\nwritten to {options.output}: elements.png")
    return record


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    main()
