"""Structured condensation: layers of equal cells against PARDISO, and against the chip.

The block of `contact_block.py` (Coulomb, friction .9) as a `LayeredBlock` of n x n Adini cells.

* host: condensation and whole solve in NumPy beside the same with PARDISO, interleaved, medians.
  The peer is given its assembled matrix; ours builds all it needs.
* cuda: from the input (lengths, layers, load) to the certified result, by stage, against the
  floating-point operations that the condensation needs (symmetric products counted half) at the
  rate of a dense product measured in the same run; memory is what CuPy's pool holds at the end.
* waves: the same block by cosines and sines, ``path="fourier"``, on either device, by stage:
  input, condensation, contact, displacement of all unknowns (found twice: once it is refined) with
  its way to the host, and the certificate of the displacement that is delivered.

    python benchmarks/contact_layers.py --device cpu --sizes 64 128 256 --waves 512 1024
    python benchmarks/contact_layers.py --device cuda --sizes 256 512 1024 2048 --waves 1024 2048
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from pathlib import Path
from typing import Any

from machine import describe

from contact import ContactProblem, ContactResult, LayeredBlock

GAP, FRICTION = 0.03, 0.9


def block(n: int, path: str | None = None) -> LayeredBlock:
    """Unit square, top held along x and pressed, sides held along y."""
    return LayeredBlock(1.0, [(1.0, n, 2.0, 0.3)], sides="y", top="x", path=path).load(
        "top", (0.0, -1.0)
    )


def operations(problem: ContactProblem) -> dict[str, float]:
    """Floating-point operations of the condensation, from the sizes of its matrices."""
    condensed = problem.condense()
    factor: Any = condensed.parts[0]._factor
    plus, minus = factor._plus.size, factor._minus.size
    m, kept, rest = plus + minus, factor._kept.size, factor._rest.size
    rows = condensed.B.shape[0]
    levels = max(len(fold.middles) for fold in factor.folds)
    doubling = (plus**3 + minus**3) / 3 + (plus**2 + minus**2) * m
    doubling += m * (plus**2 + minus**2) + 2 * m * plus * minus
    fold = m**3 / 3 + 2 * m**3
    bottom = rest**3 / 3 + rest**2 * kept + rest * kept**2
    compliance = kept**3 / 3 + kept**2 * rows + kept * rows**2
    slabs = levels * doubling + len(factor.folds) * fold
    return {"slabs": slabs, "boundary": bottom + compliance, "total": slabs + bottom + compliance}


def whole(
    n: int, device: str, path: str | None = None
) -> tuple[dict[str, float], ContactProblem, ContactResult]:
    """From the input to the certified result; seconds of each part."""
    begin = time.perf_counter()
    problem = ContactProblem(block(n, path), "bottom", GAP, FRICTION)
    rows = time.perf_counter()
    problem.condense(device)._arrays.synchronize()
    condensed = time.perf_counter()
    result = problem.solve()
    end = time.perf_counter()
    parts = {"input": rows - begin, "condense": condensed - rows, "solve": end - condensed}
    return parts | {"total": end - begin}, problem, result


def sparse(n: int) -> tuple[dict[str, float], ContactResult]:
    """The same with PARDISO, from the assembled matrix; seconds of each part."""
    body = block(n).elastic()
    _ = body.vectors
    begin = time.perf_counter()
    problem = ContactProblem(body, "bottom", GAP, FRICTION, solver="pardiso")
    rows = time.perf_counter()
    problem.condense()
    condensed = time.perf_counter()
    result = problem.solve()
    end = time.perf_counter()
    parts = {"input": rows - begin, "condense": condensed - rows, "solve": end - condensed}
    return parts | {"total": end - begin}, result


def middle(runs: list[dict[str, float]]) -> dict[str, float]:
    """Medians."""
    return {key: statistics.median(run[key] for run in runs) for key in runs[0]}


def figures(problem: ContactProblem, result: ContactResult, parts: dict[str, float]) -> Any:
    """What both devices report."""
    return {
        "unknowns": int(problem.body.f.size - problem.body.prescribed[0].size),
        "seconds": parts,
        "newton_steps": sum(line.phase == "newton" for line in result.history),
        "active_set_steps": sum(line.phase == "frictionless" for line in result.history),
        "contact_force": result.contact_force,
        "kkt": max(result.kkt.values()),
        "operations": operations(problem),
    }


def on_host(n: int, repeats: int, peer: bool) -> dict[str, Any]:
    """NumPy, and PARDISO beside it."""
    ours, theirs = [], []
    for _ in range(repeats):
        parts, problem, result = whole(n, "cpu")
        ours.append(parts)
        if peer:
            parts, other = sparse(n)
            theirs.append(parts)
            size = other.mu.max()
            assert abs(other.mu - result.mu).max() < 1e-11 * size
    row = {"n": n, **figures(problem, result, middle(ours))}
    print(f"n = {n}: numpy {row['seconds']}", flush=True)
    if peer:
        row["pardiso"] = middle(theirs)
        row["over_pardiso"] = {k: row["seconds"][k] / row["pardiso"][k] for k in row["pardiso"]}
        print(f"   pardiso {row['pardiso']}\n   ratio {row['over_pardiso']}", flush=True)
    return row


def on_device(n: int, repeats: int, rate: float) -> dict[str, Any]:
    """CuPy; `rate` in operations a second."""
    import cupy

    pool = cupy.get_default_memory_pool()
    runs = []
    for _ in range(repeats):
        problem = result = None
        pool.free_all_blocks()
        parts, problem, result = whole(n, "cuda")
        runs.append(parts)
    row = {"n": n, **figures(problem, result, middle(runs)), "device_bytes": pool.total_bytes()}
    row["bound_seconds"] = row["operations"]["total"] / rate
    row["condense_over_bound"] = row["seconds"]["condense"] / row["bound_seconds"]
    row["spread"] = [min(r["total"] for r in runs), max(r["total"] for r in runs)]
    print(
        f"n = {n}: {row['unknowns']} unknowns, {row['seconds']}, {row['newton_steps']} Newton "
        f"steps, kkt {row['kkt']:.1e}, condensation {row['condense_over_bound']:.2f} x its bound, "
        f"{row['device_bytes'] / 2**30:.1f} GiB",
        flush=True,
    )
    return row


def by_waves(n: int, device: str, repeats: int) -> dict[str, Any]:
    """Medians of the stages of a block that transforms condense."""
    runs = []
    for _ in range(repeats):
        parts, problem, result = whole(n, device, "fourier")
        assert problem.condense().path == "fourier"
        begin = time.perf_counter()
        kkt = max(result.kkt.values())
        parts["certificate"] = time.perf_counter() - begin
        parts["displacement"] = 2.0 * recovery(problem, result)
        parts["contact"] = parts["solve"] - parts["certificate"] - parts["displacement"]
        runs.append(parts)
    row = {
        "n": n,
        "unknowns": int(problem.body.f.size - problem.body.prescribed[0].size),
        "seconds": middle(runs),
        "spread": [min(r["total"] for r in runs), max(r["total"] for r in runs)],
        "history": [f"{line.phase} {line.active}" for line in result.history],
        "contact_force": result.contact_force,
        "kkt": kkt,
    }
    if device == "cuda":
        import cupy

        row["device_bytes"] = cupy.get_default_memory_pool().total_bytes()
    print(
        f"waves, n = {n}: {row['unknowns']} unknowns, "
        + ", ".join(f"{name} {value:.3f}" for name, value in row["seconds"].items())
        + f" s, kkt {kkt:.1e}, {len(result.history)} steps",
        flush=True,
    )
    return row


def recovery(problem: ContactProblem, result: ContactResult) -> float:
    """Seconds to find the displacement of all unknowns from the contact forces, on the host."""
    condensed = problem.condense()
    load = condensed.placed(result.system.load)
    reduced = condensed.reduce(load) - condensed.B.T @ (
        condensed.points.stacked(result.mu, result.t)
    )
    begin = time.perf_counter()
    u = condensed.fetched(condensed.expand(load, condensed.flexed(reduced)))
    seconds = time.perf_counter() - begin
    assert abs(u - result.u).max() < 1e-8 * abs(result.u).max()
    return seconds


def product_rate(n: int = 8192, repeats: int = 5) -> float:
    """Operations a second of a dense product on the device."""
    import cupy

    A = cupy.random.default_rng(0).random((n, n))
    _ = A @ A
    seconds = []
    for _ in range(repeats):
        cupy.cuda.runtime.deviceSynchronize()
        begin = time.perf_counter()
        _ = A @ A
        cupy.cuda.runtime.deviceSynchronize()
        seconds.append(time.perf_counter() - begin)
    return 2.0 * n**3 / statistics.median(seconds)


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write the parts of benchmarks/results/contact_layers.json that were measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--sizes", type=int, nargs="*", default=[64, 128, 256])
    parser.add_argument("--waves", type=int, nargs="*", default=[512], help="sizes by transforms")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--no-peer", action="store_true", help="leave PARDISO out")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)

    whole(32, options.device)  # libraries loaded, kernels compiled
    part: dict[str, Any] = {"machine": describe(), "repeats": options.repeats}
    if options.device == "cuda":
        import cupy

        part["device"] = cupy.cuda.runtime.getDeviceProperties(0)["name"].decode()
        part["cupy"] = cupy.__version__
        part["product_rate"] = rate = product_rate()
        print(f"{part['device']}: dense product {rate / 1e12:.1f} TFLOP/s", flush=True)
        part["rows"] = [on_device(n, options.repeats, rate) for n in options.sizes]
    else:
        peer = not options.no_peer
        part["rows"] = [on_host(n, options.repeats, peer) for n in options.sizes]
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "contact_layers.json"
    record = json.loads(path.read_text()) if path.exists() else {"benchmark": "contact_layers"}
    if options.sizes:
        record[options.device] = part
    if options.waves:
        whole(32, options.device, "fourier")
        waves = [by_waves(n, options.device, options.repeats) for n in options.waves]
        record[f"waves_{options.device}"] = {**part, "rows": waves}
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path.name}")
    return record


if __name__ == "__main__":
    main()
