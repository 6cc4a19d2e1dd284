"""What `reproduce.py --run` computes: the dissertation's experiments, by the examples' code."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

# A script beside this one has the name of the package cip: the package must be found first.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy import sparse
from scipy.special import jn_zeros
from skfem import Basis, MeshQuad
from skfem.models.poisson import laplace

from cip import Grid, Solver, Velocity
from contact import ContactProblem, Plane
from gpu import eigs, lqr
from skfem_adini import ElementQuadAdini, ElementQuadAdiniCut, lowest_eigenpairs

Found = dict[str, Any]
CELLS = (200, 400, 800, 1600, 3200)
ADVECTION_CELLS = (100, 200, 400, 800)
MESHES = (4, 8, 16, 32, 64)
# Index of the Bessel function and number of its root, in the order of Table 5.4.
DISK_MODES = ((0, 1), (1, 1), (1, 1), (2, 1), (2, 1), (0, 2), (3, 1), (3, 1), (1, 2), (1, 2))


def example(name: str) -> Any:
    """A module of examples/, whose scripts import each other."""
    folder = str(Path(__file__).parents[1] / "examples")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    return importlib.import_module(name)


def order(sizes: Any, errors: Any) -> float:
    """Order of convergence fitted over all meshes."""
    return float(-np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def transport() -> Found:
    """Tables 2.1 to 2.3 and Figures 2.1 to 2.7."""
    cip = example("cip_dissertation")
    found: Found = {"Table 2.1": {}, "Table 2.2": {}, "Table 2.3": {}, "Figure 2.6": {}}
    for profile in cip.PROFILES:
        both = {n: cip.errors(n, profile, "transport") for n in CELLS}
        for k, table in enumerate(("Table 2.1", "Table 2.2")):
            found[table][profile] = {str(n): pair[k] for n, pair in both.items()}
        found["Figure 2.6"][profile] = {
            str(ratio): cip.errors(400, profile, "transport", ratio)[0] for ratio in (0.5, 1.0, 2.0)
        }
    for profile in ("piecewise_linear", "cubic", "csl2", "csl4"):
        found["Table 2.3"][profile] = {
            str(n): cip.errors(n, profile, "advection")[0] for n in ADVECTION_CELLS
        }
    found["Figure 2.5"] = {
        profile: order(CELLS, list(row.values())) for profile, row in found["Table 2.1"].items()
    }
    for figure, profile, form, times in (
        ("Figure 2.2", "linear", "transport", (1.2, 2.4, 6.0)),
        ("Figure 2.3", "piecewise_linear", "transport", (1.2, 2.4, 6.0)),
        ("Figure 2.4", "cubic", "transport", (1.2, 2.4, 6.0)),
        ("Figure 2.7", "piecewise_linear", "advection", (0.8, 1.2, 2.0)),
        ("Figure 2.7", "cubic", "advection", (0.8, 1.2, 2.0)),
    ):
        run = cip.simulate(200, profile, form, times[-1], snapshots=times)
        x, rows = run.solver.grid.coordinates[0], {}
        for place, t in enumerate(times, start=1):
            u, exact = run[place]["u"], cip.exact(x, t, form)
            rows[str(t)] = {
                "l2": float(np.sqrt(0.02 * np.sum((u - exact) ** 2))),
                "least": float(u.min()),
                "largest": float(u.max()),
                "largest of the solution": float(exact.max()),
            }
        found.setdefault(figure, {})[profile] = rows
    return found


def characteristics() -> Found:
    """Figures 2.1 and 3.1: one step of u = x carries the foot of the characteristic and no error.

    The profiles contain the linear functions, so that u is the foot and u_x its derivative.
    """
    cip, dt = example("cip_dissertation"), 0.02
    solver = Solver(Grid((-2, 2), 200), cip.speed, "transport", "cubic", boundary=0.0)
    x = solver.grid.coordinates[0]
    moved = solver.step(solver.state(lambda x: x), dt)
    d = np.maximum(1 - x**2 + x**2 * np.exp(-2 * dt), 1e-300)
    foot, slope = x * np.exp(-dt) / np.sqrt(d), np.exp(-dt) * d**-1.5
    inside = np.abs(foot) < 2
    line = [np.abs(moved[name] - exact)[inside].max() for name, exact in
            (("u", foot), ("u_x", slope))]  # fmt: skip
    grid = Grid([(-2, 2)] * 2, (100, 100))
    solver = Solver(grid, Velocity.from_expression("x2", "-x1"), profile="adini", boundary=0.0)
    turn = 2 * np.pi / 200
    moved = solver.step(solver.state(lambda x, y: x), turn)
    X, Y = grid.mesh()
    feet = X * np.cos(turn) - Y * np.sin(turn), Y * np.cos(turn) + X * np.sin(turn)
    inside = np.maximum(*map(np.abs, feet)) < 2
    plane = [
        np.abs(moved["u"] - feet[0])[inside].max(),
        np.abs(moved["u_x"] - np.cos(turn))[inside].max(),
        np.abs(moved["u_y"] + np.sin(turn))[inside].max(),
    ]
    return {
        "Figure 2.1": {"foot": float(line[0]), "derivative": float(line[1])},
        "Figure 3.1": {"foot": float(plane[0]), "derivative": float(max(plane[1:]))},
    }


def transport_in_the_plane() -> Found:
    """Figures 3.2 and 3.3."""
    cip = example("cip_two_dimensions")
    found: Found = {"Figure 3.2": {}, "Figure 3.3": {}}
    y = np.linspace(-2, 2, 101)
    line = np.array([np.full_like(y, -0.02), y])
    for profile, splitting in cip.SCHEMES:
        scheme = cip.solver(("x2", "x1"), profile, splitting)
        for steps, name in ((30, "whole"), (15, "whole, dt = 2 h")):
            run = scheme.run(scheme.state(cip.bell), 1.2, dt=1.2 / steps)
            e = run.final["u"] - cip.blade(*scheme.grid.mesh(), 1.2)
            row = found["Figure 3.2"].setdefault(profile, {})
            row[name] = 0.04 * float(np.sqrt(np.sum(e**2)))
            if name == "whole":
                e = run.sample(line) - cip.blade(*line, 1.2)
                row["slice"] = float(np.sqrt(0.04 * np.sum(e**2)))
    for profile in ("adini", "bicubic"):
        scheme = cip.solver(("x2", "-x1"), profile, None)
        start = scheme.state(cip.disk)
        run = scheme.run(start, 16 * np.pi, dt=2 * np.pi / 200, snapshots=[8 * np.pi])
        found["Figure 3.3"][profile] = {
            turns: float(np.sqrt(0.04 * np.sum((run[k]["u"][29] - start["u"][29]) ** 2)))
            for k, turns in ((1, "4"), (2, "8"))
        }
    return found


def contact() -> Found:
    """Figures 5.5 and 5.6, Algorithms 1 to 3: the block, its forces, and the steps."""
    block = example("contact_block")
    body, plane = block.block(10), Plane((0, -0.03), (0, 1))
    problem = ContactProblem(body, "bottom", plane, 0.9)
    result = problem.solve()
    steps = [line.phase for line in result.history]
    touching, order_of = (result.status != 0).astype(int), np.argsort(result.x_nominal[0])
    u = result.u.reshape(-1, 6)  # u_x and u_y with two derivatives each
    found: Found = {
        "Figure 5.5": {
            "least u_y": float(u[:, 1].min()),
            "largest |u_x|": float(np.abs(u[:, 0]).max()),
            "penetration": float(max(0.0, -result.gap.min())),
        },
        "Figure 5.6": {
            "contact force": result.contact_force,
            "largest pressure": float(result.pressure.max()),
            "contact zones": int((np.diff(touching[order_of], prepend=0) > 0).sum()),
            "zone": [float(x) for x in result.zone[0]],
            "least mu in contact": float(result.mu[result.status != 0].min()),
            "largest mu elsewhere": float(np.abs(result.mu[result.status == 0]).max()),
        },
    }
    T, u0 = body.constraint
    rows, f = result.system.rows, T.T @ (result.system.load - body.stiffness @ u0)
    S, G, H = (T.T @ body.stiffness @ T).toarray(), (rows.G @ T).toarray(), (rows.T @ T).toarray()
    d = rows.gap - rows.G @ u0
    z, mu, count = signorini(S, f, G, d)
    free = ContactProblem(body, "bottom", plane, 0.0).solve()
    found["Algorithm 2"] = {
        "steps": count,
        "difference": float(np.abs(T @ z + u0 - free.u).max() / np.abs(free.u).max()),
    }
    rough, changes, eps = ContactProblem(body, "bottom", plane, 0.9), [], 1e-6
    for _ in range(60):
        spring = 0.9 * mu / np.maximum(eps, np.abs(H @ z))
        old, (z, mu, _) = z, signorini(S + H.T @ (spring[:, None] * H), f, G, d)
        nodal = [(T @ each + u0).reshape(-1, 6)[:, :2] for each in (old, z)]
        changes.append(float(np.abs(nodal[1] - nodal[0]).max() / np.abs(nodal[1]).max()))
    found["Algorithm 3"] = {
        "steps to three digits": int(np.flatnonzero(np.array(changes) < 1e-3)[0] + 1),
        "difference after 60": float(np.abs(T @ z + u0 - result.u).max() / np.abs(result.u).max()),
        "library's steps": sum(line.phase == "fixed point" for line in
                               rough.solve("fixed_point", eps=eps, tol=1e-6).history),
    }  # fmt: skip
    found["Algorithm 1"] = {
        "steps of newton": steps.count("newton"),
        "residual": max(result.kkt.values()),
    }
    return found


def signorini(S: Any, f: Any, G: Any, d: Any) -> tuple[Any, Any, int]:
    """Algorithm 2 as it stands, with f on the right: u, mu, and how many sets were solved for."""
    n, mu, steps = len(f), np.zeros(len(d)), 0
    u = np.linalg.solve(S, f)
    before: Any = None
    while steps < 60:
        active = mu + (G @ u - d) > 0
        if before is not None and np.array_equal(active, before):
            return u, mu, steps
        before, A = active, G[active]
        m = len(A)
        both = np.linalg.solve(
            np.block([[S, A.T], [A, np.zeros((m, m))]]), np.concatenate((f, d[active]))
        )
        u, mu = both[:n], np.zeros(len(d))
        mu[active] = both[n:]
        steps += 1
    raise RuntimeError("the sets go in circles")


def eigenvalue_tables(meshes: tuple[int, ...] = MESHES) -> Found:
    """Tables 5.1 to 5.3 and Figure 5.3."""
    module = example("eigenvalues")
    found: Found = {}
    for table, published, held in (
        ("Table 5.1", module.NEUMANN, False),
        ("Table 5.2", module.DIRICHLET, True),
    ):
        rows = {n: module.laplace_errors(n, list(published), held) for n in meshes}
        found[table] = {
            ",".join(map(str, mode)): {str(n): row[mode] for n, row in rows.items()}
            for mode in published
        }
    values = np.array([module.elastic_eigenvalues(n) for n in meshes])
    errors = np.abs(values[:-1] - values[-1]) / values[:-1]
    rates = np.log2(errors[:-1] / errors[1:]).T
    found["Table 5.3"] = {str(k + 4): [float(rate) for rate in row] for k, row in enumerate(rates)}
    found["Figure 5.3"] = {
        name: min(
            float(np.log2(row[str(meshes[-2])] / row[str(meshes[-1])]))
            for row in found[table].values()
        )
        for name, table in (("Neumann", "Table 5.1"), ("Dirichlet", "Table 5.2"))
    }
    found["Figure 5.3"]["elastic"] = float(rates[:, -1].min())
    return found


def disk(meshes: tuple[int, ...] = MESHES) -> Found:
    """Table 5.4 and Figure 5.4: the construction of 2012 and the extension."""
    module = example("curved_2012")
    exact = np.array([(jn_zeros(m, i)[-1] / module.RADIUS) ** 2 for m, i in DISK_MODES])
    table: Found = {name: {} for name in ("2012", "extension")}
    cells: Found = {}
    for n in meshes:
        mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)
        for name, matrices in (
            ("2012", module.cut_matrices(mesh, chords=False)[:2]),
            ("extension", module.extension_matrices(mesh)),
        ):
            values = lowest_eigenpairs(*matrices, 10, shift=0.0)[0]
            table[name][str(n)] = [float(error) for error in np.abs(values / exact - 1)]
    mesh = MeshQuad.init_tensor(*[np.linspace(0, 1, 33)] * 2)
    element = ElementQuadAdiniCut(mesh, module.disk)
    count = element.inside[mesh.t].sum(axis=0)
    for k in (1, 2, 3):
        cells[str(k)] = {
            "cells": int((count == k).sum()),
            "1 / sigma_min": float(np.nanmax(element.unisolvence[count == k])),
        }
    return {"Table 5.4": {"exact": exact.tolist(), **table}, "Figure 5.4": cells}


def element() -> Found:
    """Figures 5.1 and 5.2."""
    module = example("shape_functions")
    dofs = module.dofs_of_functions(ElementQuadAdini())
    basis = Basis(MeshQuad.init_tensor(*[np.linspace(0, 1, 11)] * 2), ElementQuadAdini())
    A = laplace.assemble(basis)
    blocks = sparse.coo_array(A)
    near = np.abs(blocks.data) > 1e-13
    row, column = blocks.row[near] // 3, blocks.col[near] // 3
    ticks = np.round(basis.mesh.p * 10).astype(int)
    return {
        "Figure 5.1": {"distance to duality": float(np.abs(dofs - np.eye(12)).max())},
        "Figure 5.2": {
            "most entries in a row": int(np.bincount(blocks.row[near]).max()),
            "farthest coupled vertex": int(np.abs(ticks[:, row] - ticks[:, column]).max()),
        },
    }


def algorithms() -> Found:
    """Algorithms 6 and 7."""
    rng, n = np.random.default_rng(0), 400
    A = np.diag(np.concatenate((np.linspace(2, 1.1, 20), np.zeros(n - 20))))
    A = A + 0.05 * rng.standard_normal((n, n)) / np.sqrt(n)
    products: Found = {}
    values = {}
    for restart in ("krylov-schur", "implicit"):
        calls = [0]

        def product(x: Any, calls: list[int] = calls) -> Any:
            calls[0] += 1
            return A @ x

        w = eigs(product, 10, v0=np.ones(n), ncv=25, tol=1e-10, restart=restart)[0]
        products[restart], values[restart] = calls[0], np.sort(np.abs(w))
    apart = np.abs(values["implicit"] / values["krylov-schur"] - 1).max()
    modes, B = example("heat_model").heat_modes(8)
    best = lqr(modes, B, 1.0, np.eye(2)).K
    W = B / np.linalg.norm(B, axis=0)
    for _ in range(10):
        W = np.linalg.qr(np.hstack([W, W[:, -2:] / (modes - 1.0)[:, None]]))[0]
    gains = {}
    for compression in ("printed", "galerkin"):
        K = lqr(modes, B, 1.0, np.eye(2), method="reduced", basis=W, compression=compression).K
        gains[compression] = float(np.linalg.norm(K - best) / np.linalg.norm(best))
    return {
        "Algorithm 6": {"products": products, "difference": float(apart)},
        "Algorithm 7": gains,
    }


def appendix() -> Found:
    """Figure A.1: the steps of Appendix A, checked by the script, on the host."""
    seconds = example("gpu_appendix").on_host(2**20, 500)
    return {"Figure A.1": {"steps checked": len(seconds), **seconds}}


RUNS: tuple[Callable[[], Found], ...] = (
    transport,
    characteristics,
    transport_in_the_plane,
    contact,
    eigenvalue_tables,
    disk,
    element,
    algorithms,
    appendix,
)
