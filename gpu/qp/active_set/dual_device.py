"""Batches of small dense quadratic programs on a device: a block of threads for each problem.

`gpu.cuda.dual_active_set` holds the method, a dual active set, and its certificate. A block keeps
its two matrices of n x n and its vectors in shared memory where they fit, for n to about 115, and
otherwise in global memory, where fewer blocks than problems share the room.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gpu.cuda.catalogue import kernel, limits

Array = Any  # cupy.ndarray


class _Limits(NamedTuple):  # of a launch
    threads: int = 256  # most of a block; 32, a warp, for n up to 32
    program: int = 1024  # bytes of shared memory for pointers and numbers
    steps: int = 10  # most constraints that enter or leave, over rows and variables


LIMITS = _Limits()


class Batch(NamedTuple):
    """Solutions of B problems. Where the code is not 0, x, state and residuals are no answer."""

    x: Array  # (B, n), within the bounds, and exactly at those that hold a variable
    y: Array  # (B, m), positive where an upper side holds, or a Farkas vector as in `Infeasible`
    z_box: Array  # (B, n), with Px + q + C'y + z_box = 0, or -C'y of a Farkas vector
    state: Array  # (B, m + n), int8: -1 held at the lower side, +1 at the upper one, 0 free
    code: Array  # (B,), int8: 0 solved and certified, 1 infeasible and proved, 2 not decided
    steps: Array  # (B,), int32: constraints that entered or left
    residuals: Array  # (B, 4): primal, dual, gap, complementarity as in `Residuals`


def solve_batch(
    P: Array,
    q: Array,
    C: Array,
    low: Array,
    high: Array,
    lb: Array,
    ub: Array,
    state: Array | None = None,
    tol: float = 1e-9,
) -> Batch:
    """Solve min x'Px/2 + q'x with low <= Cx <= high and lb <= x <= ub, P definite. Arrays of CuPy
    hold one problem along the first axis, or what all share, once; `state`, as in a `Batch`, is the
    active set to begin with. Residuals of what is called solved are at most tol / 100."""
    import cupy

    data = [cupy.ascontiguousarray(a, dtype=float) for a in (P, q, C, low, high, lb, ub)]
    m, n = data[2].shape[1:]
    (B,) = np.broadcast_shapes(*((len(a),) for a in (*data, *([] if state is None else [state]))))
    if state is not None:
        state = cupy.ascontiguousarray(cupy.broadcast_to(state, (B, m + n)), dtype=np.int8)
    result = Batch(
        cupy.full((B, n), np.nan),
        cupy.full((B, m), np.nan),
        cupy.full((B, n), np.nan),
        cupy.zeros((B, m + n), dtype=np.int8),
        cupy.empty(B, dtype=np.int8),
        cupy.empty(B, dtype=np.int32),
        cupy.full((B, 4), np.nan),
    )
    if not B:
        return result
    padded = -(-n // 32) * 32
    threads = min(padded, LIMITS.threads)
    # Two matrices, vectors of variables and of rows, sums of warps, the active set and the states.
    size = 2 * n * (n | 1) + 7 * padded + 2 * (m + n) + 32 + (n + 1) // 2 + -(-(m + n) // 8)
    processors, most_shared, registers = limits(
        cupy.cuda.Device().id, "MultiProcessorCount", "MaxSharedMemoryPerBlockOptin",
        "MaxRegistersPerMultiprocessor",
    )  # fmt: skip
    in_shared = 8 * size + LIMITS.program <= most_shared
    name = "dual_active_set" if in_shared else "dual_active_set_far"
    solve = kernel(name, f"{name}_solve")
    nothing = np.int64(0)  # the null pointer
    if in_shared:
        solve.max_dynamic_shared_size_bytes = 8 * size
        blocks, memory = B, nothing
    else:
        # As many as run at once.
        blocks = min(B, processors * (registers // (threads * solve.num_regs)))
        memory = cupy.empty(blocks * size)
    strided = [part for a in data for part in (a, np.int64(a[0].size if len(a) > 1 else 0))]
    solve(
        (blocks,), (threads,),
        (
            *strided, nothing if state is None else state, np.int64(B), np.int32(n), np.int32(m),
            np.int32(20 + LIMITS.steps * (m + n)), np.float64(tol), memory, np.int64(size),
            *result[:3], *result[3:],
        ),
        shared_mem=8 * size if in_shared else 0,
    )  # fmt: skip
    return result
