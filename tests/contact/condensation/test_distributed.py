"""A body on several processes has the contact that it has on one, condensed or not."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
import skfem
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from contact import ContactProblem, DistributedBody, ElasticBody, InputError, Plane, save_pvtu
from contact.condensation import primal
from contact.condensation.primal import rows_as_unknowns
from tests.contact.condensation.spread_cases import PAIRS, cases
from tests.mpi_runs import run

PARITY = "tests.contact.condensation.spread_parity"


def close(off: Any, name: str, tol: float) -> None:
    for what in {"mu", "t", "u", "inside", "stress", "resultant"} & set(off):
        assert off[what] <= tol, (name, what)
    assert off["kkt"] <= 1e-9, name
    assert off["agreed"], name


@pytest.mark.mpi
@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [1, 2, 3])
def test_contact_is_that_of_one_process(size: int) -> None:
    found: Any = run(PARITY, size, "mumps")
    assert set(found) == {name for name, _ in cases()} | set(PAIRS)
    for name, off in found.items():
        close(off, name, 1e-10)
        steps, serial = off["steps"]
        assert steps == serial, name


@pytest.mark.mpi
@pytest.mark.turns(2)
def test_contact_without_condensation_is_that_of_one_process_with_it() -> None:
    found = [run(PARITY, size, "krylov") for size in (1, 2, 3)]
    for name, _ in cases():
        for one in found:
            close(one[name], name, 1e-9)
        # It starts from sticking contact, not from contact without friction: the steps are its own.
        assert len({one[name]["steps"][0] for one in found}) == 1, name


@pytest.mark.sampled(3)
@pytest.mark.parametrize("solver", ["auto", "superlu"])
@pytest.mark.parametrize(("name", "case"), list(cases()))
def test_one_process_needs_no_petsc(
    name: str, case: Any, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    bodies = (
        DistributedBody(case.mesh, case.element, contact=case.boundary, **case.material),
        ElasticBody.from_mesh(case.mesh, case.element, **case.material),
    )
    more = {"friction": case.friction, "solver": solver}
    found, exact = (
        ContactProblem(case.hold(body), case.boundary, case.obstacle, **more).solve()
        for body in bodies
    )
    assert abs(found.mu - exact.mu).max() <= 1e-11 * exact.mu.max()
    assert abs(bodies[0].gather(found.u) - exact.u).max() <= 1e-11 * abs(exact.u).max()
    middle = case.mesh.p.mean(axis=1)[:, None] + 0.013  # inside a cell
    stress = exact.stress(middle)
    assert abs(found.stress(middle) - stress).max() <= 1e-10 * abs(stress).max()


def test_files_hold_what_the_grid_of_one_process_holds_and_the_rest_is_refused(
    tmp_path: Path,
) -> None:
    case = dict(cases())["circle"]
    body = case.hold(DistributedBody(case.mesh, case.element, contact="bottom", **case.material))
    result = ContactProblem(body, "bottom", case.obstacle, friction=0.3).solve()
    serial = case.hold(ElasticBody.from_mesh(case.mesh, case.element, **case.material))
    other = ContactProblem(serial, "bottom", case.obstacle, friction=0.3).solve()
    found, exact = pyvista.read(save_pvtu(tmp_path / "block.pvtu", result)), other.to_pyvista()
    assert set(found.array_names) == set(exact.array_names)
    for name in exact.array_names:
        size = np.abs(exact[name]).max()
        assert np.abs(found[name] - exact[name]).max() <= 1e-10 * size, name
    before = list(tmp_path.iterdir())
    flat = ContactProblem(body, "bottom", 0.0)
    for call, message in (
        (result.stress, r"result.stress\(points\)"),
        (result.nodal_stress, r"result.stress\(points\)"),
        (result.to_pyvista, r"result.stress\(points\)"),
        (lambda: body.basis, r"result.stress\(points\)"),
        (lambda: result.save(tmp_path / "result.npz"), "is not in one file"),
        (lambda: body.load(np.array([0, 1]), (0.0, 1.0)), "takes names of boundaries"),
        (lambda: ContactProblem(body, "top", 0.0), "offers"),
        (lambda: body.fix("roof"), "no facets called 'roof'"),
        (lambda: ContactProblem(body, "bottom", 0.0, solver="umfpack").condense(), "'pardiso'"),
        (lambda: flat.condense("cuda"), "on the 'cpu'"),
        (lambda: save_pvtu(tmp_path / "block.vtu", result), "ending in"),
        (lambda: save_pvtu(tmp_path / "block.pvtu", other), "to_pyvista"),
    ):
        with pytest.raises(InputError, match=message):
            call()
    assert list(tmp_path.iterdir()) == before


def test_points_moved_in_one_direction_and_free_in_the_other_are_condensed_or_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They are refused before multigrid, which needs PETSc, is asked."""
    mesh = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 4)] * 3).with_defaults()

    def problem(backend: str) -> ContactProblem:
        body: Any = DistributedBody(mesh, contact="front", E=1.0, nu=0.3, backend=backend)
        body = body.fix("back", "xy").fix("back", "z", -0.02).fix("front", "x", 0.01)
        return ContactProblem(body, "front", Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), friction=0.3)

    monkeypatch.setattr(primal, "AlteredSystem", lambda *args, **kwargs: None)
    with pytest.raises(InputError, match=r"^supports: one tangential .*backend='mumps'"):
        problem("krylov").solve()
    assert problem("mumps").solve().resultant[2] > 0


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(0, 30))
def test_the_rows_are_unknowns_and_the_rest_stays(seed: int, n: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    nb = n + more
    # Rows of neighbouring unknowns, in any order, with one entry that stands out.
    B = sparse.lil_array((n, nb))
    order = rng.permutation(nb)[:n]
    for i in range(n):
        B[i, order[i]] = 2.0 + rng.random()
        B[i, order[max(i - 1, 0)]] += 0.3 * rng.standard_normal()
    B = sparse.csr_array(B)
    pivots, change, back = rows_as_unknowns(B)
    assert np.unique(pivots).size == n
    z = rng.standard_normal(nb)
    x = back @ z
    np.testing.assert_allclose(x[pivots], B @ z, rtol=0, atol=1e-13 * np.abs(z).max() * 10)
    rest = np.setdiff1d(np.arange(nb), pivots)
    np.testing.assert_array_equal(x[rest], z[rest])
    np.testing.assert_allclose(change @ x, z, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("mesh", "element", "boundary"),
    [
        (skfem.MeshTri().refined(4), skfem.ElementTriP2(), "bottom"),
        (skfem.MeshHex().refined(2), skfem.ElementHex2(), "front"),
    ],
)
def test_second_order_elements_stay_sparse(mesh: Any, element: Any, boundary: str) -> None:
    body = ElasticBody.from_mesh(mesh.with_defaults(), element, E=1.0, nu=0.3)
    rows = ContactProblem(body, boundary, 0.0, friction=0.1).rows
    B = sparse.csr_array(sparse.vstack((rows.G, rows.T), format="csr"))
    B = B[:, np.unique(B.indices)]
    change = rows_as_unknowns(B)[1]
    assert change.nnz <= 10 * change.shape[0]


def test_rows_that_are_no_unknowns_are_refused() -> None:
    bands = (np.full(399, 1.0), np.full(400, 2.01), np.ones(399))
    smooth = sparse.csr_array(sparse.diags_array(bands, offsets=(-1, 0, 1)))
    with pytest.raises(InputError, match="each of its contact rows depends on all others"):
        rows_as_unknowns(smooth)
    with pytest.raises(InputError, match="linearly dependent"):
        rows_as_unknowns(sparse.csr_array(np.ones((3, 2))))
