"""CPU and device agree to rounding; where there is no device, the host plays one."""

import sys
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from device_cases import CASES, field, solver_of
from schemes import FAMILIES, form_of, solved
from schemes import solver_of as solver_of_scheme

from cip import Grid, InputError, MissingDependency, Solver, State, Velocity
from cip.engines import engine
from cip.engines.cuda_displacements import DeviceDisplacements
from cip.engines.cuda_kernels import OPTIONS, device_source, feet_source
from cip.engines.displacement_source import (
    FollowSource,
    combine_source,
    difference_source,
    update_source,
)
from cip.profiles.catalogue import LIMITER_CODES
from cip.sensitivities import path_tangent
from cip.sensitivities.device_window import gather_all, pull_all, push_all, tangent_all, unwind_all
from gpu.cuda.catalogue import ARCHITECTURES

SLOW = pytest.mark.slow
FAST = {
    ("cubic", None, 1, "transport", True, "float64", False),
    ("cubic", None, 1, "advection", True, "float64", True),
    ("adini", None, 2, "transport", False, "float64", False),
    ("csl4", "bounds", 1, "advection", True, "float64", False),
}
RUNS = [
    pytest.param(*run, marks=[] if run in FAST else SLOW)
    for case in CASES
    for form in ("transport", "advection")
    for stored in (True, False)
    for dtype in ("float64", "float32")
    for uneven in (False, True)
    for run in [(*case, form, stored, dtype, uneven)]
    if not (case[0].startswith("csl") and (form == "transport" or not stored))
    and not (uneven and not stored)
]


def scaled(found, expected):
    """Errors over the largest entry of each moment and 1."""
    axes = tuple(range(1, expected.ndim))
    return np.abs(found - expected) / (np.abs(expected).max(axis=axes, keepdims=True) + 1)


@pytest.mark.parametrize(("profile", "limiter", "dim", "form", "stored", "dtype", "uneven"), RUNS)
def test_steps_and_runs_agree(cupy, profile, limiter, dim, form, stored, dtype, uneven):
    """A step of random moments, whose highest derivatives go with h^-2, and a run."""
    steps, runs = [], []
    for backend in ("cpu", "cupy"):
        solver = solver_of(
            profile, limiter, dim, dtype, form=form, backend=backend, store_feet=stored,
            uneven=uneven,
        )  # fmt: skip
        shape = State.from_function(0.0, solver.grid, profile).data.shape
        data = np.random.default_rng(11).uniform(-0.8, 1.2, shape).astype(dtype)
        start = State(solver.grid, profile, data)
        steps.append(solver.run(start, 0.21, dt=0.21).final.data)
        runs.append(solver.run(solver.state(field), 0.5, dt=0.11).final.data)
    assert isinstance(steps[1], np.ndarray)
    if dtype == "float32":
        error = scaled(steps[1], steps[0])
        # A choice between profiles may fall either way within rounding.
        assert np.mean(error > 2e-5) < 0.02 if limiter else error.max() < 2e-5
    else:
        # Feet computed in the kernel use the sines of two libraries, a rounding apart.
        assert scaled(steps[1], steps[0]).max() < (1e-13 if stored else 1e-12)
        assert scaled(runs[1], runs[0]).max() < (1e-13 if stored else 1e-12)


@SLOW
@pytest.mark.parametrize("stored", [True, False])
def test_walls_on_the_device(cupy, stored):
    """Paths that begin on walls: their data are written by the host's computation."""
    ends = []
    for backend in ("cpu", "cupy"):
        solver = Solver(
            Grid((0, 1), (16, 12)), Velocity.from_expression("1 + x2/2", "0.3*x1"),
            "advection", "bicubic", boundary="1 + sin(3*t)*x2", backend=backend, store_feet=stored,
        )  # fmt: skip
        ends.append(solver.run(solver.state(1.0), 0.5, dt=0.11).final.data)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-12 * np.abs(ends[0]).max())


SWIRL = ("0.4 + 0.2*sin(2*pi*x2 + 3*t)", "0.3*cos(2*pi*x1)")


@pytest.mark.parametrize(
    ("profile", "winds"),
    [
        ("bicubic", "formula"),
        ("csl4", "formula"),
        pytest.param("adini", "snapshots", marks=SLOW),
        pytest.param("bicubic", "steady", marks=SLOW),
    ],
)
def test_fields_on_the_device(cupy, profile, winds):
    """Several fields, each by its rules, after feet that are computed once or in their kernels."""
    means = profile == "csl4"
    grid = Grid([(0, 1)] * 2, (14, 12), periodic=means)
    velocity = Velocity.from_expression(*(text.replace("3*t", "0") for text in SWIRL))
    if winds == "formula":
        velocity = Velocity.from_expression(*SWIRL)
    elif winds == "snapshots":
        (x, y), times = grid.mesh(), np.linspace(0, 0.6, 5)
        arrays = [[0.4 + 0.2 * np.sin(2 * y + 3 * t), 0.3 * np.cos(2 * x)] for t in times]
        velocity = Velocity.from_snapshots(times, arrays, grid)
    rules = {"decay": {"dust": 0.5}, "source": {"dust": "x1*(1 - x1)"}}
    rules["foot_tolerance"] = 1e-11  # the numbers of sub-steps may differ
    rules |= {"bounds": {"smoke": (0, 1)}, "limiter": "bounds"} if means else {}
    rules |= {} if means else {"boundary": {"smoke": "1 + t", "dust": 0.5, "ash": 0.0}}
    ends = []
    for backend in ("cpu", "cupy"):
        solver = Solver(grid, velocity, "advection", profile, backend=backend, **rules)
        start = solver.state({"smoke": "x2*(1 - x2)", "dust": 1.0, "ash": "sin(2*pi*x1)"})
        run = solver.run(start, 0.5, dt=0.11, gauges=[[0.3], [0.4]])
        ends.append((run.final.data, run.gauges.values["ash"]))
        assert run.final.fields == ("smoke", "dust", "ash")
        assert solver.step(start, 0.1).mass.keys() == {"smoke", "dust", "ash"}
    for one, other in zip(*ends, strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-10 * np.abs(one).max())


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("profile", "dim", "degree"),
    [
        ("cubic", 1, 5),
        ("adini", 2, 3),
        pytest.param("bicubic", 2, 5, marks=SLOW),
        pytest.param("cubic", 3, 5, marks=SLOW),
    ],
)
def test_snapshots_and_parameters_on_the_device(cupy, profile, dim, degree):
    """Random winds at uneven times, periodic in one direction, and named numbers of a formula."""
    periodic = (False, True, False)[:dim]
    data = Grid([(-0.5, 1.5), (0, 1), (-0.5, 1.5)][:dim], (9, 8, 10)[:dim], periodic=periodic)
    winds = 0.2 * np.random.default_rng(2).uniform(size=(5, dim, *data.nodes))
    text = ["a*cos(2*pi*x1 + b*t)", "a*b*sin(2*pi*x2)", "a"][:dim]
    named = Velocity.from_expression(*text, parameters={"a": 0.3, "b": 2.0})
    grid = Grid([(0, 1)] * dim, (12, 10, 8)[:dim], periodic=periodic)
    sources = set()
    for velocity in (
        Velocity.from_snapshots([0.0, 0.1, 0.3, 0.4, 0.7], winds, data, degree),
        named,
        named.with_parameters(b=-1.0),
    ):
        ends = []
        for backend in ("cpu", "cupy"):
            solver = Solver(
                grid, velocity, profile=profile, boundary=0.0, backend=backend, store_feet=False,
                foot_tolerance=1e-9,
            )  # fmt: skip
            ends.append(solver.run(solver.state(field), 0.5, dt=0.11).final.data)
        # Planes of snapshots follow displacements on the CPU, derivatives to 100 times as much; by
        # other sub-steps, between which a path of this noise may touch a wall.
        other = dim == 2 and not velocity.parameters
        limit = (1e-5 if other else 1e-10) * np.abs(ends[0]).max()
        assert np.mean(np.abs(ends[1] - ends[0]) > limit) <= 0.02 * other
        stage = solver._stages[0]
        sources.add(device_source(stage, f"node_{profile}", 0, True, "double", "int"))
    assert len(sources) == 2  # parameters are arguments of one kernel


DRIFTING = (
    "0.2*cos(t) + sin(pi*x1)**2*sin(2*pi*x2)*cos(pi*t)", "0.1 - sin(pi*x2)**2*sin(2*pi*x1)"
)  # fmt: skip


def winds_of(kind, walls, dim=2):
    """A velocity by a formula, one with a kink in a cell, or snapshots of the first, some linear in
    time."""
    if kind == "kink":
        return Velocity.from_expression("0.5*abs(sin(pi*x1 - 0.01))*cos(t)", DRIFTING[1])
    parts = [*DRIFTING, "0.1*cos(2*pi*x2)"][:dim]
    if kind == "formula":
        return Velocity.from_expression(*parts)
    grid = Grid([(0, 1)] * dim, (20, 18, 9)[:dim], periodic=not walls)
    at = [*grid.mesh(), *[0.0] * (3 - dim)]
    made = Velocity.from_expression(*parts).on(grid)
    values = [c.derivative((0,) * 4, (1.0,) * 4) for c in made]
    times = np.linspace(0, 1, 7)
    arrays = np.array([[value(*at, t) for value in values] for t in times])
    return Velocity.from_snapshots(times, arrays, grid, 3, time=kind)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("profile", "form", "winds", "walls", "fields"),
    [
        ("bicubic", "transport", "formula", False, 2),
        ("adini", "transport", "cubic", False, 1),
        ("csl4", "advection", "linear", True, 1),
        ("bicubic", "transport", "kink", False, 1),
        pytest.param("bicubic", "advection", "cubic", False, 2, marks=SLOW),
        pytest.param("adini", "advection", "kink", False, 2, marks=SLOW),
        pytest.param("csl2", "advection", "formula", True, 2, marks=SLOW),
        pytest.param("csl4", "advection", "cubic", False, 2, marks=SLOW),
    ],
)
def test_unsteady_feet_are_those_of_the_host(cupy, profile, form, winds, walls, fields):
    """Displacements of as many sub-steps, and their differences, also for several fields; to a
    tolerance for which the host takes classical steps too."""
    grid = Grid([(0, 1)] * 2, (80, 72), periodic=not walls)
    names = [f"u{q}x" for q in range(fields)]
    start = {name: f"{q} + sin(2*pi*x1)*cos(2*pi*x2)" for q, name in enumerate(names)}
    ends, counts = [], []
    with mock.patch.object(engine, "LIMITS", engine.LIMITS._replace(differences=1)):
        for backend in ("cpu", "cupy"):
            solver = Solver(
                grid, winds_of(winds, walls), form, profile, backend=backend,
                boundary=1.0 if walls else None, foot_tolerance=1e-7,
            )  # fmt: skip
            run = solver.run(solver.state(start), 0.1, dt=0.03)
            ends.append(run.final.data)
            counts.append(solver._kernels.substep_counts)
    (stage, moved), *_ = solver._kernels._memory.displaced.items()
    assert isinstance(moved, DeviceDisplacements)
    assert moved.fused == (stage.axis is None and form == "transport")
    kinks = counts[1].pop(("kinks", *stage.part(0.03)), None)
    assert (kinks is not None) == (winds == "kink" and moved.fused)
    assert {key: n for key, (_, n) in counts[1].items() if key[0] == "displaced"} == {
        key: n for key, (_, n) in counts[0].items()
    }
    scale = np.abs(ends[0]).max(axis=(-2, -1), keepdims=True)
    # Differences over a sixty-fourth of a cell, around kinks, lose three digits twice.
    assert np.max(np.abs(ends[1] - ends[0]) / scale) < (1e-8 if winds == "kink" else 1e-11)


@pytest.mark.turns(4)
def test_a_third_direction_on_the_device(cupy):
    """Sweeps of means through coefficients on lines with two directions across."""
    grid, ends = Grid([(0, 1)] * 3, (12, 10, 9), periodic=True), []
    for backend in ("cpu", "cupy"):
        velocity = winds_of("cubic", False, 3)
        solver = Solver(grid, velocity, "advection", "csl2", backend=backend)
        ends.append(solver.run(solver.state(field), 0.1, dt=0.05).final.data)
    assert isinstance(solver._kernels._displaced(solver._stages[0]), DeviceDisplacements)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-12)


def test_formulas_with_too_many_numbers_have_the_other_kernel(cupy):
    """A kernel takes few kilobytes of arguments."""
    grid = Grid([(0, 1)] * 2, (130, 130), periodic=True)
    for terms, serves in ((5, True), (41, False)):
        parts = [f"sin(2*pi*x1 + {q}.5*t)*{q + 1}e-4" for q in range(terms)]
        wind = Velocity.from_expression(" + ".join(parts), "0.1")
        solver = Solver(grid, wind, profile="adini", backend="cupy")
        assert (solver._kernels._displaced(solver._stages[0]) is not None) == serves


class CUDARuntimeError(RuntimeError):
    """As CuPy's, which is no ValueError either."""


def test_without_a_device_that_answers(monkeypatch):
    def no_driver():
        raise CUDARuntimeError("cudaErrorInsufficientDriver: CUDA driver version is insufficient")

    runtime = SimpleNamespace(CUDARuntimeError=CUDARuntimeError, getDeviceCount=no_driver)
    grid = Grid((0, 1), 8, periodic=True)
    for fake, error, message in (
        (SimpleNamespace(cuda=SimpleNamespace(runtime=runtime)), InputError,
         r"no CUDA device answers .cudaErrorInsuff"),
        (None, MissingDependency, r"pip install 'skfem-adini\[cuda13\]'"),
    ):  # fmt: skip
        monkeypatch.setitem(sys.modules, "cupy", fake)
        with pytest.raises(error, match=message):
            Solver(grid, 1.0, backend="cupy")


# Every kernel of the device compiles for every architecture: NVRTC needs no GPU.


# The form and the place of the feet are constants in a kernel: advection holds what transport has.
KERNELS = [
    (*case, feet)
    for case in CASES
    for feet in ("stored", "computed")
    if not case[0].startswith("csl") or feet == "stored"
]
ENDS = (ARCHITECTURES[0], ARCHITECTURES[-1])
KIND = ("profile", "limiter", "dim", "feet")


def check(compile_cuda, architecture, kernel, form="advection", uneven=False, **types):
    profile, limiter, dim, feet = kernel
    solver = solver_of(profile, limiter, dim, form=form, uneven=uneven)
    stage = solver._stages[-1]
    source = device_source(
        stage, solver._kernels.name(stage), LIMITER_CODES[limiter], feet == "computed",
        types.get("real", "double"), types.get("index", "int"),
    )  # fmt: skip
    cubin = compile_cuda(source, architecture, OPTIONS)
    assert cubin.startswith(b"\x7fELF")
    assert b".text.run" in cubin


# Of those that compute their feet one of each kind: the rest of their code is that of the others.
PATHS = [("cubic", None, 1), ("adini", None, 2), ("cubic", None, 3)]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    KIND, [kernel for kernel in KERNELS if kernel[3] == "stored" or kernel[:3] in PATHS]
)
def test_kernel_compiles(compile_cuda, profile, limiter, dim, feet):
    """Each kernel for the oldest or for the newest architecture, by turns."""
    kernel = (profile, limiter, dim, feet)
    check(compile_cuda, ENDS[KERNELS.index(kernel) % 2], kernel)


@pytest.mark.slow
@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize(KIND, KERNELS)
def test_every_kernel_compiles(compile_cuda, profile, limiter, dim, feet, architecture):
    """All for all, with the other types too."""
    kernel = (profile, limiter, dim, feet)
    forms = ("advection",) if profile.startswith("csl") else ("transport", "advection")
    for form in forms:
        check(compile_cuda, architecture, kernel, form)
    check(compile_cuda, architecture, kernel, real="float", index="long long")
    if feet == "stored":
        check(compile_cuda, architecture, kernel, uneven=True)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("dim", "profile", "degree"),
    [(1, "cubic", 5), (2, "adini", 3), pytest.param(2, "adini", 5, marks=pytest.mark.slow)],
)
def test_snapshots_compile(compile_cuda, dim, profile, degree):
    """Splines as arguments of the kernel; parameters are those of the oddest names."""
    grid = Grid([(0, 1)] * dim, (8,) * dim, periodic=True)
    winds = Velocity.from_snapshots([0, 1], np.zeros((2, dim, *grid.nodes)), grid, degree)
    (stage,) = Solver(grid, winds, profile=profile)._stages
    source = device_source(stage, f"node_{profile}", 0, True, "double", "int")
    assert b".text.run" in compile_cuda(source, ENDS[1], OPTIONS)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("winds", ["formula", "cubic"])
@pytest.mark.parametrize("profile", ["bicubic", "csl4"])
def test_feet_by_displacements_compile(cupy, compile_cuda, profile, winds):
    """Every kernel of them, with indices of both lengths, for the oldest or newest architecture."""
    means = profile == "csl4"
    grid = Grid([(0, 1)] * 2, (72, 70), periodic=not means)
    solver = Solver(
        grid, winds_of(winds, means), form_of(profile), profile, backend="cupy",
        boundary=0.0 if means else None,
    )  # fmt: skip
    stage = solver._stages[0]
    moved = DeviceDisplacements(stage, {}, solver._kernels)
    tables = 4 * (winds != "formula")
    made = FollowSource(moved, moved._flow(stage.blocks[-1]), tables, "long long")
    sources = [made.every(), made.halved(), difference_source("int"), combine_source(5)]
    if not means:
        name = solver._kernels.name(stage)
        sources += [update_source(moved, name, 0, real, "int", 2) for real in ("float", "double")]
    for q, source in enumerate(sources):
        assert b".text.run" in compile_cuda(source, ENDS[q % 2], OPTIONS)


def test_feet_without_parameters_compile_and_wrong_source_is_refused(compile_cuda):
    (stage,) = Solver(Grid((0, 1), 8, periodic=True), 0.5)._stages
    source = feet_source(stage, "double", "int")
    assert b".text.run" in compile_cuda(source, ARCHITECTURES[0], OPTIONS)
    with pytest.raises(RuntimeError, match='identifier "y" is undefined'):
        compile_cuda('extern "C" __global__ void run(double* x) { x[0] = y; }', "sm_90", OPTIONS)


# Tangents and adjoints: equal to those of the CPU, and the same bits again.


SCHEMES = list(dict.fromkeys(scheme for family in FAMILIES.values() for scheme in family))


def every_scheme(*fast):
    return pytest.mark.parametrize(
        "scheme",
        [
            pytest.param(s, marks=[] if s in fast else SLOW, id=f"{q}: {', '.join(s)}")
            for q, s in enumerate(SCHEMES)
        ],
    )


@every_scheme(("inflow", "cubic", "advection"))
def test_operators_are_those_of_the_cpu(cupy, monkeypatch, scheme):
    """Equal products, a dot-test on the device, and the same bits again."""
    rng = np.random.default_rng(4)
    solver, run = solved(*scheme, dt=0.06)  # the last step is shorter
    on_device, its_run = solved(*scheme, dt=0.06, backend="cupy")
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


@every_scheme(
    ("ring", "cubic", "advection"), ("inflow", "csl4", "advection"),
    ("torus", "adini", "transport"), ("space", "cubic", "transport"),
)  # fmt: skip
def test_kernels_compile(compile_cuda, scheme):
    """By NVRTC, which needs no device, for the oldest and the newest card."""
    stage = solver_of_scheme(*scheme)._stages[-1]
    sources = [
        pull_all(stage, "int"), gather_all(stage, "long long"), unwind_all(stage, 4, "int"),
        push_all(stage, "long long"), tangent_all(stage, path_tangent.PathTangent(stage).source,
                                                  "int"),
        feet_source(stage, "double", "int"), feet_source(stage, "float", "long long"),
    ]  # fmt: skip
    for q, source in enumerate(sources):
        assert b".text.run" in compile_cuda(source, ARCHITECTURES[-(q % 2)], OPTIONS)
