"""Run by mpiexec: contact problems beside the same ones of one process, as JSON."""

import json
import sys
from typing import Any

import numpy as np

from contact import ContactProblem, DistributedBody, ElasticBody
from skfem_adini.distributed import world
from tests.contact.condensation.spread_cases import PAIRS, cases, pair

COMM = world()


def off(found: Any, exact: Any) -> float:
    """The largest difference relative to the largest value."""
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def beside(result: Any, exact: Any) -> dict[str, Any]:
    size = np.abs(exact.mu).max()
    return {
        "mu": off(result.mu, exact.mu),
        "t": float(np.abs(result.t - exact.t).max() / size),
        "steps": [len(result.history), len(exact.history)],
    }


def alone(result: Any) -> tuple[dict[str, Any], bool]:
    """What all processes ask for: the certificate, and whether all have the same forces."""
    agreed = all(np.array_equal(mu, result.mu) for mu in COMM.allgather(result.mu))
    return {"kkt": max(result.kkt.values()), "agreed": agreed}, COMM.rank == 0


def compared(case: Any, backend: str) -> dict[str, Any]:
    parts = {"contact": case.boundary, "backend": backend, **case.material}
    body = case.hold(DistributedBody(case.mesh, case.element, **parts))
    problem = ContactProblem(body, case.boundary, case.obstacle, friction=case.friction)
    result = problem.solve()
    u, kkt, resultant = body.gather(result.u), result.kkt, result.resultant
    middle = case.mesh.p.mean(axis=1)[:, None] + 0.013  # inside a cell
    inside = result.sample(middle)
    stress = None if np.ndim(case.E) else result.stress(middle)
    found, first = alone(result)
    if not first:
        return {}
    assert result.kkt == kkt  # without the other processes
    assert "no residual above" in result.summary()
    serial = case.hold(ElasticBody.from_mesh(case.mesh, case.element, **case.material))
    exact = ContactProblem(serial, case.boundary, case.obstacle, friction=case.friction).solve()
    far = np.abs(exact.u).max()
    return (
        found
        | beside(result, exact)
        | {
            "u": off(u, exact.u),
            "inside": float(np.abs(inside - exact.sample(middle)).max() / far),
            "stress": 0.0 if stress is None else off(stress, exact.stress(middle)),
            "resultant": off(resultant, exact.resultant),
        }
    )


def compared_pair(dim: int, element: Any, spread: tuple[bool, bool]) -> dict[str, Any]:
    *bodies, problem = pair(dim, element, spread)
    result = problem.solve()
    u = [
        body.gather(result[body].u) if many else result[body].u
        for body, many in zip(bodies, spread, strict=True)
    ]
    found, first = alone(result)
    if not first:
        return {}
    *serial, problem = pair(dim, element, (False, False))
    exact = problem.solve()
    far = np.abs(exact[serial[0]].u).max()
    away = [np.abs(v - exact[body].u).max() / far for v, body in zip(u, serial, strict=True)]
    return found | beside(result, exact) | {"u": float(max(away))}


if __name__ == "__main__":
    found = {name: compared(case, sys.argv[1]) for name, case in cases()}
    if sys.argv[1] == "mumps":
        found |= {name: compared_pair(*given) for name, given in PAIRS.items()}
    if COMM.rank == 0:
        print(json.dumps({"size": COMM.size, **found}))
