"""The choice between a factorisation and multigrid follows the memory and the dimension."""

import logging

import pytest
import skfem

from contact import DistributedBody, InputError
from contact.body import distributed_body
from contact.body.distributed_body import choose_backend, factor_memory


@pytest.fixture(autouse=True)
def with_petsc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distributed_body, "has_petsc", lambda: True)
    monkeypatch.setattr(distributed_body, "physical_memory", lambda: 16e9)


@pytest.mark.parametrize(
    ("unknowns", "rows", "dim", "found", "why"),
    [
        (396_294, 1028, 2, "mumps", "of 16.0 GB"),
        (50_000, 3_000, 3, "mumps", "of 16.0 GB"),
        (107_811, 3_267, 3, "krylov", "faster by multigrid"),
        (1_000_000, 14_700, 3, "krylov", "of 16.0 GB"),
        (20_000_000, 4_000, 2, "krylov", "of 16.0 GB"),
        (200_000, 30_000, 2, "krylov", "of 16.0 GB"),
    ],
)
def test_the_choice_and_its_reason(
    unknowns: int, rows: int, dim: int, found: str, why: str
) -> None:
    chosen, reason = choose_backend(unknowns, rows, dim, 2)
    assert chosen == found
    assert why in reason


def test_one_process_without_petsc_is_condensed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distributed_body, "has_petsc", lambda: False)
    assert choose_backend(10**7, 10**5, 3, 1)[0] == "mumps"


def test_memory_grows_with_unknowns_rows_and_processes() -> None:
    least = factor_memory(1000, 100, 3, 1)
    assert factor_memory(2000, 100, 3, 1) > least
    assert factor_memory(1000, 200, 3, 1) > least
    assert factor_memory(1000, 100, 3, 2) > least
    # What was measured.
    assert factor_memory(396_294, 0, 2, 1) == pytest.approx(1.0e9, rel=0.05)
    assert factor_memory(107_811, 0, 3, 2) == pytest.approx(1.8e9, rel=0.05)


def test_the_body_logs_why(caplog: pytest.LogCaptureFixture) -> None:
    mesh = skfem.MeshQuad().refined(2).with_defaults()
    body = DistributedBody(mesh, contact="bottom", E=1.0, nu=0.3)
    with caplog.at_level(logging.INFO):
        assert body.chosen_backend(10) == "mumps"
    assert "the factor would take about" in caplog.text
    other = DistributedBody(mesh, contact="bottom", E=1.0, nu=0.3, backend="krylov")
    assert other.chosen_backend(10) == "krylov"


@pytest.mark.parametrize("wrong", [{"backend": "amg"}, {"multigrid": "ml"}])
def test_unknown_back_ends_are_refused(wrong: dict[str, str]) -> None:
    mesh = skfem.MeshQuad().refined(2).with_defaults()
    with pytest.raises(InputError, match=next(iter(wrong.values()))):
        DistributedBody(mesh, contact="bottom", E=1.0, nu=0.3, **wrong)  # type: ignore[arg-type]
