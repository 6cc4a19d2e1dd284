"""Closed form, fast assembly, write floor and trigonometric solver, against what they replace.

In one run on uniform meshes of the unit square:

1. building a basis: the closed-form element against the same element through scikit-fem's
   ElementGlobal (which always computes second derivatives; a line shows the closed form with them);
2. the matrix: scikit-fem's Basis and asm against `assemble`, on a mesh object that nothing was
   computed for before, congruence detection included, compilation excluded and printed apart. Two
   more meshes show what is gained where fewer cells are bitwise equal;
3. the floor: allocating and writing three arrays of the sizes of indptr, indices and data, once
   into fresh pages (np.empty and a fill, by one thread: what any assembly has to do) and once into
   pages that were touched before;
4. elasticity on tetrahedra of second order, no two of them congruent: scikit-fem's Basis and asm
   against `AffineCells`, which needs no shape functions but those of the reference cell;
5. meshes and forms of which no two cells have the same matrix: a random twist, a coefficient of
   each cell (as in the loop of topology optimisation), and bricks of width 1/12, equal up to
   rounding, beside those of 1/16. Both ways take turns in one process, and the medians of the
   processor's time and of the clock count; `assemble` should never need more than scikit-fem;
6. -div grad u = f with u = 0: `UniformSolver` against PARDISO, set-up and solution; f is a random
   load vector, residuals are relative to it, in the dofs u, h u_x, h u_y.

The least of several runs counts, two for scikit-fem. What was expected before measuring: at 256^2
the matrix has 5.3 million entries, 64 MB with 32-bit indices. At about 10 GB/s that is 7 ms, and
twice as much into fresh pages. Each of 66049 vertices needs about 0.2 microseconds for the search
of its neighbours, twice; one element matrix through Python costs 5 to 10 ms: altogether two to
three times the floor. scikit-fem makes 9.4 million triples, evaluates 16 quadrature points for
each, and sorts: some seconds.

    python benchmarks/assembly.py
    python benchmarks/assembly.py --only-irregular    # part 5 alone, into the same file
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from skfem import (
    Basis,
    BilinearForm,
    ElementHex1,
    ElementTetP2,
    ElementVector,
    MeshHex,
    MeshQuad,
    MeshTet,
)
from skfem.element import ElementGlobal
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace
from skfem.refdom import RefQuad

from skfem_adini import (
    AffineCells,
    ElementQuadAdini,
    UniformSolver,
    assemble,
    essential_dofs,
    factorize,
)
from skfem_adini.ground.pardiso import has_pardiso
from skfem_adini.solvers.exact_matrices import exact_matrix

TARGETS = {
    "basis": 12.0,
    "laplace": 60.0,
    "elasticity": 60.0,
    "floor": 3.0,
    "solver": 30.0,
    "residual": 1e-13,
    "irregular": 1.0,
}


class ElementQuadAdiniGlobal(ElementGlobal):
    """Adini's element in monomials of the global coordinates, as ElementGlobal makes it."""

    nodal_dofs = 3
    maxdeg = 3
    dofnames = ["u", "u_x", "u_y"]  # noqa: RUF012
    doflocs = ElementQuadAdini.doflocs
    refdom = RefQuad
    exponents = tuple((i, j) for i in range(4) for j in range(4) if i + j < 4 or {i, j} == {1, 3})

    def _pbasis_init(self, maxdeg: int, dim: int, Ndiff: int, is_tensorial: bool = False) -> None:
        self._pbasis = {
            diff: [
                self._pbasis_create(i=i, j=j, dx=diff.count(0), dy=diff.count(1))
                for i, j in self.exponents
            ]
            for order in range(Ndiff + 1)
            for diff in product(range(dim), repeat=order)
        }

    def gdof(self, F: Any, w: Any, i: int) -> Any:
        """Return dof i of the function with the derivatives F."""
        return F[((), (0,), (1,))[i % 3]](*w["v"][i // 3])


def seconds(work: Callable[[], Any], repeats: int) -> float:
    """Return the least time: what else runs on the machine can only add to it."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - begin)
        del result
    return min(times)


def square(n: int) -> Any:
    """Return n x n equal cells of the unit square, in a new mesh."""
    ticks = np.linspace(0, 1, n + 1)
    return MeshQuad.init_tensor(ticks, ticks)


def turned(n: int) -> Any:
    """Return the square turned by 0.3: no two cells are bitwise equal any more."""
    mesh, (c, s) = square(n), (np.cos(0.3), np.sin(0.3))
    return MeshQuad(np.array([[c, -s], [s, c]]) @ mesh.p, mesh.t)


def twisted(n: int) -> Any:
    """Return the square with vertices moved at random: no two cells are alike."""
    mesh = square(n)
    moved = np.random.default_rng(0).uniform(-0.1 / n, 0.1 / n, mesh.p.shape)
    return MeshQuad(mesh.p + moved, mesh.t)


def bricks(n: int) -> Any:
    """Return n x n x n equal cells of the unit cube."""
    ticks = np.linspace(0, 1, n + 1)
    return MeshHex.init_tensor(ticks, ticks, ticks)


def irregular(n: int, repeats: int) -> dict[str, Any]:
    """Measure cells that are unlike, by turns; `share` is the part of scikit-fem's time."""
    stiffness = BilinearForm(lambda u, v, w: w.k * (u.grad * v.grad).sum(axis=0))
    k = np.random.default_rng(1).uniform(1e-3, 1, n * n)
    adini = ElementQuadAdini()
    problems: list[tuple[str, Any, Any, Callable[[], Any], dict[str, Any]]] = [
        (f"random twist, {n} x {n}", laplace, adini, lambda: twisted(n), {}),
        (f"coefficient of each cell, {n} x {n}", stiffness, adini, lambda: square(n), {"k": k}),
        ("bricks, 12 x 12 x 12", laplace, ElementHex1(), lambda: bricks(12), {}),
        ("bricks, 16 x 16 x 16", laplace, ElementHex1(), lambda: bricks(16), {}),
    ]
    lines = []
    for name, form, element, mesh, given in problems:
        wide = {key: value[:, None] for key, value in given.items()}
        ways: dict[str, Callable[[Any], Any]] = {
            "assemble": lambda own: assemble(form, own, element, **given),  # noqa: B023
            "scikit-fem": lambda own: form.assemble(Basis(own, element), **wide),  # noqa: B023
        }
        times: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
        found = {way: work(mesh()) for way, work in ways.items()}
        for _ in range(repeats):
            for way, work in ways.items():
                own, begin, processor = mesh(), time.perf_counter(), time.process_time()
                work(own)
                times[way].append((time.process_time() - processor, time.perf_counter() - begin))
        expected = found["scikit-fem"]
        line: dict[str, Any] = {"problem": name, "unknowns": expected.shape[0]}
        line["difference"] = float(np.abs(found["assemble"] - expected).max())
        line["difference"] /= float(np.abs(expected).max())
        for way, each in times.items():
            line[way], line[f"{way}, clock"] = np.median(each, axis=0).tolist()
        line["share"] = line["assemble"] / line["scikit-fem"]
        line["share, clock"] = line["assemble, clock"] / line["scikit-fem, clock"]
        print(
            f"{name}: assemble {line['assemble']:.3f} s, scikit-fem {line['scikit-fem']:.3f} s, "
            f"share {line['share']:.2f} (clock {line['share, clock']:.2f}); difference "
            f"{line['difference']:.1e}",
            flush=True,
        )
        lines.append(line)
    return {"machine": describe(), "repeats": repeats, "rows": lines}


def bases(n: int, repeats: int) -> dict[str, Any]:
    """Measure the building of bases."""
    line: dict[str, Any] = {"n": n}
    line["closed form"] = seconds(lambda: Basis(square(n), ElementQuadAdini()), repeats)
    line["closed form, second derivatives"] = seconds(
        lambda: Basis(square(n), ElementQuadAdini(derivatives=2)), repeats
    )
    line["ElementGlobal"] = seconds(lambda: Basis(square(n), ElementQuadAdiniGlobal()), 1)
    line["ratio"] = line["ElementGlobal"] / line["closed form"]
    print(
        f"basis {n}^2: ElementGlobal {line['ElementGlobal']:.2f} s, closed form "
        f"{line['closed form']:.3f} s (with second derivatives "
        f"{line['closed form, second derivatives']:.3f} s), ratio {line['ratio']:.1f}",
        flush=True,
    )
    return line


def floor(matrix: Any, repeats: int) -> dict[str, float]:
    """Measure the writing of the arrays of a CSR matrix."""
    parts = (matrix.indptr, matrix.indices, matrix.data)

    def fresh() -> list[Any]:
        arrays = [np.empty(part.size, part.dtype) for part in parts]
        for array in arrays:
            array.fill(1)
        return arrays

    arrays = fresh()

    def warm() -> None:
        for array in arrays:
            array.fill(2)

    return {
        "bytes": float(sum(part.nbytes for part in parts)),
        "fresh": seconds(fresh, repeats),
        "warm": seconds(warm, repeats),
    }


def matrices(
    name: str, form: Any, element: Any, mesh: Callable[[int], Any], n: int, repeats: int
) -> dict[str, Any]:
    """Measure the assembly of one matrix both ways."""
    found = assemble(form, mesh(n), element, fallback=False)
    meshes = [mesh(n) for _ in range(repeats)]
    line: dict[str, Any] = {"problem": name, "n": n, "unknowns": found.shape[0]}
    line["entries"] = int(found.nnz)
    line["assemble"] = seconds(lambda: assemble(form, meshes.pop(), element), repeats)
    line["floor"] = floor(found, repeats)
    both = []
    for _ in range(2):
        own = mesh(n)
        begin = time.perf_counter()
        basis = Basis(own, element)
        middle = time.perf_counter()
        expected = form.assemble(basis)
        both.append((time.perf_counter() - begin, middle - begin))
        del basis
    total, line["Basis"] = min(both)
    line["asm"] = total - line["Basis"]
    line["ratio"] = (line["Basis"] + line["asm"]) / line["assemble"]
    line["times the floor"] = line["assemble"] / line["floor"]["fresh"]
    line["times the warm floor"] = line["assemble"] / line["floor"]["warm"]
    line["difference"] = float(np.abs(found - expected).max() / np.abs(expected).max())
    if name == "laplace":
        line["error"] = {"assemble": error(found, n), "scikit-fem": error(expected, n)}
    print(
        f"{name:>17} {n}^2: scikit-fem {line['Basis']:.3f} + {line['asm']:.3f} s, assemble "
        f"{1e3 * line['assemble']:.1f} ms, ratio {line['ratio']:.1f}; write "
        f"{1e3 * line['floor']['fresh']:.1f} ms fresh, {1e3 * line['floor']['warm']:.1f} ms warm "
        f"({line['floor']['bytes'] / 1e6:.0f} MB): {line['times the floor']:.2f} and "
        f"{line['times the warm floor']:.2f} times; difference {line['difference']:.1e}",
        flush=True,
    )
    return line


def error(matrix: Any, n: int) -> float:
    """Return the largest error of the rows of an inner vertex, from exact fractions."""
    h = 1 / n
    dofs = np.arange(12)
    K = np.zeros((12, 12))
    for d in range(2):
        exact = exact_matrix(2, d, d)
        K += exact.numerators / exact.denominator
    scale = np.where(dofs % 3 == 0, 1.0, h)
    K *= scale[:, None] * scale
    mesh = square(n)
    vertex = (n // 2) * (n + 1) + n // 2
    rows = {dof: np.zeros(matrix.shape[1]) for dof in range(3)}
    for cell in np.flatnonzero((mesh.t == vertex).any(axis=0)):
        # exact_matrix counts the corners as binary numbers with x first.
        corners = mesh.t[:, cell]
        order = np.lexsort((mesh.p[1, corners], mesh.p[0, corners]))
        own = (3 * corners[order][:, None] + np.arange(3)).ravel()
        place = 3 * int(np.flatnonzero(corners[order] == vertex)[0])
        for dof in range(3):
            rows[dof][own] += K[place + dof]
    given = matrix[3 * vertex : 3 * vertex + 3].toarray()
    exact_rows = np.array([rows[dof] for dof in range(3)])
    return float(np.abs(given - exact_rows).max() / np.abs(exact_rows).max())


def tetrahedra(n: int, repeats: int) -> dict[str, Any]:
    """Measure the stiffness of a block of tetrahedra whose vertices are moved at random."""
    ticks, lam, mu = np.linspace(0, 1, n + 1), 1.5, 1.0
    regular = MeshTet.init_tensor(ticks, ticks, ticks)
    moved = np.random.default_rng(0).uniform(-0.1 / n, 0.1 / n, regular.p.shape)
    element, one = ElementVector(ElementTetP2()), np.eye(3)

    def mesh() -> Any:
        return MeshTet(regular.p + moved, regular.t)

    tensor = lam * np.einsum("ca,db->cadb", one, one)
    tensor += mu * (np.einsum("cd,ab->cadb", one, one) + np.einsum("cb,ad->cadb", one, one))
    AffineCells.of(Basis(MeshTet(), element)).matrix(tensor)  # compiles
    basis = Basis(mesh(), element)
    cells = AffineCells.of(basis)
    line: dict[str, Any] = {"n": n, "cells": int(basis.nelems), "unknowns": int(basis.N)}
    line["AffineCells"] = seconds(lambda: AffineCells.of(basis).matrix(tensor), repeats)
    line["Basis"] = seconds(lambda: Basis(mesh(), element), 2)
    form = linear_elasticity(lam, mu)
    line["asm"] = seconds(lambda: form.assemble(basis), 2)
    expected, found = form.assemble(basis), cells.matrix(tensor)
    line["difference"] = float(abs(found - expected).max() / abs(expected).max())
    line["ratio"] = line["asm"] / line["AffineCells"]
    print(
        f"P2 tetrahedra, {line['unknowns']} unknowns: scikit-fem Basis {line['Basis']:.2f} s, asm "
        f"{line['asm']:.2f} s, AffineCells {1e3 * line['AffineCells']:.0f} ms, ratio to asm "
        f"{line['ratio']:.1f}; difference {line['difference']:.1e}",
        flush=True,
    )
    return line


def solvers(n: int, repeats: int) -> dict[str, Any]:
    """Measure the two solvers from nothing to the solution."""
    mesh, element = square(n), ElementQuadAdini()
    A = assemble(laplace, mesh, element)
    basis = Basis(mesh, element)
    h = np.tile([1.0, 1 / n, 1 / n], basis.N // 3)
    # A smooth load would be smaller, by its condition, than what the rounding of x leaves of it.
    f = h * np.random.default_rng(0).uniform(-1, 1, basis.N)
    free = UniformSolver((n, n)).free
    K, load = A[free][:, free].tocsr(), f[free]
    fixed = essential_dofs(basis, mesh.boundary_facets())
    if not np.array_equal(np.setdiff1d(np.arange(basis.N), fixed), free):
        raise RuntimeError("the two ways to name the free dofs differ")
    peer = "pardiso" if has_pardiso() else "superlu"
    line: dict[str, Any] = {"n": n, "unknowns": int(free.size), "peer": peer}
    ways: dict[str, Callable[[], Any]] = {
        "UniformSolver": lambda: UniformSolver((n, n)).solve(f)[free],
        peer: lambda: factorize(K, solver=peer).solve(load),
    }
    for name, solve in ways.items():
        x = solve()
        line[name] = seconds(solve, repeats)
        # In the dofs u, h u_x, h u_y, where all rows have one size.
        r = (load - K @ x) / h[free]
        line[f"{name} residual"] = float(np.linalg.norm(r) / np.linalg.norm(load / h[free]))
    line["ratio"] = line[peer] / line["UniformSolver"]
    print(
        f"solver {n}^2: {peer} {line[peer]:.3f} s (residual {line[f'{peer} residual']:.0e}), "
        f"UniformSolver {1e3 * line['UniformSolver']:.1f} ms (residual "
        f"{line['UniformSolver residual']:.0e}), ratio {line['ratio']:.1f}",
        flush=True,
    )
    return line


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/assembly.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=256, help="cells a side; elasticity has half")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--results", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--only-irregular", action="store_true", help="part 5 alone")
    options = parser.parse_args(argv)
    n, repeats = options.n, options.repeats
    path = options.results / "assembly.json"
    if options.only_irregular:
        assemble(laplace, square(2), ElementQuadAdini())  # compiles
        known: dict[str, Any] = json.loads(path.read_text())
        known["irregular"] = irregular(n // 2, repeats)
        known["targets"]["irregular"] = TARGETS["irregular"]
        known["reached"]["irregular"] = _never_slower(known)
        path.write_text(json.dumps(known, indent=1) + "\n")
        return known

    scalar, vector = ElementQuadAdini(), ElementVector(ElementQuadAdini())
    elasticity = linear_elasticity(1.5, 1.0)
    begin = time.perf_counter()
    assemble(laplace, square(2), scalar)
    first = time.perf_counter() - begin
    begin = time.perf_counter()
    assemble(laplace, square(2), scalar)
    compilation = first - (time.perf_counter() - begin)
    print(f"compilation of the kernels: {compilation:.2f} s (not in the ratios)")

    record: dict[str, Any] = {
        "benchmark": "assembly",
        "machine": describe(),
        "repeats": repeats,
        "compilation": compilation,
        "targets": TARGETS,
        "matrices": [
            matrices("laplace", laplace, scalar, square, n, repeats),
            matrices("elasticity", elasticity, vector, square, n // 2, repeats),
            matrices("laplace, 25/32 n", laplace, scalar, square, 25 * n // 32, 3),
            matrices("laplace, turned", laplace, scalar, turned, n // 2, 3),
        ],
        "tetrahedra": tetrahedra(max(n // 16, 2), min(repeats, 3)),
        "irregular": irregular(n // 2, repeats),
        "solver": solvers(n, repeats),
        "basis": bases(n, 3),
    }
    laplacian, elastic = record["matrices"][:2]
    solver = record["solver"]
    reached = {
        "basis": record["basis"]["ratio"] >= TARGETS["basis"],
        "laplace": laplacian["ratio"] >= TARGETS["laplace"],
        "elasticity": elastic["ratio"] >= TARGETS["elasticity"],
        "floor": max(laplacian["times the floor"], elastic["times the floor"]) <= TARGETS["floor"],
        "solver": solver["ratio"] >= TARGETS["solver"],
        "residual": solver["UniformSolver residual"] <= TARGETS["residual"],
        "irregular": _never_slower(record),
    }
    record["reached"] = {name: bool(value) for name, value in reached.items()}
    print("reached:", ", ".join(f"{k} {'yes' if v else 'NO'}" for k, v in reached.items()))
    options.results.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=1) + "\n")
    return record


def _never_slower(record: dict[str, Any]) -> bool:
    rows = record["irregular"]["rows"]
    return all(max(row["share"], row["share, clock"]) <= TARGETS["irregular"] for row in rows)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as cache:
        os.environ["NUMBA_CACHE_DIR"] = cache  # so that kernels are compiled, and that timed
        main()
