"""Files of states and runs: the same bits again, damage named, a run that was killed goes on."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import cache
from importlib.util import find_spec
from textwrap import dedent

import numpy as np
import pytest
from schemes import FAMILIES, field_of, solver_of

from cip import Grid, InputError, MissingDependency, Solver, State, Trajectory, Velocity

GRID = Grid([(0, 1)] * 2, (14, 12), periodic=(True, False))
WIND = ("1 + 0.5*sin(2*pi*x2 + 9*t)", "0.3*sin(2*pi*x1 + 7*t) + 0.2")
RULES = {"boundary": {"smoke": 1.0, "dust": "0.5 + sin(t)"}, "decay": {"dust": 0.4}}
FIELDS = {"smoke": "1 + x2", "dust": "exp(-20*(x2 - 0.5)**2)"}
ENDINGS = [
    ".npz",
    *[pytest.param(".nc", marks=pytest.mark.skipif(not find_spec("xarray"), reason="no xarray"))],
    *[pytest.param(".zarr", marks=pytest.mark.skipif(not find_spec("zarr"), reason="no zarr"))],
]


def tracers(**more):
    return Solver(GRID, Velocity.from_expression(*WIND), **(RULES | more))


def ran(solver=None, fields=FIELDS, **more):
    solver = solver or tracers()
    kinds = {"dt": 0.023, "snapshots": 6, "gauges": [[0.2, 0.5], [0.3, 0.4]]} | more
    return solver.run(solver.state(fields), kinds.pop("t_end", 1.0), **kinds)


@cache
def whole():
    return ran()


def check_same(one, other):
    assert len(one) == len(other)
    for a, b in zip(one.states, other.states, strict=True):
        assert a.t == b.t
        np.testing.assert_array_equal(a.data, b.data)
    for name in one.final.fields:
        np.testing.assert_array_equal(one.gauges.values[name], other.gauges.values[name])
    np.testing.assert_array_equal(one.gauges.t, other.gauges.t)


@pytest.mark.parametrize("ending", ENDINGS)
def test_files_give_the_same_bits(tmp_path, ending):
    run = whole()
    (path,) = run.save(tmp_path / f"run{ending}")
    again = Trajectory.load(path, run.solver)
    check_same(again, run)
    assert (again.dt, again.interrupted, again.solver) == (run.dt, False, run.solver)
    assert Trajectory.load(path).solver.form == "transport"
    state = State.load(run[2].save(tmp_path / f"state{ending}"))
    assert (state.t, state.fields) == (run[2].t, run[2].fields)
    np.testing.assert_array_equal(state.data, run[2].data)
    np.testing.assert_array_equal(State.load(path).data, run.final.data)
    assert not [file for file in tmp_path.iterdir() if file.name.startswith("tmp")]


SCHEMES = [scheme for family in FAMILIES.values() for scheme in family]


@pytest.mark.sampled(6)
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: "-".join(scheme))
@pytest.mark.parametrize("store", [None, False])
def test_a_loaded_state_goes_on_as_the_run_did(tmp_path, scheme, store):
    """In another solver, which has not seen the first steps."""

    def solver():
        made = solver_of(*scheme)
        return Solver(*made._arguments(made._boundary)[:11], store_feet=store, source=made.source,
                      decay=made.decay)  # fmt: skip

    first = solver()
    times = [0.15, 0.4]
    run = first.run(first.state(field_of(first.grid)), 0.4, dt=0.023, snapshots=times)
    middle = State.load(run[1].save(tmp_path / "state.npz"))
    rest = solver().run(middle, 0.4, dt=0.023)
    np.testing.assert_array_equal(rest.final.data, run.final.data)
    again = first.run(run[1], 0.4, dt=0.023)
    np.testing.assert_array_equal(again.final.data, run.final.data)


def test_the_memory_of_sub_steps_is_that_of_the_same_solver_only():
    run = whole()
    assert run[2]._memory[2]  # there are counts, which another velocity must not take over
    calm = Solver(GRID, [0.5, 0.2], **RULES)
    fresh = State(GRID, "bicubic", run[2].data, run[2].t, run[2].fields)
    one, other = (calm.run(state, 1.0, dt=0.1).final.data for state in (run[2], fresh))
    np.testing.assert_array_equal(one, other)


def test_a_run_in_a_folder(tmp_path):
    folder = tmp_path / "run"
    check_same(ran(save=folder), whole())
    check_same(Trajectory.load(folder), whole())
    assert len(list(folder.iterdir())) == 8
    for k in (6, 5):
        (folder / f"snapshot_0000{k}.npz").unlink()
    assert Trajectory.load(folder).interrupted
    calls = []
    check_same(ran(save=folder, resume=True, callback=lambda s: calls.append(s.t)), whole())
    assert calls[0] > whole().times[4]
    check_same(ran(save=folder, resume=True), whole())
    check_same(ran(save=tmp_path / "new", resume=True), whole())


def test_csl4_with_bounds_goes_on(tmp_path):
    """A state whose limiter let it leave the bounds is accepted again."""
    grid = Grid([(0, 1)] * 2, (12, 12), periodic=True)
    wind = Velocity.from_expression("sin(2*pi*x1)*cos(3*t)", "0.5")

    def solver():
        return Solver(grid, wind, "advection", "csl4", "bounds", "strang", bounds={"a": (0, 1)})

    kinds = {"t_end": 0.3, "dt": 0.05, "snapshots": 3, "gauges": None}
    fields = {"a": "0.5 + 0.5*sin(2*pi*x2)", "b": "x1 - x1"}
    run = ran(solver(), fields, save=tmp_path / "run", **kinds)
    assert run.final["a"].max() > 1 + 1e-3
    (tmp_path / "run" / "snapshot_00003.npz").unlink()
    again = ran(solver(), fields, save=tmp_path / "run", resume=True, **kinds)
    np.testing.assert_array_equal(again.final.data, run.final.data)


OTHERS = {
    "grid": lambda: {"solver": Solver(Grid([(0, 1), (0, 1.1)], (14, 12), (True, False)),
                                      Velocity.from_expression(*WIND), **RULES)},
    "profile": lambda: {"solver": tracers(profile="adini")},
    "velocity": lambda: {"solver": Solver(GRID, Velocity.from_expression("1.5", WIND[1]), **RULES)},
    "decay": lambda: {"solver": tracers(decay={"dust": 0.5})},
    "diffusion": lambda: {"solver": tracers(diffusion=0.1)},
    "reactions": lambda: {"solver": tracers(reactions={"smoke": "-smoke*dust"})},
    "boundary": lambda: {"solver": tracers(boundary={"smoke": 1.0, "dust": 0.5})},
    "dt": lambda: {"dt": 0.024},
    "times": lambda: {"t_end": 1.5},
    "gauges": lambda: {"gauges": None},
    "fields": lambda: {"fields": FIELDS | {"ash": 0.0}},
    "state": lambda: {"fields": FIELDS | {"smoke": "1 + 2*x2"}},
}  # fmt: skip


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished") / "run"
    ran(save=folder)
    return folder


@pytest.mark.parametrize("other", OTHERS)
def test_another_run_is_refused(finished, other):
    with pytest.raises(InputError, match=f"resume: the run in .* another {other}"):
        ran(save=finished, resume=True, **OTHERS[other]())


def test_folders_that_are_taken(finished, tmp_path):
    with pytest.raises(InputError, match="resume=True"):
        ran(save=finished)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="holds other files"):
        ran(save=tmp_path, resume=True)
    with pytest.raises(InputError, match="is a file"):
        ran(save=tmp_path / "notes.txt")
    with pytest.raises(InputError, match="pass save="):
        ran(resume=True)
    with pytest.raises(InputError, match="expected the name of a folder"):
        ran(save=3)


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 255
    path.write_bytes(data)


DAMAGE = {
    "flip": flip,
    "cut": lambda path: path.write_bytes(path.read_bytes()[:1000]),
    "empty": lambda path: path.write_bytes(b""),
    "foreign": lambda path: np.savez(path, a=np.ones(3)),
    "text": lambda path: path.write_text("no archive"),
    "gone": lambda path: path.unlink(),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_named(tmp_path, damage):
    folder = tmp_path / "run"
    ran(save=folder, snapshots=2)
    DAMAGE[damage](folder / "snapshot_00001.npz")
    for call in (
        lambda: ran(save=folder, snapshots=2, resume=True),
        lambda: Trajectory.load(folder),
    ):
        with pytest.raises(
            InputError, match=r"snapshot_00001\.npz.* remove (it|the snapshots after)"
        ):
            call()
    with pytest.raises(InputError, match=r"snapshot_00001\.npz"):
        State.load(folder / "snapshot_00001.npz")


def test_a_damaged_head_and_files_of_others(tmp_path):
    folder = tmp_path / "run"
    ran(save=folder, snapshots=1)
    head = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(head | {"dt": 0.5}))
    with pytest.raises(InputError, match=r"run\.json is damaged"):
        ran(save=folder, snapshots=1, resume=True)
    state = whole().final.save(tmp_path / "state.npz")
    with pytest.raises(InputError, match=r"State\.load"):
        Trajectory.load(state)
    with pytest.raises(InputError, match="form is 'advection'"):
        Trajectory.load(whole().save(tmp_path / "a.npz")[0], tracers(form="advection"))
    for name in ("state.h5", 3):
        with pytest.raises(InputError, match="path"):
            whole().final.save(tmp_path / name if name != 3 else 3)
    with pytest.raises(InputError, match="does not exist"):
        State.load(tmp_path / "none.npz")


def test_what_is_missing_is_named(tmp_path, monkeypatch):
    pytest.importorskip("xarray")
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(MissingDependency, match="pip install zarr"):
        whole().save(tmp_path / "run.zarr")
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(MissingDependency, match="skfem-adini"):
        whole().save(tmp_path / "run.nc")
    assert not list(tmp_path.iterdir())


# Forks a child for each folder that it reads: that needs no new interpreter.
SERVER = """
    import os, sys
    sys.path[:0] = sys.argv[1:]
    import test_restart
    solver = test_restart.tracers()
    test_restart.ran(solver, snapshots=1, t_end=0.05)  # compiles
    print("ready", flush=True)
    while folder := sys.stdin.readline():
        child = os.fork()
        if child == 0:
            test_restart.ran(solver, save=folder.strip(), resume=True, dt=0.0023, snapshots=40)
            os._exit(0)
        print(child, flush=True)
        sys.stdin.readline()  # until then its number is not given to another process
        os.waitpid(child, 0)
        print("ended", flush=True)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_kills_at_random_moments(tmp_path, kills):
    whole = ran(dt=0.0023, snapshots=40)
    here = os.path.dirname(__file__)
    server = subprocess.Popen(
        [sys.executable, "-c", dedent(SERVER), here, os.path.dirname(here)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert server.stdout.readline() == "ready\n"

        def start(folder, seconds=None):
            print(folder, file=server.stdin, flush=True)
            child = int(server.stdout.readline())
            if seconds is not None:
                time.sleep(seconds)
                os.kill(child, signal.SIGKILL)
            print("wait", file=server.stdin, flush=True)
            assert server.stdout.readline() == "ended\n"

        begin = time.perf_counter()
        start(tmp_path / "measured")
        seconds = time.perf_counter() - begin
        rng, done, folder = np.random.default_rng(11), 0, tmp_path / "run0"
        partial = []
        while done < kills:
            start(folder, rng.uniform(0.0, 0.5 * seconds))
            done += 1
            partial.append(len(list(folder.glob("snapshot_*"))))
            if len(list(folder.glob("snapshot_*"))) == 41:
                check_same(Trajectory.load(folder), whole)
                folder = tmp_path / f"run{done}"
        start(folder)
        check_same(Trajectory.load(folder), whole)
        assert any(0 < count < 41 for count in partial)
        assert not [file for file in folder.iterdir() if file.name.startswith("tmp")]
    finally:
        server.stdin.close()
        server.wait()
        server.stdout.close()
