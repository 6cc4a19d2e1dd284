"""Tables of `cip` and `gpu`: transport, quadratic programs, eigenvalues, regulators."""

from __future__ import annotations

from typing import Any

from markdown_table import Record, every_other, rows_of, source


def cip(record: Record) -> str:
    """Speed of a step on one core, in nodes a second."""
    speeds = record["speeds"]
    names = ("cubic 1-D", "spline 1-D", "adini", "adini float32", "bicubic", "spline 2-D")
    table = rows_of(
        "profile | million nodes a second | copy of its bytes",
        (
            (
                name.replace("spline", "SciPy's cubic spline,"),
                f"{speeds[name]:.0f}",
                f"{speeds[f'{name}, copy of its bytes']:.0f}"
                if f"{name}, copy of its bytes" in speeds
                else "-",
            )
            for name in names
        ),
    )
    note = "One core; a node of ours has all its moments."
    return f"{table}\n\n{note}\n\n{source('cip', record)}"


def cip_sphere(record: Record) -> str:
    """Errors of transport on the sphere beside cubic Lagrange interpolation."""
    cells = max(record["cells"])
    rows = []
    for test, found in record["tests"].items():
        by_scheme = found["errors"][str(cells)]
        for field in (name for name in next(iter(by_scheme.values())) if name != "one"):
            errors = (f"{by_scheme[scheme][field]['l2']:.1e}" for scheme in by_scheme)
            order = found["orders"]["csl4_spline"][field]
            rows.append((test, field, *errors, f"{order:.1f}"))
    schemes = " | ".join(by_scheme)
    table = rows_of(f"flow | field | {schemes} | order of csl4_spline", rows)
    mass = max(
        row["mass"]
        for found in record["tests"].values()
        for sizes in found["errors"].values()
        for scheme in ("csl2_spline", "csl4_spline")
        for row in sizes[scheme].values()
    )
    return (
        f"{table}\n\nRelative l2 errors after one revolution of a cosine bell about an axis that "
        "leans by 0, 45 and 90 degrees (Williamson et al. 1992), and after the flows of Nair and "
        f"Lauritzen (2010) have turned back, on {2 * cells} x {cells} cells in "
        f"{11 * cells // 10} steps; the mass of the csl splines changed by at most {mass:.0e}. "
        "The last scheme is measured on the same paths: cubic Lagrange interpolation in longitude "
        f"and latitude, as in many models.\n\n{source('cip_sphere', record)}"
    )


def cip_device(record: Record) -> str:
    """Speed of a step on a device, beside a copy of the same bytes and the arithmetic."""
    largest = max(row["nodes"] for row in record["kernels"])
    rows = [
        row for row in record["kernels"] if row["nodes"] == largest and row["dtype"] == "float64"
    ]

    def share(row: Record, key: str) -> str:
        return f"{100 * row[key]:.0f} %" if key in row else "-"

    table = rows_of(
        "profile | feet | velocity | 1e9 nodes a second | share of a copy "
        "| share of the arithmetic | second tracer over the first",
        (
            (
                *(row[key] for key in ("profile", "feet", "velocity")),
                f"{row['gnodes_per_s']:.1f}",
                *(share(row, key) for key in ("of_copy", "of_floor")),
                f"{row['second']:.2f}" if "second" in row else "-",
            )
            for row in rows
        ),
    )
    end = source("cip_device", record, device=record["device"]["name"])
    return (
        f"{table}\n\n{largest:,} x {largest:,} nodes in float64, steps of two cells; snapshots of "
        "1,024 x 1,024, in space of degree five or cubic. Copy: the bytes of moments, and of "
        "stored feet, read and written once in each kernel of the update. Arithmetic: operations "
        "of float64 in the machine code, at the measured rate of fused ones. With a velocity that "
        "depends on time the whole step is measured, with the estimate of the feet's error. "
        f"{end}"
    )


def qp(record: Record) -> str:
    """Dense quadratic programs with n/10 rows of each kind on a device, in factorisations."""
    rows = {row["n"]: row for row in reversed(record["rows"]) if row["l"] == row["n"] // 10}
    table = rows_of(
        "n | Cholesky factorisation | whole solve | ratio | times as fast as NumPy",
        (
            (
                f"{row['n']:,}",
                f"{row['cholesky']:.3g} s",
                f"{row['seconds']:.3g} s",
                f"**{row['ratio']:.2f}**",
                f"{row['host']['speedup']:.1f}" if "host" in row else "-",
            )
            for _, row in every_other(sorted(rows.items()))
        ),
    )
    return f"{table}\n\n{source('qp', record, device=record['device'])}"


def qp_device_peers(record: Record) -> str:
    """The same programs by other packages on the device."""
    table = rows_of(
        "n | `solve_qp` | peer | time | times ours | its error, ours",
        (
            (
                f"{row['n']:,}",
                f"{row['seconds']:.3f} s",
                name,
                f"{peer['seconds']:.2f} s",
                f"**{peer['seconds'] / row['seconds']:.0f}**",
                f"{peer['primal']:.0e}, {row['errors']['primal']:.0e}",
            )
            for row in record["rows"]
            for name, peer in row.get("device_peers", {}).items()
        ),
    )
    return f"{table}\n\n{source('qp', record, device=record['device'])}"


def qp_small(record: Record) -> str:
    """Small dense programs on one thread beside quadprog, daqp and PIQP; a batch on a device."""
    names = ("quadprog", "daqp", "piqp")
    table = rows_of(
        f"problem | ours, microseconds | {' | '.join(names)} | wrong answers of theirs",
        (
            (
                row["case"],
                f"{row['microseconds']['ours']:,.0f}",
                *(f"{row['microseconds'][name]:,.0f}" for name in names),
                ", ".join(f"{name} {row['wrong'][name]}" for name in names if row["wrong"][name])
                if row.get("wrong")
                else "",
            )
            for row in record["rows"]
        ),
    )
    one = record["batch"]
    batch = (
        f"A batch of {one['count']:,} with n = {one['n']} and {one['rows']} rows on one "
        f"{one['device']}: {one['seconds']:.3f} s, all certified; quadprog on the host's "
        f"{record['machine']['cores']} cores {one['quadprog']:.2f} s."
    )
    return f"{table}\n\n{batch} {source('qp_small', record, *names)}"


def qp_large(record: Record) -> str:
    """Larger programs on one thread; a peer whose answer is farther off than 1e-9 in brackets."""
    names = ("piqp", "proxsuite", "clarabel", "osqp")

    def time(row: Any, name: str) -> str:
        if name not in row["seconds"]:
            return "-"
        text = f"{1e3 * row['seconds'][name]:,.0f}"
        errors = row.get("errors", {}).get(name, {"violation": 0.0})
        return text if max(errors.values()) <= 1e-9 else f"({text})"

    table = rows_of(
        f"problem | ours, ms | {' | '.join(names)}",
        ((row["case"], *(time(row, name) for name in ("ours", *names))) for row in record["rows"]),
    )
    return f"{table}\n\n{source('qp_large', record, *names)}"


def qp_peers(record: Record) -> str:
    """The same programs by the solvers of qpsolvers on the host."""
    names = list(record["rows"][0]["peers"])
    table = rows_of(
        f"n | ours, device | ours, host | {' | '.join(names)}",
        (
            (
                f"{row['n']:,}",
                f"{1e3 * row['seconds']:.0f} ms",
                f"{1e3 * row['host']['seconds']:.0f} ms",
                *(f"{1e3 * row['peers'][name]['seconds']:.0f} ms" for name in names),
            )
            for row in record["rows"]
            if row.get("peers")
        ),
    )
    return f"{table}\n\n{source('qp', record, *names, device=record['device'])}"


def maros_meszaros(record: Record) -> str:
    """How many of Maros and Meszaros' problems are solved."""
    keys = ("problems", "solved", "relative_1e-9", "absolute_1e-9")
    table = rows_of(
        'problems | solved | to 1e-9 relative | absolute, `polish="digits"` | limit a problem',
        [(*(record[key] for key in keys), f"{record['limit']:.0f} s")],
    )
    return f"{table}\n\n{source('maros_meszaros', record)}"


def eigs(record: Record) -> str:
    """Ten eigenvalues of dense matrices on a device, one row an order, then harder kinds."""
    rows = []
    for n, row in every_other(list(record["table"].items())):
        host, device = row.get("host") or {}, row["device"]
        arpack = [host[name] for name in ("arpack 25", "arpack 40") if host.get(name)]
        rows.append(
            (
                f"{int(n):,}",
                f"{1e3 * device['seconds']:.1f} ms",
                f"{1e3 * device['floor']:.2f} ms",
                f"**{device['ratio']:.2f}**",
                f"{1e3 * min(arpack):.0f} ms" if arpack else "-",
            )
        )
    n, kinds = list(record["kinds"].items())[-1]
    hard = [
        (kind, *(f"{1e3 * row[name]:.0f} ms" for name in ("device", "host", "arpack")))
        for kind, row in kinds.items()
    ]
    return "\n\n".join(
        (
            rows_of("n | device | reading A once a product | ratio | ARPACK, host", rows),
            rows_of(f"kind of matrix, n = {n} | device | NumPy | ARPACK", hard),
            source("eigs", record, device="NVIDIA H200"),
        )
    )


def eigs_products(record: Record) -> str:
    """Products with the matrix beside ARPACK's, six kinds of matrices of order 400."""
    rows = []
    for space, found in record["against ARPACK"].items():
        kinds: dict[str, list[float]] = {}
        for name, row in found["rows"].items():
            if row["converged"] and row["arpack converged"]:
                ratio = row["products"] / row["arpack products"]
                kinds.setdefault(name.rsplit(" ", 1)[0], []).append(ratio)
        rows.append((space, f"**{found['median ratio']:.2f}**"))
        rows[-1] += tuple(f"{sum(ratios) / len(ratios):.2f}" for ratios in kinds.values())
    table = rows_of(f"space | median of all | {' | '.join(kinds)}", rows)
    return f"{table}\n\n{source('eigs', record)}"


def lqr(record: Record) -> str:
    """Regulators of a heated cube, and of a finite element model beside pyMOR."""
    rows = [
        (
            f"heated cube, {name}",
            f"{row['states']:,}",
            f"{row['seconds with certificate and poles']:.2f} s",
            "-",
            "-",
        )
        for name, row in list(record["default"].items())[-1:]
    ]
    rows += [
        (
            f"scikit-fem model, {name}",
            f"{row['states']:,}",
            f"{row['seconds']:.2f} s",
            f"{row['pymor']['seconds']:.2f} s",
            f"**{row['pymor']['seconds'] / row['seconds']:.1f}**",
        )
        for name, row in record["sparse"].items()
    ]
    table = rows_of("model | states | `lqr` | pyMOR | ratio", rows)
    return f"{table}\n\n{record['note']} {source('lqr', record, 'pymor')}"


def lqr_device(record: Record) -> str:
    """Dense regulators by doubling on a device."""
    table = rows_of(
        "model | states | `lqr` with certificate and poles",
        (
            (model, f"{row['states']:,}", f"{row['lqr seconds']:.2f} s")
            for model in ("heat", "circulant")
            for row in record[model]
        ),
    )
    return f"{table}\n\n{source('lqr_device', record, device=record['device'])}"
