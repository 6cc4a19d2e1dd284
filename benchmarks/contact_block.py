"""Frictional contact in units of one sparse factorisation.

For the block of `examples/contact_block.py` at n x n Adini cells, from the assembled S and f to
the certified result,

    ratio = (whole Coulomb solve) / (one factorisation + one solve with the same factoriser),

symbolic analysis (elimination order) counted on both sides, repeats of both interleaved, medians.
The base factors the same supported S, SuperLU in our nested-dissection order, PARDISO in its own.
Beside it: the next load step, assembly, and at one size what others take for the same problem: an
active-set method that factors the KKT matrix again in every step, and the QP solvers.

    python benchmarks/contact_block.py --sizes 64 128 256 --repeats 5
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
from machine import describe
from scipy import sparse
from scipy.sparse.linalg import splu, spsolve
from skfem import MeshQuad

from contact import ContactProblem, ContactResult, ElasticBody, Plane, cross_check
from contact.body.rigid_modes import dof_entities
from contact.condensation.elimination_order import nested_dissection
from skfem_adini import ElementQuadAdini
from skfem_adini.ground.pardiso import has_pardiso

OBSTACLE, FRICTION = Plane((0, -0.03), (0, 1)), 0.9
PEERS = ("osqp", "piqp", "clarabel")


def block(n: int) -> tuple[ElasticBody, dict[str, float]]:
    """Build and assemble the block; seconds of each part."""
    ticks = np.linspace(0, 1, n + 1)
    begin = time.perf_counter()
    mesh = MeshQuad.init_tensor(ticks, ticks).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=2.0, nu=0.3)
    body.fix("top", "x").fix(["left", "right"], "y").load("top", (0.0, -1.0))
    basis = time.perf_counter()
    _ = body.stiffness
    _ = body.constraint
    return body, {"basis": basis - begin, "assembly": time.perf_counter() - basis}


def base(body: ElasticBody, solver: str) -> float:
    """One factorisation and one solve of the supported body without contact; seconds."""
    begin = time.perf_counter()
    P, u0 = body.constraint
    free = P.tocsc().indices
    S, f = body.stiffness[free][:, free], (body.f - body.stiffness @ u0)[free]
    if solver == "superlu":
        entity, points, cells = dof_entities(body.basis)
        rank = np.empty(points.shape[1], dtype=np.int64)
        rank[nested_dissection(points, cells).order] = np.arange(rank.size)
        order = np.argsort(rank[entity[free]], kind="stable")
        lu = splu(
            sparse.csc_matrix(S[order][:, order]),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        z = np.empty_like(f)
        z[order] = lu.solve(f[order])
    else:
        from pypardiso.pardiso_wrapper import PyPardisoSolver

        upper = sparse.triu(S, format="csr")
        upper.sort_indices()
        begin -= time.perf_counter()
        pardiso = PyPardisoSolver(mtype=2)  # searches the disk for MKL: not a part of factoring
        begin += time.perf_counter()
        pardiso.set_phase(12)
        pardiso._call_pardiso(upper, np.zeros_like(f))
        pardiso.set_phase(33)
        z = pardiso._call_pardiso(upper, f)
    seconds = time.perf_counter() - begin
    assert np.abs(S @ z - f).max() < 1e-10 * np.abs(f).max()
    if solver == "pardiso":
        pardiso.free_memory(everything=True)
    return seconds


def whole(body: ElasticBody, solver: str) -> tuple[dict[str, float], ContactProblem, ContactResult]:
    """From assembled S and f to the certified result; seconds of each part."""
    begin = time.perf_counter()
    problem = ContactProblem(body, "bottom", OBSTACLE, FRICTION, solver=solver)
    rows = time.perf_counter()
    problem.condense()
    condensed = time.perf_counter()
    result = problem.solve()
    end = time.perf_counter()
    parts = {
        "rows": rows - begin,
        "condense": condensed - rows,
        "solve": end - condensed,
        "total": end - begin,
    }
    return parts, problem, result


def next_step(problem: ContactProblem, result: ContactResult) -> float:
    """Certified result under 2 % more load, from the last one and its factorisation; seconds."""
    body, load = problem.body, problem.body.f
    body.f = 1.02 * load
    begin = time.perf_counter()
    problem.solve(start=result)
    seconds = time.perf_counter() - begin
    body.f = load
    return seconds


def refactoring(problem: ContactProblem) -> tuple[float, float]:
    """Frictionless active-set method that factors the KKT matrix anew in each step (COLAMD)."""
    body, rows = problem.body, problem.rows
    begin = time.perf_counter()
    P, u0 = body.constraint
    S = sparse.csr_array(P.T @ body.stiffness @ P)
    f, G, d = P.T @ (body.f - body.stiffness @ u0), rows.G @ P, rows.gap - rows.G @ u0
    live = np.diff(sparse.csr_array(G).indptr) > 0
    G, d = sparse.csr_array(G)[live], d[live]
    active = np.zeros(d.size, dtype=bool)
    for _ in range(50):
        A = G[active]
        K = sparse.block_array([[S, A.T], [A, None]], format="csc") if active.any() else S.tocsc()
        solution = spsolve(sparse.csc_matrix(K), np.concatenate((f, d[active])))
        z, mu = solution[: f.size], np.zeros(d.size)
        mu[active] = solution[f.size :]
        following = mu + S.diagonal().mean() * (G @ z - d) > 0
        if np.array_equal(following, active):
            return time.perf_counter() - begin, float(mu.sum())
        active = following
    raise RuntimeError("the re-factoring active-set method did not end")


def measure(n: int, solver: str, repeats: int, peers: bool) -> dict[str, Any]:
    """All figures of one size and one factoriser."""
    body, assembly = block(n)
    base(body, solver), whole(body, solver)  # libraries loaded, memory touched
    bases, wholes, steps = [], [], []
    for _ in range(repeats):
        bases.append(base(body, solver))
        parts, problem, result = whole(body, solver)
        wholes.append(parts)
        steps.append(next_step(problem, result))
    middle = {key: statistics.median(run[key] for run in wholes) for key in wholes[0]}
    reference = statistics.median(bases)
    figures: dict[str, Any] = {
        "n": n,
        "unknowns": int(body.constraint[0].shape[1]),
        "solver": solver,
        "base": reference,
        **middle,
        "ratio": middle["total"] / reference,
        "next_step": statistics.median(steps),
        "next_step_over_total": statistics.median(steps) / middle["total"],
        **assembly,
        "newton_steps": sum(line.phase == "newton" for line in result.history),
        "active_set_steps": sum(line.phase == "frictionless" for line in result.history),
        "contact_force": result.contact_force,
        "kkt": max(result.kkt.values()),
        "spread": {"base": [min(bases), max(bases)],
                   "total": [min(r["total"] for r in wholes), max(r["total"] for r in wholes)]},
    }  # fmt: skip
    if peers:
        frictionless = ContactProblem(body, "bottom", OBSTACLE, solver=solver)
        ours = frictionless.solve()
        seconds, force = refactoring(frictionless)
        assert abs(force - ours.contact_force) < 1e-8
        rivals = {"KKT re-factored each step, frictionless": {"seconds": seconds}}
        for name in PEERS:
            for law, case, solution in (
                ("frictionless", frictionless, ours),
                ("given friction", problem, result),
            ):
                check = cross_check(case, solution, name, condensed=False)
                rivals[f"{name}, {law}"] = {"seconds": check.seconds, "error": check.displacement}
        for row in rivals.values():
            row["over_ours"] = row["seconds"] / middle["total"]
        figures["peers"] = rivals
    return figures


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run, print, write benchmarks/results/contact_block.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128, 256])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--peers-at", type=int, default=64)
    parser.add_argument("--solvers", nargs="+", default=["superlu", "pardiso"])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args(argv)

    rows = []
    for solver in options.solvers:
        if solver == "pardiso" and not has_pardiso():
            print("pypardiso is not installed: its rows are left out")
            continue
        for n in options.sizes:
            peers = n == options.peers_at and solver == options.solvers[0]
            row = measure(n, solver, options.repeats, peers)
            rows.append(row)
            print(
                f"{solver:>8} n = {n:4d}: base {row['base']:7.3f} s, total {row['total']:7.3f} s, "
                f"ratio {row['ratio']:.2f}, next step {row['next_step_over_total']:.3f} of it, "
                f"assembly {row['assembly']:.2f} s, {row['newton_steps']} Newton steps",
                flush=True,
            )
            for name, rival in row.get("peers", {}).items():
                print(f"{'':>10}{name}: {rival['seconds']:.2f} s, {rival['over_ours']:.1f} x ours")
    record = {"benchmark": "contact_block", "machine": describe(), "repeats": options.repeats,
              "rows": rows}  # fmt: skip
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "contact_block.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    print(f"written to {path.name}")
    return record


if __name__ == "__main__":
    main()
