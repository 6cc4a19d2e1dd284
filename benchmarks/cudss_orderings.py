"""Orders of elimination for cuDSS, and its factors on the host: fill, seconds, memory.

Matrices are those of `contact_device`: a block of n x n Adini rectangles and a cube of n^3 bricks,
condensed to what contact touches. Orders: cuDSS's own, and a geometric nested dissection of the
mesh, handed over. Seconds are those of a second run in the process.

    python benchmarks/cudss_orderings.py --adini 256 512 --hex1 24 40
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from contact_device import adini, hex1
from machine import describe
from scipy import sparse

from contact.condensation.elimination_order import elimination_order
from skfem_adini.solvers.cudss_library import device_arrays
from skfem_adini.solvers.cudss_schur import CudssSchur


def inner_problem(problem: Any) -> tuple[Any, Any, Any]:
    """Stiffness of the free unknowns, those to keep, and a dissection that ends with them."""
    part = problem.condense("cuda").parts[0]
    S = sparse.csr_array(part._P.T @ problem.body.stiffness @ part._P)
    S.sort_indices()
    order, kept = elimination_order(problem.body), part._boundary
    return S, kept, np.concatenate([order[~np.isin(order, kept)], kept])


def measure(S: Any, kept: Any, **options: Any) -> tuple[dict[str, Any], Any]:
    """Seconds of factors and complement, and of the same with other values."""
    xp = device_arrays()
    CudssSchur(S, kept, **options)
    xp.cuda.Device().synchronize()
    begin = time.perf_counter()
    factors = CudssSchur(S, kept, **options)
    xp.cuda.Device().synchronize()
    ready = time.perf_counter()
    factors.refactor(S)
    xp.cuda.Device().synchronize()
    again = time.perf_counter()
    return {"factor": ready - begin, "refactor": again - ready, **factors.statistics()}, factors


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/cudss_orderings.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--adini", type=int, nargs="*", default=[256, 512])
    parser.add_argument("--hex1", type=int, nargs="*", default=[24, 40])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    name = device_arrays().cuda.runtime.getDeviceProperties(0)["name"]
    record: dict[str, Any] = {
        "benchmark": "cudss_orderings", "machine": describe(),
        "device": name.decode() if isinstance(name, bytes) else str(name), "rows": [],
    }  # fmt: skip
    options.output.mkdir(parents=True, exist_ok=True)
    for pose, sizes in ((adini, options.adini), (hex1, options.hex1)):
        for n in sizes:
            S, kept, order = inner_problem(pose(n))
            ways = {"own": {}, "dissection": {"order": order}, "hybrid": {"hybrid_memory": True}}
            first = None
            for way, chosen in ways.items():
                row, factors = measure(S, kept, **chosen)
                first = factors.complement if first is None else first
                row["difference"] = float(abs(factors.complement - first).max() / abs(first).max())
                row |= {"body": pose.__name__, "n": n, "unknowns": S.shape[0], "kept": kept.size}
                record["rows"].append(row | {"way": way})
                print(record["rows"][-1], flush=True)
            text = json.dumps(record, indent=1) + "\n"
            (options.output / "cudss_orderings.json").write_text(text)
    return record


if __name__ == "__main__":
    main()
