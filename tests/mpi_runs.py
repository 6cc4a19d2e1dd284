"""Scripts started by mpiexec on a few processes, with a hard time limit."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]


def launcher() -> str:
    """The command that starts processes, or a skip with the reason."""
    for package in ("mpi4py", "petsc4py", "slepc4py"):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} is not installed")
    # Debian's petsc4py is built with Open MPI, whose launcher may have a second name.
    for name in ("mpiexec.openmpi", "mpiexec"):
        if found := shutil.which(name):
            return found
    pytest.skip("no mpiexec")


def start(module: str, size: int, *arguments: str, timeout: float = 240.0) -> Any:
    """Run a module of the tests on several processes: the finished process."""
    command = [launcher(), "-n", str(size), sys.executable, "-m", module, *arguments]
    environment = dict(
        os.environ,
        OMPI_ALLOW_RUN_AS_ROOT="1",
        OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1",
        OMPI_MCA_rmaps_base_oversubscribe="1",
        # Beside other work on few cores, who waits must let the others go on.
        OMPI_MCA_mpi_yield_when_idle="1",
        OMPI_MCA_btl_vader_single_copy_mechanism="none",
        OMP_NUM_THREADS="1",
        OPENBLAS_NUM_THREADS="1",
        MKL_NUM_THREADS="1",
        PYTHONPATH=str(ROOT),
    )
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=timeout
    )


def run(module: str, size: int, *arguments: str, timeout: float = 240.0) -> Any:
    """What a module of the tests prints as JSON in its last line; it says its size first."""
    done = start(module, size, *arguments, timeout=timeout)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    found = json.loads(done.stdout.strip().splitlines()[-1])
    assert found.pop("size") == size, "the launcher belongs to another MPI library"
    return found
