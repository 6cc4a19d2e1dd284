"""Environment of another processor: which kernels OpenBLAS, MKL, NumPy and numba take.

`python .ci/other_processor.py [TURN]` prints `NAME=value` lines for `env`. Each turn names the next
of the processors that this machine can stand in for and is not itself; without one the clock
chooses. What hangs on the last bit of a sum shows when the kernels change.
"""

import os
import subprocess
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
    brings: tuple[
        str, ...
    ]  # what it has more than the one before, as any version of NumPy names it


# From the narrowest to the widest.
PROCESSORS = (
    Processor("Prescott", "x86-64", "SSE4_2", "SSE42", ("SSE", "SSE2", "SSE3")),
    Processor(
        *("Nehalem", "x86-64-v2", "SSE4_2", "SSE42"),
        ("X86_V2", "SSSE3", "SSE41", "POPCNT", "SSE42"),
    ),
    Processor("Sandybridge", "sandybridge", "AVX", "AVX", ("AVX",)),
    Processor("Haswell", "haswell", "AVX2", "AVX2", ("X86_V3", "F16C", "FMA3", "AVX2")),
    Processor(
        *("SkylakeX", "skylake-avx512", "AVX512", "AVX512F"),
        ("X86_V4", "AVX512F", "AVX512CD", "AVX512_SKX"),
    ),
)
# Of processors that are not imitated, and so always off.
BEYOND = ("XOP", "FMA4", *(f"AVX512_{name}" for name in ("KNL", "KNM", "CLX", "CNL", "ICL", "SPR")))


def _names(turn: int) -> dict[str, str]:
    # The widest is the machine itself, which runs the other lanes.
    others = [p for p in PROCESSORS if __cpu_features__.get(p.needs)][:-1]
    if not others:
        return {}
    known = {name for p in PROCESSORS for name in p.brings} | set(BEYOND)
    if unknown := [name for name in __cpu_dispatch__ if name not in known]:
        sys.exit(
            f"{__file__}: NumPy has kernels for {', '.join(unknown)}, which no processor here has; "
            "say in PROCESSORS which one brings them, or in BEYOND that none does"
        )
    k = turn % len(others)
    keeps = {name for p in PROCESSORS[: k + 1] for name in p.brings}
    off = [n for n in __cpu_dispatch__ if __cpu_features__[n] and n not in keeps]
    names = {
        "OPENBLAS_CORETYPE": others[k].openblas,
        "NUMBA_CPU_NAME": others[k].numba,
        "MKL_ENABLE_INSTRUCTIONS": others[k].mkl,
        **({"NPY_DISABLE_CPU_FEATURES": ",".join(off)} if off else {}),
    }
    _check(names, off)
    return names


def _check(names: dict[str, str], off: list[str]) -> None:
    """NumPy itself must start with these names, without a warning, and leave the features out."""
    code = (
        "from numpy._core._multiarray_umath import __cpu_features__ as f; "
        f"assert not [n for n in {off} if f[n]], 'features that stay on'"
    )
    command = [sys.executable, "-W", "error", "-c", code]
    run = subprocess.run(command, env={**os.environ, **names}, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"{__file__}: NumPy does not take {names}:\n{run.stderr}")


if __name__ == "__main__":
    given = int(sys.argv[1]) if len(sys.argv) > 1 else int(time.time())
    print("\n".join(f"{name}={value}" for name, value in _names(given).items()))
