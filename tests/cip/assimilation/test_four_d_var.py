"""4D-Var beside the Kalman filter and the best linear unbiased estimate; covariances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from schemes import made
from scipy.sparse.linalg import aslinearoperator

from cip import Covariance, Grid, Sensors, Solver, State, Velocity, four_d_var
from cip.assimilation.assimilation_window import AssimilationWindow
from cip.assimilation.four_d_var import combined_analysis

LINE = np.linspace(0, 1, 21)
SCHEMES = {
    "cubic": (Grid((0, 1), 20, periodic=True), "cubic", ["1 + 0.3*sin(2*pi*x1 + t)"]),
    "uneven quintic": (
        Grid.from_coordinates(LINE + 0.01 * np.sin(2 * np.pi * LINE), periodic=True),
        "quintic",
        ["1 + 0.3*cos(2*pi*x1)"],
    ),
    "open": (Grid((-1, 1), 20), "cubic", ["x1"]),
    "start alone": (Grid((0, 1), 20, periodic=True), "cubic", ["1.0"]),
    "csl2": (Grid((0, 1), 16, periodic=True), "csl2", ["1 + 0.3*sin(2*pi*x1 + t)"]),
    "open csl4": (Grid((-1, 1), 12), "csl4", ["x1"]),
    "csl4 in the plane": (
        Grid([(0, 1), (-1, 1)], (6, 5), periodic=(True, False)),
        "csl4",
        ["1.0", "0.5*x2"],
    ),
    "bicubic": (
        Grid([(0, 1), (0, 2)], (6, 8), periodic=True),
        "bicubic",
        ["1.0 + 0*x1", "0.5*sin(2*pi*x1)"],
    ),
    "adini": (
        Grid([(0, 1), (-1, 1)], (7, 6), periodic=(True, False)),
        "adini",
        ["1.0 + 0*x1", "x2"],
    ),
}
TIMES = np.array([0.0, 0.07, 0.2, 0.3])


def problem(name, seed=0, dropouts=0.2):
    grid, profile, text = SCHEMES[name]
    solver = made(grid, text, profile)
    low, high = np.array(grid.bounds).T
    rng = np.random.default_rng(seed)
    points = low[:, None] + (high - low)[:, None] * rng.random((grid.dim, 5))
    values = rng.standard_normal((4, 5))
    sensors = Sensors(points, TIMES, values, 0.1 + rng.random((4, 5))).perturbed(seed, dropouts)
    B = Covariance.diffusion(grid, profile, 1.0 + 0.3 * rng.random(grid.nodes), 0.3, order=4)
    Q = Covariance.diffusion(grid, profile, 0.4, 0.5)
    return solver, solver.state("sin(2*pi*x1)"), B, sensors, Q


def model(solver, state, t0, t1):
    """The matrix of the model, column by column from runs of unit states: no derivative is used."""
    columns = []
    for unit in np.eye(state.data.size):
        one = State(solver.grid, solver.profile, unit.reshape(state.data.shape), t0)
        columns.append(solver.run(one, t1, dt=0.05).final.data.ravel())
    return np.stack(columns, axis=1)


def dense(covariance):
    S = covariance.root @ np.eye(covariance.root.shape[1])
    return S @ S.T


def kalman(solver, background, B, sensors, Q):
    """Means and covariances of the filter, and the cross covariance with the start (smoother)."""
    reports = sensors.reports(solver.grid, solver.profile)
    x, P, t = background.data.ravel(), dense(B), background.t
    start, C = x.copy(), P.copy()  # C = cov(x_0, x_k)
    cost = 0.0
    P0 = P.copy()
    for k, end in enumerate(sensors.times):
        if end > t:
            M = model(solver, background, t, end)
            x, P, C, t = M @ x, M @ P @ M.T, C @ M.T, end
            if Q is not None:
                P = P + dense(Q)
        H, R = reports.operators[k].toarray(), np.diag(reports.deviations[k] ** 2)
        S = np.linalg.inv(H @ P @ H.T + R)
        d = reports.values[k] - H @ x
        start = start + C @ H.T @ S @ d
        P0 = P0 - C @ H.T @ S @ H @ C.T
        C = C - C @ H.T @ S @ H @ P
        x, P = x + P @ H.T @ S @ d, P - P @ H.T @ S @ H @ P
        cost += 0.5 * d @ S @ d
    return x, start, P0, cost


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("weak", [False, True], ids=["strong", "weak"])
def test_it_is_the_kalman_filter_and_smoother(name, weak):
    solver, background, B, sensors, Q = problem(name)
    Q = Q if weak else None
    if name == "start alone":
        sensors = Sensors(sensors.points, [0.0], sensors.values[:1], sensors.deviations[:1])
    found = four_d_var(
        solver, background, B, sensors, dt=0.05, model_error=Q, tol=1e-11, vectors=20
    )
    end, start, P0, cost = kalman(solver, background, B, sensors, Q)
    size = background.data[0].size
    for state, wanted in ((found.states[-1], end), (found.start, start)):
        wanted = wanted.reshape(state.data.shape)
        scale = np.abs(wanted).max(axis=tuple(range(1, wanted.ndim)), keepdims=True)
        assert np.max(np.abs(state.data - wanted) / scale) < 1e-11
    np.testing.assert_allclose(found.deviations.ravel(), np.sqrt(np.diag(P0)[:size]), rtol=1e-9)
    # The innovations of the filter have the same sum of squares as the minimum (Bennett 2002).
    assert found.cost == pytest.approx(cost, rel=1e-10)
    assert found.complete
    assert found.reports == np.sum(sensors.reported)
    assert len(found.states) == len(sensors.times)


@pytest.mark.parametrize("rank", [3, 12, 30])
def test_fewer_combinations_never_promise_more(rank):
    """In the order of matrices; with repeated singular values, which one Krylov space misses."""
    rng = np.random.default_rng(rank)
    left, _ = np.linalg.qr(rng.standard_normal((12, 12)))
    right, _ = np.linalg.qr(rng.standard_normal((30, 30)))
    sizes = np.repeat([5.0, 1.0, 0.3], 4)[: min(rank, 12)]
    A = (left[:, : sizes.size] * sizes) @ right[: sizes.size]
    b = A[:, 0] + left[:, 0] + 0.1 * rng.standard_normal(12)
    exact = np.linalg.inv(np.eye(30) + A.T @ A)
    before = np.eye(30)
    for count in range(1, 13):
        part = combined_analysis(aslinearoperator(A), b, 1e-12, count, count, lambda *_: None)
        share = part.singular_values**2 / (1 + part.singular_values**2)
        now = np.eye(30) - part.directions.T @ (share[:, None] * part.directions)
        for above, below in ((before, now), (now, exact)):
            assert np.linalg.eigvalsh(above - below).min() > -1e-12
        before = now
    np.testing.assert_allclose(now, exact, rtol=0, atol=1e-12)
    np.testing.assert_allclose(part.solution, exact @ A.T @ b, rtol=0, atol=1e-12)
    assert part.complete


@pytest.mark.sampled(2)
@pytest.mark.parametrize("profile", ["adini", "bicubic"])
def test_the_linearisation_of_a_window(profile):
    """Start, parameters and model errors together: the transpose, and Taylor's remainder."""
    grid = Grid([(0, 1), (0, 1)], (8, 9), periodic=True)
    wind = Velocity.from_expression(
        "a + b*sin(2*pi*x2)", "b*cos(2*pi*x1)", parameters={"a": 0.6, "b": 0.3}
    )
    solver = Solver(grid, wind, profile=profile)
    rng = np.random.default_rng(6)
    sensors = Sensors(rng.random((2, 4)), TIMES, rng.standard_normal((4, 4)), 0.1)
    B = Covariance.diffusion(grid, profile, 1.0, 0.3)
    Q = Covariance.patterns([B.draw(3), B.draw(4)], 0.2)
    window = AssimilationWindow(
        solver, solver.state("sin(2*pi*x1)"), B, sensors, 0.05, {"b": 0.1, "a": 0.2}, [Q, None, Q]
    )
    control = 0.5 * rng.standard_normal(window.layout.size)
    assert control.size == 72 + 2 + 4
    path = window.path(control)
    A = window.linearised(path).operator()
    x, y = rng.standard_normal(A.shape[1]), rng.standard_normal(A.shape[0])
    forward, backward = A @ x, A.rmatvec(y)
    scale = np.abs(y) @ np.abs(forward) + np.abs(x) @ np.abs(backward)
    assert abs(y @ forward - x @ backward) < 1e-13 * scale
    steps = 0.5 ** np.arange(4, 9)
    left = [
        np.linalg.norm(path.residuals - window.path(control + e * x).residuals - e * forward)
        for e in steps
    ]
    slope = np.polyfit(np.log(steps), np.log(left), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.05)


def test_an_analysis_becomes_a_dataset():
    pytest.importorskip("xarray")
    solver, background, B, sensors, _ = problem("bicubic")
    wind = Velocity.from_expression("a + 0*x1", "0.5*sin(2*pi*x1)", parameters={"a": 1.0})
    solver = Solver(solver.grid, wind, profile="bicubic")
    found = four_d_var(solver, background, B, sensors, dt=0.05, parameters={"a": 1e-3}, tol=1e-6)
    dataset = found.to_xarray()
    for k, state in enumerate(found.states):
        for name in ("u", "u_x", "u_y", "u_xy"):
            np.testing.assert_array_equal(dataset[name].isel(t=k), state[name])
    assert dataset["t"].values.tolist() == TIMES.tolist()
    np.testing.assert_array_equal(dataset["y"], solver.grid.coordinates[1])
    assert dataset["deviation"].dims == ("x", "y")
    np.testing.assert_array_equal(dataset["deviation"], found.deviations)
    assert dataset["parameter_value"].sel(parameter="a") == found.parameters["a"]
    assert dataset["parameter_deviation"].sel(parameter="a") == found.parameter_deviations["a"]


@pytest.mark.parametrize(
    "unknown", [None, pytest.param({"a": 0.1, "b": 0.05}, marks=pytest.mark.slow)]
)
def test_on_a_device_it_is_that_of_the_host(cupy, unknown):
    """With inflow, a model error in one interval, and sensors of the start."""
    grid, found = Grid((0, 1), 24), []
    speed = Velocity.from_expression("a + b*x1", parameters={"a": 0.8, "b": 0.3})
    B = Covariance.diffusion(grid, "cubic", deviation=0.5, length=0.2)
    values = np.random.default_rng(3).standard_normal((3, 3))
    sensors = Sensors([0.3, 0.55, 0.9], [0.0, 0.12, 0.3], 1 + 0.1 * values, 0.2)
    for backend in ("cpu", "cupy"):
        solver = Solver(grid, speed, boundary={"x-": "1 + sin(4*t)"}, backend=backend)
        background, errors = solver.state("1 + x1**2"), [None, B]
        found.append(
            four_d_var(
                solver, background, B, sensors, dt=0.05, parameters=unknown, model_error=errors,
                tol=1e-10, vectors=9,
            )
        )  # fmt: skip
    expected, of_device = found
    for one, other in zip(expected.states, of_device.states, strict=True):
        np.testing.assert_allclose(other.data, one.data, rtol=0, atol=1e-9)
    np.testing.assert_allclose(of_device.deviations, expected.deviations, rtol=1e-9)
    for name, value in expected.parameters.items():
        assert of_device.parameters[name] == pytest.approx(value, abs=1e-9)
        spread = expected.parameter_deviations[name]
        assert of_device.parameter_deviations[name] == pytest.approx(spread, rel=1e-8)
    assert of_device.complete


def check_against_dense(reports, unknowns, seed, spread):
    """A problem of given singular values, whose mean and variances follow in closed form."""
    rng = np.random.default_rng(seed)
    rank = int(rng.integers(1, min(reports, unknowns) + 1)) if seed % 3 else min(reports, unknowns)
    sizes = 10.0 ** rng.uniform(-spread, spread, size=rank)
    left, _ = np.linalg.qr(rng.standard_normal((reports, rank)))
    right, _ = np.linalg.qr(rng.standard_normal((unknowns, rank)))
    A = aslinearoperator((left * sizes) @ right.T)
    b = rng.standard_normal(reports)
    mean = right @ (sizes / (1.0 + sizes**2) * (left.T @ b))
    known = (right**2) @ (1.0 / (1.0 + sizes**2))
    variances = known + np.maximum(1.0 - np.sum(right**2, axis=1), 0.0)
    all_of_them = combined_analysis(A, b, 1e-13, 500, reports, lambda *_: None)
    assert all_of_them.complete
    assert all_of_them.residual <= 1e-13
    # Rounding of the operator's own products, relative to the largest singular value.
    scale = np.abs(mean).max() * max(1.0, sizes.max())
    np.testing.assert_allclose(all_of_them.solution, mean, rtol=0, atol=1e-11 * scale)
    found = all_of_them.variances(np.ones(unknowns), all_of_them.directions)
    np.testing.assert_allclose(found, variances, rtol=1e-8, atol=1e-11)
    if rank == unknowns:  # nothing is left of the prior: small deviations are as accurate as large
        np.testing.assert_allclose(found, variances, rtol=1e-8)
    few = combined_analysis(A, b, 1e-10, 500, 0, lambda *_: None)
    assert few.residual <= 1e-10
    above = few.variances(np.ones(unknowns), few.directions) - variances
    assert above.min() > -1e-10
    if few.complete:
        assert above.max() < 1e-10


@settings(max_examples=60)
@given(st.integers(1, 60), st.integers(1, 60), st.integers(0, 2**31), st.sampled_from([0, 1, 3]))
def test_any_shape(reports, unknowns, seed, spread):
    check_against_dense(reports, unknowns, seed, spread)


@pytest.mark.parametrize("deviation", [0.3, 1e-6])
@pytest.mark.parametrize(
    ("patterns", "points", "times"), [(1, 20, 1), (1, 1, 1), (2, 3, 1), (4, 5, 1), (4, 6, 3)]
)
def test_a_window_with_few_unknowns(patterns, points, times, deviation):
    """At whole numbers of periods a wave is where it was, so the reports are of the patterns."""
    grid = Grid((0, 1), 16, periodic=True)
    solver = Solver(grid, 1.0)
    shapes = [solver.state(f"cos({2 * k}*pi*x1) + 0.3*sin({2 * k}*pi*x1)") for k in range(patterns)]
    rng = np.random.default_rng(points)
    places, clock = rng.random(points), np.arange(times, dtype=float)
    values = rng.standard_normal((times, points))
    sensors = Sensors(places, clock, values, deviation)
    B = Covariance.patterns(shapes)
    found = four_d_var(solver, solver.state(0.0), B, sensors, dt=1.0, vectors=values.size, tol=1e-9)
    rows = sensors.rows(grid, "cubic")
    once = np.stack([rows @ one.data.ravel() for one in shapes], axis=1)
    A, b = np.tile(once, (times, 1)) / deviation, values.ravel() / deviation
    # Householder's QR of [A; 1] does not square the condition of A.
    _, R = np.linalg.qr(np.concatenate([A, np.eye(patterns)]))
    amplitudes, *_ = np.linalg.lstsq(
        np.concatenate([A, np.eye(patterns)]), np.append(b, np.zeros(patterns)), rcond=None
    )
    nodal = np.stack([one["u"] for one in shapes], axis=1)
    np.testing.assert_allclose(
        found.start["u"], nodal @ amplitudes, rtol=0, atol=1e-7 * np.abs(amplitudes).max()
    )
    spread = np.sqrt(np.sum((nodal @ np.linalg.inv(R)) ** 2, axis=1))
    np.testing.assert_allclose(found.deviations, spread, rtol=1e-7)
    assert found.complete


def test_one_unknown_parameter_and_many_reports():
    """One speed and one amplitude beside forty reports: more than one outer iteration."""
    grid = Grid((0, 1), 32, periodic=True)
    solver = Solver(grid, Velocity.from_expression("a", parameters={"a": 0.9}), profile="quintic")
    plan = Sensors(np.linspace(0, 0.95, 20), [0.2, 0.4], deviations=0.01)
    x, t = plan.points, plan.times[:, None]
    sensors = plan.with_values(1.3 * np.sin(2 * np.pi * (x - t)))
    B = Covariance.patterns([solver.state("sin(2*pi*x1)")])
    found = four_d_var(
        solver, solver.state("sin(2*pi*x1)"), B, sensors, dt=0.1, parameters={"a": 1.0}
    )
    assert found.complete
    assert found.parameters["a"] == pytest.approx(1.0, abs=1e-4)
    # Fisher's information of the speed: the sum of (t u_x)^2 over the reports, over their variance.
    slopes = 1.3 * 2 * np.pi * t * np.cos(2 * np.pi * (x - t))
    expected = 0.01 / np.sqrt(np.sum(slopes**2))
    assert found.parameter_deviations["a"] == pytest.approx(expected, rel=1e-2)
    assert found.outer_iterations > 1
    assert found.velocity.parameters == found.parameters
    assert found.explained
    biased = sensors.with_values(sensors.values + (sensors.points > 0.5))
    start = solver.state("sin(2*pi*x1)")
    assert not four_d_var(solver, start, B, biased, dt=0.1, parameters={"a": 1e-3}).explained


# Covariances: variances, correlations beside closed forms, moments that belong to values.


UNEVEN = np.linspace(0, 1, 41) + 0.004 * np.sin(2 * np.pi * np.linspace(0, 1, 41))
GRIDS = {
    "ring": Grid((0, 2), 48, periodic=True),
    "line": Grid((0, 1), 30),
    "uneven": Grid.from_coordinates(UNEVEN),
    "plane": Grid([(0, 1), (0, 3)], (12, 15), periodic=(True, False)),
    "space": Grid([(0, 1)] * 3, (6, 5, 7), periodic=(True, False, True)),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("profile", ["cubic", "quintic", "csl2", "csl4"])
def test_variances_transposes_and_moments(name, profile):
    """Variances are exact; the moments of an error are those of the state with its values."""
    grid = GRIDS[name]
    wanted = 0.5 + np.random.default_rng(1).random(grid.nodes)
    B = Covariance.diffusion(grid, profile, wanted, 0.2)
    S = B.root @ np.eye(B.root.shape[1])
    found = np.sum(S[: grid.size] ** 2, axis=1)
    np.testing.assert_allclose(found, wanted.ravel() ** 2, rtol=1e-12)
    transposed = B.root.rmatmat(np.eye(B.root.shape[0]))
    np.testing.assert_allclose(transposed.T, S, rtol=0, atol=1e-12 * np.abs(S).max())
    error = Covariance.diffusion(grid, profile, 0.7, 0.4).draw(seed=2, t=1.5)
    again = State.from_function(np.array(error["u"]), grid, profile)
    scale = np.abs(again.data).reshape(len(again.data), -1).max(axis=1)
    gap = np.abs(again.data - error.data).reshape(len(again.data), -1).max(axis=1)
    assert np.all(gap < 1e-10 * scale)
    assert error.t == 1.5


@pytest.mark.sampled(3)
@pytest.mark.parametrize("order", [2, 3, 6])
def test_correlations_on_the_line_beside_the_closed_form(order):
    """That of (1 - kappa d^2)^-M on the infinite line: polynomials times exponentials."""
    grid = Grid((0, 40), 800, periodic=True)
    length = 1.0
    s = np.sqrt((2 * order - 3) / length**2) * np.minimum(
        grid.coordinates[0], 40 - grid.coordinates[0]
    )
    polynomial = {2: 1 + s, 3: 1 + s + s**2 / 3}
    if order == 6:  # Guttorp and Gneiting (2006): half-integer Matern 11/2
        polynomial[6] = 1 + s + 4 / 9 * s**2 + s**3 / 9 + s**4 / 63 + s**5 / 945
    exact = polynomial[order] * np.exp(-s)
    B = Covariance.diffusion(grid, "cubic", 1.0, length, order)
    unit = np.zeros(1600)
    unit[0] = 1.0
    found = (B.root @ B.root.rmatvec(unit))[:800]
    # Finite volumes of second order: h / length = 1/20.
    assert np.max(np.abs(found - exact)) < 0.02
    # Daley's length: the curvature at 0 of the correlation.
    if order == 6:
        h = grid.spacing[0]
        curvature = (2 * found[0] - found[1] - found[-1]) / h**2
        assert curvature == pytest.approx(1 / length**2, rel=0.02)


def test_correlations_have_the_same_length_in_every_direction():
    grid = Grid([(0, 20), (0, 20)], (200, 200), periodic=True)
    B = Covariance.diffusion(grid, "adini", 1.0, 1.0)
    unit = np.zeros(3 * grid.size)
    unit[0] = 1.0
    row = (B.root @ B.root.rmatvec(unit))[: grid.size].reshape(200, 200)
    assert row[7, 0] == pytest.approx(row[0, 7], rel=1e-10)
    assert row[5, 5] == pytest.approx(row[7, 1], rel=5e-3)  # at the distance sqrt(50) h
    h = 0.1
    laplacian = (row[1, 0] + row[-1, 0] + row[0, 1] + row[0, -1] - 4) / h**2
    assert -2 / laplacian == pytest.approx(1.0, rel=0.03)


def test_patterns():
    grid = GRIDS["plane"]
    states = [State.from_function(f, grid, "adini") for f in ("x1*0 + 1", "x2", "cos(x2)")]
    B = Covariance.patterns(states, [1.0, 2.0, 0.5])
    columns = np.stack([s.data.ravel() for s in states], axis=1)
    expected = columns @ np.diag([1.0, 4.0, 0.25]) @ columns.T
    S = B.root @ np.eye(B.root.shape[1])
    np.testing.assert_allclose(S @ S.T, expected, rtol=1e-13, atol=1e-13)
    variance = np.diag(expected)[: grid.size]
    np.testing.assert_allclose(B.deviations.ravel() ** 2, variance, rtol=1e-13)


@pytest.mark.parametrize("name", ["csl2", "csl4 in the plane", "bicubic"])
def test_analyses_that_conserve_mass(name):
    """The covariance is that of errors given their integral, and increments have none."""
    solver, background, B, sensors, _ = problem(name)
    conserving = B.conserving_mass()
    full, found = dense(B), dense(conserving)
    units = np.eye(full.shape[0]).reshape(-1, *background.data.shape)
    m = np.array([State(solver.grid, solver.profile, unit).mass for unit in units])
    expected = full - np.outer(full @ m, full @ m) / (m @ full @ m)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(full).max())
    nodal = np.sqrt(np.diag(found)[: solver.grid.size])
    np.testing.assert_allclose(conserving.deviations.ravel(), nodal, rtol=1e-7)
    mass = four_d_var(solver, background, conserving, sensors, dt=0.05).start.mass
    size = abs(four_d_var(solver, background, B, sensors, dt=0.05).start.mass - background.mass)
    assert abs(mass - background.mass) < 1e-12 < 1e-3 < size
