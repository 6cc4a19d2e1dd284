"""Load histories of bodies on many processes: those of one, stored and resumed by any number."""

from pathlib import Path
from typing import Any

import pytest

from contact import InputError, LoadHistory
from tests.contact.histories.spread_history import TIMES, differences, dragged, stepper
from tests.mpi_runs import run


def _right(found: dict[str, Any]) -> None:
    assert set(found) == {"2 mumps", "2 krylov", "3 mumps", "3 krylov"}
    for name, off in found.items():
        limit = 1e-11 if "mumps" in name else 1e-9
        for what in ("mu", "t", "u"):
            assert off[what] <= limit, (name, what)
        assert off["kkt"] <= 1e-9, name


@pytest.mark.mpi
def test_a_history_is_resumed_on_other_numbers_of_processes(tmp_path: Path) -> None:
    _right(run("tests.contact.histories.spread_history", 3, "begin", str(tmp_path)))
    for size, finished in ((2, 3), (1, 5)):
        for folder in tmp_path.iterdir():
            # The parts of the next step are there, but not its index: it is not finished.
            for step in range(finished + 1, TIMES.size + 1):
                folder.joinpath(f"step_{step:05d}.npz").unlink()
        _right(run("tests.contact.histories.spread_history", size, "resume", str(tmp_path)))


@pytest.mark.mpi
@pytest.mark.parametrize("size", [2, 3])
def test_moved_tools(size: int, tmp_path: Path) -> None:
    _right(run("tests.contact.histories.spread_history", size, "moved", str(tmp_path)))


def test_moved_tools_on_one_process() -> None:
    ours, theirs = dragged(2, "mumps"), dragged(2, None)
    found = differences(ours.run(TIMES), theirs.run(TIMES), ours.problem.body)
    assert max(found[what] for what in ("mu", "t", "u")) <= 1e-11
    assert found["kkt"] <= 1e-9
    last = ours.history[-1]
    assert abs(last.resultant[0]) > 0.02 * abs(last.resultant[1])  # friction knows the way


def test_one_process_stores_and_resumes(tmp_path: Path) -> None:
    path = tmp_path / "run"
    history = stepper(2, "mumps").run(TIMES[:4], path=path)
    (path / "step_00003.npz").unlink()
    (path / "step_00004.npz").unlink()
    again = stepper(2, "mumps").resume(path)
    assert len(again) == 4
    for one, other in zip(history, again, strict=True):
        assert abs(one.mu - other.mu).max() <= 1e-12 * one.mu.max()
        assert abs(one.u - other.u).max() <= 1e-12 * abs(one.u).max()


def test_another_problem_or_a_lost_part_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run"
    stepper(2, "mumps").run(TIMES[:2], path=path)
    with pytest.raises(InputError, match="another problem"):
        stepper(3, "mumps").resume(path)
    other = stepper(2, "mumps")
    other.load("left", (0.01, 0.0))
    with pytest.raises(InputError, match="another problem"):
        other.resume(path)
    with pytest.raises(InputError, match=r"LoadStepper\.resume"):
        LoadHistory.load(path)
    with pytest.raises(InputError, match="not empty"):
        stepper(2, "mumps").run(TIMES[:2], path=path)
    (path / "step_00001_0.npz").unlink()
    with pytest.raises(InputError, match="does not exist"):
        stepper(2, "mumps").resume(path)
