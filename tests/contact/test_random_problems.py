"""Random boundary problems: an answer is right or an error is raised, and most are solved."""

import numpy as np
import pytest
from scipy.linalg import LinAlgError

from contact.boundary import BoundaryProblem, Friction
from contact.errors import ContactError
from contact.methods import Options, solve_boundary
from gpu import GpuError


def random_problem(seed):
    """A dense problem such as condensation leaves it, with rough data, and a friction law.

    W couples all components through a decaying kernel and a random part and has a unit diagonal;
    some points are out of reach, some tangents prescribed, some bodies float.
    """
    rng = np.random.default_rng(seed)
    m, dim_t = int(rng.integers(1, 61)), int(rng.choice([1, 1, 2]))
    n = m * (1 + dim_t)
    place = np.sort(rng.uniform(0, 1, m))
    distance = np.abs(place[:, None] - place)
    kernel = np.exp(-rng.uniform(1.0, 30.0) * distance)
    mixing = rng.standard_normal((1 + dim_t, 1 + dim_t))
    mixing = mixing @ mixing.T / 3 + np.eye(1 + dim_t)
    noise = rng.standard_normal((n, n))
    W = np.kron(mixing, kernel) + 0.05 * rng.random() * noise @ noise.T / n + 1e-3 * np.eye(n)
    root = np.sqrt(np.diag(W))
    W = W / np.outer(root, root)

    normal = np.arange(m)
    tangent = m + np.arange(m * dim_t).reshape(dim_t, m).T
    gap = rng.uniform(-0.2, 1.0) + rng.choice([0.05, 0.5]) * rng.standard_normal(m)
    gap[rng.random(m) < 0.1] = np.inf
    held = np.zeros((m, dim_t))
    v0 = rng.choice([0.3, 1.0, 3.0]) * rng.standard_normal(n)
    v0[:m] += 0.5
    C, s = np.zeros((n, 0)), np.zeros(0)
    if rng.random() < 0.3:  # one free motion along the normals, pressed on
        C = np.concatenate((np.ones(m), np.zeros(n - m)))[:, None]
        s = np.array([rng.uniform(0.1, 2.0)])
    problem = BoundaryProblem(W, v0, C, s, gap, normal, tangent, held)
    coulomb = bool(rng.random() < 0.7)
    value = rng.uniform(0.0, 3.0) * np.where(rng.random(m) < 0.9, 1.0, 0.0)
    law = None if rng.random() < 0.15 else Friction(value, coulomb)
    return problem, law


def error(problem, law, forces):
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
    g = np.zeros(m) if law is None else law.value * (mu if law.coulomb else 1.0)
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


def solve(problem, law, method):
    name = None if law is None else "coulomb" if law.coulomb else "tresca"
    options = Options.checked(name, 1 + problem.tangent.shape[1], method, None, None, None)
    scale = np.ones(problem.gap.size)
    return solve_boundary(problem, law, options, None, scale, lambda line: None)[0]


def tally(seeds, method):
    """Seeds of problems not solved, convex ones apart; fails on an answer that is wrong."""
    unsolved = {True: [], False: []}
    wrong = []
    for seed in seeds:
        problem, law = random_problem(seed)
        try:
            size = error(problem, law, solve(problem, law, method))
        except (ContactError, GpuError, LinAlgError):
            unsolved[law is None or not law.coulomb].append(seed)
            continue
        if not size <= 1e-9:  # a thousand times the tolerance of the boundary problem
            wrong.append((seed, size))
    assert not wrong
    return unsolved[True], unsolved[False]


# Shares that may stay unsolved, without or with given friction, and of Coulomb's law with
# coefficients up to 3: about twice what is seen. Rough gaps; the damped form alone stalls at times.
UNSOLVED = {"newton": (0.0, 0.01), "pdas": (0.01, 0.08)}


def check(seeds, method):
    convex, coulomb = tally(seeds, method)
    print(f"{method}: of {len(seeds)} problems unsolved: convex {convex}, Coulomb {coulomb}")
    assert len(convex) <= UNSOLVED[method][0] * len(seeds)
    assert len(coulomb) <= UNSOLVED[method][1] * len(seeds)


@pytest.mark.parametrize(("method", "count"), [("newton", 200), ("pdas", 100)])
def test_no_wrong_answer(method, count):
    check(range(count), method)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["newton", "pdas"])
def test_no_wrong_answer_among_many(method):
    check(range(1000, 3000), method)


def test_error_sees_a_wrong_answer():
    """The measure above is zero at a solution and is not after a small change."""
    problem, law = next(
        pair for pair in map(random_problem, range(20)) if pair[1] is not None and pair[1].coulomb
    )
    forces = solve(problem, law, "newton")
    assert error(problem, law, forces) < 1e-9
    for field in ("mu", "t"):
        spoiled = type(forces)(**{**vars(forces), field: 1.001 * getattr(forces, field)})
        assert error(problem, law, spoiled) > 1e-5
