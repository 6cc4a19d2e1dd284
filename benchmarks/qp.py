"""Dense quadratic programs on one GPU, in units of one Cholesky factorisation.

For P = MM'/n + 0.01 I (from n = 25600 on, a symmetric Gaussian matrix / sqrt(n) + 3 I), q, A, G
normal, b = A x0, h = G x0 + U(0, 1):

    ratio = solve_qp, from P, q, G, h, A, b on the device to the certified result there
            / one raw cuSOLVER Cholesky factorisation of P, in place,

at the sizes of Figure 6.1 of the dissertation (2012) and with A, G of n/10 rows each; beside it
the same code on the host's cores, with the host's own Cholesky rate, and the peers that can be
imported. The dissertation states no number for its figure but one: at n = 6400 a Tesla C2050 is
about three times as fast as four cores; the same quotient stands beside it here.

Two crossover points are measured: sizes under which the host is the quicker place, in `crossover`;
and, in `paths`, the seconds of the active set beside those of the interior point on one problem,
for more and more rows of G a variable.

    python benchmarks/qp.py --sizes 200 400 800 1600 3200 6400 12800 25600 51200
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe

from gpu import QPResult, solve_qp
from gpu.arrays.dense import cholesky
from gpu.qp.data.qp_problem import check_problem
from gpu.qp.interior_point.minimise import minimise

# Rows of A and G in Figure 6.1; the larger sizes continue the last ratio.
FIGURE = {400: (40, 40), 800: (80, 80), 1600: (80, 40), 3200: (160, 40), 6400: (160, 80)}
FIGURE |= {12800: (320, 160), 25600: (640, 320), 51200: (1280, 640)}
# Section 6.1 of the dissertation: GPU against four cores.
DISSERTATION_SPEEDUP = {6400: 3.0}
# Rows of G a variable where active set and interior point are compared.
CROWDED = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)
HOST_LIMIT, PEER_LIMIT, DEVICE_PEER_LIMIT = 6400, 800, 6400


def problem(n: int, p: int, l: int, xp: Any, seed: int = 0) -> tuple[Any, ...]:
    """P, q, G, h, A, b."""
    rng = xp.random.default_rng(seed)
    M = rng.standard_normal((n, n))
    if n >= 25600:
        P = M
        for i in range(0, n, 4096):  # symmetric, with no second matrix
            for j in range(0, i + 1, 4096):
                block = (P[i : i + 4096, j : j + 4096] + P[j : j + 4096, i : i + 4096].T) * (
                    0.5 / np.sqrt(n)
                )
                P[i : i + 4096, j : j + 4096] = block
                P[j : j + 4096, i : i + 4096] = block.T
        k = xp.arange(n)
        P[k, k] += 3.0
    else:
        P = M @ M.T / n
        P = (P + P.T) / 2
        P[xp.arange(n), xp.arange(n)] += 0.01
    A, G = rng.standard_normal((p, n)), rng.standard_normal((l, n))
    q, x0 = rng.standard_normal(n), rng.standard_normal(n)
    return P, q, G, G @ x0 + rng.random(l), A, A @ x0


def errors(data: tuple[Any, ...], result: QPResult) -> dict[str, float]:
    """Relative residuals by the benchmark's own formulas."""
    P, q, G, h, A, b = data
    x, Px = result.x, P @ result.x
    force = Px + q + A.T @ result.y + G.T @ result.z
    scale = max(float(abs(v).max()) for v in (Px, q, A.T @ result.y, G.T @ result.z))
    rows = max(float(abs(A @ x - b).max()), float((G @ x - h).max()), 0.0)
    gap = float(x @ Px + q @ x + result.y @ b + result.z @ h)
    terms = max(abs(float(v)) for v in (x @ Px, q @ x, result.y @ b, result.z @ h))
    return {
        "dual": float(abs(force).max()) / scale,
        "primal": rows / max(float(abs(b).max()), float(abs(h).max())),
        "gap": abs(gap) / terms,
    }


def timed(run: Callable[[], Any], wait: Callable[[], None], repeats: int) -> tuple[float, Any]:
    """Least seconds of some repeats after a warm-up, and the last value."""
    value, best = run(), np.inf
    for _ in range(repeats):
        wait()
        begin = time.perf_counter()
        value = run()
        wait()
        best = min(best, time.perf_counter() - begin)
    return best, value


def raw_cholesky(P: Any, wait: Callable[[], None], repeats: int) -> float:
    """Seconds of one factorisation in place, the copy before it not counted."""
    best = np.inf
    for _ in range(repeats + 1):
        M = P.copy()
        wait()
        begin = time.perf_counter()
        cholesky(M)
        wait()
        best = min(best, time.perf_counter() - begin)
        del M
    return best


def peers(data: tuple[Any, ...], x: Any) -> dict[str, Any]:
    """CPU solvers of qpsolvers that can be imported; seconds and distance from our x."""
    out: dict[str, Any] = {}
    try:
        import qpsolvers
    except ImportError:
        return out
    from scipy.sparse import csc_matrix

    tight = {
        "proxqp": {"eps_abs": 1e-9, "eps_rel": 0.0},
        "piqp": {"eps_abs": 1e-9, "eps_rel": 1e-9},
        "osqp": {"eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 20000},
        "clarabel": {},
        "highs": {},
    }
    for name, options in tight.items():
        if name not in qpsolvers.available_solvers:
            continue
        make = np.asarray if name in ("proxqp", "piqp") else csc_matrix
        P, q, G, h, A, b = data
        task = qpsolvers.Problem(make(P), q, make(G), h, make(A), b)
        begin = time.perf_counter()
        try:
            other = qpsolvers.solve_problem(task, name, **options)
        except Exception as error:  # a peer's failure is a row of the table
            out[name] = {"failed": type(error).__name__}
            continue
        seconds = time.perf_counter() - begin
        out[name] = {"seconds": seconds, "found": bool(other.found)}
        if other.x is not None:
            out[name]["distance"] = float(np.abs(other.x - x).max() / np.abs(x).max())
    return out


def device_peers(data: tuple[Any, ...], wait: Callable[[], None], repeats: int) -> dict[str, Any]:
    """qpax and jaxopt on the same device, if they can be imported."""
    out: dict[str, Any] = {}
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    try:
        import jax
    except ImportError:
        return out
    jax.config.update("jax_enable_x64", True)
    P, q, G, h, A, b = (jax.dlpack.from_dlpack(v) for v in data)

    def record(name: str, solve: Callable[[], Any], x: Callable[[Any], Any]) -> None:
        try:
            seconds, value = timed(lambda: jax.block_until_ready(solve()), wait, repeats)
        except Exception as error:  # a peer's failure is a row of the table
            out[name] = {"failed": f"{type(error).__name__}: {error}"[:200]}
            return
        y = x(value)
        rows = max(float(abs(A @ y - b).max()), float((G @ y - h).max()), 0.0)
        out[name] = {"seconds": seconds, "primal": rows / float(abs(h).max())}

    try:
        import qpax

        record("qpax", lambda: qpax.solve_qp(P, q, A, b, G, h), lambda value: value[0])
    except ImportError:
        pass
    try:
        from jaxopt import OSQP

        osqp = OSQP(tol=1e-6, maxiter=20000)
        run = jax.jit(
            lambda: osqp.run(params_obj=(P, q), params_eq=(A, b), params_ineq=(G, h)).params
        )
        record("jaxopt.OSQP", run, lambda value: value.primal)
    except ImportError:
        pass
    return out


def measure(n: int, p: int, l: int, xp: Any, repeats: int, rivals: bool) -> dict[str, Any]:
    """One row of the table."""
    on_device = xp is not np
    wait = xp.cuda.Device().synchronize if on_device else lambda: None
    data = problem(n, p, l, xp)
    P, q, G, h, A, b = data
    row: dict[str, Any] = {"n": n, "p": p, "l": l, "repeats": repeats}
    row["cholesky"] = raw_cholesky(P, wait, repeats)
    row["cholesky_tflops"] = n**3 / 3 / row["cholesky"] / 1e12
    row["seconds"], result = timed(lambda: solve_qp(P, q, G, h, A, b), wait, repeats)
    row["ratio"] = row["seconds"] / row["cholesky"]
    row |= {"path": result.path, "iterations": result.iterations, "kkt": result.kkt.worst}
    row["active"] = int((result.z != 0).sum())
    row["errors"] = errors(data, result)
    if rivals and on_device and n <= DEVICE_PEER_LIMIT:
        row["device_peers"] = device_peers(data, wait, min(repeats, 2))
    if on_device and n <= HOST_LIMIT:
        host = tuple(v.get() for v in data)
        few = repeats if n <= 3200 else 2
        seconds, same = timed(lambda host=host: solve_qp(*host), lambda: None, few)
        row["host"] = {
            "seconds": seconds,
            "speedup": seconds / row["seconds"],
            "cholesky": raw_cholesky(host[0], lambda: None, few),
            "difference": float(np.abs(same.x - result.x.get()).max() / np.abs(same.x).max()),
        }
        row["host"]["cholesky_tflops"] = n**3 / 3 / row["host"]["cholesky"] / 1e12
        if rivals and n <= PEER_LIMIT:
            row["peers"] = peers(host, result.x.get())
    return row


def paths(n: int, crowd: float, xp: Any, repeats: int) -> dict[str, Any]:
    """Seconds of `solve_qp` and of the interior point alone, on one problem with crowd * n rows."""
    wait = xp.cuda.Device().synchronize if xp is not np else lambda: None
    P, q, G, h, A, b = problem(n, n // 10, int(crowd * n), xp)
    seconds, result = timed(lambda: solve_qp(P, q, G, h, A, b), wait, repeats)
    p = check_problem(P, q, G, h, A, b, None, None, None).program
    inner, point = timed(lambda: minimise(p, 1e-9), wait, repeats)
    return {
        "n": n, "p": n // 10, "l": int(crowd * n), "path": result.path, "seconds": seconds,
        "interior_point": inner, "steps": point.iterations, "iterations": result.iterations,
        "active": int((result.z != 0).sum()),
        "difference": float(abs(point.x - result.x).max() / abs(result.x).max()),
    }  # fmt: skip


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/qp.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=sorted(FIGURE))
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--crowded", type=int, nargs="*", default=[], help="sizes of `paths`")
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--host", action="store_true", help="NumPy, where there is no device")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    xp: Any = np
    if not options.host:
        import cupy as xp

    record: dict[str, Any] = {"benchmark": "qp", "machine": describe(), "rows": []}
    if xp is not np:
        record["device"] = xp.cuda.runtime.getDeviceProperties(0)["name"].decode()
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / ("qp.json" if xp is not np else "qp_host.json")
    for table, shape in (("n/10", lambda n: (n // 10, n // 10)), ("figure 6.1", FIGURE.get)):
        for n in options.sizes:
            if shape(n) is None:
                continue
            row = measure(n, *shape(n), xp, options.repeats, options.peers and table == "n/10")
            row["table"] = table
            if table == "figure 6.1" and n in DISSERTATION_SPEEDUP:
                row["dissertation_speedup"] = DISSERTATION_SPEEDUP[n]
            record["rows"].append(row)
            host = row.get("host", {})
            print(
                f"{table:>10} n {n:6d} p {row['p']:5d} l {row['l']:5d}: "
                f"{row['seconds'] * 1e3:9.2f} "
                f"ms = {row['ratio']:6.2f} Cholesky ({row['cholesky'] * 1e3:.2f} ms), "
                f"{row['iterations']} its, {row['path']}, kkt {row['kkt']:.1e}"
                + (f", host x {host['speedup']:.1f}" if host else ""),
                row.get("device_peers", ""), row.get("peers", ""), flush=True,
            )  # fmt: skip
            path.write_text(json.dumps(record, indent=1) + "\n")
            if xp is not np:
                xp.get_default_memory_pool().free_all_blocks()
    slower = [r["n"] for r in record["rows"] if r.get("host", {}).get("speedup", 2.0) < 1.0]
    record["crossover"] = max(slower, default=0)
    record["paths"] = []
    for n in options.crowded:
        for crowd in CROWDED:
            row = paths(n, crowd, xp, min(options.repeats, 2))
            record["paths"].append(row)
            print(
                f"n {n} l {row['l']}: {row['seconds'] * 1e3:.1f} ms by {row['path']} in "
                f"{row['iterations']}, interior point {row['interior_point'] * 1e3:.1f} ms in "
                f"{row['steps']}, difference {row['difference']:.0e}", flush=True,
            )  # fmt: skip
    path.write_text(json.dumps(record, indent=1) + "\n")
    return record


if __name__ == "__main__":
    main()
