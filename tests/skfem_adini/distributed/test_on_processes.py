"""On one, two and three processes everything is as on one; what fails ends, with a reason."""

import sys
from pathlib import Path
from typing import Any

import pytest
import pyvista

from skfem_adini import AdiniError, MissingDependency
from skfem_adini.distributed import communicator, world
from tests.mpi_runs import run, start

HERE = "tests.skfem_adini.distributed"


@pytest.fixture(scope="module", params=(1, 2, 3))
def parity(request: pytest.FixtureRequest) -> Any:
    """What `parity.py` found."""
    return run(f"{HERE}.parity", request.param)


@pytest.mark.mpi
@pytest.mark.sampled(3)
def test_matrices_are_the_serial_ones(parity: Any) -> None:
    assert len(parity["matrices"]) == 16
    for name, (entries, product) in parity["matrices"].items():
        assert entries <= 1e-13, name
        assert product <= 1e-13, name


@pytest.mark.mpi
@pytest.mark.sampled(3)
def test_solutions_are_the_serial_ones(parity: Any) -> None:
    assert len(parity["solutions"]) == 12
    for name, (error, iterations) in parity["solutions"].items():
        assert error <= (1e-11 if "mumps" in name else 1e-8), name
        # Systems of elasticity by BoomerAMG, which sees them as scalar, need more.
        assert iterations <= (150 if "hypre" in name else 40), name


@pytest.mark.mpi
@pytest.mark.sampled(3)
def test_eigenvalues_are_scipys(parity: Any) -> None:
    found = parity["eigenvalues"]
    assert found["values"] <= 1e-10
    assert found["norms"] <= 1e-10
    assert found["residual"] <= 1e-9


@pytest.mark.mpi
@pytest.mark.sampled(3)
def test_the_schur_complement_is_the_dense_one(parity: Any) -> None:
    assert all(error <= 1e-12 for error in parity["complement"].values()), parity["complement"]


@pytest.mark.mpi
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("raises", "this process has had enough"),
        ("is killed", "signal 9"),
        ("cannot write", "could not write its part"),
        ("is singular", "essential conditions"),
    ],
)
def test_a_process_that_fails_ends_all(what: str, words: str, tmp_path: Path) -> None:
    done = start(f"{HERE}.misfortune", 3, what, str(tmp_path / "u.pvtu"), timeout=60.0)
    assert done.returncode != 0
    assert words in done.stderr + done.stdout
    assert not (tmp_path / "u.pvtu").exists()
    assert "all went well" not in done.stdout


@pytest.mark.mpi
def test_pvtu_holds_every_cell_once(tmp_path: Path) -> None:
    done = start(f"{HERE}.misfortune", 3, "nothing", str(tmp_path / "u.pvtu"))
    assert done.returncode == 0, done.stderr
    grid = pyvista.read(tmp_path / "u.pvtu")
    assert grid.n_cells == 64
    assert abs(grid.compute_cell_sizes()["Area"].sum() - 1) < 1e-12
    assert (grid["u"] == 1.0).all()


def test_launcher_of_another_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mpi4py")
    monkeypatch.setenv("PMI_SIZE", "3")
    with pytest.raises(AdiniError, match="the launcher has started 3 processes"):
        world()


def test_processes_without_mpi4py_are_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    assert world().size == 1
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    with pytest.raises(MissingDependency, match="pip install mpi4py"):
        world()


def test_missing_petsc_names_the_three_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    with pytest.raises(MissingDependency) as raised:
        communicator.petsc(communicator.Alone())
    assert all(way in str(raised.value) for way in ("apt install", "conda install", "pip install"))
