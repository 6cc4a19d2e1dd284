"""Contact of meshed bodies with friction, condensed and solved on the host and on a CUDA device.

A block of n x n Adini rectangles, a cube of n x n x n trilinear bricks and a part of quadratic
tetrahedra with a curved underside, read from a .msh file, are pressed on a bowl and dragged.
Seconds from the mesh, or the file, to the certified result in their parts. "first" is the total of
the first run in the process, which loads kernels or the host's solver; it is followed by three of
the bodies that are solved on the host too, of which the median counts, else by one. The stiffness
is assembled in the condensation, and once more alone. Two runs in the deterministic mode must have
the same results to the last bit. Histories drag the cube on in equal steps on one condensation.

    python benchmarks/contact_device.py --adini 256 1024 --hex1 64 88 --part 34 --history 64
"""

from __future__ import annotations

import argparse
import gc
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from machine import describe
from skfem import ElementHex1, ElementTetP2, MeshHex, MeshQuad, MeshTet

from contact import ContactProblem, ContactResult, ElasticBody, LoadStepper
from contact.result.certify import certify
from skfem_adini import ElementQuadAdini
from skfem_adini.ground.pardiso import has_pardiso

FRICTION = {"adini": 0.9, "hex1": 0.3, "part": 0.3}
ELEMENTS = {"adini": ElementQuadAdini, "hex1": ElementHex1, "part": ElementTetP2}
HOST = {"adini": 256, "hex1": 32, "part": 14}  # larger bodies are not repeated on the host


def mesh_of(body: str, n: int, folder: Path) -> Any:
    """The mesh, or the file that holds it, with boundaries named bottom and top."""
    if body == "part":
        path = folder / f"part{n}.msh"
        if not path.exists():
            write_part(path, n)
        return path
    kind, dim = (MeshQuad, 2) if body == "adini" else (MeshHex, 3)
    mesh = kind.init_tensor(*[np.linspace(0.0, 1.0, n + 1)] * dim)
    ends = {"bottom": lambda x: x[-1] < 1e-9, "top": lambda x: x[-1] > 1.0 - 1e-9}
    return mesh.with_boundaries(ends)


def write_part(path: Path, n: int) -> None:
    """A cube of tetrahedra, its underside bulged and its sides drawn in, as a file of Gmsh."""
    flat = MeshTet.init_tensor(*[np.linspace(0.0, 1.0, n + 1)] * 3)
    outer = flat.boundary_facets()
    height = flat.p[2][flat.facets[:, outer]]
    ends = [outer[(np.abs(height - z) < 1e-9).all(axis=0)] for z in (0.0, 1.0)]
    x = flat.p.copy()
    x[2] += 0.04 * (1.0 - flat.p[2]) * np.sum((flat.p[:2] - 0.5) ** 2, axis=0)
    x[:2] = 0.5 + (flat.p[:2] - 0.5) * (1.0 - 0.2 * np.sin(np.pi * flat.p[2]) ** 2)
    blocks = [("tetra", flat.t.T), *(("triangle", flat.facets[:, end].T) for end in ends)]
    tags = [np.full(len(cells), tag) for tag, (_, cells) in zip((3, 1, 2), blocks, strict=True)]
    names = {"bottom": np.array([1, 2]), "top": np.array([2, 2]), "body": np.array([3, 3])}
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    meshio.write(
        path, meshio.Mesh(x.T, blocks, cell_data=data, field_data=names), file_format="gmsh22"
    )


def bowl(x: Any) -> Any:
    """Height of the obstacle."""
    return 0.2 * np.sum((x[:-1] - 0.45) ** 2, axis=0)


def posed(body: str, mesh: Any) -> ContactProblem:
    """The body with its top moved down and sideways."""
    element = ELEMENTS[body]()
    solid = ElasticBody.from_mesh(mesh, element, E=2.0, nu=0.3)
    solid.fix("top", "xyz"[element.dim - 1], -0.05).fix("top", "x", lambda x: 0.02 + 0.01 * x[0])
    if element.dim == 3:
        solid.fix("top", "y")
    return ContactProblem(solid, "bottom", bowl, FRICTION[body])


def measure(
    body: str, n: int, device: str, folder: Path, deterministic: bool = False
) -> tuple[dict[str, Any], ContactProblem, ContactResult]:
    """Pose, condense and solve; the certificate, a part of contact, once more alone."""
    mesh = mesh_of(body, n, folder)
    ticks = [time.perf_counter()]
    problem = posed(body, mesh)
    ticks.append(time.perf_counter())
    condensed = problem.condense(device, deterministic)
    ticks.append(time.perf_counter())
    result = problem.solve()
    ticks.append(time.perf_counter())
    certify(result, result.tol, 0.0)
    ticks.append(time.perf_counter())
    names = ("pose", "condensation", "contact", "certificate")
    row = {
        "body": body, "n": n, "device": device, "unknowns": problem.body.f.size,
        "boundary": condensed.unknowns, "points": problem.rows.gap.size,
        "active": int((result.mu > 0).sum()), "steps": len(result.history),
        "seconds": dict(zip(names, np.diff(ticks).tolist(), strict=True)),
        "total": ticks[3] - ticks[0], "residual": max(result.kkt.values()),
        "deterministic": deterministic,
    }  # fmt: skip
    return row, problem, result


def difference(ours: ContactResult, host: ContactResult) -> dict[str, float]:
    """Largest differences of multipliers and displacement, relative to the largest."""
    size = float(host.mu.max())
    forces = max(np.abs(ours.mu - host.mu).max(), np.abs(ours.t - host.t).max())
    return {
        "multipliers": float(forces) / size,
        "displacement": float(np.abs(ours.u - host.u).max() / np.abs(host.u).max()),
    }


def identical(one: ContactResult, other: ContactResult) -> bool:
    """Whether two results are the same to the last bit."""
    return all(np.array_equal(getattr(one, x), getattr(other, x)) for x in ("u", "mu", "t"))


def stiffness_alone(body: str, n: int, folder: Path) -> dict[str, float]:
    """Seconds that the stiffness takes on the host, and on the device if it is assembled there.

    The second time in the process.
    """
    import cupy

    def there(solid: ElasticBody) -> bool:
        assembled = solid.stiffness_on(cupy) is not None
        cupy.cuda.Device().synchronize()
        return assembled

    seconds: dict[str, float] = {}
    for _ in range(2):
        solid = posed(body, mesh_of(body, n, folder)).body
        ticks = [time.perf_counter()]
        assembled = there(solid)
        ticks.append(time.perf_counter())
        _ = solid.stiffness
        ticks.append(time.perf_counter())
        seconds = dict(zip(("cuda", "cpu"), np.diff(ticks).tolist(), strict=True))
        if not assembled:
            del seconds["cuda"]
    return seconds


def middle(
    body: str, n: int, device: str, folder: Path, repeats: int
) -> tuple[dict[str, Any], ContactResult]:
    """The run with the median total after a first one, and the last result."""
    rows: list[dict[str, Any]] = []
    for _ in range(repeats + 1):
        gc.collect()  # what the run before kept on the device
        row, _, result = measure(body, n, device, folder)
        rows.append(row)
    totals = sorted(row["total"] for row in rows[1:])
    found = next(row for row in rows[1:] if row["total"] == totals[len(totals) // 2])
    return found | {"first": rows[0]["total"], "spread": [totals[0], totals[-1]]}, result


def row_of(body: str, n: int, folder: Path, warm: bool, repeat: bool) -> list[dict[str, Any]]:
    """Measure one body on the device, twice for its bits, and on the host where that is small."""
    if not warm:
        measure(body, min(n, 12), "cuda", folder)
    alone, small = stiffness_alone(body, n, folder), n <= HOST[body]
    row, there = middle(body, n, "cuda", folder, 3 if small else 1)
    row["assembly"] = alone
    rows = [row]
    if repeat and small:  # elsewhere solutions one by one take minutes
        one = measure(body, n, "cuda", folder, deterministic=True)[2]
        gc.collect()
        again, _, other = measure(body, n, "cuda", folder, deterministic=True)
        again |= {"identical": identical(one, other), "cost": again["total"] / row["total"]}
        rows.append(again | difference(other, there))
    if small:
        beside, host = middle(body, n, "cpu", folder, 3)
        row |= difference(there, host) | {"speedup": beside["total"] / row["total"]}
        beside["assembly"] = alone
        rows.append(beside)
    return rows


def history(n: int, steps: int, folder: Path) -> dict[str, Any]:
    """Seconds of a history of the cube on one condensation beside those of a cold solve."""
    cold, problem, _ = measure("hex1", n, "cuda", folder)
    stepper = LoadStepper(problem).move("top", "x", 0.03)
    begin = time.perf_counter()
    results = stepper.run(np.linspace(0.0, 1.0, steps + 1)[1:]).results
    seconds = time.perf_counter() - begin
    return {
        "body": "hex1", "n": n, "device": "cuda", "history": steps, "total": seconds,
        "cold": cold["total"], "cold solves": seconds / cold["total"],
        "residual": max(max(result.kkt.values()) for result in results),
        "newton steps": sum(len(result.history) for result in results),
    }  # fmt: skip


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_device.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for body, sizes in (("adini", [256, 1024]), ("hex1", [32, 64, 88]), ("part", [14, 34])):
        parser.add_argument(f"--{body}", type=int, nargs="*", default=sizes)
    parser.add_argument("--history", type=int, nargs="*", default=[64])
    parser.add_argument("--load-steps", type=int, default=100)
    parser.add_argument("--no-repeat", dest="repeat", action="store_false")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)
    import cupy

    name = cupy.cuda.runtime.getDeviceProperties(0)["name"]
    record: dict[str, Any] = {
        "benchmark": "contact_device", "machine": describe(),
        "device": name.decode() if isinstance(name, bytes) else str(name),
        "host solver": "pardiso" if has_pardiso() else "superlu", "rows": [],
    }  # fmt: skip
    options.output.mkdir(parents=True, exist_ok=True)

    def keep(rows: list[dict[str, Any]]) -> None:
        record["rows"] += rows
        print(*rows, sep="\n", flush=True)
        path = options.output / "contact_device.json"
        path.write_text(json.dumps(record, indent=1) + "\n")
        gc.collect()
        cupy.get_default_memory_pool().free_all_blocks()

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for body in ("adini", "hex1", "part"):
            for i, n in enumerate(getattr(options, body)):
                keep(row_of(body, n, folder, i > 0, options.repeat))
        for n in options.history:
            keep([history(n, options.load_steps, folder)])
    return record


if __name__ == "__main__":
    main()
