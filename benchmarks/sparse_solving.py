"""Direct solvers and multigrid on bricks of Adini: where the one overtakes the other.

On n^3 cells of the unit cube, from the assembled matrix to a solution:

* Poisson with u = 0 on the boundary and a constant source;
* elasticity, held at z = 0, pulled at the opposite face.

PARDISO (or SuperLU, where PARDISO is not installed, and at the smallest sizes beside it) factors;
conjugate gradients run to a residual of 1e-10 of the load in the scaled dofs, with the near-null
space of `near_null_space` and, to show what it is worth, with constants and translations alone.
Every line gives the residual recomputed. The crossover is where the times, interpolated between
sizes, are equal.

    python benchmarks/sparse_solving.py --repeats 3
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from scipy import sparse
from skfem import Basis, ElementVector, MeshHex
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

from skfem_adini import (
    ElementHexAdini,
    NearNullSpace,
    essential_dofs,
    factorize,
    near_null_space,
)
from skfem_adini.ground.pardiso import has_pardiso

SIZES = {"poisson": [4, 8, 12, 16, 24, 32], "elasticity": [3, 4, 6, 8, 12, 16, 20]}
SUPERLU_MOST = 5000
REDUCED, FULL = "amg, translations", "amg"
PIECE = 10**7


def uniform_matrix(form: Any, basis: Any, cell: Any) -> Any:
    """Return the matrix of a form on equal cells, from the matrix of one of them."""
    own = cell.element_dofs[:, 0]
    local = form.assemble(cell).toarray()[np.ix_(own, own)]
    dofs = basis.element_dofs
    count, cells = dofs.shape
    matrix = sparse.csr_array((basis.N, basis.N))
    step = max(1, PIECE // count**2)
    for first in range(0, cells, step):
        part = dofs[:, first : first + step].T
        rows, columns = np.repeat(part, count, axis=1), np.tile(part, (1, count))
        data = np.tile(local.ravel(), len(part))
        piece = sparse.coo_array((data, (rows.ravel(), columns.ravel())), shape=matrix.shape)
        matrix = matrix + piece.tocsr()
    return matrix


def system(problem: str, n: int) -> tuple[Any, Any, NearNullSpace]:
    """Return the matrix and the load of the free dofs, and their near-null space."""
    ticks = np.linspace(0, 1, n + 1)
    elastic = problem == "elasticity"
    element = ElementVector(ElementHexAdini()) if elastic else ElementHexAdini()
    form = linear_elasticity(1.0, 1.0) if elastic else laplace
    mesh = MeshHex.init_tensor(ticks, ticks, ticks)
    basis = Basis(mesh, element, intorder=0)  # for its numbers of dofs
    K = uniform_matrix(form, basis, Basis(MeshHex.init_tensor(*[ticks[:2]] * 3), element))
    held = mesh.facets_satisfying(lambda x: x[2] == 0) if elastic else mesh.boundary_facets()
    free = basis.complement_dofs(essential_dofs(basis, held))
    load = basis.zeros()
    if elastic:
        top = np.flatnonzero(mesh.p[2] == 1)
        load[basis.nodal_dofs[0, top]] = 1.0
        load[basis.nodal_dofs[2, top]] = 0.5
    else:
        load[basis.nodal_dofs[0]] = 1.0
    return K[free][:, free], load[free], near_null_space(basis, free)


def solvers(problem: str, near_null: NearNullSpace, size: int) -> dict[str, Callable[[Any], Any]]:
    """Return what is compared: name and factorisation."""
    few = 1 if problem == "poisson" else 3
    simple = NearNullSpace(near_null.modes[:, :few], near_null.vertex)
    found: dict[str, Callable[[Any], Any]] = {}
    if has_pardiso():
        found["pardiso"] = lambda A: factorize(A, solver="pardiso")
    if size <= SUPERLU_MOST or not has_pardiso():
        found["superlu"] = lambda A: factorize(A, solver="superlu")
    found[FULL] = lambda A: factorize(A, solver="amg", near_null=near_null)
    found[REDUCED] = lambda A: factorize(A, solver="amg", near_null=simple)
    return found


def measure(problem: str, n: int, repeats: int) -> list[dict[str, Any]]:
    """Return a line for each solver at one size."""
    A, b, near_null = system(problem, n)
    scale = 1 / np.sqrt(A.diagonal())
    lines = []
    for name, make in solvers(problem, near_null, b.size).items():
        setups, solutions = [], []
        for _ in range(repeats if b.size < 2e4 else 1):
            begin = time.perf_counter()
            solver = make(A)
            middle = time.perf_counter()
            x = solver.solve(b)
            end = time.perf_counter()
            setups.append(middle - begin)
            solutions.append(end - middle)
        residual = np.linalg.norm(scale * (b - A @ x)) / np.linalg.norm(scale * b)
        lines.append(
            {
                "n": n,
                "unknowns": b.size,
                "entries": int(A.nnz),
                "solver": name,
                "setup": statistics.median(setups),
                "solve": statistics.median(solutions),
                "iterations": solver.iterations,
                "residual": float(residual),
            }
        )
        line = lines[-1]
        print(
            f"{problem:>10} n = {n:2d} {b.size:8,d} unknowns  {name:>17}: set-up "
            f"{line['setup']:7.3f} s, solution {line['solve']:7.3f} s, "
            f"{line['iterations']:3d} iterations, residual {residual:.0e}",
            flush=True,
        )
        del solver
    return lines


def crossover(lines: list[dict[str, Any]], direct: str, iterative: str) -> float | None:
    """Return the number of unknowns from which the iterative solver stays the quicker one."""
    times = {
        name: {l["unknowns"]: l["setup"] + l["solve"] for l in lines if l["solver"] == name}
        for name in (direct, iterative)
    }
    sizes = sorted(set(times[direct]) & set(times[iterative]))
    lead = np.log([times[direct][size] / times[iterative][size] for size in sizes])
    if len(sizes) == 0 or lead[-1] <= 0:
        return None
    behind = np.flatnonzero(lead <= 0)
    if behind.size == 0:
        return float(sizes[0])
    last = behind[-1]
    x = np.log(sizes[last : last + 2])
    share = -lead[last] / (lead[last + 1] - lead[last])
    return float(np.exp(x[0] + share * (x[1] - x[0])))


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/sparse_solving.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", choices=SIZES, default=list(SIZES))
    parser.add_argument("--largest", type=int, default=99, help="cells a side")
    parser.add_argument("--repeats", type=int, default=3, help="below 20000 unknowns; then once")
    parser.add_argument("--results", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)

    record: dict[str, Any] = {
        "benchmark": "sparse_solving",
        "machine": describe(),
        "repeats": options.repeats,
        "problems": {},
    }
    direct = "pardiso" if has_pardiso() else "superlu"
    for problem in options.problems:
        measure(problem, 3, 1)  # libraries loaded
        sizes = [n for n in SIZES[problem] if n <= options.largest]
        lines = [line for n in sizes for line in measure(problem, n, options.repeats)]
        equal = crossover(lines, direct, FULL)
        record["problems"][problem] = {"lines": lines, "direct": direct, "crossover": equal}
        where = "not reached" if equal is None else f"at {equal:,.0f} unknowns"
        print(f"{problem:>10} multigrid overtakes {direct} {where}\n")
    options.results.mkdir(parents=True, exist_ok=True)
    (options.results / "sparse_solving.json").write_text(json.dumps(record, indent=1) + "\n")
    return record


if __name__ == "__main__":
    main()
