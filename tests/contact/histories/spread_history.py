"""Run by mpiexec: a load history on processes, in a folder that others go on with, as JSON."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import skfem

from contact import ContactProblem, DistributedBody, ElasticBody, LoadStepper, Moved, Sphere
from skfem_adini import ElementQuadAdini
from skfem_adini.distributed import world

COMM = world()
TIMES = np.array([0.3, 0.7, 1.0, 1.4, 1.8, 2.2])
PLANE = skfem.MeshQuad.init_tensor(np.linspace(0, 1, 13), np.linspace(0, 1, 9)).with_defaults()
SPACE = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, n) for n in (5, 6, 4)]).with_defaults()


def body_of(dim: int, backend: str | None) -> tuple[Any, str, str, str]:
    """A block held above; its lower and upper side, and the name of the axis between them."""
    mesh, element = (PLANE, ElementQuadAdini()) if dim == 2 else (SPACE, None)
    below, above, down = ("bottom", "top", "y") if dim == 2 else ("front", "back", "z")
    body: Any
    if backend is None:
        body = ElasticBody.from_mesh(mesh, element, E=2.0, nu=0.3)
    else:
        body = DistributedBody(mesh, element, contact=below, E=2.0, nu=0.3, backend=backend)
    return body.fix(above, "xyz"[:dim]), below, above, down


def stepper(dim: int, backend: str | None) -> LoadStepper:
    """Pressed, then dragged to and fro; on a ball or a circle, beside a load."""
    body, below, above, down = body_of(dim, backend)
    centre = (0.5,) * (dim - 1) + (-2.0,)
    made = LoadStepper(ContactProblem(body, below, Sphere(centre, 2.0), friction=0.4))
    made.move(above, down, -0.05, lambda t: min(t, 1.0))
    made.move(above, "x", 0.03, lambda t: np.sin(2 * max(t - 1, 0)))
    made.load("right", (0.05,) + (0.0,) * (dim - 1), lambda t: 0.5 * t)
    return made


def dragged(dim: int, backend: str | None) -> LoadStepper:
    """A ball or a disk in another place in every step: pressed, then dragged and turned."""
    body, below, _, _ = body_of(dim, backend)
    ball = Sphere((0.5,) * (dim - 1) + (-2.0,), 2.0)

    def way(t: float) -> Moved:
        side, turn = 0.03 * max(t - 1, 0), 0.01 * t
        c = (side, *(0.0,) * (dim - 2), 0.05 * min(t, 1.0))
        return Moved(ball, c, turn if dim == 2 else (0.0, turn, 0.0), ball.centre)

    return LoadStepper(ContactProblem(body, below, ball, friction=0.4)).obstacle(way)


def differences(history: Any, exact: Any, body: Any) -> dict[str, float]:
    """Largest differences over the steps, relative to the largest values."""
    found = {"mu": 0.0, "t": 0.0, "u": 0.0, "kkt": 0.0}
    for ours, theirs in zip(history, exact, strict=True):
        u, kkt = body.gather(ours.u), ours.kkt
        if COMM.rank == 0:
            assert "no residual above" in ours.summary()  # without the other processes
        if COMM.rank == 0:
            size, far = np.abs(theirs.mu).max(), np.abs(theirs.u).max()
            found["mu"] = max(found["mu"], float(np.abs(ours.mu - theirs.mu).max() / size))
            found["t"] = max(found["t"], float(np.abs(ours.t - theirs.t).max() / size))
            found["u"] = max(found["u"], float(np.abs(u - theirs.u).max() / far))
            found["kkt"] = max(found["kkt"], *kkt.values())
    return found


if __name__ == "__main__":
    task, folder = sys.argv[1], Path(sys.argv[2])
    report: dict[str, Any] = {}
    for dim in (2, 3):
        for backend in ("mumps", "krylov"):
            make = dragged if task == "moved" else stepper
            ours, path = make(dim, backend), folder / f"{dim} {backend}"
            if task != "resume":
                ours.run(TIMES, path=path)
            else:
                ours.resume(path)
            theirs = make(dim, None)
            theirs.run(TIMES)
            name = f"{dim} {backend}"
            report[name] = differences(ours.history, theirs.history, ours.problem.body)
    if COMM.rank == 0:
        print(json.dumps({"size": COMM.size, **report}))
