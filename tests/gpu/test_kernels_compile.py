"""Every raw kernel compiles for every architecture: NVRTC needs neither a GPU nor a driver."""

import pytest

from gpu.kernels import ARCHITECTURES, OPTIONS, SOURCES


@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize("name", SOURCES)
def test_source_compiles(compile_cuda, name, architecture):
    cubin = compile_cuda(SOURCES[name], architecture, OPTIONS)
    assert cubin.startswith(b"\x7fELF")
    assert f"{name}_".encode() in cubin


def test_wrong_source_is_refused(compile_cuda):
    broken = SOURCES["arnoldi"].replace("double beta =", "double alpha =")
    with pytest.raises(RuntimeError, match='identifier "beta" is undefined'):
        compile_cuda(broken, "sm_90", OPTIONS)
