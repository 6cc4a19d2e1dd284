"""Run by mpiexec: two bodies on processes beside the same ones on one process, as JSON."""

import json
from typing import Any

import numpy as np
import skfem

from contact import ContactProblem, DistributedBody, ElasticBody
from skfem_adini import ElementQuadAdini
from skfem_adini.distributed import world

COMM = world()


def pair(dim: int, element: Any, spread: tuple[bool, bool]) -> tuple[Any, Any, ContactProblem]:
    """A body pressed and pushed on a larger one whose cells do not match."""
    fine, coarse = (
        np.linspace(0, 1, 13 if dim == 2 else 5),
        np.linspace(0, 1, 17 if dim == 2 else 6),
    )
    last = dim - 1
    named = {
        "low": lambda x: x[last] < x[last].min() + 1e-9,
        "high": lambda x: x[last] > x[last].max() - 1e-9,
    }
    kind = skfem.MeshQuad if dim == 2 else skfem.MeshHex
    above = kind.init_tensor(*[fine] * last, 1 + fine).with_boundaries(named)
    below = kind.init_tensor(*[-0.25 + 1.5 * coarse] * last, coarse).with_boundaries(named)

    def body(mesh: Any, name: str, E: float, on_all: bool) -> Any:
        if on_all:
            return DistributedBody(mesh, element, contact=name, E=E, nu=0.3)
        return ElasticBody.from_mesh(mesh, element, E=E, nu=0.3)

    upper, lower = body(above, "low", 1.0, spread[0]), body(below, "high", 3.0, spread[1])
    upper.fix("high", "xyz"[last], -0.02).fix("high", "x", 0.01)
    if dim == 3:
        upper.fix("high", "y")
    lower.fix("low", "xyz"[:dim]).body_force((0.0,) * last + (-1e-3,))
    return upper, lower, ContactProblem(upper, "low", lower.surface("high"), friction=0.3)


def compared(dim: int, element: Any, spread: tuple[bool, bool]) -> dict[str, Any]:
    """Differences relative to the largest values."""
    *bodies, problem = pair(dim, element, spread)
    result = problem.solve()
    found = [
        body.gather(result[body].u) if many else result[body].u
        for body, many in zip(bodies, spread, strict=True)
    ]
    kkt = result.kkt
    agreed = all(np.array_equal(mu, result.mu) for mu in COMM.allgather(result.mu))
    if COMM.rank:
        return {}
    *serial, problem = pair(dim, element, (False, False))
    exact = problem.solve()
    off = [
        float(np.abs(u - exact[body].u).max() / np.abs(exact[serial[0]].u).max())
        for u, body in zip(found, serial, strict=True)
    ]
    size = np.abs(exact.mu).max()
    return {
        "mu": float(np.abs(result.mu - exact.mu).max() / size),
        "t": float(np.abs(result.t - exact.t).max() / size),
        "u": max(off),
        "kkt": max(kkt.values()),
        "steps": [len(result.history), len(exact.history)],
        "agreed": agreed,
    }


if __name__ == "__main__":
    adini, trilinear = ElementQuadAdini(), skfem.ElementHex1()
    found = {
        "Adini": compared(2, adini, (True, True)),
        "Q2": compared(2, skfem.ElementQuad2(), (True, True)),
        "Hex1": compared(3, trilinear, (True, True)),
        "upper alone": compared(2, adini, (True, False)),
        "lower alone": compared(2, adini, (False, True)),
    }
    if COMM.rank == 0:
        print(json.dumps({"size": COMM.size, **found}))
