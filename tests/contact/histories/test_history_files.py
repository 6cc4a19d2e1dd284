"""Every file of a history is of its run, or is refused: mixtures, kills, bit flips, two starts."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest

from contact import InputError, LoadHistory

TIMES = np.linspace(0.1, 0.8, 8)
# Processes of their own import the package for seconds and then fork: one import serves all.
SERVER = """
    import os, sys
    from pathlib import Path
    import numpy as np
    from skfem import MeshQuad
    from contact import ContactProblem, ElasticBody, InputError, LoadStepper
    from skfem_adini import ElementQuadAdini

    def dragged():
        mesh = MeshQuad().refined(1).with_defaults()
        body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=1.0, nu=0.3).fix("top")
        problem = ContactProblem(body, "bottom", 0.0, 0.3, solver="superlu")
        stepper = LoadStepper(problem).move("top", "y", -0.05, lambda t: min(1.0, 4 * t))
        return stepper.move("top", "x", 0.08, lambda t: np.sin(3 * t))

    TIMES = np.linspace(0.1, 0.8, 8)
    dragged().run(TIMES)  # compiles and loads what there is
    print("ready", flush=True)
    for line in sys.stdin:
        word, folder = line.split()
        child = os.fork()
        if child:
            print(child, flush=True)
            continue
        code = 0
        try:
            if word == "run":
                dragged().run(TIMES, path=folder)
            else:
                dragged().resume(folder)
        except InputError as error:
            code = 3
        finally:
            os._exit(code)
"""


def same(ours, theirs, tolerance=0.0):
    """Times and solutions of the shorter one."""
    n = min(len(ours), len(theirs))
    return np.array_equal(ours.times[:n], theirs.times[:n]) and all(
        np.abs(a.u - b.u).max() <= tolerance * np.abs(b.u).max()
        and np.array_equal(a.system.load, b.system.load)
        and np.array_equal(a.system.rows.weights, b.system.rows.weights)
        for a, b in zip(ours, theirs, strict=False)
    )


@pytest.fixture(scope="module")
def run(make, tmp_path_factory):
    """A folder with a whole run, not to be written to, and its history."""
    folder = tmp_path_factory.mktemp("history") / "run"
    return folder, make.dragged(n=2).run(TIMES, path=folder)


@pytest.fixture
def folder(run, tmp_path):
    return Path(shutil.copytree(run[0], tmp_path / "run"))


def test_a_history_is_a_sequence_and_is_read_again(run):
    history, loaded = run[1], LoadHistory.load(run[0])
    assert len(history) == len(loaded) == 8
    assert list(history) == list(history.results)
    assert history[-1] is history.results[-1]
    assert len(history[2:5]) == 3
    assert np.array_equal(history[2:5].times, TIMES[2:5])
    with pytest.raises(IndexError):
        history[8]
    assert loaded.damage is None
    assert same(loaded, history)


def step(folder, k):
    return folder / f"step_{k:05d}.npz"


def of_another_run(folder, make, E=1.0):
    other = folder.with_name("other")
    make.dragged(n=2, E=E).run(TIMES, path=other)
    shutil.copy(step(other, 3) if E == 1.0 else other / "problem.npz", folder)


def of_another_place(folder, make):
    shutil.copy(step(folder, 4), step(folder, 3))


def exchanged(folder, make):
    step(folder, 3).rename(folder / "between")
    step(folder, 4).rename(step(folder, 3))
    (folder / "between").rename(step(folder, 4))


def of_a_single_result(folder, make):
    LoadHistory.load(folder)[2].save(step(folder, 3))


def changed(folder, make):
    with np.load(step(folder, 3)) as archive:
        arrays = dict(archive)
    np.savez(step(folder, 3), **(arrays | {"u": 1.5 * arrays["u"]}))


def other_times(folder, make):
    name = folder / "history.json"
    name.write_text(name.read_text().replace("0.1", "0.2", 1))


def first_format(folder, make):
    name = folder / "history.json"
    about = json.loads(name.read_text())
    name.write_text(json.dumps({"format": 1, "times": about["times"], "fingerprint": "0"}))


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("mix", "word"),
    [
        (of_another_run, "step_00003.*run is"),
        (lambda folder, make: of_another_run(folder, make, E=2.0), "problem"),
        (of_another_place, "number is 4"),
        (exchanged, "number is 4"),
        (of_a_single_result, "no step"),
        (changed, "changed"),
        (other_times, "no load history.*changed"),
        (first_format, r"format 1, of version 0\.1\.0"),
    ],
)
def test_mixtures_are_refused(mix, word, folder, make):
    """By `load` and, but for the problem, which the stepper knows, by `resume`; nothing is lost."""
    mix(folder, make)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match=word):
        LoadHistory.load(folder)
    with pytest.raises(InputError, match=word):
        make.dragged(n=2).resume(folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("truncated", [False, True])
def test_a_step_that_is_lost(truncated, folder, run, make, caplog):
    """The steps after it are not taken for what they would be, and are kept when it is solved."""
    (folder / ("tmp" + "0f" * 16)).write_bytes(b"half")  # a remnant
    content = step(folder, 3).read_bytes()
    step(folder, 3).unlink()
    if truncated:
        step(folder, 3).write_bytes(content[:200])
    loaded, seen = LoadHistory.load(folder), []
    assert len(loaded) == 2
    assert "step_00003" in str(loaded.damage)
    assert "step_00003" in caplog.text
    assert len(make.dragged(n=2).resume(folder, callback=seen.append)) == 8
    assert [line.number for line in seen] == [3, 4, 5, 6, 7, 8]
    assert len(list(folder.glob("aside_*_step_0000[4-8].npz"))) == 5
    assert not list(folder.glob("tmp*"))
    again = LoadHistory.load(folder)
    assert again.damage is None
    assert len(again) == 8
    assert same(again, run[1], 1e-12)


def test_problem_that_cannot_be_read(folder, run, make):
    content = (folder / "problem.npz").read_bytes()
    (folder / "problem.npz").write_bytes(content[:500])
    with pytest.raises(InputError, match="problem"):
        LoadHistory.load(folder)
    make.dragged(n=2).resume(folder)
    assert same(LoadHistory.load(folder), run[1])


def test_another_obstacle_in_time(make, tmp_path):
    """`resume` compares gaps and motions of each step too."""

    def sinking(depth):
        stepper = make.dragged(n=2)
        return stepper.obstacle(lambda t: 0.002 + depth * t)

    sinking(0.001).run(TIMES[:2], path=tmp_path / "run")
    with pytest.raises(InputError, match="another problem"):
        sinking(0.002).resume(tmp_path / "run")
    assert len(sinking(0.001).resume(tmp_path / "run")) == 2


def test_one_writer_at_a_time(make, tmp_path):
    refused = []

    def attempt(line):
        if line.number == 2:
            with pytest.raises(InputError, match="another process is writing"):
                make.dragged(n=2).resume(tmp_path / "run")
            refused.append(len(LoadHistory.load(tmp_path / "run")))

    make.dragged(n=2).run(TIMES, path=tmp_path / "run", callback=attempt)
    assert refused == [2]
    assert len(LoadHistory.load(tmp_path / "run")) == 8
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="not empty"):
        make.dragged(n=2).run(TIMES, path=tmp_path / "file")
    with pytest.raises(InputError, match="path=3"):
        LoadHistory.load(3)


class Processes:
    """Children of one process that has imported everything."""

    def __init__(self):
        self.server = subprocess.Popen(
            [sys.executable, "-c", dedent(SERVER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
        )
        assert self.server.stdout.readline() == "ready\n"

    def start(self, word, folder):
        print(word, folder, file=self.server.stdin, flush=True)
        return int(self.server.stdout.readline())

    def end(self, child):
        """Wait until a child has ended; it is the server's, so its state is read."""
        while Path(f"/proc/{child}/stat").exists():
            if Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z":
                return
            time.sleep(0.002)

    def close(self):
        self.server.stdin.close()
        self.server.wait()
        self.server.stdout.close()


@pytest.fixture(scope="module")
def processes():
    if not Path("/proc/self/stat").exists():
        pytest.skip("needs the process table of Linux")
    processes = Processes()
    yield processes
    processes.close()


@pytest.fixture(scope="module")
def whole(processes, tmp_path_factory):
    """The run of the server's problem, and the seconds that it takes."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    begin = time.perf_counter()
    processes.end(processes.start("run", folder))
    return LoadHistory.load(folder), time.perf_counter() - begin


@pytest.mark.parametrize(
    "kills",
    [pytest.param(12, marks=pytest.mark.turns(4)), pytest.param(200, marks=pytest.mark.slow)],
)
def test_kills(processes, whole, tmp_path, kills):
    history, seconds = whole
    rng = np.random.default_rng(7)
    folder, done, ended = tmp_path / "run0", 0, 0
    kept = 0
    while done < kills:
        started = (folder / "history.json").exists()
        if not started and folder.exists():
            # Killed before there was a history: what lies there are at most remnants.
            assert all(path.name.startswith("tmp") for path in folder.iterdir())
            shutil.rmtree(folder)
        child = processes.start("resume" if started else "run", folder)
        time.sleep(rng.uniform(0, 0.6 * seconds))
        os.kill(child, signal.SIGKILL)
        processes.end(child)
        done += 1
        if not (folder / "history.json").exists():
            continue
        loaded = LoadHistory.load(folder)
        assert loaded.damage is None
        assert same(loaded, history, 1e-12)
        assert len(loaded) >= kept  # nothing that was there is lost
        kept = len(loaded)
        if kept == len(history):
            processes.end(processes.start("resume", folder))
            assert not [path for path in folder.iterdir() if path.name.startswith("tmp")]
            assert not list(folder.glob("aside*"))
            ended += 1
            folder, kept = tmp_path / f"run{ended}", 0
    if not (folder / "history.json").exists():
        shutil.rmtree(folder, ignore_errors=True)
    # The last one may go on to its end.
    processes.end(processes.start("resume" if folder.exists() else "run", folder))
    assert same(LoadHistory.load(folder), history, 1e-12)
    assert len(LoadHistory.load(folder)) == len(history)


@pytest.mark.slow
def test_double_starts(processes, whole, tmp_path):
    """Of two processes that start on one folder one does the run and the other is refused."""
    history, _ = whole
    for n in range(60):
        folder = tmp_path / f"run{n}"
        children = [processes.start("run", folder) for _ in range(2)]
        for child in children:
            processes.end(child)
        loaded = LoadHistory.load(folder)
        assert loaded.damage is None
        assert len(loaded) == len(history)
        assert same(loaded, history)
        assert len(list(folder.iterdir())) == 2 + len(history)
