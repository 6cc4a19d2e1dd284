"""Faults that no test double shows: no space on the disk, a signal at any moment, a kill."""

import signal
from contextlib import contextmanager

import numpy as np
import pytest
import pyvista
from full_disk import errors_without_space
from skfem import ElementHex1

from contact import LoadHistory
from skfem_adini.ground.archives import write_arrays

TIMES = np.linspace(0.1, 1.0, 10)
SPACE = 9_000  # bytes a file may have: a step takes 13 to 17 kB, its problem 8


@pytest.fixture(scope="module")
def whole(make):
    return make.dragged(ElementHex1, n=4).run(TIMES)


WITHOUT_SPACE = """
    import sys
    from pathlib import Path
    import pyvista
    from skfem import ElementHex1, MeshHex
    from contact import ContactProblem, ElasticBody, LoadStepper

    folder = Path(sys.argv[1])
    mesh = MeshHex().refined(2).with_boundaries(
        {"bottom": lambda x: x[2] < 1e-9, "top": lambda x: x[2] > 1 - 1e-9}
    )
    body = ElasticBody.from_mesh(mesh, ElementHex1(), E=1.0, nu=0.3).fix("top")
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, 0.3)).move("top", "z", -0.05)
    history = stepper.run([0.5, 1.0])

    def kept():
        assert len(stepper.history) == 2

    calls = [
        lambda: history.results[0].save(folder / "result.npz"),
        lambda: history.to_pvd(folder / "drag.pvd"),
        lambda: stepper.run([1.5, 2.0], path=folder / "run"),
        kept,
    ]
"""


@pytest.mark.turns(4)
def test_no_space_left(tmp_path):
    """A result, an animation (VTK's own writers end the process) and a history on a full disk."""
    *errors, kept = errors_without_space(WITHOUT_SPACE, tmp_path, SPACE)
    assert len(errors) == 3
    assert all("too large" in error for error in errors)
    assert kept == "none"
    left = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert all(path.stat().st_size < SPACE and path.suffix != ".vtu" for path in left)
    assert not [path for path in left if path.name.startswith("tmp")]
    assert all("pressure" in pyvista.read(p).point_data for p in left if p.suffix == ".vtp")
    assert len(LoadHistory.load(tmp_path / "run")) == 0


@contextmanager
def ctrl_c(seconds):
    """Ctrl-C after so long, at any moment of the main thread."""
    alarm = signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    interrupt = signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, alarm)
        signal.signal(signal.SIGINT, interrupt)


# Fractions of the time that the whole run takes.
@pytest.mark.parametrize("moment", [0.3, 0.7])
def test_interrupted_anywhere(moment, whole, make, tmp_path):
    """Ctrl-C at any moment, within a step or a write: what was finished is kept and resumed."""
    lines = []
    make.dragged(ElementHex1, n=4).run(TIMES, path=tmp_path / "first", callback=lines.append)
    seconds = moment * sum(line.seconds for line in lines)
    stepper = make.dragged(ElementHex1, n=4)

    def run():
        stepper.run(TIMES, path=tmp_path / "run")
        signal.raise_signal(signal.SIGINT)  # it was quicker than before

    with ctrl_c(seconds), pytest.raises(KeyboardInterrupt):
        run()
    if not (tmp_path / "run" / "history.json").exists():
        return  # before there was anything to keep
    kept = LoadHistory.load(tmp_path / "run")
    assert len(stepper.history) - 1 <= len(kept) <= len(stepper.history)
    assert not [p for p in (tmp_path / "run").iterdir() if p.name.startswith("tmp")]
    history = make.dragged(ElementHex1, n=4).resume(tmp_path / "run")
    assert np.array_equal(history.times, TIMES)
    for ours, expected in zip(history.results, whole.results, strict=True):
        # The same arithmetic from the same state, but for the extrapolated start.
        assert np.abs(ours.u - expected.u).max() < 1e-12 * np.abs(expected.u).max()


def test_interrupted_while_writing(tmp_path):
    """The archive is brought to its end, where Ctrl-C counts; the old file stays."""
    asked = []

    class Interrupting:
        def __array__(self, dtype=None, copy=None):
            asked.append(self)
            signal.raise_signal(signal.SIGINT)
            return np.ones(3)

    path = write_arrays(tmp_path / "step.npz", {"a": np.zeros(3)})
    with ctrl_c(60.0), pytest.raises(KeyboardInterrupt):
        write_arrays(path, {"a": Interrupting(), "b": Interrupting()})
    assert len(asked) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["step.npz"]
    with np.load(path) as found:
        assert not found["a"].any()
