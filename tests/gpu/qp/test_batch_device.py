"""Batches of small quadratic programs on a device: each member as `solve_qp` finds it on the host,
infeasible and undecided ones in their places.
"""

import importlib.util

import numpy as np
import pytest

from gpu import Infeasible, InputError, batch_solve_qp, solve_qp
from gpu.qp.active_set.dual_device import solve_batch
from gpu.qp.data.standard_qp import StandardQP, residuals

pytestmark = pytest.mark.gpu
if importlib.util.find_spec("cupy") is None:
    pytest.skip("CuPy is not installed", allow_module_level=True)
import cupy  # noqa: E402

if not cupy.cuda.is_available():
    pytest.skip("no CUDA device", allow_module_level=True)

SOLVED, INFEASIBLE, UNDECIDED = 0, 1, 2
INF = np.inf


def random_batch(seed, B, n, m, shared=False):
    """Two-sided rows and bounds around a point, which the linear terms leave."""
    rng, k = np.random.default_rng(seed), 1 if shared else B
    M, C = rng.standard_normal((k, n, n)), rng.standard_normal((k, m, n))
    P = M @ M.transpose(0, 2, 1) / n + 0.1 * np.eye(n)
    x = rng.standard_normal((k, n))
    Cx = (C @ x[:, :, None])[:, :, 0]
    low, high = Cx - rng.exponential(0.5, (k, m)), Cx + rng.exponential(0.5, (k, m))
    lb, ub = x - rng.exponential(1.0, (k, n)), x + rng.exponential(1.0, (k, n))
    q = 3.0 * rng.standard_normal((B, n))
    return [(P + P.transpose(0, 2, 1)) / 2, q, C, low, high, lb, ub]


def on_device(data, state=None, **options):
    state = None if state is None else cupy.asarray(state)
    batch = solve_batch(*(cupy.asarray(a) for a in data), state=state, **options)
    return type(batch)(*(a.get() for a in batch))


def member(data, i):
    return [a[i if len(a) > 1 else 0] for a in data]


def check(data, batch, rtol=1e-9):
    """Every member against `solve_qp` and the residuals of the package; its code."""
    for i, code in enumerate(batch.code):
        P, q, C, low, high, lb, ub = member(data, i)
        rows = {"G": C, "h": high, "h_low": low} if len(C) else {}
        try:
            x = solve_qp(P, q, lb=lb, ub=ub, **rows).x
        except Infeasible:
            assert code == INFEASIBLE, i
            assert proves(C, low, high, lb, ub, batch.y[i]), i
            continue
        assert code == SOLVED, (i, batch.residuals[i])
        np.testing.assert_allclose(batch.x[i], x, rtol=0, atol=rtol * abs(x).max())
        problem = StandardQP(P, q, C, low, high, lb, ub)
        assert residuals(problem, batch.x[i], batch.y[i], batch.z_box[i]).worst <= 1e-11, i
        assert ((batch.x[i] >= lb) & (batch.x[i] <= ub)).all()
        held = batch.state[i, len(C) :]
        np.testing.assert_array_equal(batch.x[i][held < 0], lb[held < 0])
        np.testing.assert_array_equal(batch.x[i][held > 0], ub[held > 0])


def proves(C, low, high, lb, ub, y):
    """Whether max (C'y)'x over the box is below min y'(Cx) over the sides."""
    c = C.T @ y
    c[abs(c) <= 1e-12 * (abs(C.T) @ abs(y))] = 0.0  # rounding of the sum over the rows
    corner, side = np.where(c > 0, ub, lb), np.where(y > 0, low, high)
    return c[c != 0] @ corner[c != 0] < y[y != 0] @ side[y != 0]


@pytest.mark.parametrize("shared", [False, True], ids=["individual", "shared"])
@pytest.mark.parametrize("m", [0, 7, 60])
@pytest.mark.parametrize("n", [1, 5, 32, 33, 100, 150])
def test_members_are_those_of_solve_qp(n, m, shared):
    data = random_batch(n + m, 3 if n > 33 else 20, n, m, shared)
    batch = on_device(data)
    assert (batch.code == SOLVED).all()
    check(data, batch)


def test_infeasible_members_in_their_places():
    data = random_batch(0, 30, 20, 30)
    C, low, high, ub = data[2], data[3], data[4], data[6]
    # Every third member has two rows apart; every fifth a row beyond what the box allows.
    C[::3, 3], low[::3, 3], high[::3, 3] = C[::3, 1], high[::3, 1] + 0.1, INF
    C[::5, 7] = abs(C[::5, 7])
    low[::5, 7], high[::5, 7] = (C[::5, 7] * ub[::5]).sum(1) + 0.1, INF
    batch = on_device(data)
    wrong = (np.arange(30) % 3 == 0) | (np.arange(30) % 5 == 0)
    np.testing.assert_array_equal(batch.code, np.where(wrong, INFEASIBLE, SOLVED))
    check(data, batch)


@pytest.mark.parametrize("unit", [1e-12, 1e12])
@pytest.mark.parametrize("of", ["length", "force", "variables", "rows"])
def test_units_do_not_matter(of, unit):
    P, q, C, low, high, lb, ub = random_batch(1, 10, 20, 30)
    data = {
        "length": (P, q * unit, C, low * unit, high * unit, lb * unit, ub * unit),
        "force": (P * unit, q * unit, C, low, high, lb, ub),
        "variables": (P / unit**2, q / unit, C / unit, low, high, lb * unit, ub * unit),
        "rows": (P, q, C * unit, low * unit, high * unit, lb, ub),
    }[of]
    batch = on_device(data)
    assert (batch.code == SOLVED).all()
    x = on_device((P, q, C, low, high, lb, ub)).x
    if of in ("length", "variables"):
        x = x * unit
    np.testing.assert_allclose(batch.x, x, rtol=0, atol=1e-11 * abs(x).max())


def test_mixed_units():
    P, q, C, low, high, lb, ub = random_batch(2, 10, 20, 30)
    rng = np.random.default_rng(2)
    unit, row = 10.0 ** rng.uniform(-6, 6, (10, 20)), 10.0 ** rng.uniform(-6, 6, (10, 30))
    mixed = (
        unit[:, :, None] * P * unit[:, None], unit * q, row[:, :, None] * C * unit[:, None],
        low * row, high * row, lb / unit, ub / unit,
    )  # fmt: skip
    batch = on_device(mixed)
    assert (batch.code == SOLVED).all()
    np.testing.assert_allclose(unit * batch.x, on_device((P, q, C, low, high, lb, ub)).x, atol=1e-9)


def test_warm_starts():
    data = random_batch(3, 20, 30, 60)
    cold = on_device(data)
    right = on_device(data, cold.state)
    assert (right.steps == 0).all()
    assert cold.steps.min() > 10
    guess = np.random.default_rng(3).integers(-1, 2, cold.state.shape).astype(np.int8)
    for state in (cold.state, -cold.state, guess, cold.state[:1]):
        warm = on_device(data, state)
        assert (warm.code == SOLVED).all()
        np.testing.assert_allclose(warm.x, cold.x, atol=1e-11)
        np.testing.assert_array_equal(warm.state, cold.state)


def test_dependent_equalities():
    P, q, C, low, high, lb, ub = random_batch(4, 10, 20, 20)
    C[:, 5], C[:, 6] = C[:, 2], C[:, 0] - 2.0 * C[:, 1]
    low[:, :7] = high[:, :7] = (C[:, :7] @ ((lb + ub) / 2)[:, :, None])[:, :, 0]
    data = [P, q, C, low, high, np.full_like(lb, -INF), np.full_like(ub, INF)]
    batch = on_device(data)
    assert (batch.code == SOLVED).all()
    check(data, batch)
    low[::2, 6] = high[::2, 6] = low[::2, 6] + 1e-5
    batch = on_device(data)
    np.testing.assert_array_equal(batch.code, [INFEASIBLE, SOLVED] * 5)
    check(data, batch)


def test_rows_that_are_zero_at_the_solution():
    P, q, C, _, _, lb, ub = random_batch(11, 10, 20, 8)
    zero = np.zeros((1, 8))
    data = [P, q, C, zero, zero, lb - INF, ub + INF]
    batch = on_device(data)
    assert (batch.code == SOLVED).all()
    check(data, batch)


@pytest.mark.parametrize("origin", [False, True], ids=["somewhere", "origin"])
def test_degenerate_vertices(origin):
    """Sixty rows, each twice, meet in one point of twenty variables."""
    P, _, C, _, high, lb, ub = random_batch(5, 10, 20, 60)
    rng = np.random.default_rng(5)
    C = np.concatenate([C, C], axis=1)
    x = np.zeros((10, 20)) if origin else rng.standard_normal((10, 20))
    y = rng.exponential(1.0, (10, 120)) * (rng.random((10, 120)) < 0.3)
    q = -(P @ x[:, :, None] + C.transpose(0, 2, 1) @ y[:, :, None])[:, :, 0]
    high = (C @ x[:, :, None])[:, :, 0]
    batch = on_device([P, q, C, np.full_like(high, -INF), high, lb - INF, ub + INF])
    assert (batch.code == SOLVED).all()
    np.testing.assert_allclose(batch.x, x, atol=1e-12)
    assert (abs(batch.state).sum(1) <= 20).all()


def test_fixed_variables_and_equal_sides_of_either_sign():
    P, q, C, low, high, lb, ub = random_batch(6, 10, 20, 10)
    x = (lb + ub) / 2
    lb[:, :8] = ub[:, :8] = x[:, :8]
    low[:] = high[:] = (C @ x[:, :, None])[:, :, 0]
    low[:, 4:], high[:, 4:] = low[:, 4:] - 1.0, high[:, 4:] + 1.0
    data = P, q, C, low, high, lb, ub
    batch = on_device(data)
    assert (batch.code == SOLVED).all()
    check(data, batch)
    np.testing.assert_array_equal(batch.state[:, :4], np.sign(batch.y[:, :4]))
    np.testing.assert_array_equal(batch.state[:, 10:18], np.sign(batch.z_box[:, :8]))


def test_more_problems_than_blocks():
    """Without rows and bounds; the matrices of 120 unknowns do not fit into shared memory."""
    P, q, C, low, high, lb, ub = random_batch(10, 1000, 120, 0, shared=True)
    batch = on_device([P, q, C, low, high, lb - INF, ub + INF])
    assert (batch.code == SOLVED).all()
    np.testing.assert_allclose(batch.x, np.linalg.solve(P[0], -q.T).T, atol=1e-10)


def test_what_is_not_decided_is_said():
    data = random_batch(7, 6, 20, 10)
    data[0][1, :, 3] = data[0][1, 3] = 0.0  # semi-definite
    data[0][2] -= 2.0 * np.eye(20)  # indefinite
    data[1][3, 5] = np.nan
    data[4][4, 2] = np.nan
    batch = on_device(data)
    np.testing.assert_array_equal(batch.code, [SOLVED] + 4 * [UNDECIDED] + [SOLVED])
    tight = on_device(data, tol=1e-15)  # residuals of 1e-17 are out of reach
    assert (tight.code == UNDECIDED).all()


def test_runs_repeat_to_the_last_bit():
    data = random_batch(8, 50, 40, 50)
    first, second = on_device(data), on_device(data)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


def test_no_problems():
    data = random_batch(9, 1, 4, 3)
    data[1] = data[1][:0]
    assert on_device(data).x.shape == (0, 4)


def test_the_public_door():
    """`batch_solve_qp` with data, derivatives, failures and faults of single members."""
    P, q, C, low, high, lb, ub = random_batch(11, 40, 6, 9)
    low[3], lb[5] = high[3] + 1.0, ub[5] + 1.0
    given = {"P": P, "q": q, "G": C, "h": high, "h_low": low, "lb": lb, "ub": ub}
    there = {name: cupy.asarray(value) for name, value in given.items()}
    here, found = batch_solve_qp(**given), batch_solve_qp(**there)
    assert set(found.errors) == set(here.errors) == {3, 5}
    assert found.status == here.status
    for name in ("x", "z", "z_box", "active_rows"):
        value = getattr(found, name).get()
        np.testing.assert_allclose(value, getattr(here, name), rtol=0, atol=1e-11, err_msg=name)
    again = batch_solve_qp(**there, start=found)
    np.testing.assert_allclose(again.x.get(), here.x, rtol=0, atol=1e-11)
    dx = np.random.default_rng(0).standard_normal(q.shape)
    one, two = here.vjp(dx), found.vjp(cupy.asarray(dx))
    for name in ("P", "q", "G", "h", "h_low", "lb", "ub", "degenerate"):
        np.testing.assert_allclose(
            getattr(two, name).get(), getattr(one, name), rtol=0, atol=1e-9, err_msg=name
        )
    far = {"lb": cupy.full(q.shape, -1e30), "ub": cupy.full(q.shape, 1e30)}
    np.testing.assert_allclose(
        batch_solve_qp(there["P"], there["q"], **far).x.get(),
        np.linalg.solve(P, -q[..., None])[..., 0], rtol=0, atol=1e-10,
    )  # fmt: skip
    there["P"][7, 0, 1] += 1e-6
    with pytest.raises(InputError, match="not symmetric") as caught:
        batch_solve_qp(**there)
    assert caught.value.index == 7
