"""The kernels of the adjoint on a device compile without one, for the oldest and newest card."""

import pytest

from cip import Grid, Solver, Velocity
from cip.engines.cuda_engine import OPTIONS, feet_source
from cip.sensitivities.device_window import gather_all, pull_all, push_all, tangent_all, unwind_all
from cip.sensitivities.path_tangent import PathTangent
from gpu.cuda.catalogue import ARCHITECTURES

FLOW = ["0.5 + a*sin(2*pi*x1)*cos(t)", "b*cos(2*pi*x1)", "a*sin(2*pi*x2)"]
FAST = [("cubic", 1, True), ("csl4", 1, False), ("adini", 2, True), ("cubic", 3, False)]
PROFILES = [
    *(("cubic", 1), ("quintic", 1), ("csl2", 1), ("csl4", 1), ("adini", 2), ("bicubic", 2)),
    *(("cubic", 2), ("quintic", 2), ("cubic", 3), ("quintic", 3)),
    *(("csl2", 2), ("csl4", 2), ("csl2", 3), ("csl4", 3)),
]
CASES = [
    pytest.param(*case, periodic, marks=[pytest.mark.slow] * ((*case, periodic) not in FAST))
    for case in PROFILES
    for periodic in (True, False)
]


def stage_of(profile, dim, periodic=True, parameters=True):
    grid = Grid([(0, 1)] * dim, (8, 9, 7)[:dim], periodic=periodic)
    values = {"a": 0.1, "b": 0.2} if dim > 1 else {"a": 0.1}
    flow = FLOW[:dim] if parameters else ["0.5"] * dim
    velocity = Velocity.from_expression(*flow, parameters=values if parameters else None)
    solver = Solver(
        grid, velocity, "advection" if profile.startswith("csl") else "transport", profile,
        splitting="strang" if dim > 1 and profile not in ("adini", "bicubic") else None,
        boundary=None if periodic else 0.0,
    )  # fmt: skip
    return solver._stages[-1]


@pytest.mark.parametrize(("profile", "dim", "periodic"), CASES)
def test_kernels_compile(compile_cuda, profile, dim, periodic):
    stage = stage_of(profile, dim, periodic)
    sources = [
        pull_all(stage, "int"), gather_all(stage, "long long"), unwind_all(stage, 4, "int"),
        push_all(stage, "long long"), tangent_all(stage, PathTangent(stage).source, "int"),
        feet_source(stage, "double", "int"), feet_source(stage, "float", "long long"),
    ]  # fmt: skip
    for q, source in enumerate(sources):
        assert b".text.run" in compile_cuda(source, ARCHITECTURES[-(q % 2)], OPTIONS)


def test_feet_without_parameters_compile(compile_cuda):
    source = feet_source(stage_of("cubic", 1, parameters=False), "double", "int")
    assert b".text.run" in compile_cuda(source, ARCHITECTURES[0], OPTIONS)
