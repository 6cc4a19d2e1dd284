"""CUDA C to machine code without a GPU or a driver, by the library of an NVRTC wheel."""

import ctypes
import importlib.util
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def compile_cuda():
    """The function `compile_source` with the newest NVRTC that is installed."""
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

    def compiler(source, architecture, options):
        return compile_source(library, source, architecture, options)

    return compiler


def compile_source(nvrtc, source, architecture, options):
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
