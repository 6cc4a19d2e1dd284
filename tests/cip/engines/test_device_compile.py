"""Every kernel of the device compiles for every architecture: NVRTC needs no GPU."""

import numpy as np
import pytest
from device_cases import CASES, solver_of

from cip import Grid, Solver, Velocity
from cip.engines.cuda_engine import OPTIONS, device_source
from cip.profiles.catalogue import LIMITER_CODES
from gpu.cuda.catalogue import ARCHITECTURES

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


def test_wrong_source_is_refused(compile_cuda):
    with pytest.raises(RuntimeError, match='identifier "y" is undefined'):
        compile_cuda('extern "C" __global__ void run(double* x) { x[0] = y; }', "sm_90", OPTIONS)
