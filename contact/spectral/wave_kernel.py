"""Condensation of layers on a device: one thread per wave, with matrices in registers."""

from __future__ import annotations

import functools
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from contact.spectral.wave_cells import Column

MOST = 6  # node unknowns; matrices of more do not fit into registers
_THREADS = 64  # threads per block

SOURCE = r"""
template <int n> struct Symmetric {  // the upper triangle, row by row
    double v[n * (n + 1) / 2];
    __device__ __forceinline__ double& operator()(int i, int j) {
        return i <= j ? v[i * (2 * n - i - 1) / 2 + j] : v[j * (2 * n - j - 1) / 2 + i];
    }
};

template <int n, int k> __device__ __forceinline__ void eliminate(Symmetric<n>& z) {
    #pragma unroll
    for (int e = 0; e < k; ++e) {
        const double over = 1.0 / z(e, e);
        #pragma unroll
        for (int i = e + 1; i < n; ++i) {
            const double factor = z(e, i) * over;
            #pragma unroll
            for (int j = i; j < n; ++j) z(i, j) -= factor * z(e, j);
        }
    }
}

// The slab of two, one above the other; it may be one of them.
__device__ JOINED void join(Symmetric<2 * R>& lower, Symmetric<2 * R>& upper,
                            Symmetric<2 * R>& both) {
    Symmetric<3 * R> z;
    #pragma unroll
    for (int i = 0; i < R; ++i) {
        #pragma unroll
        for (int j = 0; j < R; ++j) {
            z(i, R + j) = lower(j, R + i);
            z(i, 2 * R + j) = upper(i, R + j);
            z(R + i, 2 * R + j) = 0.0;
            if (j < i) continue;
            z(i, j) = lower(R + i, R + j) + upper(i, j);
            z(R + i, R + j) = lower(i, j);
            z(2 * R + i, 2 * R + j) = upper(R + i, R + j);
        }
    }
    eliminate<3 * R, R>(z);
    #pragma unroll
    for (int i = 0; i < 2 * R; ++i) {
        #pragma unroll
        for (int j = i; j < 2 * R; ++j) both(i, j) = z(R + i, R + j);
    }
}

extern "C" __global__ void __launch_bounds__(THREADS) condense(
    const double* __restrict__ tables, const int* __restrict__ counts, const int layers,
    const double* __restrict__ first, const double* __restrict__ second,
    const long long breadth, const long long waves, const double* __restrict__ base,
    double* __restrict__ stiffness, double* __restrict__ compliance) {
    const long long w = blockIdx.x * (long long)THREADS + threadIdx.x;
    if (w >= waves) return;
    double f[9];
    f[0] = 1.0;
    if constexpr (LATERAL == 1) {
        sincos(first[w], &f[2], &f[1]);
    } else {
        const double x = first[w / breadth], y = second[w % breadth];
        sincos(x, &f[1 + LATERAL * 2], &f[1]);
        sincos(y, &f[2 + LATERAL * 2], &f[2]);
        sincos(x + y, &f[3 + LATERAL * 2], &f[3]);
        sincos(x - y, &f[4 + LATERAL * 2], &f[4]);
    }
    Symmetric<2 * R> whole, power;
    bool begun = false;
    for (int layer = 0; layer < layers; ++layer) {
        const double* table = tables + (long long)layer * (R * (2 * R + 1)) * FUNCTIONS;
        #pragma unroll
        for (int e = 0; e < R * (2 * R + 1); ++e) {
            double sum = 0.0;
            #pragma unroll
            for (int m = 0; m < FUNCTIONS; ++m) sum += table[e * FUNCTIONS + m] * f[m];
            power.v[e] = sum;
        }
        for (int rest = counts[layer]; rest > 0; rest >>= 1) {
            if (rest & 1) {
                if (begun) join(whole, power, whole);
                else whole = power;
                begun = true;
            }
            if (rest > 1) join(power, power, power);
        }
    }
    // Last come the unknowns that forces act on.
    constexpr int order[INNER + D] = {ORDER};
    Symmetric<INNER + D> face;
    #pragma unroll
    for (int i = 0; i < INNER + D; ++i) {
        #pragma unroll
        for (int j = i; j < INNER + D; ++j) face(i, j) = whole(order[i], order[j]);
    }
    if (base) {
        #pragma unroll
        for (int i = 0, e = 0; i < D; ++i) {
            #pragma unroll
            for (int j = i; j < D; ++j, ++e) face(i, j) += base[e * waves + w];
        }
    }
    eliminate<INNER + D, INNER>(face);
    Symmetric<2 * D> inverse;
    #pragma unroll
    for (int i = 0, e = 0; i < D; ++i) {
        #pragma unroll
        for (int j = 0; j < D; ++j) {
            inverse(i, D + j) = i == j ? 1.0 : 0.0;
            if (j < i) continue;
            inverse(D + i, D + j) = 0.0;
            stiffness[e * waves + w] = inverse(i, j) = face(INNER + i, INNER + j);
            ++e;
        }
    }
    eliminate<2 * D, D>(inverse);
    #pragma unroll
    for (int i = 0, e = 0; i < D; ++i) {
        #pragma unroll
        for (int j = i; j < D; ++j, ++e) compliance[e * waves + w] = -inverse(D + i, D + j);
    }
}
"""


def source(unknowns: int, dim: int, inner: Sequence[int]) -> str:
    """The kernel for elements of so many unknowns a node; `inner` unknowns of the whole slab are
    eliminated at last.
    """
    order = [*inner, *range(dim)]
    known = {
        "R": unknowns, "D": dim, "LATERAL": dim - 1, "FUNCTIONS": 3 if dim == 2 else 9,
        "INNER": len(inner), "THREADS": _THREADS, "ORDER": ", ".join(map(str, order)),
        "JOINED": "__forceinline__" if unknowns <= 3 else "__noinline__",
    }  # fmt: skip
    return "".join(f"#define {name} {value}\n" for name, value in known.items()) + SOURCE


def condensed(column: Column, phases: Sequence[Any], base: Any) -> tuple[Any, Any]:
    """As `contact.spectral.wave_condensation.condensed`, by CuPy arrays."""
    cupy = sys.modules["cupy"]
    r, d = column.tables.shape[1] // 2, column.dim
    waves = int(np.prod([p.size for p in phases]))
    upper = np.triu_indices(2 * r)
    tables = cupy.asarray(np.ascontiguousarray(column.tables[:, upper[0], upper[1]]))
    counts = cupy.asarray(np.array(column.counts, dtype=np.int32))
    stiffness, compliance = (cupy.empty((d * (d + 1) // 2, waves)) for _ in range(2))
    kernel = _kernel(source(r, d, column.eliminated))
    kernel(
        (-(-waves // _THREADS),), (_THREADS,),
        (tables, counts, np.int32(len(column.counts)), phases[0], phases[-1],
         np.int64(phases[-1].size), np.int64(waves),
         np.uint64(0) if base is None else base, stiffness, compliance),
    )  # fmt: skip
    return stiffness, compliance


@functools.cache
def _kernel(text: str) -> Any:
    cupy = sys.modules["cupy"]
    return cupy.RawModule(code=text, options=("--std=c++17",)).get_function("condense")
