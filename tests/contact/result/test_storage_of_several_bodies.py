"""Results of several bodies come back from a file bit for bit, with bodies, names and pairs."""

import json

import numpy as np
import pytest
from pressed_pairs import PROBLEMS, pair

from contact import ContactResult, InputError, LoadHistory, LoadStepper
from contact.output.archive import read_arrays, write_arrays
from contact.result.stored_result import problem_arrays

FIELDS = ("u", "mu", "t", "x", "pressure", "shear", "gap", "status", "slip", "resultants", "part")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", PROBLEMS)
def test_round_trip(name, tmp_path):
    problem = PROBLEMS[name]()
    result = problem.solve()
    loaded = ContactResult.load(result.save(tmp_path / "result.npz"))
    for field in FIELDS:
        assert np.array_equal(getattr(loaded, field), getattr(result, field)), field
    assert loaded.kkt == result.kkt
    assert loaded.system.law == result.system.law
    for field in ("owner", "axes", "normals", "tangents", "gap", "functional"):
        assert np.array_equal(
            getattr(loaded.system.rows, field), getattr(result.system.rows, field)
        )
    bodies = problem.body.bodies
    assert len(loaded.solid.bodies) == len(bodies)
    for k, body in enumerate(bodies):
        ours, theirs = result[body], loaded[k]
        assert theirs.body.name == body.name
        assert np.array_equal(theirs.u, ours.u)
        assert np.array_equal(theirs.nodal_stress(), ours.nodal_stress())
        assert np.array_equal(theirs.von_mises(), ours.von_mises())
        assert np.array_equal(theirs.resultant, ours.resultant)
        assert np.array_equal(theirs.balance()["support"], ours.balance()["support"])
        assert set(theirs.body.mesh.boundaries) == set(body.mesh.boundaries)


def test_bodies_are_found_by_name_and_number(tmp_path):
    result = pair().solve()
    loaded = ContactResult.load(result.save(tmp_path / "result.npz"))
    assert np.array_equal(loaded["upper"].u, loaded[0].u)
    assert np.array_equal(loaded["lower"].u, loaded[1].u)
    assert loaded["lower"].u.size != loaded["upper"].u.size
    with pytest.raises(InputError, match=r"body: 'middle' is not one of 'upper', 'lower'"):
        loaded["middle"]
    with pytest.raises(InputError, match=r"2 bodies; choose one"):
        loaded.stress()


def test_name_of_one_body(tmp_path, make):
    problem, result = make.solved()
    problem.body.named("block")
    loaded = ContactResult.load(problem.solve().save(tmp_path / "named.npz"))
    assert np.array_equal(loaded["block"].u, result.u)


def test_file_of_one_body_is_as_before(make):
    """Format 3, read by earlier versions; checksums of load histories depend on every name."""
    _, result = make.solved()
    arrays = problem_arrays(result.system)
    about = json.loads(str(arrays["about"]))
    assert about["format"] == 3
    assert list(about) == [
        *("format", "mesh", "element", "plane", "dilatation"),
        *("functional", "boundaries", "subdomains"),
    ]
    rows = {name.split("/")[1] for name in arrays if name.startswith("rows/")}
    assert rows == {"G", "T", "weights", "x", "x_nominal", "normals", "tangents", "part"}


def test_several_bodies_have_a_format_of_their_own():
    """An earlier version, which knows formats 2 and 3, refuses the file."""
    about = json.loads(str(problem_arrays(pair().system)["about"]))
    assert about["format"] == 4
    assert [body["name"] for body in about["bodies"]] == ["upper", "lower"]


def swap_owner(arrays):
    arrays["rows/owner"] = 1 - arrays["rows/owner"]


def owner_that_is_none(arrays):
    arrays["rows/owner"] = arrays["rows/owner"] + 2


def turn_axes(arrays):
    arrays["rows/axes"] = arrays["rows/axes"][:, ::-1].copy()


def no_axes(arrays):
    del arrays["rows/axes"]


def shorter_axes(arrays):
    arrays["rows/axes"] = 0.9 * arrays["rows/axes"]


def no_mesh(arrays):
    del arrays["body/1/p"]


def other_load(arrays):
    arrays["load"] = 2 * arrays["load"]


def shorter_load(arrays):
    arrays["load"] = arrays["load"][:-1]


def other_material(arrays):
    arrays["body/1/E"] = 1.01 * arrays["body/1/E"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "change",
    [
        *(swap_owner, owner_that_is_none, turn_axes, no_axes, shorter_axes),
        *(no_mesh, other_load, shorter_load, other_material),
    ],
)
def test_contradictions_are_refused(change, tmp_path):
    """With a valid checksum: the problem itself shows that the arrays do not belong together."""
    path = pair().solve().save(tmp_path / "result.npz")
    arrays, _ = read_arrays(path)
    change(arrays)
    write_arrays(path, arrays)
    with pytest.raises(InputError, match=r"result file .*result\.npz"):
        ContactResult.load(path)


def test_edited_file_is_refused(tmp_path):
    path = pair().solve().save(tmp_path / "result.npz")
    arrays, checksum = read_arrays(path)
    arrays["rows/weights"] = 1.5 * arrays["rows/weights"]
    np.savez(path, checksum=np.array(checksum), **arrays)
    with pytest.raises(InputError, match="another checksum"):
        ContactResult.load(path)


def stepper():
    moved = LoadStepper(pair()).load("top", (0.05, 0.0), np.sin, body="upper")
    return moved.load("right", (-0.02, 0.0), body=1)


def test_history_in_a_folder(tmp_path):
    """Written, read, interrupted and resumed: every step is the same."""
    times = [0.5, 1.0, 1.5]
    history = stepper().run(times, path=tmp_path / "run")
    read = LoadHistory.load(tmp_path / "run")
    assert [r.kkt for r in read] == [r.kkt for r in history]
    assert np.array_equal(read[-1]["lower"].u, history[-1]["lower"].u)
    assert read[0].solid.bodies[1].basis is read[2].solid.bodies[1].basis
    (tmp_path / "run" / "step_00003.npz").unlink()
    resumed = stepper().resume(tmp_path / "run")
    # The start is one from the file: the same to rounding of the solution.
    assert np.abs(resumed[-1].u - history[-1].u).max() <= 1e-12 * np.abs(history[-1].u).max()


def test_history_of_other_bodies_is_refused(tmp_path):
    stepper().run([0.5], path=tmp_path / "run")
    other = LoadStepper(pair(E=2.5)).load("top", (0.05, 0.0), np.sin, body="upper")
    with pytest.raises(InputError, match="history of another problem"):
        other.load("right", (-0.02, 0.0), body=1).resume(tmp_path / "run")


def test_heat_of_one_of_two_bodies(tmp_path):
    """Stresses are those of the body's own thermal strain; the other body has none."""
    problem = pair()
    problem.body.bodies[1].heat(3e-3, 10.0)
    result = problem.solve()
    loaded = ContactResult.load(result.save(tmp_path / "warm.npz"))
    assert loaded[0].body.thermal is None
    assert np.array_equal(loaded[1].body.thermal, result[1].body.thermal)
    assert np.array_equal(loaded["lower"].stress(), result["lower"].stress())
    assert np.abs(result["lower"].stress() - pair().solve()["lower"].stress()).max() > 1e-3
