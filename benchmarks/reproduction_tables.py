"""Tables of docs/reproduction.md: what the dissertation prints beside ours, from results/*.json."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from dissertation import (
    CONTACT_STEPS,
    FIGURE_2_5_ORDER,
    FIGURE_3_2_ERROR,
    FIGURE_3_3_ERROR,
    FIGURE_5_2_ENTRIES,
    FIGURE_5_3_ORDERS,
    FIGURE_6_1_SPEEDUP,
    TABLE_5_4,
)
from errata_list import ERRATA
from markdown_table import Record, rows_of, source
from reproduction_runs import MESHES, example

Table = Callable[[Record], str]
NAMES = {
    "linear": "linear",
    "piecewise_linear": "piecewise linear",
    "smoothed": "smoothed, width 1e-6",
    "cubic": "cubic",
    "csl2": "CSL2",
    "csl4": "CSL4",
}
COLUMNS = " | ".join(f"n = {n}" for n in MESHES)


def lines(label: str, printed: Iterable[float] | None, ours: Iterable[float], form: str) -> list:
    """Rows of a table: printed, ours, ratio; or ours alone where nothing is printed."""
    ours = list(ours)
    row = ("ours", *(f"{value:{form}}" for value in ours))
    if printed is None:
        return [(label, *row)]
    printed = list(printed)
    ratios = (f"{a / b:.3g}" for a, b in zip(ours, printed, strict=True))
    above = (label, "printed", *(f"{value:{form}}" for value in printed))
    return [above, ("", *row), ("", "ratio", *ratios)]


def beside(rows: Iterable[tuple[Any, ...]], form: str = ".3g") -> str:
    """A table of single numbers, (quantity, printed or a word, ours or a text, remark)."""
    found = []
    for quantity, printed, ours, remark in rows:
        both = not isinstance(printed, str) and not isinstance(ours, str)
        cells = (f"{x:{form}}" if isinstance(x, float) else str(x) for x in (printed, ours))
        found.append((quantity, *cells, f"{ours / printed:.3g}" if both else "-", remark))
    return rows_of("quantity | printed | ours | ratio | remark", found)


def transport(name: str) -> Table:
    """Tables 2.1 to 2.3."""

    def table(record: Record) -> str:
        printed = getattr(example("cip_dissertation"), name.upper().translate({32: "_", 46: "_"}))
        cells = list(record[name]["cubic"])
        rows = []
        for profile, row in record[name].items():
            old = printed.get(profile)
            old = old and [old[int(n)] for n in cells]
            rows += lines(NAMES[profile], old, row.values(), ".3e")
        return rows_of(f"profile | N | {' | '.join(cells)}", rows)

    return table


def snapshots(name: str) -> Table:
    """Figures 2.2 to 2.4 and 2.7: how far u leaves the range of the solution, and its error."""

    def table(record: Record) -> str:
        rows = [
            (NAMES[profile], t, f"{max(0.0, -row['least']):.1e}",
             f"{max(0.0, row['largest'] - row['largest of the solution']):.1e}", f"{row['l2']:.2e}")
            for profile, times in record[name].items()
            for t, row in times.items()
        ]  # fmt: skip
        return rows_of("profile | t | below zero | above the solution | l2 error", rows)

    return table


def feet(name: str) -> Table:
    """Figures 2.1 and 3.1."""

    def table(record: Record) -> str:
        rows = (("error of the foot y", "-", record[name]["foot"], "largest over the grid"),
                ("error of its derivative", "-", record[name]["derivative"],
                 "what scales the derivative of u"))  # fmt: skip
        return beside(rows, ".0e")

    return table


def figure_2_5(record: Record) -> str:
    """Orders of convergence."""
    orders = record["Figure 2.5"].items()
    printed = {"cubic": FIGURE_2_5_ORDER}
    return beside(
        (NAMES[p], printed.get(p, "-"), order, "order of Table 2.1") for p, order in orders
    )


def figure_2_6(record: Record) -> str:
    """Errors over the time step."""
    found = record["Figure 2.6"]
    head = " | ".join(f"dt / h = {ratio}" for ratio in found["cubic"])
    rows = ((NAMES[p], *(f"{error:.3e}" for error in row.values())) for p, row in found.items())
    return rows_of(f"profile | {head}", rows)


def figure_3_2(record: Record) -> str:
    """The bell that becomes a blade."""
    rows = []
    for profile, row in record["Figure 3.2"].items():
        name = f"{profile}, {'split' if profile == 'cubic' else 'direct'}: "
        rows += [
            (f"{name}slice x = -.02", FIGURE_3_2_ERROR, row["slice"], "between two lines of nodes"),
            (f"{name}whole square", FIGURE_3_2_ERROR, row["whole"], "printed for the slice"),
            (f"{name}whole, dt = 2 h", "-", row["whole, dt = 2 h"], "half as many steps"),
        ]
    return beside(rows)


def figure_3_3(record: Record) -> str:
    """The slotted disk."""
    rows = [
        (f"{profile}, {turns} revolutions", FIGURE_3_3_ERROR if turns == "4" else "-", error,
         "edges smoothed over .16")
        for profile, row in record["Figure 3.3"].items()
        for turns, error in row.items()
    ]  # fmt: skip
    return beside(rows)


def eigenvalues(name: str, published: str) -> Table:
    """Tables 5.1 and 5.2."""

    def table(record: Record) -> str:
        printed, rows = getattr(example("eigenvalues"), published), []
        for mode, row in record[name].items():
            old = printed[tuple(map(int, mode.split(",")))]
            rows += lines(f"({mode})", old, row.values(), ".4e")
        return rows_of(f"(k,l) | - | {COLUMNS}", rows)

    return table


def table_5_3(record: Record) -> str:
    """Rates of the free elastic square."""
    printed, rows = example("eigenvalues").ELASTIC_RATES, []
    for (k, row), old in zip(record["Table 5.3"].items(), printed, strict=True):
        rows += lines(f"eigenvalue {k}", old, row, ".4f")
    return rows_of("- | - | n = 4 to 8 | 8 to 16 | 16 to 32", rows)


def figure_5_3(record: Record) -> str:
    """Orders on the two finest meshes."""
    rows = record["Figure 5.3"].items()
    return beside((f"least order, {name}", FIGURE_5_3_ORDERS[name], order,
                   "printed as *better than*") for name, order in rows)  # fmt: skip


def figure_5_4(record: Record) -> str:
    """Cut cells."""
    rows = (
        (k, row["cells"], f"{row['1 / sigma_min']:.1e}") for k, row in record["Figure 5.4"].items()
    )
    return rows_of("vertices inside | cells | largest 1 / sigma_min, ours", rows)


def table_5_4(record: Record) -> str:
    """Eigenvalues of the disk."""
    found, rows = record["Table 5.4"], []
    for k, ((m, i), exact, printed) in enumerate(TABLE_5_4):
        ours = [row[k] for row in found["extension"].values()]
        rows += lines(f"({m},{i}): {exact:g}", printed, ours, ".2e")
        rows.append(("", "2012's element", *(f"{row[k]:.2e}" for row in found["2012"].values())))
    return rows_of(f"(m,i): eigenvalue | - | {COLUMNS}", rows)


def figure_5_1(record: Record) -> str:
    """Shape functions."""
    distance = record["Figure 5.1"]["distance to duality"]
    return beside([("distance of the functions' dofs from the identity", "-", distance, "")], ".0e")


def figure_5_2(record: Record) -> str:
    """Structure of the matrix."""
    found = record["Figure 5.2"]
    return beside(
        (
            ("cells between coupled vertices", 1, found["farthest coupled vertex"], "per axis"),
            ("entries in a row", FIGURE_5_2_ENTRIES, found["most entries in a row"],
             "of the Laplacian, where u_x and u_y do not couple"),
        )
    )  # fmt: skip


def contact(name: str) -> Table:
    """Figures 5.5 and 5.6."""

    def table(record: Record) -> str:
        rows = []
        for quantity, value in record[name].items():
            ours = " to ".join(f"{x:.4f}" for x in value) if isinstance(value, list) else value
            rows.append((quantity.replace("|", "\\|"), "-", ours, ""))
        return beside(rows, ".5g")

    return table


def algorithm_1(record: Record) -> str:
    """The full contact problem."""
    found = record["Algorithm 1"]
    return beside(
        (
            ("steps of `newton` after the frictionless start", "-", found["steps of newton"], ""),
            ("largest residual", "-", found["residual"], "recomputed from the problem"),
        ),
        ".2g",
    )


def algorithm_2(record: Record) -> str:
    """Signorini's problem."""
    found = record["Algorithm 2"]
    return beside(
        (
            (
                "active sets until they repeat",
                "finitely many",
                found["steps"],
                "section 5.2's block",
            ),
            ("difference to `ContactProblem.solve`", "-", found["difference"], "of u, relative"),
        ),
        ".2g",
    )


def algorithm_3(record: Record) -> str:
    """The discrete contact problem with friction."""
    found = record["Algorithm 3"]
    return beside(
        (
            ("steps to three digits", f"< {CONTACT_STEPS}", found["steps to three digits"],
             "of the vertices' displacement"),
            ("difference to the solution after 60 steps", "-", found["difference after 60"],
             "of u, relative"),
            ("steps of `fixed_point` to 1e-6", "-", found["library's steps"],
             "of the contact points' displacement, and the law"),
        ),
        ".2g",
    )  # fmt: skip


def _figure_6_1_rows(record: Record) -> list[dict[str, Any]]:
    rows = record["rows"]
    return [row for row in rows if row["table"] == "figure 6.1" and row["n"] <= 6400]


def algorithm_4(record: Record) -> str:
    """Quadratic programs."""
    rows = [(f"{row['n']:,}", row["iterations"], f"{row['kkt']:.0e}")
            for row in _figure_6_1_rows(record)]  # fmt: skip
    table = rows_of("n | active sets, ours | residual, ours", rows)
    return f"{table}\n\n{source('qp', record, device=record['device'])}"


def figure_6_1(record: Record) -> str:
    """Quadratic programs on a device."""
    rows = []
    for row in _figure_6_1_rows(record):
        n, host = row["n"], row["host"]
        sizes = f"{n:,}", f"{row['p']} + {row['l']}"
        times = f"{row['seconds']:.4f} s", f"{host['seconds']:.4f} s", f"{host['speedup']:.3g}"
        printed = FIGURE_6_1_SPEEDUP
        end = (f"{printed:g}", f"{host['speedup'] / printed:.3g}") if n == 6400 else ("-", "-")
        rows.append((*sizes, *times, *end))
    table = rows_of("n | equations + inequalities | device, ours | host, ours | host over device "
                    "| printed | ratio", rows)  # fmt: skip
    return f"{table}\n\n{source('qp', record, device=record['device'])}"


def algorithm_5(record: Record) -> str:
    """The gain by eigenvectors, and by the default method."""
    rows = [
        (name.split("=")[-1], *(f"{row[pi]['gain error']:.1e}" for pi in ("printed", "symmetric")))
        for name, row in record["table 6.2"].items()
    ]
    best = record["default"]["N=11"]
    rows.append((f"default of `lqr`, {best['rank']} vectors", f"{best['against Newton']:.0e}", "-"))
    return rows_of("L | error, as listed | error, symmetric", rows) + "\n\n" + source("lqr", record)


def algorithm_6(record: Record) -> str:
    """Implicit restarts."""
    found = record["Algorithm 6"]
    products = found["products"]
    return beside(
        (
            ("products, restarts as listed", "-", products["implicit"], "order 400, space of 25"),
            ("products, Krylov-Schur", "-", products["krylov-schur"], "the default"),
            ("largest relative difference", "-", found["difference"], "of the ten eigenvalues"),
        ),
        ".2g",
    )


def table_6_1(record: Record) -> str:
    """Ten eigenvalues."""
    rows = []
    for n, row in record["table"].items():
        if then := row.get("dissertation"):
            pairs = ((then["four cores"], row["host"]["ours"]),
                     (then["Tesla"], row["device"]["seconds"]))  # fmt: skip
            cells = [f"{cell:.3g}" for a, b in pairs for cell in (a, b, b / a)]
            rows.append((f"{int(n):,}", *cells))
    table = rows_of("n | four cores, printed | host, ours | ratio | Tesla C2050, printed "
                    "| device, ours | ratio", rows)  # fmt: skip
    return f"{table}\n\n{source('eigs', record, device=record['device']['name'])}"


def table_6_2(record: Record) -> str:
    """Riccati gains."""
    rows = []
    for name, row in record["table 6.2"].items():
        _, N, L = (word.split("=")[-1] for word in name.split())
        then, ours = row["dissertation"], row["printed"]
        cells = (then["four cores"], then["GPU"], ours["seconds"], ours["seconds"] / then["GPU"])
        rows.append((L, f"{N}^3", *(f"{x:.3g}" for x in cells), f"{ours['gain error']:.1e}"))
    table = rows_of("L | N | four cores, printed | GPU, printed | device, ours | over the GPU "
                    "| error of the gain, ours", rows)  # fmt: skip
    return f"{table}\n\n{source('lqr', record, device=record['device']['name'])}"


def algorithm_7(record: Record) -> str:
    """Reduced equation."""
    found = record["Algorithm 7"]
    return beside((
        ("error of the gain, as listed", "-", found["printed"], '`compression="printed"`'),
        ("error of the gain, Galerkin", "-", found["galerkin"], "A and Q on the same basis"),
    ), ".1e")  # fmt: skip


def figure_a_1(record: Record) -> str:
    """The appendix."""
    checked = record["Figure A.1"]["steps checked"]
    return beside([("steps of the appendix checked", "-", checked, "on the host")])


def errata(record: Record) -> str:
    """What is printed, what is right, and the error of both where a number tells them apart."""
    rows = []
    for *texts, check in ERRATA:
        pair = record["errata"].get(check)
        found = f"{pair[0]:.2g} as printed, {pair[1]:.0e} corrected" if pair else "by reading"
        rows.append((*(text.replace("|", "\\|") for text in texts), found))
    return rows_of("where | printed | right | checked", rows)


def reproduction(record: Record) -> str:
    """Where the numbers of reproduce.json come from."""
    return source("reproduce", record, "scikit-fem", "MKL")


REPRODUCTION: dict[str, Table] = {
    **{f"table_2_{k}": transport(f"Table 2.{k}") for k in (1, 2, 3)},
    **{f"figure_2_{k}": snapshots(f"Figure 2.{k}") for k in (2, 3, 4, 7)},
    **{f"figure_{k}_1": feet(f"Figure {k}.1") for k in (2, 3)},
    "table_5_1": eigenvalues("Table 5.1", "NEUMANN"),
    "table_5_2": eigenvalues("Table 5.2", "DIRICHLET"),
    **{f"figure_5_{k}": contact(f"Figure 5.{k}") for k in (5, 6)},
    **{
        table.__name__: table
        for table in (
            *(figure_2_5, figure_2_6, figure_3_2, figure_3_3, figure_5_1, figure_5_2, figure_5_3),
            *(figure_5_4, table_5_3, table_5_4, table_6_1, table_6_2, figure_6_1, figure_a_1),
            *(algorithm_1, algorithm_2, algorithm_3, algorithm_4, algorithm_5, algorithm_6),
            *(algorithm_7, errata, reproduction),
        )
    },
}
# The files of those tables that are not in reproduce.json.
MEASURED = {
    "algorithm_4": "qp",
    "figure_6_1": "qp",
    "algorithm_5": "lqr",
    "table_6_1": "eigs",
    "table_6_2": "lqr_heat_h200",
}
FILES = dict.fromkeys(REPRODUCTION, "reproduce") | MEASURED
