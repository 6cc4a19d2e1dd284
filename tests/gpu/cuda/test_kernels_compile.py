"""Every raw kernel compiles for every architecture: NVRTC needs neither a GPU nor a driver.

Machine code comes for each: in the fast lane for the oldest and the newest one, and optimised, as
users get it, in the slow lane, since that takes five times as long.
"""

import pytest

from gpu.cuda.catalogue import ARCHITECTURES, OPTIONS, SOURCES

QUICK = ("--Ofast-compile=max",)


def check(compile_cuda, name, architecture, *options):
    cubin = compile_cuda(SOURCES[name], architecture, OPTIONS + options)
    assert cubin.startswith(b"\x7fELF")
    assert f"{name}_".encode() in cubin


@pytest.mark.parametrize("architecture", [ARCHITECTURES[0], ARCHITECTURES[-1]])
@pytest.mark.parametrize("name", SOURCES)
def test_source_compiles(compile_cuda, name, architecture):
    check(compile_cuda, name, architecture, *QUICK)


@pytest.mark.slow
@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize("name", SOURCES)
def test_source_compiles_optimised(compile_cuda, name, architecture):
    check(compile_cuda, name, architecture)


def test_wrong_source_is_refused(compile_cuda):
    broken = SOURCES["arnoldi"].replace("double beta =", "double alpha =")
    with pytest.raises(RuntimeError, match='identifier "beta" is undefined'):
        compile_cuda(broken, "sm_90", OPTIONS)
