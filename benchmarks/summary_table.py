"""The table at the head of the performance page: what, against whom, how many times as fast."""

from __future__ import annotations

import json
from pathlib import Path

from markdown_table import Record, rows_of

RESULTS = Path(__file__).parent / "results"


def read(name: str) -> Record:
    """Results of a script."""
    return json.loads((RESULTS / f"{name}.json").read_text())


def span(ratios: list[float]) -> str:
    """The least and the largest of some ratios."""
    ends = min(ratios), max(ratios)
    low, high = (f"{r:.2f}" if r < 2 else f"{r:.{int(r < 10)}f}" for r in ends)
    return low if low == high else f"{low} to {high}"


def summary(contact_block: Record) -> str:
    """One row a kind of work, each from the results of the script that its last column names."""
    blocks = contact_block["rows"]
    peers = blocks[0]["peers"].items()
    rough = read("rough_peers")["rows"]
    steps = [row for row in read("cip_tracers")["rows"] if row["velocity"] == "steady"]
    qp = {row["case"]: row["microseconds"] for row in read("qp_small")["rows"]}["n = 50, 3n rows"]
    dense = [row for row in read("qp_device_peers")["rows"] if "device_peers" in row]
    models = [row for row in read("lqr")["sparse"].values() if "pymor" in row]
    faster = [
        (
            "frictionless contact",
            "OSQP, PIQP, Clarabel, a matrix factored anew",
            [rival["over_ours"] for name, rival in peers if "frictionless" in name],
            "contact_block",
        ),
        (
            "rough contact by transforms",
            "tamaas, one core",
            [
                row["tamaas"]["1e-08"]["seconds"] / row["ours, one core"]["1e-08"]["seconds"]
                for row in rough
            ],
            "rough_peers",
        ),
        (
            "contact of meshed bodies, H200",
            "the same on its host",
            [row["speedup"] for row in read("contact_device")["rows"] if "speedup" in row],
            "contact_device",
        ),
        (
            "matrices of equal cells",
            "scikit-fem",
            [row["ratio"] for row in read("assembly")["matrices"]],
            "assembly",
        ),
        (
            "step of transport, feet kept",
            "SciPy's cubic spline",
            [1 / row["splines"] for row in steps if row["profile"] in ("adini", "bicubic")],
            "cip_tracers",
        ),
        (
            "dense quadratic program, n = 50",
            "quadprog, DAQP, PIQP",
            [qp[peer] / qp["ours"] for peer in ("quadprog", "daqp", "piqp")],
            "qp_small",
        ),
        (
            "large dense quadratic program, H200",
            "qpax, jaxopt.OSQP",
            [
                rival["seconds"] / row["seconds"]
                for row in dense
                for rival in row["device_peers"].values()
            ],
            "qp",
        ),
        (
            "regulator of a scikit-fem model",
            "pyMOR",
            [row["pymor"]["seconds"] / row["seconds"] for row in models],
            "lqr",
        ),
    ]
    whole = span([row["ratio"] for row in blocks if row["solver"] == "pardiso"])
    first = (
        "contact with friction, with its certificate",
        "one factorisation and solution alone",
        f"**{whole}** times its time",
        "`python benchmarks/contact_block.py`",
    )
    others = (
        (what, whom, f"**{span(ratios)}** times as fast", f"`python benchmarks/{script}.py`")
        for what, whom, ratios, script in faster
    )
    return rows_of("what | against | ratio | measured by", (first, *others))
