"""Tables of bodies that touch each other or rough planes, and of bodies on many processes."""

from __future__ import annotations

from markdown_table import Record, rows_of, source


def contact_pair(record: Record) -> str:
    """Two bodies with friction in units of the factorisations of both."""
    table = rows_of(
        "bodies | unknowns | contact points | factor + solve of both | whole contact solve | ratio "
        "| next step of finite sliding",
        (
            (
                f"{row['kind']}, {row['n']} cells",
                f"{row['unknowns']:,}",
                f"{row['points']:,}",
                f"{row['base']:.2f} s",
                f"{row['total']:.2f} s",
                f"**{row['ratio']:.2f}**",
                f"{row['sliding_step_over_base']:.2f} of them"
                if "sliding_step_over_base" in row
                else "-",
            )
            for row in record["rows"]
        ),
    )
    note = f"Median of {record['repeats']} interleaved repeats, PARDISO on both sides."
    return f"{table}\n\n{note} {source('contact_pair', record, 'MKL')}"


def distributed(record: Record) -> str:
    """Contact, systems and assembly on one and two processes."""
    rows = record["rows"]
    lines = []
    for row in rows["block"]:
        lines.append(
            (
                "Coulomb block in the plane, MUMPS",
                f"{row['unknowns']:,.0f}",
                f"{row['processes']:.0f}",
                f"{row['assembly']:.1f} s",
                f"{row['total']:.1f} s",
                f"{row['total'] / row['base']:.2f} of a plain factor and solve",
                f"{row['memory']:.1f} GB",
            )
        )
    for row in rows["brick"]:
        lines.append(
            (
                "brick under its weight, multigrid",
                f"{row['unknowns']:,.0f}",
                f"{row['processes']:.0f}",
                f"{row['matrix']:.1f} s",
                f"{row['total']:.1f} s",
                f"{row['iterations']:.0f} iterations",
                f"{row['memory']:.1f} GB",
            )
        )
    for row in rows["million"]:
        lines.append(
            (
                "brick on a ball with friction, multigrid",
                f"{row['unknowns']:,.0f}",
                f"{row['processes']:.0f}",
                f"{row['body'] + row['matrices']:.0f} s",
                f"{row['solve']:.0f} s",
                f"{row['steps']:.0f} Newton steps, {row['iterations']:.0f} iterations",
                f"{row['memory']:.1f} GB",
            )
        )
    table = rows_of(
        "problem | unknowns | processes | matrices | solve | in which | memory of all", lines
    )
    faster = ", ".join(
        f"{name} {rows[task][0][key] / rows[task][1][key]:.2f}"
        for name, task, key in (
            ("assembly", "block", "matrix"),
            ("multigrid", "brick", "total"),
            ("MUMPS in the plane", "block", "base"),
        )
    )
    model = rows_of(
        "what | measured at | core seconds there | grows like | core hours at 100,000,000 "
        "| memory there",
        (
            (
                line["what"],
                f"{line['unknowns']:,.0f}",
                f"{line['core_seconds']:.0f}",
                f"n^{line['growth']:g}",
                f"{line['core_seconds_then'] / 3600:.1f}",
                f"{line['terabytes_then']:.2f} TB",
            )
            for line in record["model"]
        ),
    )
    text = (
        f"Two processes are faster than one by: {faster}. The next table is arithmetic, not a run: "
        "the figures above times the growth that nested dissection and multigrid have on paper."
    )
    return "\n\n".join((table, text, model, source("distributed", record)))


def rough_layers(record: Record) -> str:
    """Contact of a rough plane with blocks of layers, by transforms: cubes of bricks, 2-D Adini."""
    lines, ends = [], []
    for where in (place for place in ("cuda", "cpu") if place in record):
        found = record[where]
        lines += [
            (
                "device" if where == "cuda" else "NumPy",
                f"{row['n']}^{row.get('dim', 3)}" + (" Adini" if row.get("dim") == 2 else ""),
                f"{row['unknowns']:,}",
                f"{row['friction']:g}",
                f"{row['condense']:.2f} s",
                f"{row['contact']:.2f} s",
                f"{row['products']}",
                f"{row['residual']:.0e}",
                f"{row['memory']:.2g} GB" if "memory" in row else "",
            )
            for row in found["rows"]
        ]
        ends.append(_growth(found))
        more = {"device": found["device"]} if where == "cuda" else {}
        ends.append(source("rough_layers", found, **more))
    table = rows_of(
        "where | cells | unknowns | friction | condensation | contact, certified "
        "| products | residual | memory",
        lines,
    )
    return "\n\n".join((table, *filter(None, ends)))


def _growth(found: Record) -> str:
    """What twice the points and twice the layers cost."""
    grown = found.get("growth", {})
    if not {"product", "doubling"} <= set(grown):
        return ""
    over_all = grown.get("product of all sizes")
    text = (
        f"Between the two largest cubes a product grows as (n^2 log n)^{grown['product']:.2f}"
        + ("" if over_all is None else f", over all of them as (n^2 log n)^{over_all:.2f}")
        + f"; twice as many layers add {max(0.0, 1e3 * grown['doubling']):.2g} ms to condensation"
    )
    if "power of depth" not in grown:
        return text + "."
    depths = ", ".join(f"{row['rows']:,} layers {row['condense']:.2g} s" for row in found["depths"])
    n = found["depths"][0]["n"]
    return (
        f"{text}, which grows as the depth to the power {grown['power of depth']:.2f} "
        f"({n} x {n} columns: {depths})."
    )


def rough_peers(record: Record) -> str:
    """A rough surface on a half space beside tamaas, at equal accuracy, and on a thick block."""
    names = [name for name in record["rows"][0] if name not in ("n", "area")]
    goals = list(record["rows"][0]["ours"])
    lines = [
        (
            f"{row['n']} x {row['n']}",
            f"{100 * row['area']:.1f} %",
            goal,
            *(f"{row[name][goal]['seconds']:.2f} s" for name in names),
            f"**{row['tamaas'][goal]['seconds'] / row['ours'][goal]['seconds']:.2f}**",
        )
        for row in record["rows"]
        for goal in goals
    ]
    head = " | ".join(names)
    table = rows_of(f"points | contact | error of the pressure | {head} | tamaas over ours", lines)
    block = rows_of(
        "thick block of bricks beside tamaas' half space | contact area, counted | corrected "
        "| forces of 16 x 16 squares | pressure, rms",
        (
            (
                f"{row['n']}^3",
                f"{100 * row['area_off']:+.2f} %",
                f"{100 * row['corrected_off']:+.2f} %",
                f"{100 * row['force_off']:.2f} %",
                f"{100 * row['pressure_off']:.1f} %",
            )
            for row in record["block"]
        ),
    )
    power = record["orders"]
    note = (
        "Fitted powers of the spacing: "
        f"{power['area_off']:.2f} of the counted area, {power['force_off']:.2f} of the forces, "
        f"{power['pressure_off']:.2f} of the pressure. On the half space tamaas and ours count "
        "the same points in contact at every size. "
        if all(row["tamaas"][goals[-1]]["area"] == row["ours"][goals[-1]]["area"]
               for row in record["rows"])
        else ""
    )  # fmt: skip
    end = f"{note}tamaas {record['peers']['tamaas']}. " + source("rough_peers", record)
    return "\n\n".join((table, block, end))


def contact_device(record: Record) -> str:
    """Meshed bodies on a device, and on its host where they were solved there too."""
    names = {"adini": "Adini rectangles", "hex1": "trilinear bricks", "part": "P2 tetrahedra"}
    parts = ("pose", "condensation", "contact")
    table = rows_of(
        "body | unknowns | kept by condensation | where | mesh to problem | condensation "
        "| contact, certified | in all | residual",
        (
            (
                f"{names[row['body']]}, {row['n']}",
                f"{row['unknowns']:,}",
                f"{row['boundary']:,}",
                _where(row, record),
                *(f"{row['seconds'][part]:.2f} s" for part in parts),
                f"**{row['total']:.2g} s**",
                f"{row['residual']:.0e}",
            )
            for row in record["rows"]
            if "history" not in row
        ),
    )
    notes = [
        "The stiffness is assembled in the condensation, on the device if few cells differ in "
        "shape. After a first run in the process, the "
        "median of three of what was solved on the host too, one of the others."
    ]
    for row in record["rows"]:
        if "speedup" in row:
            notes.append(
                f"{names[row['body']].capitalize()}, {row['n']}: {row['speedup']:.1f} times as "
                f"fast as {record['host solver']}; the stiffness alone takes "
                f"{_assembled(row['assembly'])}."
            )
        if "history" in row:
            notes.append(
                f"{row['history']} load steps of {names[row['body']]}, {row['n']}, on one "
                f"condensation: {row['total']:.1f} s, {row['cold solves']:.1f} times a whole "
                f"solution, with residuals up to {row['residual']:.0e}."
            )
    notes.append(source("contact_device", record, device=record["device"]))
    return f"{table}\n\n{' '.join(notes)}"


def _assembled(seconds: dict[str, float]) -> str:
    """Seconds of the assembly on the host, and on the device where it is done there."""
    host = f"{seconds['cpu']:.2f} s on the host"
    return f"{seconds['cuda']:.2f} s on the device, {host}" if "cuda" in seconds else host


def _where(row: Record, record: Record) -> str:
    """Where a body was solved, and whether a repetition gave the same bits."""
    if row["device"] == "cuda":
        alike = ", the same bits twice" if row.get("identical") else ""
        return f"device{', deterministic' if row.get('deterministic') else ''}{alike}"
    return str(record["host solver"])


def contact_gpus(record: Record) -> str:
    """A cube whose factors several GPUs share."""

    def each(gigabytes: list[float]) -> str:
        return ", ".join(f"{size:.2g}" for size in gigabytes)

    table = rows_of(
        "trilinear bricks | unknowns | contact rows | GPUs | factors, GB of each GPU "
        "| at the peak | condensation | contact, certified | solutions | residual",
        (
            (
                f"{row['n']} in each direction",
                f"{row['unknowns']:,}",
                f"{row['rows']:,}",
                f"{row['gpus']}",
                each(row["factor GB"]),
                each(row["peak GB"]),
                f"{row['condensation']:.1f} s",
                f"{row['contact']:.1f} s",
                f"{row['solutions']}",
                f"{row['residual']:.0e}",
            )
            for row in record["rows"]
        ),
    )
    counts = [("one", 1), ("two", 2), ("four", 4)]
    *first, last = [word for word, n in counts if any(row["gpus"] == n for row in record["rows"])]
    cards = source(
        "contact_gpus", record, device=record["device"], count=f"{', '.join(first)} and {last}"
    )
    return f"{table}\n\n{cards}"
