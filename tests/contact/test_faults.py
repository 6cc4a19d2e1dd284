"""Faults that no test double shows: no space on the disk, a signal at any moment, a kill."""

import resource
import signal
import subprocess
import sys
from textwrap import dedent

import numpy as np
import pytest
import pyvista
from skfem import ElementHex1

from contact import ContactProblem, ElasticBody, LoadHistory, LoadStepper
from contact.complete_file import complete_file

TIMES = np.linspace(0.1, 1.0, 10)
SPACE = 9_000  # bytes a file may have: a step of the stepper below takes 13 to 17 kB, its problem 8


def dragged(make, n=4):
    """A cube held by its top, pressed on a foundation and dragged; hexahedra."""
    ticks = np.linspace(0, 1, n + 1)
    body = ElasticBody.from_mesh(
        make.box(ElementHex1, ticks, ticks, ticks), ElementHex1(), E=1.0, nu=0.3
    )
    stepper = LoadStepper(ContactProblem(body.fix("top"), "bottom", 0.0, 0.3))
    stepper.move("top", "z", -0.05, lambda t: min(1.0, 4 * t))
    return stepper.move("top", "x", 0.08, lambda t: np.sin(3 * t))


@pytest.fixture(scope="module")
def whole(make):
    return dragged(make).run(TIMES)


@pytest.fixture
def little_space():
    """Files of this process may not grow past `SPACE`: what a full disk does to a write."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (SPACE, limits[1]))
    yield lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    signal.signal(signal.SIGXFSZ, handler)


def test_no_space_for_a_result(whole, tmp_path, little_space):
    with pytest.raises(OSError, match="too large"):
        whole.results[0].save(tmp_path / "result.npz")
    assert not list(tmp_path.iterdir())


def test_no_space_for_an_animation(whole, tmp_path, little_space):
    """VTK's own writers end the process here; the files of the first series that fit are whole."""
    with pytest.raises(OSError, match="too large"):
        whole.to_pvd(tmp_path / "drag.pvd")
    left = list(tmp_path.iterdir())
    assert not [path for path in left if path.suffix == ".vtu" or path.name.startswith("tmp")]
    assert all("pressure" in pyvista.read(p).point_data for p in left if p.suffix == ".vtp")


def test_no_space_in_a_history(whole, make, tmp_path, little_space):
    """The first step does not fit: kept in memory, not on disk; with space again it is resumed."""
    stepper = dragged(make)
    with pytest.raises(OSError, match="too large"):
        stepper.run(TIMES, path=tmp_path / "run")
    assert len(stepper.history) == 1
    assert len(LoadHistory.load(tmp_path / "run")) == 0
    little_space()
    history = dragged(make).resume(tmp_path / "run")
    assert np.array_equal(history.results[-1].u, whole.results[-1].u)


# Fractions of the time that the whole run takes.
@pytest.mark.parametrize("moment", [0.3, 0.7])
def test_interrupted_anywhere(moment, whole, make, tmp_path):
    """Ctrl-C at any moment, within a step or a write: what was finished is kept and resumed."""
    lines = []
    dragged(make).run(TIMES, path=tmp_path / "first", callback=lines.append)
    seconds = moment * sum(line.seconds for line in lines)
    stepper = dragged(make)

    def run():
        signal.setitimer(signal.ITIMER_REAL, seconds)
        stepper.run(TIMES, path=tmp_path / "run")
        signal.raise_signal(signal.SIGALRM)  # it was quicker than before

    handler = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            run()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
    if not (tmp_path / "run" / "history.json").exists():
        return  # before there was anything to keep
    kept = LoadHistory.load(tmp_path / "run")
    assert len(stepper.history) - 1 <= len(kept) <= len(stepper.history)
    assert not [p for p in (tmp_path / "run").iterdir() if p.name.startswith("tmp")]
    history = dragged(make).resume(tmp_path / "run")
    assert np.array_equal(history.times, TIMES)
    for ours, expected in zip(history.results, whole.results, strict=True):
        # The same arithmetic from the same state, but for the extrapolated start.
        assert np.abs(ours.u - expected.u).max() < 1e-12 * np.abs(expected.u).max()


def test_killed_while_writing(tmp_path):
    """A process that ends in the middle of a file leaves the old one."""
    path = tmp_path / "result.txt"
    path.write_text("old")
    script = """
        import os, signal, sys
        from pathlib import Path
        from contact.complete_file import complete_file
        with complete_file(Path(sys.argv[1])) as file:
            file.write(b"half of the new")
            file.flush()
            os.kill(os.getpid(), signal.SIGKILL)
    """
    done = subprocess.run([sys.executable, "-c", dedent(script), str(path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert path.read_text() == "old"
    with complete_file(path) as file:
        file.write(b"new")
    assert path.read_text() == "new"
