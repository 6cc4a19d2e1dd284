"""Tangent and adjoint on a CUDA device: equal to those of the CPU, and the same bits again."""

import numpy as np
import pytest
from schemes import FAMILIES, solved, solver_of

from cip import Grid, Solver
from cip.engines.cuda_engine import OPTIONS, feet_source
from cip.sensitivities import path_tangent
from cip.sensitivities.device_window import gather_all, pull_all, push_all, tangent_all, unwind_all
from gpu.cuda.catalogue import ARCHITECTURES

SLOW = pytest.mark.slow
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
    stage = solver_of(*scheme)._stages[-1]
    sources = [
        pull_all(stage, "int"), gather_all(stage, "long long"), unwind_all(stage, 4, "int"),
        push_all(stage, "long long"), tangent_all(stage, path_tangent.PathTangent(stage).source,
                                                  "int"),
        feet_source(stage, "double", "int"), feet_source(stage, "float", "long long"),
    ]  # fmt: skip
    for q, source in enumerate(sources):
        assert b".text.run" in compile_cuda(source, ARCHITECTURES[-(q % 2)], OPTIONS)


def test_feet_without_parameters_compile(compile_cuda):
    (stage,) = Solver(Grid((0, 1), 8, periodic=True), 0.5)._stages
    source = feet_source(stage, "double", "int")
    assert b".text.run" in compile_cuda(source, ARCHITECTURES[0], OPTIONS)
