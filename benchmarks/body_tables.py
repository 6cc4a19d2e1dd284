"""Tables of bodies that touch each other or rough planes, and of bodies on many processes."""

from __future__ import annotations

from markdown_table import Record, every_other, rows_of, source


def contact_pair(record: Record) -> str:
    """Two bodies with friction in units of the factorisations of both."""
    table = rows_of(
        "bodies | unknowns | factor + solve of both | contact solve | ratio "
        "| step of finite sliding, ratio",
        (
            (
                f"{row['kind']}, {row['n']} cells",
                f"{row['unknowns']:,}",
                f"{row['base']:.2f} s",
                f"{row['total']:.2f} s",
                f"**{row['ratio']:.2f}**",
                f"{row['sliding_step_over_base']:.2f}" if "sliding_step_over_base" in row else "-",
            )
            for row in record["rows"]
        ),
    )
    return f"{table}\n\n{source('contact_pair', record, 'MKL')}"


def contact_materials(record: Record) -> str:
    """Load steps of large strain beside their assemblies and factorisations."""
    table = rows_of(
        "unknowns | contact points | iterations of two steps | tangents | factors | both steps "
        "| ratio | with held factors | ratio",
        (
            (
                *(f"{row[name]:,}" for name in ("unknowns", "points", "iterations")),
                *(f"{row[name]:.2f} s" for name in ("assembly", "factor", "total")),
                f"**{row['ratio']:.2f}**",
                f"{row['chords']['total']:.2f} s",
                f"**{row['chords']['total'] / (row['assembly'] + row['factor']):.2f}**",
            )
            for row in record["rows"]
        ),
    )
    peer, said = record["felupe"], ""
    if peer is not None:
        times = peer["ours"] / peer["felupe"]
        said = f"A tangent of {peer['cells']:,} Q1 cells takes {times:.2f} times that of felupe "
        said += f"{peer['version']}. "
    return f"{table}\n\n{said}{source('contact_materials', record, 'MKL')}"


def contact_nonlinear_device(record: Record) -> str:
    """A load step of large strain on a device and on its host."""
    names = "tangent", "factor", "certificate", "step"
    table = rows_of(
        "unknowns | contact points | on | iterations | tangents | factors | certificate | step",
        (
            (
                *(f"{row[name]:,}" for name in ("unknowns", "points")),
                row["device"],
                str(row["iterations"]),
                *(f"{row[name]:.2f} s" for name in names),
            )
            for row in record["rows"]
        ),
    )
    said = f"The host takes {record['factoriser']} and all its cores. "
    said += source("contact_nonlinear_device", record, device=record["device"])
    return f"{table}\n\n{said}"


def contact_derivatives(record: Record) -> str:
    """Gradients over solutions, histories and steps; heat over mechanics."""
    one, past, far = (record[name] for name in ("gradients", "history", "sliding"))
    solve = f"a solution with its factorisation, {one['unknowns']:,} unknowns"
    steps = f"{past['steps']} steps with friction, {past['n']} x {past['n']} cells"
    parts = "loads, supports, friction, gap, motions"
    lines = [
        (f"gradient by {parts}", solve, f"**{one['gradient_over_solve']:.3f}**"),
        ("the same and by moduli", solve, f"{one['moduli_over_solve']:.3f}"),
        ("the same and by vertices", solve, f"{one['vertices_over_solve']:.2f}"),
        ("difference by one number", solve, f"{one['difference_over_solve']:.2f}"),
        ("gradient of a history", steps, f"**{past['backward_over_run']:.2f}**"),
        ("the same with checkpoints", steps, f"{past['checkpoints_over_run']:.2f}"),
        ("gradient of steps of finite sliding", "these steps", f"{far['backward_over_run']:.2f}"),
        *(
            (
                f"heat and contact, conductance within {heat['width']:g}, "
                f"{heat['iterations']} iterations",
                "a contact solve with factors that exist",
                f"{heat['ratio']:.0f}",
            )
            for heat in record["heat"]
        ),
    ]
    table = rows_of("what | over | ratio of processor time", lines)
    return f"{table}\n\n{source('contact_derivatives', record, 'MKL')}"


def distributed(record: Record) -> str:
    """Contact and systems on one and two processes."""
    rows = record["rows"]
    lines = []
    for name, kind in (
        ("Coulomb block in the plane, MUMPS", "block"),
        ("brick under its weight, multigrid", "brick"),
        ("brick on a ball with friction, multigrid", "million"),
    ):
        for row in rows[kind]:
            seconds = row["solve" if kind == "million" else "total"]
            lines.append(
                (
                    name,
                    f"{row['unknowns']:,.0f}",
                    f"{row['processes']:.0f}",
                    f"{seconds:.1f} s",
                    f"**{seconds / row['base']:.2f}**" if kind == "block" else "-",
                    f"{row['memory']:.1f} GB",
                )
            )
    table = rows_of(
        "problem | unknowns | processes | solve | over factor + solve | memory of all", lines
    )
    return f"{table}\n\n{source('distributed', record)}"


def rough_layers(record: Record) -> str:
    """Contact of a rough plane with blocks of layers, by transforms: cubes of bricks, 2-D Adini."""
    lines, ends = [], []
    for where in (place for place in ("cuda", "cpu") if place in record):
        found = record[where]
        runs: dict[tuple[int, int], list[Record]] = {}
        for row in found["rows"]:
            runs.setdefault((row.get("dim", 3), row["n"]), []).append(row)
        for dim in (2, 3):
            sizes = [n for of, n in runs if of == dim]
            for n in sizes if dim == 2 else every_other(sizes):
                smooth, rubbing = sorted(runs[dim, n], key=lambda row: row["friction"])
                lines.append(
                    (
                        "device" if where == "cuda" else "NumPy",
                        f"{n}^{dim}" + (" Adini" if dim == 2 else ""),
                        f"{smooth['unknowns']:,}",
                        f"{smooth['condense']:.2f} s",
                        *(f"{row['contact']:.2f} s" for row in (smooth, rubbing)),
                        f"{rubbing['memory']:.2g} GB" if "memory" in rubbing else "-",
                    )
                )
        more = {"device": found["device"]} if where == "cuda" else {}
        ends.append(source("rough_layers", found, **more))
    table = rows_of(
        "where | cells | unknowns | condensation | contact | with friction | memory", lines
    )
    return "\n\n".join((table, *ends))


def rough_peers(record: Record) -> str:
    """A rough surface on a half space beside tamaas and Polonsky-Keer, at equal accuracy."""
    names = [name for name in record["rows"][0] if name not in ("n", "area", "ours, one core")]
    goal = list(record["rows"][0]["ours"])[-1]
    lines = [
        (
            f"{row['n']} x {row['n']}",
            *(f"{row[name][goal]['seconds']:.2f} s" for name in names),
            f"**{row['tamaas'][goal]['seconds'] / row['ours'][goal]['seconds']:.2f}**",
        )
        for row in record["rows"]
    ]
    table = rows_of(f"points | {' | '.join(names)} | tamaas over ours", lines)
    end = f"Error of the pressure {goal}; tamaas {record['peers']['tamaas']}."
    return f"{table}\n\n{end} {source('rough_peers', record)}"


def contact_dynamics(record: Record) -> str:
    """Steps with inertia beside the substitution and the factorisation that they need."""
    costs = [
        (
            f"{row['unknowns']:,}",
            f"{row['friction']:.1f}",
            *(f"{1e3 * row[name]:.1f} ms" for name in ("solve_s", "boundary_s", "step_s")),
            f"**{row['step_over_one_solution_and_boundary']:.2f}**",
            f"{row['hundred_steps_over_factor']:.1f}",
        )
        for row in record["cost"]
    ]
    header = (
        "unknowns | friction | forward and backward substitution | boundary problem | step "
        "| step over these two | 100 steps over a factorisation"
    )
    balls = [
        (
            f"{row['reach']:.3g}",
            f"{row['unknowns']:,}",
            *(f"{row[name]:.4f}" for name in ("duration", "force")),
            *(f"{row['quasistatic_' + name]:.4f}" for name in ("duration", "force")),
        )
        for row in (record["fine_ball"], *record["ball"])
    ]
    impact = rows_of(
        "a / R | unknowns | duration | force | duration by its static compliance | force by it",
        balls,
    )
    end = (
        "Impact of a ball, over Hertz' theory: the difference is of the order "
        f"{record['ball_order_duration']:.2f} (duration) and {record['ball_order_force']:.2f} "
        "(force) in a / R. A mass on the static compliance of the same ball differs as much."
    )
    return "\n\n".join(
        (rows_of(header, costs), impact, f"{end} {source('contact_dynamics', record, 'MKL')}")
    )


def contact_device(record: Record) -> str:
    """Meshed bodies on a device, and on its host where they were solved there too."""
    names = {"adini": "Adini rectangles", "hex1": "trilinear bricks", "part": "P2 tetrahedra"}
    sizes: dict[tuple[str, int], list[Record]] = {}
    for row in record["rows"]:
        if "history" not in row:
            sizes.setdefault((row["body"], row["n"]), []).append(row)
    lines = []
    for (body, n), rows in sizes.items():
        found = {(row["device"], row["deterministic"]): row for row in rows}
        quick = found["cuda", False]
        others = [found.get(way) for way in (("cuda", True), ("cpu", False))]
        lines.append(
            (
                f"{names[body]}, {n}",
                f"{quick['unknowns']:,}",
                *("-" if row is None else f"{row['total']:.2g} s" for row in (quick, *others)),
                f"**{quick['speedup']:.1f}**" if "speedup" in quick else "-",
            )
        )
    table = rows_of(
        f"body | unknowns | device | device, same bits each time | host, {record['host solver']} "
        "| host over device",
        lines,
    )
    notes = [
        f"{row['history']} load steps of {names[row['body']]}, {row['n']}, take "
        f"{row['cold solves']:.1f} cold solves."
        for row in record["rows"]
        if "history" in row
    ]
    notes.append(source("contact_device", record, device=record["device"]))
    return f"{table}\n\n{' '.join(notes)}"


def contact_gpus(record: Record) -> str:
    """A cube whose factors several GPUs share."""
    table = rows_of(
        "trilinear bricks | unknowns | GPUs | factors of one, up to | condensation | contact",
        (
            (
                f"{row['n']}^3",
                f"{row['unknowns']:,}",
                f"{row['gpus']}",
                f"{max(row['factor GB']):.2g} GB",
                f"{row['condensation']:.1f} s",
                f"{row['contact']:.1f} s",
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
