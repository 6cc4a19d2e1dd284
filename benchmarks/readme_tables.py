"""Write the README's tables from benchmarks/results/*.json."""

from __future__ import annotations

import json
import math
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


def elements(record: dict[str, Any]) -> str:
    """Dofs and seconds to one accuracy, one row a problem, and against whom Adini loses."""
    problems = record["problems"].values()
    names = list(next(iter(problems))["runs"])
    target, reference = record["target"], record["reference_dofs"]
    lines = [f"| problem | {' | '.join(names)} |", f"| --- {'| --- ' * len(names)}|"]
    verdicts = []
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
                    "not reached"
                    if found["dofs_to_target"] is None
                    else f"{found['dofs_to_target']:,.0f} ({found['seconds_to_target']:.2f} s)"
                    for found in row.values()
                ]
                label += f", dofs to {target:.0e}"
            lines.append(f"| {label} | {' | '.join(cells)} |")
            listed = {
                word: ", ".join(f"{name} {ratio:.1f} x" for name, ratio in rivals) or "nobody"
                for word, rivals in problem["verdict"][norm].items()
            }
            verdicts.append(
                f"* {problem['title']} ({norm}): smaller error than {listed['wins']}; "
                f"larger than {listed['loses']}."
            )
    machine = record["machine"]
    return "\n".join(
        [
            *lines,
            "",
            f"Per dof, at {reference:,} dofs, Adini has a",
            "",
            *verdicts,
            "",
            f"`benchmarks/elements.py`, seconds for basis, assembly and solution, median of "
            f"{record['repeats']} on {machine['cores']} cores ({machine['processor']}), "
            f"scikit-fem {machine['versions']['scikit-fem']}.",
        ]
    )


def sparse_solving(record: dict[str, Any]) -> str:
    """Set-up and solution in 3-D, a factorisation beside multigrid, one row a size."""
    lines = [
        "| problem | unknowns | factor + solve | multigrid | iterations | with constants alone |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    notes = []
    for problem, found in record["problems"].items():
        for size in sorted({line["unknowns"] for line in found["lines"]}):
            row = {line["solver"]: line for line in found["lines"] if line["unknowns"] == size}
            direct, full, simple = (
                row[name] for name in (found["direct"], "amg", "amg, translations")
            )
            seconds = [part["setup"] + part["solve"] for part in (direct, full)]
            lines.append(
                f"| {problem} | {size:,} | {seconds[0]:.2f} s | {seconds[1]:.2f} s | "
                f"{full['iterations']} | {simple['iterations']} |"
            )
        equal = found["crossover"]
        where = "at none of these sizes" if equal is None else f"from {equal:,.0f} unknowns on"
        notes.append(f"{problem}: multigrid is the quicker one {where}")
    machine = record["machine"]
    return "\n".join(
        [
            *lines,
            "",
            f"{'; '.join(notes).capitalize()}. `benchmarks/sparse_solving.py`, "
            f"{machine['cores']} cores ({machine['processor']}), residual 1e-10, "
            f"pyamg {machine['versions'].get('pyamg', '-')}, "
            f"MKL {machine['versions'].get('mkl', '-')}.",
        ]
    )


def assembly(record: dict[str, Any]) -> str:
    """Assembly against scikit-fem's, one row a matrix."""
    lines = [
        "| matrix | `assemble` | scikit-fem: Basis + asm | ratio | times writing the CSR arrays |",
        "| --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {row['problem']}, {row['n']} x {row['n']} | {1e3 * row['assemble']:.0f} ms | "
        f"{row['Basis'] + row['asm']:.2f} s | **{row['ratio']:.0f}** | "
        f"{row['times the floor']:.1f} |"
        for row in record["matrices"]
    ]
    machine, solver, basis = record["machine"], record["solver"], record["basis"]
    return "\n".join(
        [
            *lines,
            "",
            f"A Basis of the closed form is made {basis['ratio']:.0f} x quicker than of the same "
            f"element through `ElementGlobal` ({basis['n']} x {basis['n']}); `UniformSolver` "
            f"solves Poisson's equation there {solver['ratio']:.0f} x quicker than "
            f"{solver['peer'].upper()}, set-up included. Compilation apart. "
            f"`benchmarks/assembly.py`, median of {record['repeats']}, "
            f"{machine['cores']} cores ({machine['processor']}).",
        ]
    )


def eigs(record: dict[str, Any]) -> str:
    """Ten eigenvalues of dense matrices on a device, one row an order."""
    lines = [
        "| n | device | bandwidth floor | ratio | ARPACK, host | Tesla, 2012 | four cores, 2012 |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for n, row in record["table"].items():
        host, device, then = row.get("host") or {}, row["device"], row.get("dissertation")
        arpack = [host[name] for name in ("arpack 25", "arpack 40") if host.get(name)]
        beside = [min(arpack) if arpack else None]
        beside += [then["Tesla"], then["four cores"]] if then else [None, None]
        cells = ["-" if seconds is None else f"{1e3 * seconds:.0f} ms" for seconds in beside]
        lines.append(
            f"| {int(n):,} | {1e3 * device['seconds']:.1f} ms | {1e3 * device['floor']:.2f} ms | "
            f"{device['ratio']:.2f} | {' | '.join(cells)} |"
        )
    hard = [
        "| matrices | n | device | NumPy | ARPACK |",
        "| --- | --- | --- | --- | --- |",
    ]
    for n, rows in record["kinds"].items():
        for kind, row in rows.items():
            cells = [f"{1e3 * row[name]:.1f} ms" for name in ("device", "host", "arpack")]
            hard.append(f"| {kind} | {n} | {' | '.join(cells)} |")
    machine = record["machine"]
    return "\n".join(
        [
            *lines,
            "",
            f"The {record['k']} eigenvalues of largest modulus; the floor is the time to read the "
            "matrix once a product at the copy bandwidth measured in the run. "
            f"`benchmarks/eigs.py`, one NVIDIA H200, {machine['cores']} host cores.",
            "",
            *hard,
            "",
            "Six kinds, the mean of three each; ARPACK with the quicker of its spaces of 25 and "
            "40. Host times on all cores or on one, whichever is less.",
        ]
    )


def curved(record: dict[str, Any]) -> str:
    """Eigenvalues of the disk, the mesh of each method that is nearest to 7,000 unknowns."""
    lines = [
        "| method | unknowns | first eigenvalue | worst of ten | mesh to matrices | eigenvalues |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, rows in record["runs"].items():
        row = min(rows, key=lambda row: abs(math.log(row["dofs"] / 7000)))
        eigenvalues = row["seconds"]["eigenvalues"]
        lines.append(
            f"| {name} | {row['dofs']:,} | {row['first']:.1e} | {row['worst']:.1e} | "
            f"{row['total'] - eigenvalues:.2f} s | {eigenvalues:.2f} s |"
        )
    machine = record["machine"]
    return "\n".join(
        [
            *lines,
            "",
            f"`benchmarks/curved.py`, median of {record['repeats']}, {machine['cores']} cores "
            f"({machine['processor']}).",
        ]
    )


TABLES = {
    "curved": curved,
    "contact_block": contact_block,
    "elements": elements,
    "sparse_solving": sparse_solving,
    "assembly": assembly,
    "eigs": eigs,
}


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
