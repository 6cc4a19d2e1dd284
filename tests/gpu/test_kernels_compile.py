"""Every raw kernel compiles for every architecture: NVRTC needs neither a GPU nor a driver."""

import ctypes
import importlib.util
from pathlib import Path

import pytest

from gpu.kernels import ARCHITECTURES, OPTIONS, SOURCES


@pytest.fixture(scope="module")
def nvrtc():
    """The library of an nvidia-cuda-nvrtc wheel, CUDA 13 before 12."""
    spec = importlib.util.find_spec("nvidia")
    folders = list(spec.submodule_search_locations) if spec else []
    found = [path for folder in folders for path in Path(folder).glob("*/lib/libnvrtc.so.1[23]")]
    if not found:
        pytest.skip("no NVRTC: pip install 'skfem-adini[nvrtc]'")
    path = max(found, key=lambda path: path.name)
    # NVRTC looks for its builtins by name: it finds them once they are loaded.
    for builtins in path.parent.glob("libnvrtc-builtins.so.*"):
        ctypes.CDLL(str(builtins))
    library = ctypes.CDLL(str(path))
    library.nvrtcGetErrorString.restype = ctypes.c_char_p
    return library


def compile_source(nvrtc, source, architecture, options=OPTIONS):
    """Machine code of a source; RuntimeError with the compiler's log where it is wrong."""
    program = ctypes.c_void_p()
    code = nvrtc.nvrtcCreateProgram(
        ctypes.byref(program), source.encode(), b"kernels.cu", 0, None, None
    )
    assert code == 0, nvrtc.nvrtcGetErrorString(code).decode()
    try:
        flags = [f"--gpu-architecture={architecture}".encode(), *map(str.encode, options)]
        code = nvrtc.nvrtcCompileProgram(
            program, len(flags), (ctypes.c_char_p * len(flags))(*flags)
        )
        size = ctypes.c_size_t()
        if code:
            nvrtc.nvrtcGetProgramLogSize(program, ctypes.byref(size))
            log = ctypes.create_string_buffer(size.value)
            nvrtc.nvrtcGetProgramLog(program, log)
            raise RuntimeError(log.value.decode())
        assert nvrtc.nvrtcGetCUBINSize(program, ctypes.byref(size)) == 0
        cubin = ctypes.create_string_buffer(size.value)
        assert nvrtc.nvrtcGetCUBIN(program, cubin) == 0
        return cubin.raw
    finally:
        nvrtc.nvrtcDestroyProgram(ctypes.byref(program))


@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize("name", SOURCES)
def test_source_compiles(nvrtc, name, architecture):
    cubin = compile_source(nvrtc, SOURCES[name], architecture)
    assert cubin.startswith(b"\x7fELF")
    assert f"{name}_".encode() in cubin


def test_wrong_source_is_refused(nvrtc):
    broken = SOURCES["arnoldi"].replace("double beta =", "double alpha =")
    with pytest.raises(RuntimeError, match='identifier "beta" is undefined'):
        compile_source(nvrtc, broken, "sm_90")
