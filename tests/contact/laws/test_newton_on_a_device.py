"""Newton's steps where W lies, in two and three dimensions, against the host's methods.

NumPy takes the place of the device; what would copy a part of W to the host is refused.
"""

from dataclasses import replace

import numpy as np
import pytest
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTetP2

from contact import ContactProblem, ElasticBody, LayeredBlock, Plane
from contact.arrays.dense_arrays import DeviceMatrix, HostArrays
from contact.laws.methods import solve_boundary
from contact.laws.options import Options
from gpu import Infeasible
from skfem_adini import ElementHexAdini


class Elsewhere(HostArrays):
    """The host's arrays in the place of a device's; Cholesky's method where it is offered."""

    def __init__(self):
        self.definite = 0

    def values(self, W):
        return W.values

    def solve_square(self, A, b, definite=False):
        if definite:
            self.definite += 1
            np.linalg.cholesky(A)  # A is what was promised
        return super().solve_square(A, b)


class Kept(DeviceMatrix):
    """A matrix that gives products with vectors and its diagonal alone."""

    def __matmul__(self, x):
        assert x.ndim == 1
        return super().__matmul__(x)

    def refuse(self, *args, **options):
        raise AssertionError("W is moved to the host")

    __getitem__ = __add__ = __array__ = take = refuse


def box(make, element, unit=1.0):
    ticks = [np.linspace(0.0, 1.0, 4 if element().dim == 3 else 9)] * element().dim
    return ElasticBody.from_mesh(make.box(element, *ticks), element(), E=2.0 * unit, nu=0.3)


def held(make, element, unit=1.0):
    body = box(make, element, unit)
    body.fix("top", "xyz"[body.dim - 1], -0.05).fix("top", "x", lambda x: 0.02 + 0.01 * x[0])
    return body, "bottom", lambda x: 0.2 * np.sum((x[:-1] - 0.45) ** 2, axis=0)


def floating(make, element, unit=1.0):
    body = box(make, element, unit)
    down = np.zeros(body.dim)
    down[-1], down[0] = -0.1 * unit, 0.01 * unit
    return body.load("top", tuple(down)), "bottom", 0.0


def wedged(make, element, unit=1.0):
    """Two boundaries, between planes that close in; supports hold one tangent of some points."""
    body = box(make, element, unit).fix("right", "x", -0.01).fix("right", "yz")
    body.fix("front", "y", lambda x: 0.01 * (1.0 - x[0]))
    below, above = Plane((1.0, 0.0, 0.0), (0.05, 0.0, 1.0)), Plane((1.0, 0.0, 1.0), (0.05, 0.0, -1))
    return body, ["bottom", "top"], (below, above)


def layered(make, element, unit=1.0):
    block = LayeredBlock(1.0, [(1.0, 16, 2.0, 0.3)]).fix("top", "xy", -0.05)
    return block, "bottom", lambda x: 0.3 * (x[0] - 0.4) ** 2


CASES = {
    "held Quad1": (held, ElementQuad1, 1.0),
    "held Hex1": (held, ElementHex1, 1.0),
    "held TetP2": (held, ElementTetP2, 1.0),
    "held Adini": (held, ElementHexAdini, 1.0),
    "soft": (held, ElementHex1, 1e-6),
    "hard": (held, ElementHex1, 1e11),
    "floating Quad1": (floating, ElementQuad1, 1.0),
    "floating Hex1": (floating, ElementHex1, 1.0),
    "floating TetP1": (floating, ElementTetP1, 1.0),
    "wedged": (wedged, ElementHex1, 1.0),
    "layered": (layered, None, 1.0),
}
LAWS = {"coulomb": 0.4, "tresca": 0.03, None: 0.0}


def moved(problem):
    """The boundary problem on the host and with W elsewhere, and the scaled law."""
    condensed, system = problem.condense(), problem.system
    here = condensed.boundary_problem(system.load, system.rows.gap, motion=system.motion)
    there = replace(here, W=Kept(Elsewhere(), here.W))
    return here, there, system.scaled_friction(condensed.point_scale)


def solved(problem, law, name, method="newton", limit=None):
    options = Options.checked(name, problem.tangent.shape[1] + 1, method, None, limit, None)
    lines = []
    forces, _ = solve_boundary(problem, law, options, None, np.ones(problem.gap.size), lines.append)
    return forces, list(map(str, lines))


def same(forces, host, tol):
    assert np.abs(forces.mu - host.mu).max() <= tol * host.mu.max()
    assert np.abs(forces.t - host.t).max() <= tol * host.mu.max()


@pytest.mark.sampled(4)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("case", CASES)
def test_the_host_finds_the_same_forces(make, case, law):
    pose, element, unit = CASES[case]
    friction = LAWS[law] * (unit if law == "tresca" else 1.0)
    here, there, scaled = moved(ContactProblem(*pose(make, element, unit), friction, law=law))
    if law is None and here.s.size:  # nothing holds the body along the ground
        for one in (here, there):
            with pytest.raises(Infeasible):
                solved(one, scaled, law)
        return
    host, forces = (solved(one, scaled, law)[0] for one in (here, there))
    assert host.mu.max() > 0
    same(forces, host, 1e-10)
    assert law is not None or there.W.arrays.definite > 0


@pytest.mark.parametrize(
    ("method", "limit"), [("newton", 1), ("pdas", None), ("tresca_loop", None)]
)
def test_the_host_solves_what_stalls_and_all_other_methods(make, method, limit):
    here, _, law = moved(ContactProblem(*layered(make, None), 0.4))
    there = replace(here, W=DeviceMatrix(Elsewhere(), here.W))
    forces, _ = solved(there, law, "coulomb", method, limit)
    same(forces, solved(here, law, "coulomb", method, limit)[0], 1e-10)
