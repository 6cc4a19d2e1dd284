"""Random boundary problems: an answer is right or an error is raised, and most are solved."""

import numpy as np
import pytest
from scipy.linalg import LinAlgError

from contact import PressureOverclosure
from contact.condensation.boundary_problem import BoundaryProblem
from contact.condensation.primal import PrimalProblem
from contact.errors import ContactError
from contact.laws.friction import Coulomb, Tresca
from contact.laws.methods import solve_boundary
from contact.laws.options import Options
from contact.laws.surface_law import SurfaceLaw
from gpu import GpuError

TOLERANCE = 1e-10  # what `solve` promises by default: the solvers aim a hundred times lower


def random_problem(seed):
    """A dense problem such as condensation leaves it, with rough data, and a friction law.

    1 to 400 points, friction 0 to 3, loads of 1e-9 to 1e12. W couples all components through a
    decaying or the logarithmic kernel of the half plane, or at random, and has a unit diagonal. In
    a fifth of the problems rows repeat others, exactly or nearly. Some points are out of reach,
    some friction bounds are zero, some bodies float.
    """
    rng = np.random.default_rng([seed, 11])
    m = int(400 ** rng.uniform(0, 1) ** 2)
    dim_t = int(rng.choice([1, 1, 2]))
    n = m * (1 + dim_t)
    W = compliance(rng, m, dim_t)
    normal = np.arange(m)
    tangent = m + np.arange(m * dim_t).reshape(dim_t, m).T
    gap = rng.uniform(-0.2, 1.0) + rng.choice([0.05, 0.5]) * rng.standard_normal(m)
    gap[rng.random(m) < 0.1] = np.inf
    gap[0] = min(gap[0], 1.0)
    v0 = rng.choice([0.3, 1.0, 3.0]) * rng.standard_normal(n)
    v0[:m] += 0.5
    if rng.random() < 0.2:
        apart = rng.choice([0.0, 1e-12, 1e-9, 1e-6])
        rows = np.eye(n)
        for i in range(1, m):
            if rng.random() < 0.2:
                j = int(rng.integers(0, i))
                for first in range(0, n, m):
                    rows[first + i] = rows[first + j]
                    rows[first + i, first + i] += apart * rng.standard_normal()
                if rng.random() < 0.7:
                    gap[i] = gap[j]
        W, v0 = rows @ W @ rows.T, rows @ v0
    root = np.sqrt(np.diag(W))
    W = W / np.outer(root, root)
    C, s = np.zeros((n, 0)), np.zeros(0)
    if rng.random() < 0.3:  # one free motion along the normals, pressed on
        C = np.concatenate((np.ones(m), np.zeros(n - m)))[:, None]
        s = np.array([rng.uniform(0.1, 2.0)])
    scale = 10.0 ** rng.uniform(-9, 12)
    held = np.zeros((m, dim_t))
    problem = BoundaryProblem(W, v0 * scale, C, s * scale, gap * scale, normal, tangent, held)
    coulomb = bool(rng.random() < 0.7)
    value = rng.uniform(0.0, 3.0) * np.where(rng.random(m) < 0.9, 1.0, 0.0)
    value = value if coulomb else value * scale
    return problem, None if rng.random() < 0.15 else (Coulomb if coulomb else Tresca)(value)


def compliance(rng, m, dim_t):
    """Symmetric, positive definite, of order m (1 + dim_t)."""
    place = np.sort(rng.uniform(0, 1, m)) if rng.random() < 0.5 else (np.arange(m) + 0.5) / m
    distance = np.abs(place[:, None] - place)
    kind = rng.choice(["decaying", "decaying", "half plane", "random"])
    if kind == "decaying":
        kernel = np.exp(-rng.uniform(1.0, 30.0) * distance)
    elif kind == "half plane":
        kernel = -np.log(np.maximum(distance, 0.3 / m) / 2.0)
        kernel += max(0.0, -np.linalg.eigvalsh(kernel)[0]) * np.eye(m)
    else:
        kernel = rng.standard_normal((m, m))
        kernel = kernel @ kernel.T / m
    mixing = rng.standard_normal((1 + dim_t, 1 + dim_t))
    W = np.kron(mixing @ mixing.T / 3 + np.eye(1 + dim_t), kernel)
    noise = rng.standard_normal(W.shape)
    mean = np.trace(W) / len(W)
    return W + mean * (0.05 * rng.random() * noise @ noise.T / len(W) + 1e-3 * np.eye(len(W)))


def error(problem, friction, forces):
    """Largest violation of contact, friction and balance, from their definition.

    Displacements and forces are compared with the largest force: W has a unit diagonal.
    """
    mu, t, a = forces.mu, forces.t, forces.a
    stacked = np.concatenate((mu, t.T.ravel()))
    v = problem.v0 - problem.W @ stacked + problem.C @ a
    m = mu.size
    u_n, u_t = v[:m], v[m:].reshape(-1, m).T
    reach = np.isfinite(problem.gap)
    size = max(np.abs(stacked).max(), 1e-12 * np.abs(problem.v0).max())
    opening = np.where(reach, problem.gap - u_n, np.inf)
    g = np.zeros(m)
    if friction is not None:
        coulomb = isinstance(friction, Coulomb)
        g = friction.coefficient * mu if coulomb else friction.given
    length = np.linalg.norm(t, axis=1)
    power = np.sum(t * u_t, axis=1) - g * np.linalg.norm(u_t, axis=1)
    return max(
        np.max(-mu, initial=0.0) / size,
        np.max(-opening, initial=0.0) / size,
        np.max(np.minimum(np.abs(mu), np.abs(opening)), initial=0.0) / size,
        np.max(length - g, initial=0.0) / size,
        np.abs(power).max(initial=0.0) / size / max(size, np.abs(u_t).max()),
        np.abs(problem.C.T @ stacked - problem.s).max(initial=0.0) / size,
    )


def solve(problem, friction, method):
    name = None if friction is None else type(friction).__name__.lower()
    options = Options.checked(name, 1 + problem.tangent.shape[1], method, None, None, None)
    scale = np.ones(problem.gap.size)
    return solve_boundary(problem, friction, options, None, scale, lambda line: None)[0]


def unsolved(seeds, method):
    """Seeds of the problems that are given up; fails on an answer that is wrong."""
    given_up = []
    for seed in seeds:
        problem, friction = random_problem(seed)
        try:
            forces = solve(problem, friction, method)
        except (ContactError, GpuError, LinAlgError):
            given_up.append(seed)
            continue
        assert error(problem, friction, forces) <= TOLERANCE, seed
    return given_up


@pytest.mark.turns(3)
def test_no_wrong_answer():
    assert not unsolved(range(500), "newton")


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_no_wrong_answer_among_ten_thousand(part):
    """1000 seeds each; .1 % may be given up."""
    assert len(unsolved(range(1000 * part, 1000 * (part + 1)), "newton")) <= 1


@pytest.mark.parametrize(
    "count", [40, pytest.param(1000, marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_damped_form_alone(count):
    """It stalls at times, on Coulomb's law with coefficients up to 3 and rough gaps."""
    assert len(unsolved(range(count), "pdas")) <= 0.1 * count


class Rows:
    """A stiffness of contact rows alone, with the solver of `AlteredSystem`."""

    def __init__(self, K):
        self._K = K

    def of_chosen(self, x):
        return x

    def solve(self, alteration, load, right, start, tol):
        held = alteration.held
        A = alteration.of_rows @ self._K + alteration.of_x.toarray()
        A[held] = np.eye(held.size)[held]
        x = np.linalg.solve(A, right)
        return x, self._K @ x


def posed_by_stiffness(problem):
    """The same problem with its rows as unknowns of the body."""
    K, none = np.linalg.inv(problem.W), np.zeros(problem.v0.size)
    return PrimalProblem(
        W=np.zeros((0, 0)), v0=none, C=problem.C, s=problem.s, gap=problem.gap,
        normal=problem.normal, tangent=problem.tangent, prescribed_slip=problem.prescribed_slip,
        system=Rows(K), load=K @ problem.v0, v=none,
    )  # fmt: skip


@pytest.mark.parametrize("law", [Coulomb, Tresca, type(None)])
def test_rows_as_unknowns_of_the_body(law):
    compared = 0
    for seed in range(80):
        problem, friction = random_problem(seed)
        if not isinstance(friction, law) or problem.s.size or problem.gap.size > 100:
            continue
        if np.linalg.cond(problem.W) > 1e6:  # rows that repeat others have no stiffness
            continue
        forces = solve(posed_by_stiffness(problem), friction, "newton")
        assert error(problem, friction, forces) < 1e-9
        compared += 1
    assert compared >= 3


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(80))
def test_ties_and_compliant_surfaces(seed):
    """Bonded points stay, the others obey the curve: by the definition of the laws."""
    rng = np.random.default_rng([seed, 7])
    m, dim_t = int(rng.integers(1, 60)), int(rng.choice([1, 2]))
    n, unit = m * (1 + dim_t), 10.0 ** rng.uniform(-9, 9)
    root = rng.standard_normal((n, n))
    W = root @ root.T / n + 0.1 * np.eye(n)
    W /= np.sqrt(np.outer(np.diag(W), np.diag(W)))
    gap, v0 = rng.uniform(-0.2, 1.0, m) * unit, rng.standard_normal(n) * unit
    bonded = (rng.random(m) < 0.2) & (rng.random() < 0.5 + (seed % 4 == 3))
    law = [
        PressureOverclosure([0.0, 1.0], [0.0, 10.0 ** rng.uniform(-3, 3)]),
        PressureOverclosure([0.0, 0.1 * unit, unit], [-0.1 * unit, 0.05 * unit, 0.1 * unit]),
        PressureOverclosure.exponential(unit * 10.0 ** rng.uniform(-2, 1), 0.1 * unit),
        None,
    ][seed % 4]
    one, number = np.ones(m), np.where(bonded, -1, 0)
    laws = law and SurfaceLaw(one, one, one, laws=(law,), number=number, bonded=bonded)
    problem = BoundaryProblem(
        W, v0, np.zeros((n, 0)), np.zeros(0), gap, np.arange(m),
        m + np.arange(m * dim_t).reshape(dim_t, m).T, np.zeros((m, dim_t)),
        bonded=bonded, compliance=laws,
    )  # fmt: skip
    F = rng.uniform(0.0, 0.5)
    forces = solve(problem, Coulomb(np.full(m, F)), "newton")
    u_n, u_t = problem.displacements(forces.mu, forces.t, forces.a)
    size, free = max(np.abs(forces.mu).max(), np.abs(forces.t).max(), 1e-9 * unit), ~bonded
    if law is None:
        off = np.minimum(forces.mu, gap - u_n)
        assert np.abs(off[free]).max(initial=0.0) <= 1e-9 * size
    else:
        slope = laws.at(forces.mu, u_n - gap, 0.0 * gap).slope
        off = np.abs(law.pressure(u_n - gap) - forces.mu) * np.minimum(slope, 1.0)
        assert np.max(off[free & (slope > 0)], initial=0.0) <= 1e-9 * size
        assert np.all((u_n - gap - law.start)[free & (slope == 0)] <= 1e-9 * size)
    assert np.all(forces.mu[free] >= -1e-10 * size)
    length = np.linalg.norm(forces.t, axis=1)
    assert np.all((length - F * forces.mu)[free] <= 1e-10 * size)
    power = np.sum(forces.t * u_t, axis=1) - F * forces.mu * np.linalg.norm(u_t, axis=1)
    assert np.abs(power[free]).max(initial=0.0) <= 1e-9 * size * max(size, np.abs(u_t).max())
    assert np.abs((u_n - gap)[bonded]).max(initial=0.0) <= 1e-9 * size
    assert np.abs(u_t[bonded]).max(initial=0.0) <= 1e-9 * size
