"""Contact of a cube whose factors several GPUs of a process share.

A cube of n x n x n trilinear bricks is pressed on a bowl and dragged, as in contact_device.py. Its
contact rows are too many for a dense compliance: Newton's steps are solved by Krylov's method, and
each product is a solution by the factors. Seconds of each part, and the most memory that each GPU
held at once, beyond what it held before.

    python benchmarks/contact_gpus.py --hex1 64 88 --large 100 --gpus 1 2
"""

from __future__ import annotations

import argparse
import gc
import json
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from contact_device import FRICTION, bowl, difference, mesh_of, posed
from machine import describe

from contact import ContactProblem, ContactResult


class Watch:
    """The most memory that each GPU held at once while this context was open, in GB."""

    def __init__(self, count: int) -> None:
        self._count, self._done = count, threading.Event()

    def __enter__(self) -> Watch:
        self._before = [self._held(i) for i in range(self._count)]
        self._most = list(self._before)
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._done.set()
        self._thread.join()

    def gigabytes(self) -> list[float]:
        """Most less what was held before, of each GPU."""
        return [(m - b) / 1e9 for m, b in zip(self._most, self._before, strict=True)]

    def _look(self) -> None:
        while not self._done.wait(0.02):
            self._most = [max(m, self._held(i)) for i, m in enumerate(self._most)]

    @staticmethod
    def _held(gpu: int) -> int:
        import cupy

        with cupy.cuda.Device(gpu):
            free, total = cupy.cuda.runtime.memGetInfo()
        return int(total - free)


class Counted:
    """Factors that count their solutions, and the seconds that these take."""

    def __init__(self, factors: Any) -> None:
        self._factors, self.count, self.seconds = factors, 0, 0.0

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._factors, name)
        if name not in ("at", "once", "solve"):
            return method

        def timed(*given: Any) -> Any:
            begin = time.perf_counter()
            found = method(*given)
            self.count += 1
            self.seconds += time.perf_counter() - begin
            return found

        return timed


def on_gpus(body: Any, n: int, gpus: int) -> tuple[dict[str, Any], ContactResult]:
    """Condense and solve on so many GPUs."""
    device = tuple(f"cuda:{i}" for i in range(gpus))
    problem = ContactProblem(body, "bottom", bowl, FRICTION["hex1"])
    with Watch(gpus) as watch:
        ticks = [time.perf_counter()]
        condensed = problem.condense(device)
        ticks.append(time.perf_counter())
        part: Any = condensed.parts[0]
        statistics = part.statistics()
        part._solver = solver = Counted(part._solver)
        result = problem.solve()
        ticks.append(time.perf_counter())
    row = {
        "body": "hex1", "n": n, "gpus": gpus, "unknowns": body.f.size,
        "rows": condensed.B.shape[0], "condensation": ticks[1] - ticks[0],
        "contact": ticks[2] - ticks[1], "solutions": solver.count, "solving": solver.seconds,
        "steps": len(result.history), "residual": max(result.kkt.values()),
        "entries": statistics["entries"], "estimated GB": statistics["device"] / 1e9,
        "factor GB": [used / 1e9 for used in statistics["used"]], "peak GB": watch.gigabytes(),
    }  # fmt: skip
    return row, result


def row_of(n: int, counts: list[int], folder: Path, keep: Any) -> None:
    """Measure one cube on each number of GPUs; they must find the same."""
    begin = time.perf_counter()
    body = posed("hex1", mesh_of("hex1", n, folder)).body
    _ = body.stiffness
    before, first = time.perf_counter() - begin, None
    for gpus in counts:
        row, result = on_gpus(body, n, gpus)
        row["pose and assembly"] = before
        if first is None:
            first = result
        else:
            row |= difference(result, first)
        keep(row)
        gc.collect()


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_gpus.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hex1", type=int, nargs="*", default=[64, 88])
    parser.add_argument("--large", type=int, nargs="*", default=[100], help="on most GPUs alone")
    parser.add_argument("--gpus", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    import cupy

    name = cupy.cuda.runtime.getDeviceProperties(0)["name"]
    record: dict[str, Any] = {
        "benchmark": "contact_gpus", "machine": describe(),
        "device": name.decode() if isinstance(name, bytes) else str(name), "rows": [],
    }  # fmt: skip
    options.output.mkdir(parents=True, exist_ok=True)

    def keep(row: dict[str, Any]) -> None:
        record["rows"].append(row)
        print(row, flush=True)
        path = options.output / "contact_gpus.json"
        path.write_text(json.dumps(record, indent=1) + "\n")

    def warm_up(row: dict[str, Any]) -> None:
        print("warm-up:", row, flush=True)

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        row_of(20, options.gpus, folder, warm_up)
        for n in options.hex1:
            row_of(n, options.gpus, folder, keep)
        for n in options.large:
            row_of(n, [max(options.gpus)], folder, keep)
    return record


if __name__ == "__main__":
    main()
