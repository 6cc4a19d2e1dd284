"""Dense Riccati equations by doubling on one GPU: seconds, residuals, errors against exact ones.

The heat equation of the dissertation's section 6.2 with N^3 modes, its diagonal matrix made dense
by a reflection, and the circulant example of the benchmark collection with its exact solution.
Beside the seconds: those of the products that the doubling consists of, at the speed of one
product measured in the same run.

    python benchmarks/lqr_device.py --heat 11 21 --circulant 4096     (CuPy)
    python benchmarks/lqr_device.py --host --heat 8 --circulant 512
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe

from gpu import lqr
from gpu.riccati.methods.doubling import double
from gpu.riccati.methods.reduced import solve as reduced
from gpu.riccati.problem.lqr_problem import balance, check_lqr, scaled_hamiltonian

ROOT = Path(__file__).parents[1]


def load(path: Path) -> Any:
    """A module by its file."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def timed(work: Callable[[], Any], xp: Any) -> tuple[float, Any]:
    """Seconds of one run, the device waited for."""
    wait = (lambda: None) if xp is np else xp.cuda.get_current_stream().synchronize
    wait()
    begin = time.perf_counter()
    result = work()
    wait()
    return time.perf_counter() - begin, result


def reflected_heat(N: int) -> tuple[Any, Any, Any, Any, np.ndarray]:
    """Diagonal and input of the heat equation, the same seen through I - 2 v v^T, and v."""
    D, B = load(ROOT / "examples" / "heat_model.py").heat_modes(N)
    v = np.random.default_rng(0).standard_normal(len(D))
    v /= np.linalg.norm(v)
    w = D * v
    A = 4 * (v @ w) * np.outer(v, v) - 2 * np.outer(v, w)
    A -= 2 * np.outer(w, v)
    A[np.arange(len(D)), np.arange(len(D))] += D
    return D, B, A, B - 2 * np.outer(v, v @ B), v


def warm(A: Any, B: Any, few: int, xp: Any) -> tuple[Any, Any]:
    """A stable part of the problem, of ``few`` states."""
    shift = xp.abs(A[:few, :few]).sum(axis=1).max()
    return A[:few, :few] - shift * xp.eye(few), B[:few, : min(few, B.shape[1])].copy()


def measure(A: Any, B: Any, xp: Any) -> tuple[dict[str, Any], Any]:
    """Doubling alone, then `lqr` with certificate and poles."""
    problem = check_lqr(A, B, 1.0, None)
    standard = problem.standard()
    blocks: Any = scaled_hamiltonian(standard, balance(standard))
    if xp is not np:
        double(*(M[:256, :256].copy() for M in blocks))  # libraries and kernels are loaded
    alone, iterations = timed(lambda: double(*blocks).iterations, xp)
    del standard, problem
    blocks = None
    if xp is not np:
        xp.get_default_memory_pool().free_all_blocks()
    n, few = len(A), min(len(A), 1600)
    # Kernels are compiled once: for a smaller problem of the same kind.
    first, _ = timed(lambda: lqr(*warm(A, B, few, xp), 1.0, None, fallback=False), xp)
    whole, result = timed(lambda: lqr(A, B, 1.0, None, fallback=False), xp)
    product, _ = timed(lambda: A @ A, xp)
    flop = (16 + 2 / 3) * n**3 * iterations
    return {
        "states": n,
        "iterations": iterations,
        "doubling seconds": alone,
        "lqr seconds": whole,
        "seconds of a first lqr, of at most 1600 states": first,
        "product seconds": product,
        "doubling over its products": alone / (flop / (2 * n**3) * product),
        "residual": result.residual,
        "abscissa": result.abscissa,
        "bound": result.bound,
        "stable": result.stable,
        **{key: value for key, value in result.info.items() if key != "history"},
    }, result


def main() -> None:
    """Run, print, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--heat", type=int, nargs="*", default=[11], help="N")
    parser.add_argument("--circulant", type=int, nargs="*", default=[512], help="n")
    parser.add_argument("--host", action="store_true")
    parser.add_argument(
        "--output", type=Path, default=ROOT / "benchmarks" / "results" / "lqr_device.json"
    )
    arguments = parser.parse_args()
    report: dict[str, Any] = {"machine": describe(), "heat": [], "circulant": []}
    if arguments.host:
        xp: Any = np
    else:
        import cupy as xp

        properties = xp.cuda.runtime.getDeviceProperties(0)
        report["device"] = properties["name"].decode()
        report["cupy"] = xp.__version__
    host = np.asarray if xp is np else xp.asnumpy
    carex = load(ROOT / "tests" / "gpu" / "carex_problems.py")
    for n in arguments.circulant:
        A, B, _, _, X = carex.example_3_2(n)
        row, result = measure(xp.asarray(A), xp.asarray(B), xp)
        row["error"] = float(np.linalg.norm(host(result.S) - X) / np.linalg.norm(X))
        report["circulant"].append(row)
        print("circulant", row, flush=True)
    for N in arguments.heat:
        D, B, A, reflected, v = reflected_heat(N)
        exact = reduced(check_lqr(D, B, 1.0, None), tol=1e-13).gain
        row, result = measure(xp.asarray(A), xp.asarray(reflected), xp)
        K = host(result.K)
        K = K - 2 * np.outer(K @ v, v)
        row["gain against the modal method"] = float(
            np.linalg.norm(K - exact) / np.linalg.norm(exact)
        )
        report["heat"].append(row)
        print("heat", row, flush=True)
        del result
        if xp is not np:
            xp.get_default_memory_pool().free_all_blocks()
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
