"""A 4D-Var window on a CUDA device: the start of a tracer on n x n cells from noisy snapshots.

A steady flow on a periodic square, 100 steps, Adini's profile. Every tenth step all nodes report
their value, with noise of deviation .05. The start is sought by 50 steps of conjugate gradients on

    J(v) = |v|^2 / 2 + sum_k |H M_k L v - y_k|^2 / (2 sigma^2),

where L is the root of the background's covariance, a filter in Fourier space that also gives the
slopes, and M_k the run up to the k-th snapshot: each step is one tangent and one adjoint run of the
window by ``solver.tangent`` and its transpose, all on the device. The reports come from exact
characteristics of the flow, not from the scheme.

    python benchmarks/assimilation_device.py --cells 4096 --write
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

# The folder of this script holds cip.py: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from machine import describe

from cip import Grid, Solver, Velocity

ROOT = Path(__file__).parents[1]
DT, STEPS, EVERY, NOISE, LENGTH = 0.01, 100, 10, 0.05, 0.05


class Background:
    """The root L of a covariance: from n x n numbers to the three moments of a state."""

    def __init__(self, cells: int, xp: Any) -> None:
        self.xp, self.cells = xp, cells
        k = 2 * np.pi * xp.fft.fftfreq(cells, 1.0 / cells)[:, None]
        l = 2 * np.pi * xp.fft.rfftfreq(cells, 1.0 / cells)[None, :]
        spectrum = xp.exp(-0.25 * LENGTH**2 * (k**2 + l**2))
        one = xp.zeros((cells, cells))
        one[0, 0] = 1.0
        variance = xp.fft.irfft2(spectrum**2 * xp.fft.rfft2(one), s=one.shape)[0, 0]
        self.filter = spectrum / xp.sqrt(variance)
        # The slope of the shortest wave of an even number of nodes is zero at all of them.
        self.slopes = (1j * k * (abs(k) < np.pi * cells), 1j * l * (abs(l) < np.pi * cells))

    def moments(self, v: Any) -> Any:
        """L v, shape (3, n, n)."""
        fft, waves = self.xp.fft, self.filter * self.xp.fft.rfft2(v)
        parts = [waves, *(slope * waves for slope in self.slopes)]
        return self.xp.stack([fft.irfft2(part, s=v.shape) for part in parts])

    def transposed(self, m: Any) -> Any:
        """L^T m, shape (n, n)."""
        fft = self.xp.fft
        waves = fft.rfft2(m[0])
        for slope, part in zip(self.slopes, m[1:], strict=True):
            waves = waves - slope * fft.rfft2(part)
        return fft.irfft2(self.filter * waves, s=m[0].shape)


def truth(x: Any, y: Any, t: float, xp: Any, steps: int = 400) -> Any:
    """The tracer at time t, by characteristics of the flow followed back with small steps."""
    h = -t / steps if t else 0.0

    def flow(x: Any, y: Any) -> tuple[Any, Any]:
        return xp.sin(2 * np.pi * y), -xp.sin(2 * np.pi * x)

    for _ in range(steps if t else 0):
        a, b = flow(x, y)
        c, d = flow(x + h / 2 * a, y + h / 2 * b)
        e, f = flow(x + h / 2 * c, y + h / 2 * d)
        g, i = flow(x + h * e, y + h * f)
        x, y = x + h / 6 * (a + 2 * c + 2 * e + g), y + h / 6 * (b + 2 * d + 2 * f + i)
    return xp.sin(2 * np.pi * x) * xp.cos(4 * np.pi * y) + 0.5 * xp.cos(6 * np.pi * (x + y))


def measure(cells: int, iterations: int, xp: Any) -> dict[str, Any]:
    """Seconds of the set-up and of the iterations, and what became of the start."""
    grid = Grid([(0, 1)] * 2, (cells, cells), periodic=True)
    flow = Velocity.from_expression("sin(2*pi*x2)", "-sin(2*pi*x1)")
    solver = Solver(grid, flow, profile="adini", backend="cpu" if xp is np else "cupy")
    begin = time.perf_counter()
    background, state = Background(cells, xp), solver.state(0.0)
    operators = []
    for _ in range(STEPS // EVERY):
        run = solver.run(state, state.t + EVERY * DT, dt=DT)
        operators.append(solver.tangent(run))
        state = run.final
    setup = time.perf_counter() - begin
    lines = [xp.asarray(line) for line in grid.coordinates]
    x, y = xp.meshgrid(*lines, indexing="ij")
    rng = xp.random.default_rng(0)
    reports = []
    for k in range(1, len(operators) + 1):
        reports.append(truth(x, y, k * EVERY * DT, xp))
        reports[-1] += NOISE * rng.standard_normal(reports[-1].shape)

    def forward(v: Any) -> list[Any]:
        z, values = background.moments(v).ravel(), []
        for operator in operators:
            z = operator @ z
            values.append(z[: cells * cells].reshape(cells, cells))
        return values

    def backward(values: list[Any]) -> Any:
        z = xp.zeros(3 * cells * cells)
        for operator, value in zip(operators[::-1], values[::-1], strict=True):
            z[: cells * cells] += value.ravel() / NOISE**2
            z = operator.T @ z
        return background.transposed(z.reshape(3, cells, cells))

    begin = time.perf_counter()
    v = xp.zeros((cells, cells))
    r = backward(reports)
    p, size, first = r.copy(), float(xp.vdot(r, r)), float(xp.vdot(r, r))
    for _ in range(iterations):
        q = p + backward(forward(p))
        alpha = size / float(xp.vdot(p, q))
        v, r = v + alpha * p, r - alpha * q
        size, before = float(xp.vdot(r, r)), size
        p = r + size / before * p
    found, exact = background.moments(v)[0], truth(x, y, 0.0, xp)
    error = float(xp.linalg.norm(found - exact) / xp.linalg.norm(exact))
    return {
        "cells": cells, "steps": STEPS, "iterations": iterations, "setup": setup,
        "window": time.perf_counter() - begin, "gradient": (size / first) ** 0.5,
        "error": error,
    }  # fmt: skip


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Measure, print, and write benchmarks/results/assimilation_device.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=256)
    parser.add_argument("--iterations", type=int, default=50)
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cuda")
    parser.add_argument("--write", action="store_true", help="keep the result in results/")
    options = parser.parse_args(argv)
    record: dict[str, Any] = {"benchmark": "assimilation_device", "machine": describe()}
    xp: Any = np
    if options.device == "cuda":
        import cupy as xp

        name = xp.cuda.runtime.getDeviceProperties(0)["name"]
        record["device"] = name.decode() if isinstance(name, bytes) else str(name)
        measure(64, 2, xp)  # compiles
    record["window"] = found = measure(options.cells, options.iterations, xp)
    if options.device == "cuda":
        found["memory"] = xp.get_default_memory_pool().total_bytes() / 1e9
    print(", ".join(f"{k} {v:.4g}" for k, v in found.items()))
    if options.write:
        path = ROOT / "benchmarks" / "results" / "assimilation_device.json"
        path.write_text(json.dumps(record, indent=1) + "\n")
    return record


if __name__ == "__main__":
    main()
