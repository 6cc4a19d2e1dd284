"""Run by mpiexec: contact problems beside the same ones of one process, as JSON."""

import json
import sys
from typing import Any

import numpy as np

from contact import ContactProblem, DistributedBody, ElasticBody
from skfem_adini.distributed import world
from tests.contact.condensation.spread_cases import cases

COMM = world()


def compared(case: Any, backend: str) -> dict[str, Any]:
    """Differences relative to the largest value, the steps, and the certificate."""
    parts = {"contact": case.boundary, "backend": backend, **case.material}
    body = case.hold(DistributedBody(case.mesh, case.element, **parts))
    problem = ContactProblem(body, case.boundary, case.obstacle, friction=case.friction)
    result = problem.solve()
    u, kkt, resultant = body.gather(result.u), result.kkt, result.resultant
    middle = case.mesh.p.mean(axis=1)[:, None] + 0.013  # inside a cell
    inside = result.sample(middle)
    stress = None if np.ndim(case.E) else result.stress(middle)
    agreed = all(np.array_equal(mu, result.mu) for mu in COMM.allgather(result.mu))
    if COMM.rank:
        return {}
    assert result.kkt == kkt  # without the other processes
    assert "no residual above" in result.summary()
    serial = case.hold(ElasticBody.from_mesh(case.mesh, case.element, **case.material))
    exact = ContactProblem(serial, case.boundary, case.obstacle, friction=case.friction).solve()
    size = np.abs(exact.mu).max()
    far = np.abs(exact.u).max()
    return {
        "mu": np.abs(result.mu - exact.mu).max() / size,
        "t": np.abs(result.t - exact.t).max() / size,
        "u": np.abs(u - exact.u).max() / far,
        "inside": np.abs(inside - exact.sample(middle)).max() / far,
        "stress": 0.0 if stress is None else _off(stress, exact.stress(middle)),
        "resultant": _off(resultant, exact.resultant),
        "steps": [len(result.history), len(exact.history)],
        "kkt": max(kkt.values()),
        "agreed": agreed,
    }


def _off(found: Any, exact: Any) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


if __name__ == "__main__":
    found = {name: compared(case, sys.argv[1]) for name, case in cases()}
    if COMM.rank == 0:
        print(json.dumps({"size": COMM.size, **found}))
