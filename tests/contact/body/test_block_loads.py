"""The load of a block without a mesh: edited, shared with results, and placed on a device."""

from copy import copy, deepcopy
from types import SimpleNamespace

import numpy as np
import pytest

from contact import ContactProblem, InputError, LayeredBlock
from contact.arrays.dense_arrays import HostArrays


def block():
    return LayeredBlock(1.0, [(1.0, 4, 2.0, 0.3)], sides="y", top="x")


def loaded():
    body = block().load(["top", "left"], (0.1, -1.0))
    return body.load("top", lambda x: np.array([0 * x[0], x[0]]))


def test_loads_are_those_of_the_body_with_a_mesh():
    whole = loaded().elastic()
    plain = block().elastic().load(["top", "left"], (0.1, -1.0))
    plain.load("top", lambda x: np.array([0 * x[0], x[0]]))
    assert whole.f == pytest.approx(plain.f, abs=1e-15)
    assert np.array_equal(loaded().f, loaded().loads)
    for body in (loaded(), deepcopy(loaded())):
        assert np.array_equal(body.body_force((0.0, -1.0)).f, loaded().body_force((0.0, -1.0)).f)


def test_a_copy_has_a_load_of_its_own():
    first = loaded()
    second, kept = copy(first), first.loads.copy()
    second.f[3] += 1.0
    second.load("top", (0.0, -1.0))
    first.load("bottom", (0.0, 0.5))
    assert second.f[3] == pytest.approx(kept[3] + 1.0)
    assert np.array_equal(first.f - kept, block().load("bottom", (0.0, 0.5)).f)


def test_edited_in_place():
    body = loaded()
    problem = ContactProblem(body, "bottom", 0.03, 0.3)
    first = problem.solve()
    before = first.applied.copy()
    body.f *= 2.0
    assert problem.solve().applied == pytest.approx(2.0 * before)
    assert np.array_equal(first.applied, before)
    with pytest.raises(ValueError, match="read-only"):
        first.applied[0] = 1.0
    body.f[5] = np.nan
    with pytest.raises(InputError, match=r"^f: "):
        problem.solve()


def test_loads_that_overflow_change_nothing():
    body = block()
    for _ in range(4):  # a node takes a fourth of each
        body.load("top", (0.0, 1.7e308))
    kept = body.loads
    with pytest.raises(InputError, match=r"^f: "):
        body.load(["bottom", "top"], (0.0, 1.7e308))
    assert body.loads is kept


def test_only_what_acts_goes_to_a_device():
    copied = []

    def asarray(values):
        copied.append(np.size(values))
        return np.array(values)

    body = loaded()
    arrays = HostArrays()
    arrays.xp = SimpleNamespace(zeros=np.zeros, asarray=asarray)
    body.compute_with(arrays)
    snapshot = body.snapshot()
    assert np.array_equal(body.placed(snapshot.loads), body.loads)
    assert max(copied) < body.ndofs
    assert np.array_equal(body.placed(2.0 * body.loads), 2.0 * body.loads)
    assert max(copied) == body.ndofs
