"""Tangent and adjoint on a CUDA device: equal to those of the CPU, and the same bits again."""

import numpy as np
import pytest
from derivative_checks import few_examples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cip import Grid, Solver, Source, Velocity
from cip.sensitivities import path_tangent

BOX, NODES = [(0, 1), (0, 1.5), (0, 1.2)], {1: (41,), 2: (31, 24), 3: (9, 8, 7)}
START = {
    1: "1.2 + sin(2*pi*x1)",
    2: "1.2 + sin(2*pi*x1)*cos(4*pi*x2/3)",
    3: "1.2 + sin(2*pi*x1)*cos(4*pi*x2/3)*(1 + x3**2)",
}
# Of each kind of grid and flow the components by directions; cos(t) is left out of steady ones.
FLOWS = {
    "periodic": ["0.6 + a*sin(2*pi*x1)*cos(t)", "b*cos(2*pi*x1) + 0.3", "b*sin(2*pi*x1)"],
    "uneven": ["0.6 + a*sin(2*pi*x1)*cos(t)", "b*cos(2*pi*x1) + 0.3", "b*sin(2*pi*x1)"],
    "outflow": ["a*(x1 - 0.5)*cos(t)", "b*(x2 - 0.7)", "a*(x3 - 0.4)"],
    "inflow": ["0.7*cos(3*x1) + a*x1*cos(t)", "0.3 + b*x1*cos(t)", "b - a*x3"],
}
DIRECT = [("cubic", 1), ("quintic", 1), ("csl2", 1), ("csl4", 1), ("adini", 2), ("bicubic", 2)]
SPLIT = [
    *(("cubic", 2), ("quintic", 2), ("cubic", 3), ("quintic", 3)),
    *(("csl2", 2), ("csl4", 2), ("csl2", 3), ("csl4", 3)),
]
FAST = ("cubic", 1, "inflow", True, "advection")


def grid_of(dim, flow):
    box, nodes = BOX[:dim], NODES[dim]
    if flow != "uneven":
        return Grid(box, nodes, periodic=flow == "periodic")
    lines = [np.linspace(low, high, n + 1) for (low, high), n in zip(box, nodes, strict=True)]
    lines = [x + 0.01 * np.sin(2 * np.pi * x / x[-1]) for x in lines]
    return Grid.from_coordinates(*lines, periodic=True)


def data_of(dim, flow, form, split):
    """On all walls, of any kind where the scheme allows it; none where nothing enters."""
    if flow != "inflow":
        return None
    if split:
        return 0.0 if form == "advection" else 0.8
    return "1 + sin(3*t)" if dim == 1 else "1 + sin(3*t)*cos(x2 - x1)"


def solved(profile, dim, flow, steady, form, backend, a=0.21, b=0.13, dt=0.06):
    """A solver and a run of five steps, the last one shorter."""
    texts = [text.replace("*cos(t)", "") if steady else text for text in FLOWS[flow][:dim]]
    values = {"a": a, "b": b} if dim > 1 else {"a": a}
    velocity = Velocity.from_expression(*texts, parameters=values)
    split = dim > 1 and profile not in ("adini", "bicubic")
    boundary, splitting = data_of(dim, flow, form, split), "strang" if split else None
    solver = Solver(
        grid_of(dim, flow), velocity, form, profile, splitting=splitting, boundary=boundary,
        backend=backend,
    )  # fmt: skip
    return solver, solver.run(solver.state(START[dim]), 0.27, dt=dt)


def schemes():
    """Every profile with every flow; steadiness and form by turns, so that all pairs occur."""
    for q, case in enumerate(DIRECT + SPLIT):
        for f, flow in enumerate(FLOWS):
            advect = (q // 2 + f // 2) % 2 or case[0].startswith("csl")
            yield *case, flow, (q + f) % 2 == 1, "advection" if advect else "transport"


SCHEMES = [pytest.param(*one, marks=[pytest.mark.slow] * (one != FAST)) for one in schemes()]


@pytest.mark.parametrize(("profile", "dim", "flow", "steady", "form"), SCHEMES)
def test_operators_are_those_of_the_cpu(cupy, monkeypatch, profile, dim, flow, steady, form):
    scheme = profile, dim, flow, steady, form
    compare(cupy, monkeypatch, solved(*scheme, "cpu"), solved(*scheme, "cupy"))


@pytest.mark.slow
@pytest.mark.parametrize(("profile", "dim"), DIRECT + SPLIT)
@settings(few_examples, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    a=st.floats(0.05, 0.3), b=st.floats(-0.2, 0.2), dt=st.floats(0.04, 0.28),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_the_adjoint_is_the_transpose(cupy, profile, dim, a, b, dt, seed):
    form = "advection" if profile.startswith("csl") else "transport"
    scheme = profile, dim, "periodic", False, form
    solver, run = solved(*scheme, "cupy", a, b, dt)
    tangent, adjoint, rng = solver.tangent(run), solver.adjoint(run), np.random.default_rng(seed)
    weight, size = rng.standard_normal(tangent.shape[0]), run[0].data.size
    gradient = (adjoint @ cupy.asarray(weight)).get()
    for only in (slice(0, size), slice(size, None)):  # the state, and the velocity
        change = np.zeros(tangent.shape[1])
        change[only] = rng.standard_normal(change[only].size)
        new = (tangent @ cupy.asarray(change)).get()
        bound = np.abs(weight) @ np.abs(new) + np.abs(change) @ np.abs(gradient)
        assert np.any(new)
        assert abs(weight @ new - change @ gradient) <= 1e-13 * bound


@pytest.mark.slow
@pytest.mark.parametrize(("profile", "dim"), [("cubic", 1), ("csl4", 1), ("bicubic", 2)])
def test_sources_decay_and_data_with_parameters(cupy, monkeypatch, profile, dim):
    pairs, form = [], "advection" if profile == "csl4" else "transport"
    data = Source.from_expression("g*sin(3*t + 0.2) + 0.1*a", {"g": 0.8, "a": 0.5})
    puff = Source.from_expression("q*exp(-40*(x1 - m)**2)*sin(3*t + 0.4)", {"q": 1.3, "m": 0.4})
    decay = Source.from_expression("k*(1.2 + sin(2*pi*x1 + t)) + 0.3*a", {"k": 0.7, "a": 0.5})
    speed = Velocity.from_expression(*["a + 0.3*x1", "0.2"][:dim], parameters={"a": 0.5})
    for backend in ("cpu", "cupy"):
        solver = Solver(
            grid_of(dim, "inflow"), speed, form, profile, boundary=data, backend=backend,
            source=puff, decay=decay,
        )  # fmt: skip
        pairs.append((solver, solver.run(solver.state(START[dim]), 0.27, dt=0.06)))
    compare(cupy, monkeypatch, *pairs)


def compare(cupy, monkeypatch, of_host, of_device):
    """Equal products, a dot-test on the device, and the same bits again; of solvers with runs."""
    rng = np.random.default_rng(4)
    (solver, run), (on_device, its_run) = of_host, of_device
    weight = rng.standard_normal(run.final.data.size)
    expected = solver.adjoint(run) @ weight
    change = rng.standard_normal(expected.size)
    tangent, adjoint = on_device.tangent(its_run), on_device.adjoint(its_run)
    gradient = adjoint @ cupy.asarray(weight)
    assert isinstance(gradient, cupy.ndarray)
    expected_new = solver.tangent(run) @ change  # of so few nodes by NumPy
    with monkeypatch.context() as compiling:
        compiling.setattr(path_tangent, "_COMPILE_FROM", 0)
        new = tangent @ cupy.asarray(change)
    for found, known in ((gradient, expected), (new, expected_new)):
        bound = 1e-12 * np.abs(known).max()
        np.testing.assert_allclose(found.get(), known, rtol=1e-12, atol=bound)
    size = np.abs(weight) @ np.abs(new.get()) + np.abs(change) @ np.abs(gradient.get())
    assert abs(weight @ new.get() - change @ gradient.get()) <= 1e-13 * size
    # On the host: the threads of every kernel in the opposite order.
    monkeypatch.setattr(cupy, "backward", True, raising=False)
    again = on_device.adjoint(its_run, checkpoints=2) @ cupy.asarray(weight)
    assert (again == gradient).all()


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["adini", "csl4"])
def test_remainder_is_of_second_order(cupy, profile):
    """The change of a functional less its derivative falls with the square of the change."""

    def end(a):
        grid = Grid([(0, 1)] * 2, (40, 40), periodic=True)
        flow = Velocity.from_expression("0.3 + a*sin(2*pi*x2)", "0.2", parameters={"a": a})
        split = {"splitting": "strang", "form": "advection"} if profile == "csl4" else {}
        solver = Solver(grid, flow, profile=profile, backend="cupy", **split)
        run = solver.run(solver.state("sin(2*pi*x1)*cos(2*pi*x2)"), 0.1, dt=0.02)
        return solver, run

    solver, run = end(0.21)
    weight = cupy.asarray(np.random.default_rng(7).standard_normal(run.final.data.size))
    slope = float((solver.adjoint(run) @ weight)[-1])
    steps = 1e-4 * 2.0 ** -np.arange(4)
    base = float(weight @ cupy.asarray(run.final.data).ravel())
    left = []
    for step in steps:
        moved = float(weight @ cupy.asarray(end(0.21 + step)[1].final.data).ravel())
        left.append(abs(moved - base - step * slope))
    order = np.polyfit(np.log(steps), np.log(left), 1)[0]
    assert abs(order - 2.0) < 0.05
