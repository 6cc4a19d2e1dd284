"""Ten eigenvalues of largest modulus: time in units of reading the matrix.

Table 6.1 of the dissertation and beyond: dense matrices with twenty separated eigenvalues,

    A = diag(2 ... 1.1, 0, ...) + 0.05 G / sqrt(n),   G Gaussian, k = 10, tol = 1e-10,

the dissertation's own matrices being unknown. A product reads A once, so that

    floor = products * 8 n^2 bytes / (copy rate measured in the same run),   ratio = time / floor.

Beside it, in one run on one machine: the same code on NumPy, ARPACK (SciPy) with its space of 25
and with ours, all eigenvalues (cuSOLVER, LAPACK), CuPy's eigsh for a symmetric matrix, a sparse
matrix of a million rows, and what one Arnoldi step costs. Residuals are printed, so that no time
is that of a wrong answer. Without a device the host's part runs.

Products are counted against ARPACK's with the same k, tol, start and dimension ncv on six kinds of
matrices of order 400, three of each: separated eigenvalues, Gaussian, uniform and symmetric random
entries, a geometric sequence and a convection operator. Ours include those of the search for
missed eigenvalues, which ARPACK does not make.

With `--kinds` the same matrices, of these orders, in mean seconds: ours on the device and on NumPy
beside the quicker of ARPACK's two spaces on the same host. Times of the host are those of all cores
or of one, whichever is less.

    python benchmarks/eigs.py --sizes 400 800 1600 3200 6400 12800 25600 51200 \\
        --products --kinds 400 800 --sparse 1000000
"""

from __future__ import annotations

import argparse
import importlib
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from scipy import sparse
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator
from scipy.sparse.linalg import eigs as arpack

from gpu import NotConverged

module = importlib.import_module("gpu.eigenvalues.eigs")
eigs = module.eigs

K, TOL = 10, 1e-10
# Seconds of Table 6.1: ten eigenvalues, space of 25, four cores and a Tesla C2050.
DISSERTATION = {
    400: (0.02596, 0.15194),
    800: (0.04439, 0.16896),
    1600: (0.19215, 0.16221),
    3200: (0.64021, 0.20552),
    6400: (2.29447, 0.50485),
}
HOST_LIMIT = {"ours": 12800, "arpack": 12800, "all": 1600}


class Products:
    """Counts the products of the iterations while it is entered."""

    def __enter__(self) -> Products:
        self._iterate, self.count = module.krylov_schur, 0

        def counted(*arguments: Any, **options: Any) -> Any:
            found = self._iterate(*arguments, **options)
            self.count += found.matvecs
            return found

        module.krylov_schur = counted
        return self

    def __exit__(self, *_: object) -> None:
        module.krylov_schur = self._iterate


def device() -> Any:
    """CuPy with a device, or None."""
    try:
        import cupy
    except ImportError:
        return None
    return cupy if cupy.cuda.is_available() else None


def seconds(work: Callable[[], Any], cp: Any = None, repeats: int = 5) -> float:
    """Median of a few runs after one to warm up; fewer where a run is long."""
    wait = cp.cuda.get_current_stream().synchronize if cp else lambda: None
    taken: list[float] = []
    for run in range(repeats + 1):
        wait()
        begin = time.perf_counter()
        work()
        wait()
        spent = time.perf_counter() - begin
        if run > 0 or spent > 5.0:
            taken.append(spent)
        if sum(taken) > 5.0:
            break
    return float(np.median(taken))


def on_cores(work: Callable[[], Any], repeats: int) -> float:
    """Seconds on all cores or on one, whichever is quicker: threads disturb small products."""
    from threadpoolctl import threadpool_limits

    spent = seconds(work, repeats=repeats)
    with threadpool_limits(limits=1, user_api="blas"):
        return min(spent, seconds(work, repeats=repeats))


def separated(n: int, xp: Any, seed: int = 0) -> Any:
    """The matrix of the table, made where it is used."""
    rng = xp.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A *= 0.05 / np.sqrt(n)
    A[xp.arange(20), xp.arange(20)] += xp.linspace(2.0, 1.1, 20)
    return A


def residual(A: Any, w: Any, v: Any, xp: Any) -> float:
    """Largest \\|A v - w v\\| of unit vectors."""
    return float(xp.linalg.norm(A @ v - v * w, axis=0).max())


def copy_rate(cp: Any) -> float:
    """Bytes read and written a second by a copy on the device."""
    source = cp.random.default_rng(0).standard_normal(2**28)
    target = cp.empty_like(source)
    return 2 * source.nbytes / seconds(lambda: cp.copyto(target, source), cp)


def on_device(n: int, cp: Any, rate: float) -> dict[str, Any]:
    """One row: ours on the device, and all eigenvalues by cuSOLVER."""
    A = separated(n, cp)
    with Products() as products:
        w, v = eigs(A, K, tol=TOL)
    floor = products.count * 8.0 * n * n / rate
    row = {
        "seconds": seconds(lambda: eigs(A, K, tol=TOL), cp, 20),
        "products": products.count,
        "floor": floor,
        "residual": residual(A, w, v, cp),
    }
    row["ratio"] = row["seconds"] / floor
    if n <= 3200:
        row["all eigenvalues, cuSOLVER"] = seconds(lambda: cp.linalg.eigvals(A), cp, 2)
    return row


def on_host(n: int) -> dict[str, Any]:
    """One row: ours on NumPy, ARPACK with two spaces, LAPACK."""
    A, row = separated(n, np), {}
    if n <= HOST_LIMIT["ours"]:
        with Products() as products:
            w, v = eigs(A, K, tol=TOL)
        row["ours"] = on_cores(lambda: eigs(A, K, tol=TOL), repeats=3)
        row["products"], row["residual"] = products.count, residual(A, w, v, np)
    if n <= HOST_LIMIT["arpack"]:
        v0 = np.random.default_rng(1).standard_normal(n)
        for ncv in (25, 40):
            count = [0]

            def product(x: Any, count: list[int] = count) -> Any:
                count[0] += 1
                return A @ x

            operator = LinearOperator(A.shape, matvec=product, dtype=float)
            w, v = arpack(operator, K, tol=TOL, ncv=ncv, v0=v0)
            row[f"arpack {ncv}"] = on_cores(
                lambda ncv=ncv: arpack(A, K, tol=TOL, ncv=ncv, v0=v0), repeats=3
            )
            row[f"arpack {ncv} products"] = count[0]
            row[f"arpack {ncv} residual"] = residual(A, w, v, np)
    if n <= HOST_LIMIT["all"]:
        row["all eigenvalues, LAPACK"] = seconds(lambda: np.linalg.eigvals(A), repeats=1)
    return row


def steps(n: int, cp: Any, rate: float, size: int = 40) -> dict[str, float]:
    """One Arnoldi step: in one launch with its product, or with a library product."""
    from gpu.eigenvalues.krylov.arnoldi import FusedSteps

    A = separated(n, cp)
    V, rows = cp.zeros((size + 1, n)), cp.zeros((size, 2, size + 2))
    V[0] = 1.0 / np.sqrt(n)
    fused = FusedSteps(V, rows)

    def apart() -> None:
        for j in range(size):
            fused(A @ V[j], j)

    row = {}
    if fused.multiplies(A):
        row["sweep"] = seconds(lambda: fused.sweep(A, 0, size), cp) / size
    return row | {
        "apart": seconds(apart, cp) / size,
        "product alone": seconds(lambda: [A @ V[j] for j in range(size)], cp) / size,
        "floor": 8.0 * n * n / rate,
    }


def sparse_matrix(n: int) -> sparse.csr_array:
    """About 17 entries a row in random columns, twenty separated eigenvalues."""
    rng = np.random.default_rng(0)
    columns = rng.integers(0, n, (n, 16)).ravel()
    places = np.repeat(np.arange(n), 16)
    entries = rng.standard_normal(columns.size) * 0.01
    A = sparse.csr_array((entries, (places, columns)), shape=(n, n))
    return sparse.csr_array(
        A + sparse.diags_array(np.r_[np.linspace(2, 1.1, 20), np.zeros(n - 20)])
    )


def large_sparse(n: int, cp: Any) -> dict[str, Any]:
    """A million rows: ours on the device beside ARPACK on the host."""
    A = sparse_matrix(n)
    v0 = np.random.default_rng(1).standard_normal(n)
    begin = time.perf_counter()
    w, v = arpack(A, K, tol=TOL, ncv=25, v0=v0)
    row = {"arpack 25": time.perf_counter() - begin, "arpack residual": residual(A, w, v, np)}
    if cp:
        from cupyx.scipy.sparse import csr_matrix

        B = csr_matrix(sparse.csr_matrix(A))
        with Products() as products:
            w, v = eigs(B, K, tol=TOL)
        row["seconds"] = seconds(lambda: eigs(B, K, tol=TOL), cp, 3)
        row["products"], row["residual"] = products.count, residual(B, w, v, cp)
        row["times arpack"] = row["arpack 25"] / row["seconds"]
    return row


def test_set(n: int, seed: int) -> dict[str, Any]:
    """Six matrices, four of random entries and two banded ones that are far from normal."""
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((n, n))
    separate = np.r_[np.linspace(2.0, 1.1, 20), np.zeros(n - 20)]
    return {
        "separated": 0.05 * G / np.sqrt(n) + np.diag(separate),
        "gaussian": G,
        "uniform": rng.random((n, n)),
        "symmetric": G + G.T,
        "geometric": np.diag(0.97 ** np.arange(n)) + 0.01 * np.triu(G, 1) / np.sqrt(n),
        "convection": np.diag(2.0 + 0.2 * rng.random(n))
        - np.diag(np.full(n - 1, 1.3), 1)
        - np.diag(np.full(n - 1, 0.7), -1),
    }


def against_arpack(n: int = 400, seeds: int = 3) -> dict[str, Any]:
    """Products of the iterations: ours with the search for missed ones, over ARPACK's."""
    table: dict[str, Any] = {}
    start = np.random.default_rng(1).standard_normal(n)
    for ncv in (25, 40):
        rows: dict[str, Any] = {}
        for seed in range(seeds):
            for kind, A in test_set(n, seed).items():
                count, row = [0], rows.setdefault(f"{kind} {seed}", {})

                def product(x: Any, A: Any = A, count: list[int] = count) -> Any:
                    count[0] += 1
                    return A @ x

                operator = LinearOperator(A.shape, matvec=product, dtype=float)
                options = {"tol": TOL, "ncv": ncv, "v0": start}
                with Products() as products:
                    row["converged"] = converges(eigs, operator, **options)
                row["products"] = products.count
                count[0] = 0
                row["arpack converged"] = converges(arpack, operator, maxiter=2000, **options)
                row["arpack products"] = count[0]
        ratios = [row["products"] / row["arpack products"] for row in rows.values()]
        table[f"ncv {ncv}"] = {"median ratio": float(np.median(ratios)), "rows": rows}
    return table


def kinds_in_seconds(n: int, cp: Any, seeds: int = 3) -> dict[str, Any]:
    """The six kinds of order n, three of each, in mean seconds: ours on either side, and ARPACK
    with the quicker of two spaces."""
    start = np.random.default_rng(1).standard_normal(n)
    rows: dict[str, Any] = {}
    for seed in range(seeds):
        for kind, A in test_set(n, seed).items():
            taken = {"host": on_cores(lambda A=A: eigs(A, K, tol=TOL), repeats=3)}
            for ncv in (25, 40):
                options = {"tol": TOL, "ncv": ncv, "v0": start, "maxiter": 2000}
                taken[f"arpack {ncv}"] = on_cores(
                    lambda A=A, options=options: arpack(A, K, **options), repeats=3
                )
            if cp:
                B = cp.asarray(A)
                taken["device"] = seconds(lambda B=B: eigs(B, K, tol=TOL), cp, 5)
            row = rows.setdefault(kind, dict.fromkeys(taken, 0.0))
            for name, spent in taken.items():
                row[name] += spent / seeds
    for row in rows.values():
        row["arpack"] = min(row["arpack 25"], row["arpack 40"])
    return rows


def converges(solve: Callable[..., Any], operator: Any, **options: Any) -> bool:
    """Whether a solver returns."""
    try:
        solve(operator, K, **options)
    except (ArpackNoConvergence, NotConverged):
        return False
    return True


def symmetric(n: int, cp: Any) -> dict[str, float]:
    """CuPy's eigsh, its absolute tolerance set to ours, beside ours on a symmetric matrix."""
    from cupyx.scipy.sparse.linalg import eigsh

    A = separated(n, cp)
    A = (A + A.T) / 2
    w, v = eigs(A, K, tol=TOL)
    s, u = eigsh(A, K, tol=TOL, ncv=40)
    return {
        "seconds": seconds(lambda: eigs(A, K, tol=TOL), cp),
        "residual": residual(A, w, v, cp),
        "cupyx eigsh": seconds(lambda: eigsh(A, K, tol=TOL, ncv=40), cp),
        "cupyx residual": residual(A, s, u, cp),
    }


def main() -> None:
    """Run, print, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[400, 800, 1600])
    parser.add_argument("--sparse", type=int, default=0, help="rows of the sparse matrix")
    parser.add_argument("--products", action="store_true", help="count against ARPACK's")
    parser.add_argument("--kinds", type=int, nargs="*", default=[], help="orders of the six kinds")
    parser.add_argument(
        "--output", type=Path, default=Path(__file__).parent / "results" / "eigs.json"
    )
    arguments = parser.parse_args()
    cp, rate = device(), 0.0
    result: dict[str, Any] = {"machine": describe(), "k": K, "tol": TOL, "table": {}}
    if cp:
        rate = copy_rate(cp)
        name = cp.cuda.runtime.getDeviceProperties(0)["name"].decode()
        result["device"] = {"name": name, "cupy": cp.__version__, "copy bytes a second": rate}
        print(f"{name}, copy {rate / 1e12:.2f} TB/s")
    # The device first: once its cores were all busy the host is slow to launch kernels.
    for n in arguments.sizes:
        row: dict[str, Any] = result["table"].setdefault(n, {})
        if cp:
            row["device"] = on_device(n, cp, rate)
            cp.get_default_memory_pool().free_all_blocks()
            if n <= 25600:
                row["step"] = steps(n, cp, rate)
                row["symmetric"] = symmetric(n, cp) if n in (1600, 6400, 25600) else None
            cp.get_default_memory_pool().free_all_blocks()
            print(n, json.dumps(row, default=float), flush=True)
            arguments.output.write_text(json.dumps(result, indent=1, default=float) + "\n")
    for n, row in result["table"].items():
        row["host"] = on_host(n)
        if n in DISSERTATION:
            row["dissertation"] = dict(zip(("four cores", "Tesla"), DISSERTATION[n], strict=True))
        print(n, "host", json.dumps(row["host"], default=float), flush=True)
        arguments.output.write_text(json.dumps(result, indent=1, default=float) + "\n")
    for n in arguments.kinds:
        result.setdefault("kinds", {})[n] = kinds_in_seconds(n, cp)
        print("kinds", n, json.dumps(result["kinds"][n], default=float), flush=True)
        arguments.output.write_text(json.dumps(result, indent=1, default=float) + "\n")
    if arguments.products:
        result["against ARPACK"] = against_arpack()
        print("products over ARPACK's", json.dumps(result["against ARPACK"]))
        arguments.output.write_text(json.dumps(result, indent=1, default=float) + "\n")
    if arguments.sparse:
        result["sparse"] = {arguments.sparse: large_sparse(arguments.sparse, cp)}
        print("sparse", json.dumps(result["sparse"], default=float))
        arguments.output.write_text(json.dumps(result, indent=1, default=float) + "\n")


if __name__ == "__main__":
    main()
