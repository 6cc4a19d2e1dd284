"""Tables of `cip` and `gpu`: transport, quadratic programs, eigenvalues, regulators."""

from __future__ import annotations

from markdown_table import Record, rows_of, source


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
    return f"{table}\n\nOne core; a node of ours has all its moments. {source('cip', record)}"


def cip_device(record: Record) -> str:
    """Speed of a step on a device, beside a copy of the same bytes."""
    largest = max(row["nodes"] for row in record["kernels"])
    table = rows_of(
        "profile | numbers | feet | velocity | thousand million nodes a second "
        "| bandwidth over a copy's",
        (
            (
                row["profile"],
                row["dtype"],
                row["feet"],
                row["velocity"],
                f"{row['gnodes_per_s']:.1f}",
                f"{100 * row['of_copy']:.0f} %",
            )
            for row in record["kernels"]
            if row["nodes"] == largest
        ),
    )
    device = record["device"]["name"]
    return (
        f"{table}\n\n{largest:,} x {largest:,} nodes; a copy moves "
        f"{record['copy_tb_per_s']:.2f} TB/s. {source('cip_device', record, device=device)}"
    )


def qp(record: Record) -> str:
    """Dense quadratic programs on a device, in Cholesky factorisations."""
    rows = [
        (
            f"{row['n']:,}",
            f"{row['p']:,} + {row['l']:,}",
            f"{row['cholesky']:.3g} s",
            f"{row['seconds']:.3g} s",
            f"**{row['ratio']:.2f}**",
            f"{row['host']['speedup']:.1f}" if "host" in row else "-",
            f"{row['kkt']:.0e}",
        )
        for row in record["rows"]
    ]
    table = rows_of(
        "n | equations + inequalities | Cholesky factorisation | whole solve | ratio "
        "| times as fast as NumPy | residual",
        rows,
    )
    return f"{table}\n\n{source('qp', record, device=record['device'])}"


def qp_device_peers(record: Record) -> str:
    """The same programs by other packages on the device."""
    rows = [
        (
            f"{row['n']:,}",
            f"{row['seconds']:.3f} s",
            f"{row['errors']['primal']:.0e}",
            name,
            f"{peer['seconds']:.2f} s",
            f"{peer['seconds'] / row['seconds']:.0f}",
            f"{peer['primal']:.0e}",
        )
        for row in record["rows"]
        for name, peer in row.get("device_peers", {}).items()
    ]
    table = rows_of("n | `solve_qp` | its error | peer | time | times ours | its error", rows)
    return f"{table}\n\n{source('qp', record, device=record['device'])}"


def qp_peers(record: Record) -> str:
    """The same programs by the solvers of qpsolvers on the host."""
    names = list(record["rows"][0]["peers"])
    rows = [
        (
            f"{row['n']:,}",
            f"{1e3 * row['seconds']:.0f} ms",
            f"{1e3 * row['host']['seconds']:.0f} ms",
            *(f"{1e3 * row['peers'][name]['seconds']:.0f} ms" for name in names),
            ", ".join(f"{row['peers'][name]['distance']:.0e}" for name in names),
        )
        for row in record["rows"]
        if row.get("peers")
    ]
    peers = " | ".join(names)
    table = rows_of(f"n | ours, device | ours, host | {peers} | their distances to ours", rows)
    return f"{table}\n\n{source('qp', record, *names, device=record['device'])}"


def maros_meszaros(record: Record) -> str:
    """How many of Maros and Meszaros' problems are solved."""
    return (
        rows_of(
            "problems | solved | to 1e-9 relative | to 1e-9 absolute | limit a problem",
            [
                (
                    record["problems"],
                    record["solved"],
                    record["relative_1e-9"],
                    record["absolute_1e-9"],
                    f"{record['limit']:.0f} s",
                )
            ],
        )
        + f"\n\nOf the {record['to_1000_unknowns']} problems with up to 1,000 unknowns, "
        f"{record['to_1000_unknowns_relative_1e-9']} are solved to 1e-9 relative. "
        + source("maros_meszaros", record)
    )


def eigs(record: Record) -> str:
    """Ten eigenvalues of dense matrices on a device, one row an order."""
    rows = []
    for n, row in record["table"].items():
        host, device, then = row.get("host") or {}, row["device"], row.get("dissertation")
        arpack = [host[name] for name in ("arpack 25", "arpack 40") if host.get(name)]
        beside = [min(arpack) if arpack else None]
        beside += [then["Tesla"], then["four cores"]] if then else [None, None]
        cells = ["-" if seconds is None else f"{1e3 * seconds:.0f} ms" for seconds in beside]
        rows.append(
            (
                f"{int(n):,}",
                f"{1e3 * device['seconds']:.1f} ms",
                f"{1e3 * device['floor']:.2f} ms",
                f"{device['ratio']:.2f}",
                *cells,
            )
        )
    hard = [
        (kind, n, *(f"{1e3 * row[name]:.1f} ms" for name in ("device", "host", "arpack")))
        for n, kinds in record["kinds"].items()
        for kind, row in kinds.items()
    ]
    return "\n\n".join(
        (
            rows_of(
                "n | device | bandwidth floor | ratio | ARPACK, host | Tesla, 2012 "
                "| four cores, 2012",
                rows,
            ),
            f"The {record['k']} eigenvalues of largest modulus; the floor is the time to read the "
            "matrix once a product at the copy bandwidth measured in the run.",
            rows_of("matrices | n | device | NumPy | ARPACK", hard),
            "Six kinds, the mean of three each; ARPACK with the quicker of its spaces of 25 and "
            "40. Host times on all cores or on one, whichever is less. "
            + source("eigs", record, device="NVIDIA H200"),
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
            f"{row['self-consistency']:.0e}",
        )
        for name, row in record["default"].items()
    ]
    rows += [
        (
            f"scikit-fem model, {name}",
            f"{row['states']:,}",
            f"{row['seconds']:.2f} s",
            f"{row['pymor']['seconds']:.2f} s",
            f"{row['gain error']:.0e}",
        )
        for name, row in record["sparse"].items()
    ]
    table = rows_of("model | states | `lqr` | pyMOR | error of the gain", rows)
    end = source("lqr", record, "pymor")
    return f"{table}\n\n{record['note']} {end}"


def lqr_device(record: Record) -> str:
    """Dense regulators by doubling on a device."""
    table = rows_of(
        "model | states | `lqr` with certificate and poles | residual",
        (
            (
                model,
                f"{row['states']:,}",
                f"{row['lqr seconds']:.2f} s",
                f"{row['residual']:.0e}",
            )
            for model in ("heat", "circulant")
            for row in record[model]
        ),
    )
    return f"{table}\n\n{source('lqr_device', record, device=record['device'])}"
