"""Small dense programs: the compiled dual active set, sequences, batches and derivatives."""

import copy
import itertools
import pickle
from concurrent.futures import ThreadPoolExecutor

import convex_problems as problems
import numpy as np
import piqp
import pytest
from scipy import sparse
from scipy.linalg import hilbert

from gpu import Infeasible, InputError, NotConverged, QPFactor, Status, batch_solve_qp, solve_qp
from gpu.qp.active_set import dual_kernels
from gpu.qp.active_set.dual import LIMITS, Kept, dual_active_set, result_of, rows_of
from gpu.qp.data.qp_problem import UNDECIDED, check_problem
from gpu.qp.data.qp_result import residuals_of

NAMES = "P", "q", "G", "h", "A", "b", "lb", "ub", "h_low"


def family(seed, n=8, l=12, m=2, count=None):
    """A strictly convex problem with rows of both kinds, two-sided rows and bounds; or many."""
    rng = np.random.default_rng([38, seed])
    k = () if count is None else (count,)
    M = rng.standard_normal((*k, n, n))
    P = M @ np.swapaxes(M, -1, -2) / n + 0.1 * np.eye(n)
    G, A, x = (rng.standard_normal((*k, *shape)) for shape in ((l, n), (m, n), (n, 1)))
    value = (G @ x)[..., 0]
    data = {
        "P": (P + np.swapaxes(P, -1, -2)) / 2, "q": 2.0 * rng.standard_normal((*k, n)), "G": G,
        "h": value + rng.exponential(0.3, value.shape), "A": A, "b": (A @ x)[..., 0],
        "lb": x[..., 0] - rng.exponential(0.5, (*k, n)), "ub": x[..., 0] + 1.0,
        "h_low": value - rng.exponential(0.3, value.shape),
    }  # fmt: skip
    return data if m else data | {"A": None, "b": None}


def optimal(data, result, bound=1e-13):
    """The conditions of optimality in extended precision, each over its terms."""
    wide = {name: np.asarray(value, np.longdouble) for name, value in data.items()}
    x, y, z, z_box = (np.asarray(v, np.longdouble) for v in (
        result.x, result.y, result.z, result.z_box
    ))  # fmt: skip
    P, q, G, A = wide["P"], wide["q"], wide["G"], wide["A"]
    force = abs(P) @ abs(x) + abs(q) + abs(G.T) @ abs(z) + abs(A.T) @ abs(y)
    assert abs(P @ x + q + G.T @ z + A.T @ y + z_box).max() <= bound * force.max()
    length = max(abs(x).max(), abs(np.linalg.solve(data["P"], data["q"])).max())
    assert abs(A @ x - wide["b"]).max() <= bound * (abs(A).max() * length + abs(wide["b"]).max())
    for value, low, high, multiplier, unit in (
        (G @ x, wide["h_low"], wide["h"], z, abs(G).max()),
        (x, wide["lb"], wide["ub"], z_box, 1.0),
    ):  # fmt: skip
        room = bound * unit * length
        assert np.all(value <= high + room)
        assert np.all(value >= low - room)
        side = np.where(multiplier > 0, high, np.where(multiplier < 0, low, value))
        assert abs(value - side).max() <= room


@pytest.mark.parametrize("unit", [1.0, 1e-12, 1e12])
@pytest.mark.parametrize(("n", "l"), [(1, 1), (5, 0), (8, 12), (20, 60), (40, 20)])
def test_optimal_in_extended_precision_and_equal_to_a_peer(n, l, unit):
    for seed in range(6):
        data = family(seed, n, max(l, 1), min(2, n - 1) or 1)
        moved = data | {name: unit * data[name] for name in ("q", "h", "h_low", "b", "lb", "ub")}
        result = solve_qp(**moved)
        optimal(moved, result)
        assert result.path == "active set"
        peer = piqp.DenseSolver()
        peer.settings.eps_abs = peer.settings.eps_rel = 1e-12
        peer.setup(*(data[k] for k in ("P", "q", "A", "b", "G", "h_low", "h", "lb", "ub")))
        peer.solve()
        np.testing.assert_allclose(result.x / unit, peer.result.x, rtol=0, atol=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_units_of_rows_and_variables_change_no_answer(seed):
    data, rng = family(seed), np.random.default_rng(seed)
    plain = solve_qp(**data)
    D, E, F = (10.0 ** rng.uniform(-6, 6, data[name].shape) for name in ("q", "h", "b"))
    scaled = {
        "P": D[:, None] * data["P"] * D, "q": D * data["q"], "G": E[:, None] * data["G"] * D,
        "h": E * data["h"], "h_low": E * data["h_low"], "A": F[:, None] * data["A"] * D,
        "b": F * data["b"], "lb": data["lb"] / D, "ub": data["ub"] / D,
    }  # fmt: skip
    scaled["P"] = (scaled["P"] + scaled["P"].T) / 2
    result = solve_qp(**scaled)
    np.testing.assert_allclose(D * result.x, plain.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(E * result.z, plain.z, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(result.active_rows, plain.active_rows)


def test_equal_bits_from_lists_and_arrays():
    data = family(3)
    one = solve_qp(**data)
    two = solve_qp(**{name: value.tolist() for name, value in data.items()})
    for name in ("x", "y", "z", "z_box", "active", "active_rows"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert (one.kkt, one.history, one.status) == (two.kkt, two.history, two.status)


def test_nothing_is_compiled_anew_for_other_storage():
    data = family(9)
    known = solve_qp(**data)
    factor = QPFactor(data["P"], G=data["G"], A=data["A"])
    sides = {name: data[name] for name in ("h", "b", "lb", "ub", "h_low")}
    factor.solve(data["q"], **sides)
    many = {name: np.stack([value, value]) for name, value in data.items()}
    batch_solve_qp(**many)
    kernels = (dual_kernels.solve_one, dual_kernels.solve, dual_kernels.solve_many)
    before = [len(kernel.signatures) for kernel in kernels]

    def frozen(value):
        value = value.copy()
        value.flags.writeable = False
        return value

    def strided(value):
        return np.repeat(value, 2, axis=-1)[..., ::2]

    for change in (frozen, strided, np.asfortranarray, lambda v: np.frombuffer(
        b"x" + v.tobytes(), np.uint8)[1:].view(float).reshape(v.shape)
    ):  # fmt: skip
        other = {name: change(value) for name, value in data.items()}
        np.testing.assert_array_equal(solve_qp(**other).x, known.x)
        found = factor.solve(other["q"], **{name: other[name] for name in sides})
        np.testing.assert_allclose(found.x, known.x, rtol=0, atol=1e-13)
        batch = batch_solve_qp(**{name: change(value) for name, value in many.items()})
        np.testing.assert_allclose(batch.x[1], known.x, rtol=0, atol=1e-13)
    assert [len(kernel.signatures) for kernel in kernels] == before


def test_rows_that_return_and_vertices_of_too_many_rows():
    # Each row three times, and all sides through the solution: most of them carry no force.
    for seed in range(6):
        data = family(seed, 6, 8, 2)
        x = solve_qp(**data).x
        for name in ("G", "A"):
            data[name] = np.concatenate([data[name], data[name], -2.0 * data[name]])
        data["h"], data["h_low"], data["b"] = data["G"] @ x, data["G"] @ x - 5.0, data["A"] @ x
        result = solve_qp(**data)
        optimal(data, result, 1e-12)
        np.testing.assert_allclose(result.x, solve_qp(**data, start=result).x, atol=1e-13)


def test_contradictions_come_with_a_proof_that_names_the_rows():
    G = np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(Infeasible) as caught:
        solve_qp(np.eye(3), np.zeros(3), G, np.array([1.0, -2.0, 5.0]))
    y = caught.value.certificate
    assert y[2] == 0.0
    np.testing.assert_allclose(y[0], y[1])
    assert y @ np.array([1.0, -2.0, 5.0]) > 0.0 > y[0]
    # Sides that are apart by rounding only are no contradiction.
    close = solve_qp(np.eye(3), np.ones(3), G, np.array([1.0 - 3e-16, -1.0, 5.0]))
    assert close.kkt.worst < 1e-12


@pytest.mark.parametrize("general", [False, True])
def test_compiled_residuals_are_those_of_the_certificate(general):
    for seed in range(10):
        data = family(seed, 9, 11, 3)
        if not general:
            data |= dict.fromkeys(("G", "h", "h_low"))
        result = solve_qp(**data)
        problem = check_problem(**data)
        known = residuals_of(problem, result.x, result.y, result.z, result.z_box)
        # Sums in another order: digits of rounding differ.
        for name in ("stationarity", "primal", "sign", "complementarity", "gap"):
            assert getattr(result.kkt, name) == pytest.approx(getattr(known, name), abs=1e-15)


@pytest.mark.parametrize("general", [False, True])
def test_the_certificate_sees_that_another_problem_was_solved(general):
    data, rng = family(12, 14, 6, 2), np.random.default_rng(12)
    if not general:
        data |= dict.fromkeys(("G", "h", "h_low"))
    problem = check_problem(**data)
    rows = rows_of(problem)
    for wrong in ("rows", "matrix"):
        kept = Kept(rows.P + (wrong == "matrix") * np.diag(rng.random(14)), rows.C)
        kept.S *= 1.0 + (wrong == "rows") * 1e-3 * rng.random(kept.S.shape)
        kept.begin(rows, np.zeros(rows.low.size, np.int8))
        found = kept.run(rows)
        y, z = found.y[: rows.equal], found.y[rows.equal :]
        known = residuals_of(problem, found.x, y, z, found.z_box)
        assert result_of(rows, found) is None
        assert known.worst > 1e-7
        names = ("stationarity", "primal", "sign", "complementarity", "gap")
        for k, name in enumerate(names):
            assert found.kkt[k] == pytest.approx(getattr(known, name), rel=1e-6, abs=1e-13), name
        assert known.primal > 1e-7 if wrong == "rows" else known.stationarity > 1e-7


def test_what_is_not_decided_goes_to_other_methods(monkeypatch):
    data = family(8)
    known = solve_qp(**data)
    monkeypatch.setattr("gpu.qp.active_set.dual.LIMITS", LIMITS._replace(steps=0))
    assert dual_active_set(rows_of(check_problem(**data))).code == UNDECIDED
    result = solve_qp(**data)
    assert (known.iterations > 0, result.kkt.worst < 1e-13) == (True, True)
    np.testing.assert_allclose(result.x, known.x, rtol=0, atol=1e-12)
    assert rows_of(check_problem(**data | {"P": np.diag([0.0] + 7 * [1.0])})) is None


def test_sequences_continue_from_the_last_active_set():
    data = family(1, 20, 40, 3)
    fixed = {name: data.pop(name) for name in ("P", "G", "A")}
    factor, rng = QPFactor(**fixed), np.random.default_rng(1)
    first = factor.solve(**data)
    assert factor.solve(**data).iterations == 1 < first.iterations
    for k in range(300):
        data["q"] = data["q"] + 0.05 * rng.standard_normal(20)
        if k % 50 == 0:  # other sides, and no sides where some were held
            data["h"] = np.where(rng.random(40) < 0.3, np.inf, data["h"])
            data["lb"] = np.where(rng.random(20) < 0.3, -np.inf, data["lb"])
        result = factor.solve(**data)
        again = solve_qp(**fixed, **data)
        optimal(fixed | data, result)
        np.testing.assert_allclose(result.x, again.x, rtol=0, atol=1e-12)
        np.testing.assert_allclose(result.z, again.z, rtol=0, atol=1e-11)
    with pytest.raises(Infeasible):
        factor.solve(**data | {"h_low": data["ub"].max() + 1e3 * abs(fixed["G"]).sum(axis=1)})
    with pytest.raises(Infeasible):
        factor.solve(**data | {"lb": 9.0, "ub": np.full(20, 10.0)})
    optimal(fixed | data, factor.solve(**data))  # and nothing is left of that
    start = factor.solve(**data, start=first)
    np.testing.assert_allclose(start.x, factor.solve(**data).x, atol=1e-12)


def test_a_sequence_in_many_threads():
    data = family(2, 15, 30)
    fixed = {name: data.pop(name) for name in ("P", "G", "A")}
    factor, rng = QPFactor(**fixed), np.random.default_rng(2)
    linear = [data["q"] + rng.standard_normal(15) for _ in range(64)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda q: factor.solve(**data | {"q": q}).x, linear))
    for q, x in zip(linear, found, strict=True):
        np.testing.assert_allclose(x, solve_qp(**fixed, **data | {"q": q}).x, rtol=0, atol=1e-12)


def test_sequences_of_other_problems_are_those_of_solve_qp():
    rng = np.random.default_rng(3)
    thin = np.diag(np.r_[np.ones(4), np.zeros(4)])
    G, h, q = rng.standard_normal((5, 8)), np.ones(5), rng.standard_normal(8)
    for P in (thin, sparse.csr_array(thin + np.eye(8))):
        factor = QPFactor(P, G=G)
        found = factor.solve(q, h, lb=-1.0, ub=1.0)
        np.testing.assert_allclose(found.x, solve_qp(P, q, G, h, lb=-1.0, ub=1.0).x, atol=1e-9)
    with pytest.raises(InputError, match="G is given without h"):
        factor.solve(q)
    with pytest.raises(InputError, match="A has shape"):
        QPFactor(np.eye(2), A=[[1.0, 2.0, 3.0]])
    box = QPFactor(np.eye(2))
    assert box.solve([1, -3], lb=[0, 0], ub=2).x.tolist() == [0.0, 2.0]
    for bad in ([np.nan, 1.0], np.array([1j, 0.0])):
        with pytest.raises(InputError, match="q"):
            box.solve(bad)
    with pytest.raises(InputError, match="q has shape"):
        box.solve([1.0, 1.0, 1.0])


@pytest.mark.parametrize("shared", [(), ("P",), ("P", "G", "A"), ("lb", "h", "b"), ("ub", "P")])
def test_batches_equal_single_problems(shared):
    data = family(4, 10, 20, 2, count=150)
    # Sides that problems share are wide, so that each of them has a solution.
    wide = {"lb": -9.0, "ub": np.full(10, 9.0), "h": np.full(20, 60.0), "b": np.zeros(2)}
    if "P" in shared or "b" in shared:
        data |= wide | {"h_low": None}
        shared = {"lb", "ub", "h", "b", *shared}
    data = {name: v[0] if name in shared and np.ndim(v) > 1 and len(v) == 150 else v
            for name, v in data.items()}  # fmt: skip
    batch = batch_solve_qp(**data)
    assert not batch.errors
    assert len(batch) == 150
    for i, result in enumerate(batch):
        own = {
            name: v[i] if np.ndim(v) and len(v) == 150 else v for name, v in data.items()
        }  # fmt: skip
        alone = solve_qp(**own)
        np.testing.assert_allclose(result.x, alone.x, rtol=0, atol=1e-12)
        np.testing.assert_allclose(result.z, alone.z, rtol=0, atol=1e-11)
        assert result.status is alone.status is batch.status[i]
        np.testing.assert_array_equal(result.active_rows, alone.active_rows)
    cold = batch_solve_qp(**data, warm_start=False)
    np.testing.assert_allclose(cold.x, batch.x, rtol=0, atol=1e-12)
    again = batch_solve_qp(**data, start=cold)
    assert set(again.iterations.tolist()) == {1}
    np.testing.assert_allclose(again.x, batch.x, rtol=0, atol=1e-12)


def test_members_without_solution_are_reported_in_place():
    data = family(5, 6, 9, 1, count=8)
    data["h_low"][3], data["lb"][5] = data["h"][3] + 1.0, data["ub"][5] + 1.0
    batch = batch_solve_qp(**data)
    assert [i for i, status in enumerate(batch.status) if status is Status.INFEASIBLE] == [3, 5]
    assert set(batch.errors) == {3, 5}
    assert np.isnan(batch.x[[3, 5]]).all()
    assert "6 of 8" in repr(batch)
    with pytest.raises(Infeasible):
        batch[3]
    optimal({name: value[4] for name, value in data.items()}, batch[4])
    assert [result.x.size for result in batch[:3]] == [6, 6, 6]
    flat = batch_solve_qp(np.zeros((1, 1)), [[1.0], [0.0], [-1.0]], lb=[[-np.inf], [0.0], [0.0]])
    assert [status.name for status in flat.status] == ["UNBOUNDED", "DEGENERATE", "UNBOUNDED"]
    data["q"][2, 1] = np.nan
    with pytest.raises(InputError, match="q") as caught:
        batch_solve_qp(**data)
    assert caught.value.index == 2
    assert len(batch_solve_qp(np.eye(2), np.zeros((0, 2)))) == 0


def test_batches_do_not_depend_on_threads(monkeypatch):
    data = family(6, 7, 9, 1, count=300)
    data |= {name: data[name][0] for name in ("P", "G", "A")}
    data |= {"h": 50.0, "h_low": None, "b": [0.0], "lb": -9.0, "ub": 9.0}
    found = []
    for threads in (1, 3):
        monkeypatch.setattr("gpu.qp.batch.cores", lambda threads=threads: threads)
        found.append(batch_solve_qp(**data))
    for name in ("x", "y", "z", "z_box", "kkt", "iterations"):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(found[1], name))


def differences(data, name, direction, cotangents, step=1e-6):
    """Central differences of a linear function of the solution."""

    def value(sign):
        r = solve_qp(**data | {name: data[name] + sign * step * direction}, tol=1e-9)
        return sum(c @ v for c, v in zip(cotangents, (r.x, r.z, r.y, r.z_box), strict=True))

    return (value(1.0) - value(-1.0)) / (2.0 * step)


@pytest.mark.parametrize("seed", range(5))
def test_gradients_against_differences(seed):
    data, rng = family(seed, 7, 10, 2), np.random.default_rng(seed)
    result = solve_qp(**data)
    cotangents = [rng.standard_normal(size) for size in (7, 10, 2, 7)]
    found = result.vjp(*cotangents)
    assert found.degenerate is False
    assert np.count_nonzero(result.active_rows) + np.count_nonzero(result.active) > 1
    for name in NAMES:
        direction = rng.standard_normal(data[name].shape)
        if name == "P":
            direction = (direction + direction.T) / 2
        known = differences(data, name, direction, cotangents)
        value = (getattr(found, name) * direction).sum()
        assert value == pytest.approx(known, rel=1e-7, abs=2e-7), name
    # The same of a sequence, of a batch, of the interior point and of a sparse problem.
    fixed = {name: data[name] for name in ("P", "G", "A")}
    rest = {name: value for name, value in data.items() if name not in fixed}
    others = [
        QPFactor(**fixed).solve(**rest).vjp(*cotangents),
        solve_qp(**data | {"P": QPFactor(data["P"])}).vjp(*cotangents),
        solve_qp(**data | {"P": sparse.csr_array(data["P"])}).vjp(*cotangents),
    ]
    for other, name in itertools.product(others, NAMES):
        value = getattr(other, name)
        value = value.toarray() if sparse.issparse(value) else value
        np.testing.assert_allclose(value, getattr(found, name), rtol=0, atol=1e-9, err_msg=name)


def test_gradients_of_batches_sum_what_is_shared():
    data, rng = family(7, 6, 8, 2, count=5), np.random.default_rng(7)
    cotangents = [rng.standard_normal((5, size)) for size in (6, 8, 2, 6)]
    found = batch_solve_qp(**data).vjp(*cotangents)
    parts = []
    for i in range(5):
        alone = solve_qp(**{name: value[i] for name, value in data.items()})
        parts.append(alone.vjp(*(c[i] for c in cotangents)))
    for name in NAMES:
        each = np.stack([getattr(part, name) for part in parts])
        np.testing.assert_allclose(getattr(found, name), each, rtol=0, atol=1e-10)
    assert found.degenerate.tolist() == [False] * 5
    one = {name: value[0] for name, value in data.items()} | {"q": data["q"]}
    one |= {"h": 90.0, "h_low": None, "b": np.zeros(2), "lb": -9.0, "ub": 9.0}
    batch = batch_solve_qp(**one)
    found = batch.vjp(*cotangents)
    parts = [result.vjp(*(c[i] for c in cotangents)) for i, result in enumerate(batch)]
    for name in ("P", "G", "A"):
        each = np.stack([getattr(part, name) for part in parts])
        np.testing.assert_allclose(
            getattr(found, name), each.sum(axis=0, keepdims=True), rtol=0, atol=1e-10
        )
    lost = batch_solve_qp(np.eye(1), [[1.0], [1.0]], lb=[[0.0], [3.0]], ub=2.0).vjp([[1.0], [1.0]])
    assert lost.lb.tolist() == [[1.0], [0.0]]
    assert lost.degenerate.tolist() == [False, True]


def test_degenerate_derivatives_say_so():
    # x = max(-q, 0) at q = 0; the derivative from one side is -1, from the other 0.
    touched = solve_qp(np.eye(1), [0.0], lb=0.0).vjp([1.0])
    assert touched.degenerate
    assert touched.q.tolist() in ([-1.0], [0.0])
    double = solve_qp(np.eye(2), [-1.0, -1.0], [[1.0, 1.0], [1.0, 1.0]], [1.0, 1.0])
    assert double.vjp([1.0, 0.0]).degenerate or np.count_nonzero(double.z) == 1
    flat = solve_qp(np.diag([1.0, 0.0]), [-1.0, 0.0], lb=-1.0, ub=1.0)
    with pytest.raises(NotConverged, match="not unique"):
        flat.vjp([0.0, 1.0])
    plain = solve_qp(np.eye(2), [1.0, 1.0])
    with pytest.raises(InputError, match="dx has shape"):
        plain.vjp([1.0])
    # Units of variables do not matter, a bound that is far in its own is not touched.
    assert solve_qp(np.eye(2), [-1e6, -1e-4], lb=0.0).vjp([1.0, 1.0]).degenerate is False
    far = solve_qp(np.diag([1e-12, 1e8]), [-1e-6, -1e4], lb=0.0)
    assert far.vjp([1.0, 1.0]).degenerate is False
    # Rows that depend on each other are one problem's own affair.
    A = np.array([[[1.0, 1.0], [1.0, 1.0]], [[1.0, 1.0], [1.0, -1.0]]])
    batch = batch_solve_qp(np.eye(2), [[1.0, 2.0], [3.0, 1.0]], A=A, b=[[1.0, 1.0], [1.0, 0.0]])
    assert batch.vjp(dx=np.ones((2, 2))).degenerate.tolist() == [True, False]


def test_derivatives_are_those_of_the_problem_that_was_solved():
    P, q, A = np.eye(2), np.array([0.0, -1.0]), np.array([[1.0, 1.0]])
    free, tied = solve_qp(P, q), solve_qp(P, np.zeros(2), A=A, b=np.zeros(1))
    P[0, 0], A[0, 1] = 100.0, -3.0
    np.testing.assert_allclose(free.vjp([1.0, 0.0]).q, [-1.0, 0.0])
    np.testing.assert_allclose(tied.vjp([1.0, 0.0]).q, [-0.5, 0.5])
    # Arrays of large problems are the caller's, and a change that shows is refused.
    P, q = np.eye(300), np.ones(300)
    large = solve_qp(P, q, np.ones((1, 300)), np.ones(1))
    q += 1.0
    with pytest.raises(InputError, match="were changed"):
        large.vjp(np.ones(300))
    # Ill-conditioned matrices are not taken for changed ones.
    steep = solve_qp(hilbert(9), np.cos(np.arange(9.0)))
    np.testing.assert_allclose(steep.vjp(np.eye(9)[0]).q, -np.linalg.inv(hilbert(9))[0], rtol=1e-3)


def test_what_is_asked_in_vain():
    with pytest.raises(InputError, match="q has one dimension"):
        batch_solve_qp(np.eye(2), [1.0, 2.0])
    small = batch_solve_qp(np.eye(1), np.ones((2, 1)), lb=0.0)
    with pytest.raises(InputError, match="start has"):
        batch_solve_qp(np.eye(3), np.ones((2, 3)), lb=0.0, start=small)
    factor = QPFactor(np.eye(2))
    factor.solve([1.0, 1.0])
    for again in (copy.copy, copy.deepcopy, lambda f: pickle.loads(pickle.dumps(f))):
        assert again(factor).solve([1.0, -1.0]).x.tolist() == [-1.0, 1.0]
    for tol in ("x", None, np.ones(2)):
        with pytest.raises(InputError, match="tol"):
            factor.solve([1.0, 1.0], tol=tol)
    result = solve_qp(np.eye(2), [1.0, 1.0])
    for dx in ("abc", [[1.0], [1.0, 2.0]], np.array([1j, 1j])):
        with pytest.raises(InputError, match="dx"):
            result.vjp(dx)
    batch = batch_solve_qp(np.eye(1), [[1.0], [1.0]], lb=[[0.0], [3.0]], ub=2.0)
    with pytest.raises(InputError, match="dx has shape"):
        batch.vjp(np.ones((7, 1)))
    batch[0].x[:] = 7.0
    assert batch.x[0] == 0.0
    own, shared = np.ones((2, 1, 2)), np.array([[1.0, -1.0]])
    found = batch_solve_qp(np.eye(2), np.zeros((2, 2)), own, [[-1.0], [-2.0]], shared, [0.0])
    found = found.vjp(np.ones((2, 2)))
    assert (found.G.shape, found.A.shape, found.P.shape) == ((2, 1, 2), (1, 1, 2), (1, 2, 2))


@pytest.mark.parametrize("seed", range(0, 60, 4))
def test_batches_of_every_kind_of_problem(seed):
    p = problems.convex_problem(seed, 12)
    (P, q, G, h, A, b, lb, ub), keywords = problems.arguments(p)
    batch = batch_solve_qp(P, [q, q], G, h, A, b, lb, ub, **keywords)
    if p.fate == "solvable":
        assert problems.error_of(p, batch[0]) <= 4e-9
        assert problems.error_of(p, batch[1]) <= 4e-9
    else:
        assert batch.status[0].name == p.fate.upper()
