"""Orders of elimination for cuDSS, and its factors on the host: fill, seconds, memory.

Matrices are those of `contact_device`: a block of n x n Adini rectangles, a cube of n^3 bricks and
a part of tetrahedra, condensed to what contact touches. Orders: cuDSS's own, and a geometric nested
dissection of the mesh, handed over with its tree, whose seconds on the host are "ordering". Seconds
are those of a second run in the process.

    python benchmarks/cudss_orderings.py --adini 256 512 --hex1 24 40 --part 14
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

from contact_device import mesh_of, posed
from machine import describe
from scipy import sparse

from contact.condensation.elimination_order import dissected, elimination_tree
from skfem_adini.solvers.cudss import CudssSchur
from skfem_adini.solvers.cudss_library import device_arrays


def inner_problem(problem: Any) -> tuple[Any, Any, Any, float]:
    """Stiffness of the free unknowns, those to keep, a dissection, and its seconds."""
    part = problem.condense("cuda").parts[0]
    S = sparse.csr_array(part._P.T @ problem.body.stiffness @ part._P)
    S.sort_indices()
    begin = time.perf_counter()
    tree = elimination_tree(dissected(problem.body), part._boundary)
    seconds = time.perf_counter() - begin
    return S, part._boundary, tree, seconds


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
    parser.add_argument("--part", type=int, nargs="*", default=[14])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    name = device_arrays().cuda.runtime.getDeviceProperties(0)["name"]
    record: dict[str, Any] = {
        "benchmark": "cudss_orderings", "machine": describe(),
        "device": name.decode() if isinstance(name, bytes) else str(name), "rows": [],
    }  # fmt: skip
    options.output.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp())
    for body in ("adini", "hex1", "part"):
        for n in getattr(options, body):
            S, kept, tree, seconds = inner_problem(posed(body, mesh_of(body, n, folder)))
            ways = {"own": {}, "dissection": {"tree": tree}, "hybrid": {"hybrid_memory": True}}
            first = None
            for way, chosen in ways.items():
                row, factors = measure(S, kept, **chosen)
                first = factors.complement if first is None else first
                row["difference"] = float(abs(factors.complement - first).max() / abs(first).max())
                row |= {"body": body, "n": n, "unknowns": S.shape[0], "kept": kept.size}
                row["ordering"] = seconds if way == "dissection" else 0.0
                record["rows"].append(row | {"way": way})
                print(record["rows"][-1], flush=True)
            text = json.dumps(record, indent=1) + "\n"
            (options.output / "cudss_orderings.json").write_text(text)
    return record


if __name__ == "__main__":
    main()
