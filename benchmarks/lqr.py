"""Riccati gains of the heat equation: Table 6.2 with accuracy, the default method, peers.

Table 6.2 of the dissertation: the gain by L eigenvectors of the inverse Hamiltonian (Algorithm 5)
with dense matrices of N^3 modes. New beside the seconds: the error of the gain against a gain of
1e-11, the loss of cost, and the slowest pole of the closed loop. Then the default method on the
same problems and with 64^3 modes, and sparse problems of a scikit-fem model beside pyMOR's RADI.

    python benchmarks/lqr.py --dense 11 --modal 11 16 21 64 --sparse 2 3 4
    python benchmarks/lqr.py --device --dense 11 16 21        (CuPy, on one GPU)
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe

from gpu import lqr
from gpu.riccati.methods.hamiltonian import solve as algorithm5
from gpu.riccati.methods.reduced import solve as reduced
from gpu.riccati.problem.lqr_problem import check_lqr

ROOT = Path(__file__).parents[1]
# Seconds of Table 6.2, four cores and one GPU (GeForce GT 640M LE), by L and N.
DISSERTATION = {
    (50, 11): (1.316, 1.148),
    (50, 16): (13.804, 5.479),
    (50, 21): (74.870, 15.899),
    (100, 11): (1.297, 1.249),
    (100, 16): (12.924, 5.229),
    (100, 21): (69.210, 14.706),
    (200, 11): (3.327, 4.226),
    (200, 16): (26.838, 12.095),
    (200, 21): (138.537, 30.806),
}


def example(name: str) -> Any:
    """A module of examples/."""
    sys.path.insert(0, str(ROOT / "examples"))
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


heat_modes = example("heat_model").heat_modes


def timed(work: Callable[[], Any], cp: Any = None, repeats: int = 3) -> tuple[float, float, Any]:
    """Median seconds after one run to warm up, of clock and processor, and the result.

    Where a run is long there are fewer. With one BLAS thread a machine that others use adds to the
    clock, not to the processor's seconds.
    """
    wait = cp.cuda.get_current_stream().synchronize if cp else lambda: None
    taken: list[float] = []
    busy: list[float] = []
    for run in range(repeats + 1):
        wait()
        begin, used = time.perf_counter(), time.process_time()
        result = work()
        wait()
        spent, used = time.perf_counter() - begin, time.process_time() - used
        if run > 0 or spent > 10.0:
            taken.append(spent)
            busy.append(used)
        if sum(taken) > 10.0:
            break
    return float(np.median(taken)), float(np.median(busy)), result


def quality(A: np.ndarray, B: np.ndarray, K: np.ndarray, best: np.ndarray) -> dict[str, float]:
    """Error of the gain, slowest pole, and the loss of cost, of a diagonal A and R = 1.

    The cost of K exceeds the least by the integral of |(K - K*) x|^2: for the gains of this table
    the worst initial state of unit norm, by the trace of that Gramian, bounded by its energy.
    """
    modes = np.argsort(-A)[:400]  # the rest decays at once and is not fed back
    loop = np.diag(A[modes]) - B[modes] @ K[:, modes]
    poles, vectors = np.linalg.eig(loop)
    D = (K - best)[:, modes] @ vectors
    gram = -(D.conj().T @ D) / (poles.conj()[:, None] + poles)
    inverse = np.linalg.inv(vectors)
    loss = (inverse.conj().T @ gram @ inverse).real
    value = 1 / abs(poles.real).min()
    return {
        "gain error": float(np.linalg.norm(K - best) / np.linalg.norm(best)),
        "slowest pole": float(poles.real.max()),
        "worst cost loss": float(np.linalg.eigvalsh((loss + loss.T) / 2).max()),
        "time scale": float(value),
    }


def table(N: int, L: int, dense: bool, cp: Any) -> dict[str, Any]:
    """Algorithm 5, printed and symmetric, on N^3 modes."""
    A, B = heat_modes(N)
    best = reduced(check_lqr(A, B, 1.0, np.eye(2))).gain
    move = cp.asarray if cp else np.asarray
    problem = check_lqr(move(np.diag(A) if dense else A), move(B), 1.0, np.eye(2))
    row: dict[str, Any] = {}
    for pi in ("printed", "symmetric"):
        seconds, used, found = timed(lambda pi=pi: algorithm5(problem, modes=L, pi=pi), cp)
        K = found.gain.get() if cp else found.gain
        row[pi] = {
            "seconds": seconds,
            "processor seconds": used,
            **found.info,
            **quality(A, B, K, best),
        }
    row["dissertation"] = dict(
        zip(("four cores", "GPU"), DISSERTATION.get((L, N), ()), strict=False)
    )
    return row


def default(N: int) -> dict[str, Any]:
    """The default method on N^3 modes, beside a Newton step that shares no projection of Q."""
    A, B = heat_modes(N)
    seconds, used, found = timed(lambda: reduced(check_lqr(A, B, 1.0, np.eye(2))))
    tighter = reduced(check_lqr(A, B, 1.0, np.eye(2)), tol=1e-13 if N < 40 else 1e-12)
    size = np.linalg.norm(tighter.gain)
    certified, used_in_all, result = timed(lambda: lqr(A, B, 1.0, np.eye(2)))
    info = {key: value for key, value in found.info.items() if key != "history"}
    row = {
        "states": N**3,
        "seconds": seconds,
        "processor seconds": used,
        **info,
        "seconds with certificate and poles": certified,
        "processor seconds with certificate and poles": used_in_all,
        "proved stable": result.stable and result.bound <= 0.0,
        "slowest pole": result.abscissa,
        "self-consistency": float(np.linalg.norm(found.gain - tighter.gain) / size),
    }
    if N <= 21:
        newton = reduced(check_lqr(A, B, 1.0, np.eye(2)), refine=True).gain
        row["against Newton"] = float(np.linalg.norm(found.gain - newton) / size)
    return row


def main() -> None:
    """Run, print, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dense", type=int, nargs="*", default=[11], help="N, dense A")
    parser.add_argument("--diagonal", type=int, nargs="*", default=[], help="N, diagonal A")
    parser.add_argument("--modes", type=int, nargs="+", default=[50, 100, 200])
    parser.add_argument("--modal", type=int, nargs="*", default=[], help="N, default method")
    parser.add_argument("--sparse", type=int, nargs="*", default=[], help="refinements")
    parser.add_argument("--rail", type=int, nargs="*", default=[], help="nodes along a side")
    parser.add_argument("--device", action="store_true")
    parser.add_argument(
        "--output", type=Path, default=Path(__file__).parent / "results" / "lqr.json"
    )
    options = parser.parse_args()
    cp = None
    result: dict[str, Any] = {
        "machine": describe(),
        "BLAS threads": os.environ.get("OPENBLAS_NUM_THREADS", "all"),
    }
    if options.device:
        import cupy as cp  # type: ignore[no-redef]

        name = cp.cuda.runtime.getDeviceProperties(0)["name"].decode()
        result["device"] = {"name": name, "cupy": cp.__version__}
    result["table 6.2"] = {}

    def write(key: str, name: str, row: dict[str, Any]) -> None:
        result.setdefault(key, {})[name] = row
        print(key, name, json.dumps(row, default=float), flush=True)
        options.output.write_text(json.dumps(result, indent=1, default=float) + "\n")

    for kind, sizes in (("dense", options.dense), ("diagonal", options.diagonal)):
        for N in sizes:
            for L in options.modes:
                write("table 6.2", f"{kind} N={N} L={L}", table(N, L, kind == "dense", cp))
                if cp:
                    cp.get_default_memory_pool().free_all_blocks()
    for N in options.modal:
        write("default", f"N={N}", default(N))
    for refine in options.sparse:
        from lqr_sparse import model, sparse_row  # needs scikit-fem, which may be missing

        write("sparse", f"refine={refine}", sparse_row(*model(refine)))
    for nodes in options.rail:
        from lqr_sparse import rail, sparse_row

        write("sparse", f"rail of {nodes**2}", sparse_row(*rail(nodes)))


if __name__ == "__main__":
    main()
