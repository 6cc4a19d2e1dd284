"""Environment of another processor: which kernels OpenBLAS, MKL, NumPy and numba take.

`python .ci/other_processor.py [TURN]` prints `NAME=value` lines for `env`. Each turn names the next
of the processors that this machine can stand in for and is not itself; without one the clock
chooses. What hangs on the last bit of a sum shows when the kernels change.
"""

import sys
import time
from dataclasses import dataclass

from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__


@dataclass(frozen=True)
class Processor:
    """Names that each library has for one kind of processor, and what the machine must have."""

    openblas: str
    numba: str
    mkl: str
    needs: str
    keeps: tuple[str, ...]  # NumPy's dispatched features that stay on, both ways of naming them


AVX2 = ("X86_V3", "AVX2", "FMA3", "F16C", "AVX")
# From the narrowest to the widest.
PROCESSORS = (
    Processor("Prescott", "x86-64", "SSE4_2", "SSE42", ()),
    Processor("Nehalem", "x86-64-v2", "SSE4_2", "SSE42", ()),
    Processor("Sandybridge", "sandybridge", "AVX", "AVX", ("AVX",)),
    Processor("Haswell", "haswell", "AVX2", "AVX2", AVX2),
    Processor("SkylakeX", "skylake-avx512", "AVX512", "AVX512F", (*AVX2, "AVX512F", "X86_V4")),
)


def _names(turn: int) -> dict[str, str]:
    # The widest is the machine itself, which runs the other lanes.
    others = [p for p in PROCESSORS if __cpu_features__.get(p.needs)][:-1]
    if not others:
        return {}
    processor = others[turn % len(others)]
    off = [n for n in __cpu_dispatch__ if __cpu_features__[n] and n not in processor.keeps]
    names = {
        "OPENBLAS_CORETYPE": processor.openblas,
        "NUMBA_CPU_NAME": processor.numba,
        "MKL_ENABLE_INSTRUCTIONS": processor.mkl,
    }
    return {**names, "NPY_DISABLE_CPU_FEATURES": ",".join(off)} if off else names


if __name__ == "__main__":
    given = int(sys.argv[1]) if len(sys.argv) > 1 else int(time.time())
    print("\n".join(f"{name}={value}" for name, value in _names(given).items()))
