"""Write the tables of README and docs from benchmarks/results/*.json.

A table stands between `<!-- name: begin -->` and `<!-- name: end -->`; `name` is a function of
this file or of `kernel_tables.py`, which reads the results it is named after, or an entry of
`reproduction_tables.py`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import body_tables
import inverse_tables
import kernel_tables
import profile_tables
import reproduction_tables
import summary_table
import validation_table
from markdown_table import Record, every_other, rows_of, source

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def contact_block(record: Record) -> str:
    """Ratios of the contact solve, one row a size."""
    blocks = [
        rows_of(
            "cells | unknowns | factoriser | factor + solve | contact solve | ratio "
            "| next load step",
            (
                (
                    f"{row['n']} x {row['n']}",
                    f"{row['unknowns']:,}",
                    "PARDISO" if row["solver"] == "pardiso" else "SuperLU",
                    f"{row['base']:.2f} s",
                    f"{row['total']:.2f} s",
                    f"**{row['ratio']:.2f}**",
                    f"{100 * row['next_step_over_total']:.1f} %",
                )
                for row in record["rows"]
            ),
        )
    ]
    for row in record["rows"]:
        if "peers" in row:
            rivals = "; ".join(
                f"{name} {rival['over_ours']:.1f}" for name, rival in row["peers"].items()
            )
            blocks.append(f"Times of others over ours at {row['n']} x {row['n']}: {rivals}.")
    return "\n\n".join((*blocks, source("contact_block", record, "MKL", "qpsolvers")))


def mkl(record: Record) -> str:
    """What PARDISO gives: the same contact solve with either factoriser."""
    seconds = {(row["n"], row["solver"]): row["total"] for row in record["rows"]}
    return rows_of(
        "contact solve | SuperLU | PARDISO | times as fast",
        (
            (f"{n} x {n} cells", f"{slow:.2f} s", f"{fast:.2f} s", f"{slow / fast:.1f}")
            for (n, solver), slow in seconds.items()
            if solver == "superlu" and (fast := seconds.get((n, "pardiso")))
        ),
    )


def contact_layers(record: Record) -> str:
    """The largest layered blocks by slab doubling and by waves, on a device and in NumPy."""
    parts = [
        (f"{where}, {path}", record[name])
        for where, device in (("device", "cuda"), ("NumPy", "cpu"))
        for path, name in (("slab doubling", device), ("waves", f"waves_{device}"))
        if name in record
    ]
    rows = []
    for where, found in parts:
        for row in found["rows"][-1:]:
            beside = row.get("over_pardiso", {}).get("total")
            rows.append(
                (
                    where,
                    f"{row['n']} x {row['n']}",
                    f"{row['unknowns']:,}",
                    f"{row['seconds']['total']:.2f} s",
                    "-" if beside is None else f"**{beside:.2f}**",
                )
            )
    table = rows_of("where | cells | unknowns | input to result | over PARDISO", rows)
    ends = [
        source("contact_layers", found, device=found["device"])
        if "device" in found
        else source("contact_layers", found, "MKL")
        for _, found in parts
    ]
    return "\n\n".join((table, *dict.fromkeys(ends)))


def contact_scaling(record: Record) -> str:
    """How time grows with the mesh, and what a load history costs."""
    rows = []
    for title, name, form in (
        ("square, Adini", "planar", "{0} x {0}"),
        ("cube, Q1", "solid", "{0}^3"),
    ):
        for row in every_other(record[name]["rows"]):
            contact = sum(row[part] for part in ("rows", "condense", "solve"))
            rows.append(
                (
                    title,
                    form.format(row["n"]),
                    f"{row['unknowns']:,}",
                    f"{row['base']:.2f} s",
                    f"{contact:.2f} s",
                    f"**{contact / row['base']:.2f}**",
                )
            )
    table = rows_of("body | cells | unknowns | factor + solve | contact solve | ratio", rows)
    history = next(iter(record["history"].values()))
    note = (
        f"{history['steps']} load steps on {history['n']} x {history['n']} cells take "
        f"{history['over_cold']:.1f} cold solves."
    )
    return f"{table}\n\n{note} {source('contact_scaling', record, 'MKL')}"


def contact_far(record: Record) -> str:
    """What steps of far tools, of wear and of adhesion cost."""
    table = rows_of(
        "tool | unknowns | contact points | small sliding | far | ratio | closest points",
        (
            (
                row["tool"],
                f"{row['unknowns']:,}",
                row["points"],
                f"{1e3 * row['small']:.1f} ms",
                f"{1e3 * row['far']:.0f} ms",
                f"**{row['ratio']:.0f}**",
                f"{100 * row['share']:.0f} %",
            )
            for row in record["far"]
        ),
    )
    wear = "; ".join(f"{row['n']}^2 points {row['ratio']:.1f}" for row in record["wear"])
    glue = "; ".join(
        f"{row['points']}^2 points {row['ratio']:.0f}, pull-off off by {100 * row['off']:.1f} %"
        for row in record["jkr"]
    )
    return (
        f"{table}\n\nA history with wear over one without, on a grid with friction: {wear}. A "
        f"history of a sphere that adheres (JKR) over one that is pressed, on a grid: {glue}.\n\n"
        f"{source('contact_far', record, 'MKL')}"
    )


def contact_peers(record: Record) -> str:
    """Accuracy and time beside other contact codes, on the finest mesh of each."""
    finest = record["line"][-1]["h"]
    line = rows_of(
        "Hertz line contact, a / h | unknowns | rms error of the pressure / p0 "
        "| error of the half-width | seconds",
        (
            (
                f"{row['name']}, {row['h']}",
                f"{row['unknowns']:,.0f}",
                f"{row['rms']:.1e}",
                f"{row['half_width']:.1e}",
                f"{row['seconds']:.2g}",
            )
            for row in record["line"]
            if row["h"] == finest
        ),
    )
    block = rows_of(
        "block with Coulomb friction, cells | unknowns | error of u | error of the force "
        "| penetration | seconds",
        (
            (
                f"{row['name']}, {row['n']} x {row['n']}",
                f"{row['unknowns']:,}",
                f"{row['u_error']:.1e}",
                f"{row['force_error']:.1e}",
                f"{row['penetration']:.0e}",
                f"{row['seconds']:.2f}",
            )
            for row in record["block"]
            if row["n"] == record["block"][-1]["n"]
        ),
    )
    peers = ", ".join(f"{name} {version}" for name, version in record["peers"].items())
    return "\n\n".join((line, block, f"Beside {peers}. {source('contact_peers', record)}"))


def elements(record: Record) -> str:
    """Dofs and seconds to one accuracy, one row a problem."""
    problems = record["problems"].values()
    names = list(next(iter(problems))["runs"])
    target, reference = record["target"], record["reference_dofs"]
    rows = []
    for problem in problems:
        for norm, row in problem["summary"].items():
            if norm == "H1":
                continue
            label = f"{problem['title']}; {norm}"
            if all(found["dofs_to_target"] is None for found in row.values()):
                cells = [f"{found['error_at_reference']:.1e}" for found in row.values()]
                label += f", error at {reference:,} dofs"
            else:
                cells = [
                    "-"
                    if found["dofs_to_target"] is None
                    else f"{found['dofs_to_target']:,.0f} ({found['seconds_to_target']:.2f} s)"
                    for found in row.values()
                ]
                label += f", dofs to {target:.0e}"
            rows.append((label, *cells))
    end = source("elements", record, "scikit-fem", "MKL")
    return rows_of(" | ".join(("problem", *names)), rows) + f"\n\n{end}"


def sparse_solving(record: Record) -> str:
    """Set-up and solution in 3-D, a factorisation beside multigrid, the largest sizes."""
    rows, notes = [], []
    for problem, found in record["problems"].items():
        for size in sorted({line["unknowns"] for line in found["lines"]})[-3:]:
            row = {line["solver"]: line for line in found["lines"] if line["unknowns"] == size}
            direct, multigrid = row[found["direct"]], row["amg"]
            seconds = [part["setup"] + part["solve"] for part in (direct, multigrid)]
            ratio = f"**{seconds[0] / seconds[1]:.2f}**"
            rows.append((problem, f"{size:,}", *(f"{s:.2f} s" for s in seconds), ratio))
        equal = found["crossover"]
        where = "at none of these sizes" if equal is None else f"from {equal:,.0f} unknowns on"
        notes.append(f"{problem} {where}")
    table = rows_of("problem | unknowns | factor + solve | multigrid | ratio", rows)
    end = source("sparse_solving", record, "pyamg", "MKL")
    return f"{table}\n\nMultigrid is quicker: {'; '.join(notes)}. {end}"


def _unlike_cells(record: Record) -> str:
    """Assembly where cells are unlike, by turns with scikit-fem."""
    unlike = rows_of(
        "unlike cells | `assemble` | scikit-fem: Basis + asm | ratio",
        (
            (
                row["problem"],
                f"{1e3 * row['assemble']:.0f} ms",
                f"{1e3 * row['scikit-fem']:.0f} ms",
                f"**{row['scikit-fem'] / row['assemble']:.0f}**",
            )
            for row in record["rows"]
        ),
    )
    return f"\n\n{unlike}\n\nProcessor time. {source('assembly', record, 'scikit-fem')}"


def assembly(record: Record) -> str:
    """Assembly against scikit-fem's, one row a matrix."""
    table = rows_of(
        "matrix | `assemble` | scikit-fem: Basis + asm | ratio",
        (
            (
                f"{row['problem']}, {row['n']} x {row['n']}",
                f"{1e3 * row['assemble']:.0f} ms",
                f"{row['Basis'] + row['asm']:.2f} s",
                f"**{row['ratio']:.0f}**",
            )
            for row in record["matrices"]
        ),
    )
    solver, cells = record["solver"], record["tetrahedra"]
    table += _unlike_cells(record["irregular"]) if "irregular" in record else ""
    return (
        f"{table}\n\nElasticity on {cells['cells']:,} unlike tetrahedra of second order: "
        f"`AffineCells` {cells['AffineCells']:.2f} s, scikit-fem {cells['asm']:.1f} s, without the "
        f"Basis. `UniformSolver` solves Poisson's equation {solver['ratio']:.0f} times as fast as "
        f"{solver['peer'].upper()}. {source('assembly', record, 'scikit-fem', 'MKL')}"
    )


def curved(record: Record) -> str:
    """Eigenvalues of the disk, the mesh of each method that is nearest to 7,000 unknowns."""
    lines = []
    for name, runs in record["runs"].items():
        row = min(runs, key=lambda row: abs(math.log(row["dofs"] / 7000)))
        errors = (f"{row[which]:.1e}" for which in ("first", "worst"))
        lines.append((name, f"{row['dofs']:,}", *errors, f"{row['total']:.2f} s"))
    table = rows_of("method | unknowns | first eigenvalue | worst of ten | time", lines)
    return f"{table}\n\n{source('curved', record, 'scikit-fem', 'ngsolve', 'xfem')}"


def first_result(record: Record) -> str:
    """Seconds of a fresh process to its first results, with and without machine code on disk."""
    lines = []
    for row in record["rows"]:
        (imports, first, again), cold = row["warm"], row["cold"][1]
        times = (f"{seconds:.2f} s" for seconds in (imports, cold, first))
        lines.append((row["case"], *times, f"{1e3 * again:.1f} ms"))
    table = rows_of("first | import | nothing on disk | later processes | the same again", lines)
    return f"{table}\n\n{source('first_result', record, 'numba', 'scikit-fem')}"


# The tables, and the file that each is read from where its name is another.
TABLES: dict[str, Callable[[Record], str]] = {
    table.__name__: table
    for table in (
        summary_table.summary,
        *(assembly, elements, sparse_solving, curved, first_result),
        *(contact_block, mkl, contact_scaling, contact_layers, contact_peers, contact_far),
        *(body_tables.contact_pair, body_tables.distributed, body_tables.rough_layers),
        *(body_tables.contact_dynamics, body_tables.rough_peers, body_tables.contact_device),
        *(body_tables.contact_gpus, body_tables.contact_materials),
        *(body_tables.contact_nonlinear_device, body_tables.contact_derivatives),
        inverse_tables.assimilation_device,
        *(kernel_tables.cip, kernel_tables.cip_sphere, kernel_tables.cip_device),
        *(profile_tables.cip_profiles, profile_tables.cip_profile_costs),
        *(profile_tables.cip_profile_orders, profile_tables.cip_areas, profile_tables.cip_tracers),
        *(profile_tables.cip_cited, profile_tables.cip_steps),
        *(inverse_tables.adjoint, inverse_tables.assimilation, inverse_tables.calibration),
        *(kernel_tables.qp, kernel_tables.qp_peers, kernel_tables.qp_device_peers),
        *(kernel_tables.qp_small, kernel_tables.qp_large),
        *(kernel_tables.maros_meszaros, validation_table.validation),
        validation_table.periodic,
        *(kernel_tables.eigs, kernel_tables.eigs_products),
        *(kernel_tables.lqr, kernel_tables.lqr_device),
    )
} | reproduction_tables.REPRODUCTION
FILES = {
    "summary": "contact_block", "mkl": "contact_block", "periodic": "validation_periodic",
    **dict.fromkeys(("cip_profile_costs", "cip_profile_orders", "cip_areas"), "cip_profiles"),
    "cip_steps": "cip_tracers",
} | reproduction_tables.FILES  # fmt: skip


def regenerated(text: str) -> str:
    """Return the page with every table replaced by what its JSON file says."""

    def written(match: re.Match[str]) -> str:
        name = match[1]
        record = json.loads((RESULTS / f"{FILES.get(name, name)}.json").read_text())
        return f"<!-- {name}: begin -->\n\n{TABLES[name](record)}\n\n<!-- {name}: end -->"

    return re.sub(r"<!-- (\w+): begin -->.*?<!-- \1: end -->", written, text, flags=re.S)


if __name__ == "__main__":
    for page in PAGES:
        text = page.read_text()
        if (new := regenerated(text)) != text:
            page.write_text(new)
