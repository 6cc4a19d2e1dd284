"""Units, order of the variables and repetition do not matter."""

from types import SimpleNamespace

import convex_problems as problems
import numpy as np
import pytest
from scipy import sparse

from gpu import GpuError, Infeasible, QPFactor, Unbounded, batch_solve_qp, solve_qp
from gpu.qp.data.standard_qp import StandardQP
from gpu.qp.interior_point import kkt_system
from gpu.qp.interior_point.kkt_system import LIMITS, safe_system

SEEDS = [3, 7, 13, 26, 41, 60, 77, 83]


def solved(p):
    return solve_qp(p.P, p.q, A=p.A, b=p.b, lb=p.lb, ub=p.ub)


def feasible(qps, seed):
    p = qps.random(seed)
    while not p.feasible:
        seed += 1000
        p = qps.random(seed)
    return p


@pytest.mark.parametrize("seed", SEEDS)
def test_a_repeated_call_gives_the_same_bits(qps, seed):
    p = feasible(qps, seed)
    first, second = solved(p), solved(p)
    for name in ("x", "y", "z_box", "active"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert first.history == second.history


@pytest.mark.parametrize("seed", SEEDS)
def test_units_by_powers_of_two_change_no_bit(qps, seed):
    p = feasible(qps, seed)
    rng = np.random.default_rng(seed)
    n, m = p.q.size, p.b.size
    unit = 2.0 ** rng.integers(-30, 30, n)
    row = 2.0 ** rng.integers(-30, 30, m)
    scaled = solve_qp(
        2.0**36 * unit[:, None] * p.P * unit,
        2.0**36 * unit * p.q,
        A=row[:, None] * p.A * unit,
        b=row * p.b,
        lb=p.lb / unit,
        ub=p.ub / unit,
    )
    result = solved(p)
    np.testing.assert_array_equal(unit * scaled.x, result.x)
    np.testing.assert_array_equal(scaled.z_box, 2.0**36 * unit * result.z_box)
    assert scaled.history == result.history


@pytest.mark.parametrize("factor", [1e-12, 1e-6, 1e6, 1e12])
def test_contact_like_scales(factor):
    t = np.linspace(0.0, 1.0, 60)
    W = np.exp(-10 * np.abs(t[:, None] - t))
    r = np.sin(7 * t)
    ub = np.where(t < 0.5, np.inf, 0.05)
    reference = solve_qp(W, -r, lb=np.where(t < 0.5, 0.0, -0.05), ub=ub)
    result = solve_qp(factor * W, -r, lb=np.where(t < 0.5, 0.0, -0.05) / factor, ub=ub / factor)
    np.testing.assert_array_equal(result.active, reference.active)
    np.testing.assert_allclose(factor * result.x, reference.x, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
def test_order_of_the_variables(qps, seed):
    p = feasible(qps, seed)
    result = solved(p)
    order = np.random.default_rng(seed).permutation(p.q.size)
    permuted = solve_qp(
        p.P[np.ix_(order, order)],
        p.q[order],
        A=p.A[:, order],
        b=p.b,
        lb=p.lb[order],
        ub=p.ub[order],
    )
    root = np.sqrt(np.diag(p.P))
    # Both are stationary to rounding; the condition of P, up to 1e8, separates the points.
    distance = root[order] * np.abs(permuted.x - result.x[order])
    assert distance.max() <= 1e-7 * (root * np.abs(result.x)).max()


def differs(value, terms):
    """A difference whose rounding is zero."""
    return np.where(abs(value) <= 1e-12 * terms, 0.0, value)


def moved(p, x, tidy=True):
    """The problem in x - x0: what holds at x0 is exactly zero, or rounding if not `tidy`."""

    def difference(value, terms):
        return differs(value, terms) if tidy else value

    def side(M, r):
        finite = np.where(np.isfinite(r), r, 0.0)
        shifted = difference(finite - M @ x, abs(finite) + abs(M) @ abs(x))
        return np.where(np.isfinite(r), shifted, r)

    unit = np.eye(len(x))
    q = difference(p.q + p.P @ x, abs(p.q) + abs(p.P) @ abs(x))
    return SimpleNamespace(
        P=p.P, q=q, G=p.G, A=p.A, h=side(p.G, p.h), h_low=side(p.G, p.h_low), b=side(p.A, p.b),
        lb=side(unit, p.lb), ub=side(unit, p.ub),
    )  # fmt: skip


def in_lengths(p, unit):
    sides = {name: unit * getattr(p, name) for name in ("q", "h", "h_low", "b", "lb", "ub")}
    return SimpleNamespace(**{**vars(p), **sides})


def run(p, stored=np.asarray):
    arguments, keywords = problems.arguments(p)
    arguments = [stored(a) if np.ndim(a) == 2 else a for a in arguments]
    return solve_qp(*arguments, **keywords)


def outcome(p):
    try:
        return run(p)
    except GpuError as error:
        return error


def objective(p, x):
    return 0.5 * x @ p.P @ x + p.q @ x


SEEDS_OF_LENGTHS = [
    range(0, 10),
    [95, 832, 1190],  # forces without any side; sparse systems whose pivots are poor
    pytest.param(range(10, 500), marks=pytest.mark.slow),
    pytest.param(range(500, 1250), marks=pytest.mark.slow),
]


@pytest.mark.parametrize("stored", [np.asarray, sparse.csr_array], ids=["dense", "sparse"])
@pytest.mark.parametrize("seeds", SEEDS_OF_LENGTHS, ids=str)
def test_the_origin_and_lengths_are_nothing_special(seeds, stored):
    """Sizes relative to an x that is zero were no sizes: the problems were given up."""
    for seed in seeds:
        p = problems.convex_problem(seed, 25)
        if p.fate != "solvable":
            continue
        x = run(p).x
        origin = moved(p, x)
        for unit in (1.0, 1e-12, 1e12) if seed % 5 == 0 else (1.0,):
            for program, here in ((origin, 0.0 * x), (p, x)):
                result = run(in_lengths(program, unit), stored)
                assert result.kkt.worst <= 1e-9, seed
                found, known = (objective(program, v) for v in (result.x / unit, here))
                terms = abs(program.q) @ (abs(x) + abs(result.x / unit))
                assert abs(found - known) <= 1e-8 * max(terms, abs(x @ p.P @ x)), seed
                if "strict" in p.kind:
                    np.testing.assert_allclose(
                        result.x / unit, here, rtol=1e-6, atol=1e-8 * abs(x).max()
                    )


def whole(seed, rounded):
    """A program of integers, or of integers times numbers near one, and its solution; every second
    one has no multipliers, so that at the origin q is nothing or rounding."""
    rng = np.random.default_rng([36, seed])
    n = int(rng.integers(1, 13))

    def draw(*shape, most=5):
        value = rng.integers(-most, most + 1, shape).astype(float)
        return value * rng.uniform(0.5, 1.5, shape) if rounded else value

    curved = seed % 3
    L = draw([0, int(rng.integers(1, max(n // 2, 1) + 1)), n][curved], n)
    P = L.T @ L + np.eye(n) * (curved == 2)
    G, A = draw(int(rng.integers(0, 2 * n + 1)), n), draw(int(rng.integers(0, n // 2 + 1)), n)
    x, pushed = draw(n, most=9), rng.random() < 0.5
    z = rng.integers(0, 4, len(G)) * (rng.random(len(G)) < 0.5)
    slack = np.where(z > 0, 0, rng.integers(0, 5, len(G)) * (rng.random(len(G)) < 0.5))
    where = rng.integers(-1, 2, n)
    free = rng.random(n) < rng.choice([0.0, 0.5, 1.0])
    lb = np.where(free & (where >= 0), -np.inf, x - np.where(where < 0, 0, rng.integers(0, 5, n)))
    ub = np.where(free & (where <= 0), np.inf, x + np.where(where > 0, 0, rng.integers(0, 5, n)))
    q = G.T @ z + A.T @ draw(len(A)) + where * rng.integers(0, 4, n)
    # Sums in another order than in `moved`, so that differences leave their rounding.
    q = -(L.T @ (L @ x) + x * (curved == 2)) - pushed * q
    h, b = ((M * x)[:, ::-1].sum(axis=1) for M in (G, A))
    return SimpleNamespace(
        P=(P + P.T) / 2, q=q, G=G, A=A, h=h + slack, h_low=np.full(len(G), -np.inf), b=b,
        lb=lb, ub=ub,
    ), x  # fmt: skip


@pytest.mark.parametrize("rounded", [False, True], ids=["exact", "rounded"])
@pytest.mark.parametrize(
    "seeds",
    [
        range(12),
        *(pytest.param(range(k, k + 38), marks=pytest.mark.slow) for k in range(12, 1000, 38)),
    ],
    ids=str,
)
def test_what_translations_leave_of_zeros(seeds, rounded):
    """To and beside the origin, where sides and forces are nothing but rounding."""
    for seed in seeds:
        p, x = whole(seed, rounded)
        size = max(abs(p.q) @ abs(x), x @ p.P @ x, 1.0)
        for unit, away in ((1.0, 0.0), (1e-12, 0.0), (1e12, 0.0), (1.0, 2.0**-30)):
            here = away * x
            program = moved(p, x - here, tidy=False)
            result = outcome(in_lengths(program, unit))
            if isinstance(result, GpuError):
                # Nothing has a size beside rounding, or that of q is a ray where P is singular; or
                # dependent rows, known to 1e-7 beside the origin, contradict each other by so much.
                sides = np.concatenate([program.h, program.b, program.lb, program.ub])
                alone = not (abs(sides[np.isfinite(sides)]) > 0.5).any()
                assert rounded, seed
                apart = away > 0 if isinstance(result, Infeasible) else seed % 3 == 1
                assert alone or (apart and isinstance(result, Infeasible | Unbounded)), seed
                continue
            value = objective(program, result.x / unit) - objective(program, here)
            assert abs(value) <= 1e-8 * size, seed
            assert result.kkt.worst <= 1e-9, seed
            if seed % 3 == 2:
                np.testing.assert_allclose(result.x / unit, here, atol=1e-9)


@pytest.mark.parametrize("unit", [1.0, 1e-12, 1e6, 1e12, 1e20])
@pytest.mark.parametrize("sides", [(), (0.0,)], ids=["no sides", "sides at zero"])
def test_curvature_alone_makes_every_length(sides, unit):
    """Nearly singular, and without any other length."""
    P = np.array([[1e-3, -0.0315], [-0.0315, 1.0]])
    x = np.array([-0.7, 0.02])
    rows = (np.ones((len(sides), 2)), unit * np.array(sides)) if sides else (None, None)
    result = solve_qp(
        sparse.csr_array(P), -unit * (P @ x), None if not sides else sparse.csr_array(rows[0]),
        rows[1],
    )  # fmt: skip
    assert result.kkt.worst <= 1e-12
    np.testing.assert_allclose(result.x / unit, x, rtol=1e-9)


def test_a_sparse_program_that_failed_is_factored_with_symmetric_pivoting():
    rng = np.random.default_rng(0)
    P, C = np.diag([1.0, 0.0, 2.0, 0.0]), rng.standard_normal((2, 4))
    nothing, free = np.zeros(2), np.full(4, np.inf)

    def program(P, C):
        return StandardQP(P, np.ones(len(free)), C, nothing, nothing, -free, free)

    system = safe_system(program(sparse.csr_array(P), sparse.csr_array(C)))
    system.factor(np.full(4, 1e-12), np.full(2, 1e-12))
    r, s = rng.standard_normal(4), rng.standard_normal(2)
    K = np.block([[P + 1e-12 * np.eye(4), C.T], [C, -1e-12 * np.eye(2)]])
    expected = np.linalg.solve(K, np.concatenate([r, s]))
    np.testing.assert_allclose(np.concatenate(system.solve(r, s)), expected, rtol=1e-9)
    free = np.full(LIMITS.pivoted, np.inf)
    P, C = sparse.eye_array(free.size, format="csr"), sparse.csr_array(np.ones((2, free.size)))
    assert safe_system(program(P, C)) is None


@pytest.mark.parametrize("seed", [832, 1190])
def test_pivots_of_larger_sparse_programs_are_chosen_by_size(seed, monkeypatch):
    """Above 600 unknowns there was no other system where pivots on the diagonal are poor."""
    monkeypatch.setattr(kkt_system, "LIMITS", LIMITS._replace(dense=0))
    p = problems.convex_problem(seed, 25)
    for program in (p, moved(p, run(p).x)):
        assert run(program, sparse.csr_array).kkt.worst <= 1e-9


@pytest.mark.parametrize("seed", range(40))
def test_projections_on_plane_cones(seed):
    """Onto G x <= 0, of points that the cone sends to its apex."""
    rng = np.random.default_rng(seed)
    m, n = int(rng.integers(1, 9)), int(rng.integers(2, 6))
    G = rng.standard_normal((m, n))
    far = G.T @ rng.exponential(size=m)
    for unit in (1.0, 1e-12, 1e12):
        result = solve_qp(np.eye(n), -unit * far, G, np.zeros(m))
        assert abs(result.x).max() <= 1e-12 * unit * abs(far).max()
        assert result.kkt.worst <= 1e-9
        assert result.path == "interior point" or result.iterations <= 20
    for result in batch_solve_qp(QPFactor(np.eye(n)), [-far, -2.0 * far], G, np.zeros((2, m))):
        assert abs(result.x).max() <= 1e-12 * abs(far).max()


@pytest.mark.parametrize("stored", [np.asarray, sparse.csr_array], ids=["dense", "sparse"])
@pytest.mark.parametrize("curved", [0, 1, 2], ids=["linear", "semidefinite", "strict"])
@pytest.mark.parametrize("seed", range(6))
def test_rows_through_the_origin(seed, curved, stored):
    """Some rows pass through it, others do not; linear programs have no length but theirs."""
    rng = np.random.default_rng([seed, curved])
    n, m = int(rng.integers(2, 8)), int(rng.integers(1, 10))
    G, A = rng.standard_normal((m, n)), rng.standard_normal((int(rng.integers(0, n // 2 + 1)), n))
    M = rng.standard_normal((max(1, n // 2), n))
    P = [0.0 * np.eye(n), M.T @ M, M.T @ M + np.eye(n)][curved]
    away = rng.random(m) < 0.4 * (seed % 2)
    low = np.where(rng.random(n) < 0.5, 0.0, -np.inf)
    push = np.where(low == 0.0, rng.exponential(size=n), 0.0)
    q = push - G.T @ (rng.exponential(size=m) * ~away) - A.T @ rng.standard_normal(len(A))
    h = np.where(away, rng.exponential(size=m), 0.0)
    for unit in (1.0, 1e-12, 1e12):
        result = solve_qp(
            stored((P + P.T) / 2), unit * q, stored(G), unit * h, stored(A), np.zeros(len(A)), low
        )
        assert result.kkt.worst <= 1e-9
        x = result.x / unit
        assert abs(0.5 * x @ P @ x + q @ x) <= 1e-9 * abs(q).max()


@pytest.mark.parametrize("seed", range(0, 160, 8))
def test_boxes_with_equality_rows_at_the_origin(qps, seed):
    p = feasible(qps, seed)
    x = solved(p).x
    for unit in (1.0, 1e-12, 1e12):
        result = solve_qp(
            p.P, unit * (p.q + p.P @ x), A=p.A, b=unit * (p.b - p.A @ x),
            lb=unit * (p.lb - x), ub=unit * (p.ub - x),
        )  # fmt: skip
        root = np.sqrt(np.diag(p.P))
        force = (abs(p.q) + abs(p.P) @ abs(x)) / root
        assert (root * abs(result.x)).max() <= 1e-7 * unit * force.max()
