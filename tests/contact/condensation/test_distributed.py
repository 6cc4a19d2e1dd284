"""A body on several processes has the contact that it has on one."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista

from contact import ContactProblem, DistributedBody, ElasticBody, InputError, save_pvtu
from tests.contact.condensation.spread_cases import cases
from tests.mpi_runs import run

PARITY = "tests.contact.condensation.spread_parity"


@pytest.mark.mpi
@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [1, 2, 3])
def test_contact_is_that_of_one_process(size: int) -> None:
    found: Any = run(PARITY, size, "mumps")
    assert set(found) == {name for name, _ in cases()}
    for name, off in found.items():
        for what in ("mu", "t", "u", "inside", "stress", "resultant"):
            assert off[what] <= 1e-10, (name, what)
        steps, serial = off["steps"]
        assert steps == serial, name
        assert off["kkt"] <= 1e-9, name
        assert off["agreed"], name


@pytest.mark.mpi
@pytest.mark.turns(2)
def test_contact_without_condensation_is_that_of_one_process_with_it() -> None:
    found = [run(PARITY, size, "krylov") for size in (1, 2, 3)]
    for name, _ in cases():
        for one in found:
            off: Any = one[name]
            for what in ("mu", "t", "u", "inside", "stress", "resultant"):
                assert off[what] <= 1e-9, (name, what)
            assert off["kkt"] <= 1e-9, name
            assert off["agreed"], name
        # It starts from sticking contact, not from contact without friction: the steps are its own.
        assert len({one[name]["steps"][0] for one in found}) == 1, name


@pytest.mark.mpi
@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [1, 2, 3])
def test_two_bodies_touch_as_on_one_process(size: int) -> None:
    found: Any = run("tests.contact.condensation.spread_pairs", size)
    assert len(found) == 5
    for name, off in found.items():
        for what in ("mu", "t", "u"):
            assert off[what] <= 1e-10, (name, what)
        assert off["kkt"] <= 1e-9, name
        steps, serial = off["steps"]
        assert steps == serial, name
        assert off["agreed"], name


def test_two_bodies_are_condensed_or_refused() -> None:
    case = dict(cases())["Adini .9"]
    parts = {"contact": "bottom", "backend": "krylov", **case.material}
    lower = DistributedBody(case.mesh.translated((0.0, -1.0)), contact="top", E=1.0, nu=0.3)
    lower.fix("bottom", "xy")
    upper = DistributedBody(case.mesh, case.element, **parts).fix("top", "xy", -0.01)
    with pytest.raises(InputError, match="are condensed"):
        ContactProblem(upper, "bottom", lower.surface("top"), friction=0.3).condense()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("solver", ["auto", "superlu"])
@pytest.mark.parametrize(("name", "case"), list(cases()))
def test_one_process_needs_no_petsc(
    name: str, case: Any, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    parts = {"contact": case.boundary, **case.material}
    bodies = (
        DistributedBody(case.mesh, case.element, **parts),
        ElasticBody.from_mesh(case.mesh, case.element, **case.material),
    )
    found, exact = (
        ContactProblem(
            case.hold(body), case.boundary, case.obstacle, friction=case.friction, solver=solver
        ).solve()
        for body in bodies
    )
    assert abs(found.mu - exact.mu).max() <= 1e-11 * exact.mu.max()
    assert abs(bodies[0].gather(found.u) - exact.u).max() <= 1e-11 * abs(exact.u).max()
    middle = case.mesh.p.mean(axis=1)[:, None] + 0.013  # inside a cell
    stress = exact.stress(middle)
    assert abs(found.stress(middle) - stress).max() <= 1e-10 * abs(stress).max()


def test_what_has_no_place_on_many_processes_is_refused(tmp_path: Path) -> None:
    case = dict(cases())["circle"]
    body = case.hold(DistributedBody(case.mesh, case.element, contact="bottom", **case.material))
    result = ContactProblem(body, "bottom", case.obstacle, friction=0.3).solve()
    for refused in (result.stress, result.nodal_stress, result.to_pyvista, lambda: body.basis):
        with pytest.raises(InputError, match=r"result.stress\(points\)"):
            refused()
    with pytest.raises(InputError, match="is not in one file"):
        result.save(tmp_path / "result.npz")
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="takes names of boundaries"):
        body.load(np.array([0, 1]), (0.0, 1.0))
    with pytest.raises(InputError, match="offers"):
        ContactProblem(body, "top", 0.0)
    with pytest.raises(InputError, match="no facets called 'roof'"):
        body.fix("roof")
    with pytest.raises(InputError, match="'pardiso'"):
        ContactProblem(body, "bottom", 0.0, solver="umfpack").condense()
    with pytest.raises(InputError, match="on the 'cpu'"):
        ContactProblem(body, "bottom", 0.0).condense("cuda")


def test_the_files_hold_what_the_grid_of_one_process_holds(tmp_path: Path) -> None:
    case = dict(cases())["circle"]
    body = case.hold(DistributedBody(case.mesh, case.element, contact="bottom", **case.material))
    result = ContactProblem(body, "bottom", case.obstacle, friction=0.3).solve()
    found = pyvista.read(save_pvtu(tmp_path / "block.pvtu", result))
    serial = case.hold(ElasticBody.from_mesh(case.mesh, case.element, **case.material))
    other = ContactProblem(serial, "bottom", case.obstacle, friction=0.3).solve()
    exact = other.to_pyvista()
    assert set(found.array_names) == set(exact.array_names)
    for name in exact.array_names:
        size = np.abs(exact[name]).max()
        assert np.abs(found[name] - exact[name]).max() <= 1e-10 * size, name
    with pytest.raises(InputError, match="ending in"):
        save_pvtu(tmp_path / "block.vtu", result)
    with pytest.raises(InputError, match="to_pyvista"):
        save_pvtu(tmp_path / "block.pvtu", other)
