r"""Appendix A of the dissertation in Python: the first steps with a graphics processor.

1. Vector addition, b <- a + b, by a raw kernel: one thread an entry, i = thread + block * threads.
2. The linear system A x = f by A = Q R, y = Q^T f, R x = y. Q^T stands on the left of f; the
   dissertation's call asks for the right side, which has no meaning for one vector.
3. Pinned memory: pages that stay where they are, so that the device can fetch them itself.
4. Pooled memory: an allocation that finds a freed block need not ask the driver.
5. Coalescing: neighbouring threads that read neighbouring entries share a transaction.

Every line checks its result before it prints a time. Without CuPy or without a device the same
steps run on NumPy and SciPy, and the script says so; 3 and 4 have no counterpart there, and 5
becomes the walk along the rows of an array or down its columns.

    python examples/gpu_appendix.py [--size 4194304] [--order 2000] [--output out]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.linalg import lapack

KERNELS = r"""
extern "C" __global__ void add(const int* a, int* b, int size)
{
    int i = threadIdx.x + blockIdx.x * blockDim.x;
    if (i < size)
        b[i] += a[i];
}

// Every entry is read once; `stride` is the distance between those of neighbouring threads.
extern "C" __global__ void gather(const double* a, double* b, int rows, int stride)
{
    int i = threadIdx.x + blockIdx.x * blockDim.x;
    if (i < rows * stride)
        b[i] = a[(i % rows) * stride + i / rows];
}
"""
THREADS = 256  # a block: a multiple of the 32 that run in step
STRIDE = 32


def has_device() -> bool:
    """Whether CuPy can be imported and sees a device."""
    try:
        import cupy
    except ImportError:
        return False
    return bool(cupy.cuda.is_available())


def best(work: Callable[[], object], wait: Callable[[], object], repeats: int = 5) -> float:
    """Least seconds of a few runs, after one that compiles and warms up."""
    seconds = []
    for _ in range(repeats + 1):
        wait()
        begin = time.perf_counter()
        work()
        wait()
        seconds.append(time.perf_counter() - begin)
    return min(seconds[1:])


def data(size: int, order: int) -> tuple[np.ndarray, ...]:
    """Two vectors of integers, and a linear system with its solution."""
    rng = np.random.default_rng(0)
    a, b = rng.integers(0, 100, (2, size), dtype=np.int32)
    A, x = rng.standard_normal((order, order)), rng.standard_normal(order)
    return a, b, A, x


def solve_by_qr(A: np.ndarray, f: np.ndarray) -> np.ndarray:
    """LAPACK's geqrf, ormqr and trtrs, the host's names of the dissertation's three calls."""
    room = 64 * len(f)  # of less LAPACK makes smaller blocks
    qr, tau, _, info = lapack.dgeqrf(A, lwork=room)
    y, _, failed = lapack.dormqr("L", "T", qr, tau, f[:, None], lwork=room)
    x, singular = lapack.dtrtrs(qr, y)
    assert info == failed == singular == 0
    return x[:, 0]


def on_host(size: int, order: int) -> dict[str, float]:
    """The NumPy path: seconds by name."""
    a, b, A, x = data(size, order)
    seconds = {}

    total = b.copy()
    np.add(total, a, out=total)
    assert np.array_equal(total - b, a)
    seconds["vector addition"] = best(lambda: np.add(a, b, out=total), lambda: None)

    f = A @ x
    assert np.allclose(solve_by_qr(A, f), x, rtol=1e-6, atol=1e-6)
    seconds["solve by QR"] = best(lambda: solve_by_qr(A, f), lambda: None, repeats=2)

    table = np.arange(float(size // STRIDE * STRIDE)).reshape(-1, STRIDE)
    copied = np.empty(table.size)
    for name, walk in {"neighbours": table, "strided": table.T}.items():
        target = copied.reshape(walk.shape)
        np.copyto(target, walk)
        assert np.array_equal(target, walk)
        seconds[f"copy, {name}"] = best(lambda t=target, w=walk: np.copyto(t, w), lambda: None)
    return seconds


def on_device(size: int, order: int) -> dict[str, float]:
    """The CuPy path: seconds by name; the device is waited for before a clock is read."""
    import cupy
    import cupyx
    from cupyx.lapack import gels

    wait = cupy.cuda.get_current_stream().synchronize
    kernels = cupy.RawModule(code=KERNELS, options=("--std=c++17",))
    a, b, A, x = data(size, order)
    seconds = {}

    add, blocks = kernels.get_function("add"), -(-size // THREADS)
    a_device, b_device = cupy.asarray(a), cupy.asarray(b)
    add((blocks,), (THREADS,), (a_device, b_device, np.int32(size)))
    assert np.array_equal(b_device.get(), a + b)
    seconds["vector addition"] = best(
        lambda: add((blocks,), (THREADS,), (a_device, b_device, np.int32(size))), wait
    )

    A_device = cupy.asarray(A)
    f = A_device @ cupy.asarray(x)
    assert np.allclose(gels(A_device, f).get(), x, rtol=1e-6, atol=1e-6)
    seconds["solve by QR"] = best(lambda: gels(A_device, f), wait, repeats=2)

    stream, target = cupy.cuda.get_current_stream(), cupy.empty(size, dtype=np.int32)
    pinned = cupyx.empty_pinned(size, dtype=np.int32)
    pinned[...] = a
    for name, source in {"pageable": a, "pinned": pinned}.items():
        target.fill(-1)
        target.set(source, stream=stream)
        wait()
        assert np.array_equal(target.get(), a)
        seconds[f"to the device, {name}"] = best(
            lambda s=source: target.set(s, stream=stream), wait
        )

    runtime = cupy.cuda.runtime
    seconds["allocation, driver"] = best(lambda: runtime.free(runtime.malloc(8 * size)), wait)
    seconds["allocation, pool"] = best(lambda: cupy.empty(size), wait)

    gather, rows = kernels.get_function("gather"), size // STRIDE
    entries = cupy.arange(float(rows * STRIDE))
    copied = cupy.empty_like(entries)
    blocks = -(-entries.size // THREADS)
    for name, shape in {"neighbours": (entries.size, 1), "strided": (rows, STRIDE)}.items():
        arguments = (entries, copied, *map(np.int32, shape))
        copied.fill(-1.0)
        gather((blocks,), (THREADS,), arguments)
        assert bool((copied == entries.reshape(shape).T.ravel()).all())
        seconds[f"copy, {name}"] = best(lambda g=arguments: gather((blocks,), (THREADS,), g), wait)
    return seconds


def picture(seconds: dict[str, float], where: str, size: int, output: Path) -> None:
    """Draw the times as bars; the two copies of a pair move the same bytes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 1.2 + 0.4 * len(seconds)), layout="constrained")
    axes = figure.subplots()
    bars = axes.barh(list(seconds), [1e3 * value for value in seconds.values()], color="#1f6f8b")
    axes.bar_label(bars, fmt="%.3g", padding=3)
    axes.set(xscale="log", xlabel="milliseconds", title=f"{where}, {size} entries a vector")
    axes.invert_yaxis()
    axes.margins(x=0.15)
    output.mkdir(parents=True, exist_ok=True)
    figure.savefig(output / "gpu_appendix.png", dpi=120)


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Print and draw the table and return it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=2**22, help="entries of the vectors")
    parser.add_argument("--order", type=int, default=2000, help="unknowns of the linear system")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the PNG")
    arguments = parser.parse_args(argv)
    device = has_device()
    if device:
        print("CuPy, on the device; seconds:")
        seconds = on_device(arguments.size, arguments.order)
    else:
        print("No CuPy or no device: NumPy on the host; seconds:")
        seconds = on_host(arguments.size, arguments.order)
    for name, value in seconds.items():
        print(f"  {name:24s} {value:10.6f}")
    picture(seconds, "CuPy" if device else "NumPy", arguments.size, arguments.output)
    return seconds


if __name__ == "__main__":
    main()
