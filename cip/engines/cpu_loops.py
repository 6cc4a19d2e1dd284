"""The kernels over all nodes on the CPU: rows of nodes, shared among threads.

The loops are plain Python: `cip.jit.loop_over` compiles one for each kernel `node`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any

from cip.jit import Array, Index, Out, Real, pointer

# Fewer nodes than this a thread are not worth waking it.
_NODES_A_THREAD = 40_000

address = pointer()
# In its place `loop_over` puts a kernel.
node: Any = None


def run_line(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, h: Array, n: Index,
    periodic: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Nodes start..stop of the one line of a grid in one dimension."""
    m, out, feet, h = address(m), address(out), address(feet), address(h)
    for i in range(start, stop):
        node(m, out, feet, n, i, h, n, 1, 0, i, 0, 1, n, periodic, i, advect, limiter)


def run_lines(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, h: Array, size: Index,
    dim: Index, axis: Index, inner: Index, n: Index, periodic: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Rows start..stop of a sweep: row number (block, i) holds the `inner` nodes i of its lines."""
    m, out, feet, h = address(m), address(out), address(feet), address(h)
    block = start // n
    i = start - block * n
    for _ in range(start, stop):
        base = block * n * inner
        for q in range(inner):
            node(
                m, out, feet, size, base + i * inner + q, h, size, dim, axis,
                base + i * inner + q, base + q, inner, n,
                periodic, i, advect, limiter,
            )  # fmt: skip
        i += 1
        if i == n:
            i = 0
            block += 1


def run_conservative(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, h: Array, size: Index,
    dim: Index, axis: Index, inner: Index, n: Index, periodic: Index,
    limiter: Index, low: Real, high: Real, slack: Real,
) -> None:  # fmt: skip
    """As `run_lines`, for the conservative profiles."""
    m, out, feet, h = address(m), address(out), address(feet), address(h)
    block = start // n
    i = start - block * n
    for _ in range(start, stop):
        base = block * n * inner
        for q in range(inner):
            node(
                m, out, feet, h, size, dim, axis, base + i * inner + q, base + q, inner, n,
                periodic, i, limiter, low, high, slack,
            )  # fmt: skip
        i += 1
        if i == n:
            i = 0
            block += 1


def run_plane(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, hx: Array, hy: Array,
    size: Index, nx: Index, ny: Index, px: Index, py: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Rows start..stop of a plane."""
    m, out, feet, hx, hy = address(m), address(out), address(feet), address(hx), address(hy)
    for i in range(start, stop):
        for j in range(ny):
            node(
                m, out, feet, size, i * ny + j, hx, hy, size, i * ny + j, i, j, nx, ny, px, py,
                advect, limiter,
            )  # fmt: skip


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="cip")


if hasattr(os, "register_at_fork"):
    # The child has the pool without its threads: it would wait for them for ever.
    os.register_at_fork(after_in_child=_pool.cache_clear)


def threads() -> int:
    """Number of threads: `NUMBA_NUM_THREADS` where set, else the cores of this process."""
    given = os.environ.get("NUMBA_NUM_THREADS", "")
    if given.isdigit() and int(given) > 0:
        return int(given)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share(work: Callable[[int, int], Any], rows: int, size: int) -> None:
    """Call work(start, stop) on parts of the rows, each by one thread."""
    parts = min(threads(), rows, max(1, size // _NODES_A_THREAD))
    if parts == 1:
        work(0, rows)
        return
    cuts = [rows * part // parts for part in range(parts + 1)]
    tasks = [_pool(threads()).submit(work, *cut) for cut in pairwise(cuts)]
    for task in tasks:
        task.result()
