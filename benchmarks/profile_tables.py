"""Tables of `cip_profiles` and `cip_tracers`; `performance_tables.py` writes them."""

from __future__ import annotations

from markdown_table import Record, rows_of, source

CASES = ("line", "rotation", "zalesak", "swirl", "deformation", "space")


def _name(row: Record) -> str:
    names = {"splines": "SciPy's cubic splines", "WENO5": "WENO5, SSP-RK3"}
    name = names.get(row["profile"], f"`{row['profile']}`")
    return name if row["limiter"] is None else f"{name}, `{row['limiter']}`"


def cip_profiles(record: Record) -> str:
    """The error of every profile and limiter in every flow."""
    names = list(dict.fromkeys(_name(row) for case in CASES for row in record[case]["rows"]))
    found = {
        (case, _name(row)): f"{row['error']:.2g}" for case in CASES for row in record[case]["rows"]
    }
    best = {
        case: min(record[case]["rows"], key=lambda row: row["error"])["error"] for case in CASES
    }
    rows = [
        (name, *(_bold(found.get((case, name), "-"), best[case]) for case in CASES))
        for name in names
    ]
    head = "profile, limiter | " + " | ".join(
        f"{case}, {record[case]['cells']}^{3 if case == 'space' else 1 if case == 'line' else 2}"
        for case in CASES
    )
    return f"{rows_of(head, rows)}\n\n{source('cip_profiles', record, 'scipy')}"


def _bold(text: str, best: float) -> str:
    return f"**{text}**" if text == f"{best:.2g}" else text


def cip_profile_costs(record: Record) -> str:
    """Cost, change of the integral and extrema in the swirl and in space."""
    rows = [
        (
            _name(row), "-" if row["profile"] == "WENO5" else f"{row['cost']:.1f}",
            f"{row['mass']:.0e}", f"{row['least']:.2f}", f"{row['largest']:.2f}",
            *(_in_space(record, row)),
        )
        for row in record["swirl"]["rows"]
    ]  # fmt: skip
    head = "swirl: profile, limiter | cost | mass | least | largest | space: cost | mass"
    return f"{rows_of(head, rows)}\n\n{source('cip_profiles', record, 'scipy')}"


def _in_space(record: Record, row: Record) -> tuple[str, str]:
    for one in record["space"]["rows"]:
        if _name(one) == _name(row) and row["profile"] != "WENO5":
            return f"{one['cost']:.1f}", f"{one['mass']:.0e}"
    return "-", "-"


def cip_profile_orders(record: Record) -> str:
    """Errors against the flow map with and without shear, and when only the step changes."""
    cells = {(row["cells"], row["steps"]) for row in record["orders"]}
    found = {
        (row["flow"], row["profile"], row["cells"], row["steps"]): f"{row['error']:.1e}"
        for row in record["orders"]
    }
    columns = sorted(cells)
    rows = [
        (flow, f"`{profile}`", *(found[flow, profile, *column] for column in columns))
        for flow in ("shear", "none")
        for profile in ("bicubic", "csl4")
    ]
    head = "shear | profile | " + " | ".join(f"{n}^2, {steps} steps" for n, steps in columns)
    return f"{rows_of(head, rows)}\n\n{source('cip_profiles', record)}"


def cip_areas(record: Record) -> str:
    """The change of areas inside level sets."""
    titles = {"zalesak": "Zalesak's disk, one turn", "vortex": "vortex in a box, T = 8"}
    rows = [
        (
            titles[row["case"]], f"{row['cells']}^2", f"`{row['profile']}`",
            f"{100 * row['change']:.2f} %",
        )
        for row in record["areas"]
    ]  # fmt: skip
    head = "level set | cells | profile | change of the area"
    return f"{rows_of(head, rows)}\n\n{source('cip_profiles', record)}"


def cip_cited(record: Record) -> str:
    """Errors beside those that others have published."""
    titles = {"bell": "cosine bell on the sphere", "vortex": "circle in a vortex, T = 15"}
    rows: dict[tuple[str, ...], list[str]] = {}
    for row in record["rows"]:
        n = row["cells"]
        cells = f"{2 * n} x {n}" if row["case"] == "bell" else f"{n}^2"
        steps = "" if row["steps"] is None else str(row["steps"])
        key = titles[row["case"]], cells, row["scheme"], steps
        rows.setdefault(key, []).append(f"{row['error']:.1e}")
    head = "test | cells | scheme | steps | error"
    shown = [(*key, " / ".join(errors)) for key, errors in rows.items()]
    return f"{rows_of(head, shown)}\n\n{source('cip_cited', record)}"


def cip_tracers(record: Record) -> str:
    """What a further tracer costs."""
    rows = [
        (
            f"`{row['profile']}`", row["velocity"], f"{row['second']:.2f}",
            f"{row['each_of_five']:.2f}",
        )
        for row in record["rows"]
    ]  # fmt: skip
    head = "profile | velocity | second tracer | each of four more"
    cells = record["rows"][0]["cells"]
    table = rows_of(head, rows)
    return f"{table}\n\nIn times of the first, {cells}^2 nodes.\n\n{source('cip_tracers', record)}"


def cip_steps(record: Record) -> str:
    """What a step costs by where its velocity comes from."""
    found = {(row["profile"], row["velocity"]): row for row in record["rows"]}
    profiles, kinds = (dict.fromkeys(key[q] for key in found) for q in (0, 1))
    rows = [
        (
            f"`{profile}`", *(f"{found[profile, kind]['splines']:.2f}" for kind in kinds),
            f"{found[profile, 'winds, degree 5']['of_formula']:.2f}",
        )
        for profile in profiles
    ]  # fmt: skip
    table = rows_of(" | ".join(("a step", *kinds, "winds of degree 5 / formula")), rows)
    cells = record["rows"][0]["cells"]
    return (
        f"{table}\n\nA step of {cells}^2 nodes over a cell in times of SciPy's cubic spline with "
        "prefilter at as many points, winds from 11 snapshots; steady velocities keep their feet."
        f"\n\n{source('cip_tracers', record)}"
    )
