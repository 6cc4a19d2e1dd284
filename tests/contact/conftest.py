"""Bodies, contact problems and independent measures shared by the tests of this folder."""

import functools
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from contact import ContactProblem, ElasticBody, LoadStepper, Plane
from skfem_adini import ElementQuadAdini

# The suite imports test modules by path; what they share lies beside this file.
sys.path.insert(0, str(Path(__file__).parent))
from families import box

# A graded side, no two cells alike; 0 and 1 are its ends.
GRADED = np.array([0.0, 0.13, 0.2, 0.41, 0.55, 0.8, 0.86, 1.0])
FOUNDATION = {2: Plane((0.0, -0.03), (0.0, 1.0)), 3: Plane((0.0, 0.0, -0.03), (0.0, 0.0, 1.0))}


def remesh(mesh, p=None, t=None):
    """The mesh with other vertices or cells, its names kept."""
    p, t = mesh.p if p is None else p, mesh.t if t is None else t
    return type(mesh)(p, t, sort_t=False).with_boundaries(dict(mesh.boundaries))


def block(n=10, element=ElementQuadAdini, sides=("left", "right"), E=2.0, nu=0.3):
    """Unit square of the dissertation's section 5.2, n x n cells."""
    ticks = np.linspace(0.0, 1.0, n + 1)
    body = ElasticBody.from_mesh(box(element, ticks, ticks), element(), E=E, nu=nu)
    body.fix("top", "x").load("top", (0.0, -1.0))
    return body.fix(list(sides), "y") if sides else body


def block_problem(n=10, friction=0.9, law="coulomb", functional=None, **body):
    return ContactProblem(block(n, **body), "bottom", FOUNDATION[2], friction, law, functional)


def dragged(element=ElementQuadAdini, n=6, friction=0.3, gap=0.0, E=1.0):
    """A history of a block held by its top, pressed on a foundation and dragged to and fro."""
    ticks = [np.linspace(0, 1, n + 1)] * element().dim
    body = ElasticBody.from_mesh(box(element, *ticks), element(), E=E, nu=0.3).fix("top")
    stepper = LoadStepper(ContactProblem(body, "bottom", gap, friction))
    stepper.move("top", len(ticks) - 1, -0.05, lambda t: min(1.0, 4 * t))
    return stepper.move("top", "x", 0.08, lambda t: np.sin(3 * t))


def dome(element, n=4, friction=0.3, law="coulomb"):
    """Box of n x n x 2 cells, pushed down and sideways and twisted on a paraboloid: 3-D slip."""
    ticks = np.linspace(-1.0, 1.0, n + 1)
    mesh = box(element, ticks, ticks, np.array([0.0, 0.4, 1.0]))
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    body.fix("top", "x", lambda x: 0.01 - 0.03 * x[1]).fix("top", "y", lambda x: 0.03 * x[0])
    body.fix("top", "z", -0.05)
    return ContactProblem(body, "bottom", lambda x: 0.04 * (x[0] ** 2 + x[1] ** 2), friction, law)


@functools.lru_cache(maxsize=64)
def _solved(method, keys):
    problem = block_problem(**dict(keys))
    return problem, problem.solve(method)


def solved(method="newton", **keys):
    """(problem, result) of a block, solved once a session."""
    return _solved(method, tuple(sorted(keys.items())))


def law_error(result):
    """Largest violation of contact and friction law, written here from their definition.

    Lengths are taken relative to the largest displacement, forces to the largest contact force.
    """
    rows, system = result.system.rows, result.system
    reach = np.isfinite(rows.gap)
    u_n, u_t = rows.G @ result.u, (rows.T @ result.u).reshape(result.t.shape)
    length = np.abs(result.u).max()
    force = max(np.abs(result.mu).max(), np.abs(result.t).max()) or 1.0
    open_ = (rows.gap[reach] - u_n[reach]) / length
    mu = result.mu[reach] / force
    coulomb = system.law == "coulomb"
    g = (system.friction * (result.mu if coulomb else 1.0) if system.law else 0 * result.mu) / force
    size = np.linalg.norm(result.t / force, axis=1)
    # Power of friction g |u_t| is reached: t . u_t = g |u_t|, which holds for stick and for slip.
    power = (result.t / force * u_t / length).sum(axis=1)
    power = power - g * np.linalg.norm(u_t, axis=1) / length
    errors = {
        "penetration": np.max(-open_, initial=0.0),
        "tension": np.max(-mu, initial=0.0),
        "complementarity": np.abs(mu * open_).max(initial=0.0),
        "out of reach": np.abs(result.mu[~reach]).max(initial=0.0) / force,
        "cone": np.max(size - g, initial=0.0),
        "power": np.abs(power).max(initial=0.0),
    }
    return max(errors.values())


@pytest.fixture(scope="session")
def make():
    """The builders of this module."""
    return SimpleNamespace(
        box=box,
        remesh=remesh,
        block=block,
        problem=block_problem,
        dome=dome,
        dragged=dragged,
        solved=solved,
        law_error=law_error,
        foundation=FOUNDATION,
        graded=GRADED,
    )
