"""The kernels over all nodes on the CPU: rows of nodes, shared among threads.

The loops are plain Python: `cip.jit.loop_over` compiles one for each kernel `node`. They take the
records of `cip.profiles.records` as plain tuples: numba unpacks these ten times faster.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any

from cip.jit import Array, Index, Out, kernel, pointer
from cip.profiles.records import Foot, Limits, Line, Update

# With fewer nodes per thread than this, starting the thread takes longer than it saves.
_NODES_A_THREAD = 40_000

address = pointer()


@kernel
def at_addresses(line: Line) -> Line:
    """A `Line` with the address of its widths, as the kernels need it, from a record or tuple."""
    h, first, stride, n, periodic = line
    return Line(address(h), first, stride, n, periodic)


# `loop_over` replaces it by a kernel.
node: Any = None


def run_line(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    limiter: Index,
) -> None:  # fmt: skip
    """Nodes start..stop of the one line of a grid in one dimension."""
    m, out, feet = address(m), address(out), address(feet)
    line, advect = at_addresses(line), Update(*update).advect
    # Constants, so that the compiler removes the code for other dimensions.
    n, own = line.n, Line(line.h, 0, 1, line.n, line.periodic)
    known = Update(n, 1, 0, advect)
    for i in range(start, stop):
        node(m, out, Foot(feet, n, i), own, known, i, i, limiter)


def run_lines(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    limiter: Index,
) -> None:  # fmt: skip
    """Rows start..stop of a sweep; `line` is the first line of the grid in its direction. Row
    ``block line.n + i`` holds node i of ``line.stride`` adjacent lines.
    """
    m, out, feet = address(m), address(out), address(feet)
    line, update = at_addresses(line), Update(*update)
    inner, n = line.stride, line.n
    block = start // n
    i = start - block * n
    for _ in range(start, stop):
        base = block * n * inner
        for q in range(inner):
            o = base + i * inner + q
            own = Line(line.h, base + q, inner, n, line.periodic)
            node(m, out, Foot(feet, update.size, o), own, update, o, i, limiter)
        i += 1
        if i == n:
            i = 0
            block += 1


def run_conservative(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    limits: Limits,
) -> None:  # fmt: skip
    """As `run_lines`, for the conservative profiles."""
    m, out, feet = address(m), address(out), address(feet)
    line, update = at_addresses(line), Update(*update)
    limits = Limits(*limits)
    inner, n = line.stride, line.n
    block = start // n
    i = start - block * n
    for _ in range(start, stop):
        base = block * n * inner
        for q in range(inner):
            own = Line(line.h, base + q, inner, n, line.periodic)
            node(m, out, feet, own, update, base + i * inner + q, i, limits)
        i += 1
        if i == n:
            i = 0
            block += 1


def run_plane(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, x: Line, y: Line, update: Update,
    limiter: Index,
) -> None:  # fmt: skip
    """Rows start..stop of a plane; x and y are the lines through its first node."""
    m, out, feet = address(m), address(out), address(feet)
    x, y, update = at_addresses(x), at_addresses(y), Update(*update)
    for i in range(start, stop):
        for j in range(y.n):
            o = i * y.n + j
            node(m, out, Foot(feet, update.size, o), x, y, update, o, i, j, limiter)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="cip")


if hasattr(os, "register_at_fork"):
    # After a fork the child has the pool but not its threads, and would wait for them for ever.
    os.register_at_fork(after_in_child=_pool.cache_clear)


def threads() -> int:
    """Number of threads: `NUMBA_NUM_THREADS` where set, else the cores of this process."""
    given = os.environ.get("NUMBA_NUM_THREADS", "")
    if given.isdigit() and int(given) > 0:
        return int(given)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share(work: Callable[[int, int], Any], rows: int, size: int) -> None:
    """Call work(start, stop) on parts of the rows, one per thread; `size` counts the nodes."""
    parts = min(threads(), rows, max(1, size // _NODES_A_THREAD))
    if parts == 1:
        work(0, rows)
        return
    cuts = [rows * part // parts for part in range(parts + 1)]
    tasks = [_pool(threads()).submit(work, *cut) for cut in pairwise(cuts)]
    for task in tasks:
        task.result()
