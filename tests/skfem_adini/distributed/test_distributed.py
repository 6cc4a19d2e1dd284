"""Several processes give what one gives; what fails ends, with a reason."""

import sys
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
import skfem
from scipy import linalg
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass, unit_load

from skfem_adini import AdiniError, ElementQuadAdini, InputError, MissingDependency, near_null_space
from skfem_adini.distributed import (
    DistributedBasis,
    DistributedMatrix,
    DistributedSolver,
    TensorGrid,
    communicator,
    lowest_eigenpairs,
    partition,
    smooth_modes,
    world,
)
from tests.mpi_runs import run, start
from tests.skfem_adini.distributed.spaces import spaces
from tests.skfem_adini.distributed.threads_as_processes import on_threads

SPACES = list(spaces())
SIZES = (1, 2, 3, 5)


@pytest.mark.sampled(7)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("name", "mesh", "element", "form"), SPACES, ids=[s[0] for s in SPACES])
def test_matrices_products_and_loads_are_the_serial_ones(
    name: str, mesh: Any, element: Any, form: Any, size: int
) -> None:
    def task(comm: Any) -> Any:
        space = DistributedBasis(mesh, element, comm)
        K = space.assemble(form)
        x = space.extended(np.cos(space.numbers[space.owned].astype(float)))
        assert np.array_equal(space.numbers[space.owned], space.first + np.arange(space.owned.size))
        owned = space.first, space.owned.size, space.N
        return owned, K.gather(), space.gather(x), space.gather(K @ x), space.gather(K.diagonal())

    results = on_threads(size, task)
    # Every dof has one owner, and numbers are consecutive.
    firsts, counts, total = np.transpose([owned for owned, *_ in results])
    assert np.cumsum([0, *counts]).tolist() == [*firsts, total[0]]
    _, K, x, y, diagonal = results[0]
    exact = form.assemble(skfem.Basis(mesh, deepcopy(element)))
    largest = abs(exact).max()
    assert abs(K - exact).max() <= 1e-13 * largest
    assert np.abs(y - exact @ x).max() <= 1e-13 * largest * np.abs(x).max()
    assert np.abs(diagonal - exact.diagonal()).max() <= 1e-13 * largest


@pytest.mark.sampled(2)
@pytest.mark.parametrize("size", [1, 3])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_mesh_its_maker_and_a_grid_give_one_space(size: int, dim: int) -> None:
    grid = TensorGrid(*[np.linspace(0, 1, n) ** 1.3 for n in (6, 5, 8)[:dim]])
    whole = grid.mesh()
    element = skfem.ElementVector(skfem.ElementQuad2() if dim == 2 else skfem.ElementHex1())
    form, side = linear_elasticity(1.0, 1.0), "top"

    def task(comm: Any) -> Any:
        found = []
        for mesh in (whole, lambda: whole, grid):
            space = DistributedBasis(mesh, element, comm)
            mask = np.zeros(space.basis.N)
            mask[space.boundary_dofs("left", "top")] = 1.0
            strip, cells = space.strip([side])
            found.append((space.assemble(form).gather(), space.gather(mask), strip, cells))
        return found

    results = on_threads(size, task)
    serial = skfem.Basis(whole, element)
    exact, fixed = form.assemble(serial), serial.get_dofs(["left", "top"]).flatten()
    for K, mask, strip, cells in results[0]:
        assert abs(K - exact).max() <= 1e-13 * abs(exact).max()
        assert np.array_equal(np.flatnonzero(mask), np.sort(fixed))
        assert np.allclose(strip.p[:, strip.t].mean(axis=1), whole.p[:, whole.t[:, cells]].mean(1))
        assert strip.boundaries[side].size == whole.boundaries[side].size
    assert {tuple(cells) for r in results for *_, cells in r} == {tuple(results[0][0][3])}


@pytest.mark.parametrize("mesh", [m for _, m, *_ in SPACES[::5]])
@pytest.mark.parametrize("size", [1, 2, 7])
def test_parts_are_balanced_and_none_is_empty(mesh: Any, size: int) -> None:
    counts = np.bincount(partition(mesh, size), minlength=size)
    assert counts.sum() == mesh.t.shape[1]
    assert counts.min() > 0
    assert counts.max() <= 1.5 * counts.mean() + 2


def test_strips_take_the_place_of_metis(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pymetis", None)
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, 3, 13), np.linspace(0, 1, 5))
    part = partition(mesh, 3)
    middle = mesh.p[0, mesh.t].mean(axis=0)
    assert [set(np.round(middle[part == k] / 1.0 - 0.5)) for k in range(3)] == [{0}, {1}, {2}]


@pytest.mark.parametrize("size", [1, 3])
def test_smooth_modes_are_without_energy(size: int) -> None:
    mesh = skfem.MeshQuad().refined(2)

    def task(comm: Any) -> Any:
        vector = DistributedBasis(mesh, skfem.ElementVector(ElementQuadAdini()), comm)
        scalar = DistributedBasis(mesh, skfem.ElementQuad2(), comm)
        K, L = vector.assemble(linear_elasticity(1.0, 1.0)), scalar.assemble(laplace)
        modes = smooth_modes(vector)
        gathered = np.array([vector.gather(m) for m in modes.T]) if comm.size else None
        return (np.abs(K.rows @ modes).max(), np.abs(L.rows @ smooth_modes(scalar)).max(), gathered)

    for elastic, harmonic, _ in (found := on_threads(size, task)):
        assert elastic <= 1e-12
        assert harmonic <= 1e-12
    theirs = near_null_space(skfem.Basis(mesh, skfem.ElementVector(ElementQuadAdini()))).modes
    # They span the same space as the modes of multigrid on one process.
    assert np.linalg.matrix_rank(np.hstack((found[0][2].T, theirs)), tol=1e-9) == 3


def test_one_process_without_petsc_solves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "petsc4py", None)
    mesh = skfem.MeshQuad().refined(3).with_defaults()
    space = DistributedBasis(mesh, ElementQuadAdini())
    fixed = space.boundary_dofs("left")
    solver = DistributedSolver(space.assemble(laplace), fixed)
    assert solver.method == "factorize"
    given = np.where(np.isin(np.arange(space.N), fixed), 0.5, 0.0)
    x = solver.solve(space.assemble(unit_load), given)
    basis = skfem.Basis(mesh, ElementQuadAdini())
    K, f = laplace.assemble(basis), unit_load.assemble(basis)
    exact = skfem.solve(*skfem.condense(K, f, x=given, D=basis.get_dofs("left")))
    assert np.abs(x - exact).max() <= 1e-11 * np.abs(exact).max()
    values, vectors = lowest_eigenpairs(
        space.assemble(laplace), space.assemble(mass), 3, fixed, shift=-1.0
    )
    free = np.setdiff1d(np.arange(basis.N), basis.get_dofs("left"))
    A, B = (form.assemble(basis)[free][:, free].toarray() for form in (laplace, mass))
    assert np.abs(values / linalg.eigh(A, B, eigvals_only=True)[:3] - 1).max() <= 1e-11
    assert np.abs(vectors[fixed]).max() == 0.0


def test_more_processes_than_cells_are_named_on_all_of_them() -> None:
    for mesh in (skfem.MeshQuad(), lambda: skfem.MeshQuad()):
        with pytest.raises(InputError, match="2 processes are more than the 1 cells"):
            on_threads(2, lambda comm, m=mesh: DistributedBasis(m, skfem.ElementQuad1(), comm))
    with pytest.raises(InputError, match="ticks: 2 processes"):
        on_threads(2, lambda comm: DistributedBasis(TensorGrid([0, 1], [0, 1]), None, comm))


def test_bad_input_is_named() -> None:
    space = DistributedBasis(skfem.MeshQuad().refined(1).with_defaults(), skfem.ElementQuad1())
    K, triangles = space.assemble(laplace), skfem.MeshTri().refined(1)
    cases: list[tuple[str, Any]] = [
        ("mesh: expected a mesh", lambda: DistributedBasis(None, skfem.ElementQuad1())),
        ("ElementTriMorley", lambda: DistributedBasis(triangles, skfem.ElementTriMorley())),
        ("ElementTriArgyris", lambda: DistributedBasis(triangles, skfem.ElementTriArgyris())),
        ("names: no boundary 'roof'", lambda: space.boundary_dofs("roof")),
        ("contact: no facets called 'roof'", lambda: space.strip(["roof"])),
        ("rows: expected shape", lambda: DistributedMatrix(space, K.rows[:2])),
        ("solver='lu'", lambda: DistributedSolver(K, solver="lu")),  # type: ignore[arg-type]
        ("ticks: expected", lambda: TensorGrid([0.0, 1.0])),
        ("ascending", lambda: TensorGrid([0.0, 1.0], [1.0, 0.0])),
        ("ticks=.*masked", lambda: TensorGrid([0.0, 1.0], [0.0, np.ma.masked])),
        *(("parts", lambda n=n: partition(space.mesh, n)) for n in (0, 1.5, True, 99)),
    ]
    for words, call in cases:
        with pytest.raises(InputError, match=words):
            call()


# Under mpiexec, and where something is missing.


HERE = "tests.skfem_adini.distributed"


@pytest.mark.mpi
@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [1, 2, 3])
def test_all_is_as_on_one_process(size: int) -> None:
    """Matrices, solutions, eigenvalues and Schur complements that `parity.py` compares."""
    parity = run(f"{HERE}.parity", size)
    assert len(parity["matrices"]) == 16
    for name, (entries, product) in parity["matrices"].items():
        assert max(entries, product) <= 1e-13, name
    assert len(parity["solutions"]) == 12
    for name, (error, iterations) in parity["solutions"].items():
        assert error <= (1e-11 if "mumps" in name else 1e-8), name
        # Systems of elasticity by BoomerAMG, which sees them as scalar, need more.
        assert iterations <= (150 if "hypre" in name else 40), name
    found = parity["eigenvalues"]
    assert max(found["values"], found["norms"]) <= 1e-10
    assert found["residual"] <= 1e-9
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
