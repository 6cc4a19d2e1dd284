"""The bolted lap joint: examples/lap_joint.py against statics and the law of friction."""

import numpy as np
import pytest

from contact import Status

# The script runs in every CI run by itself; what it finds is checked in the slow lane.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lap")
    script = example("lap_joint")
    arguments = ["--cells", "3", "--steps", "4", "--output", str(folder)]
    return script, script.main(arguments), folder


def test_every_step_is_certified_and_drawn(run):
    _, found, folder = run
    for result in found.history.results:
        assert max(result.kkt.values()) <= 1e-10
    assert (folder / "lap_joint.png").stat().st_size > 10_000


def test_forces_balance_on_each_body(run):
    _, found, _ = run
    last = found.history.results[-1]
    for body in found.bodies.values():
        assert np.abs(last[body].balance()["residual"]).max() <= 1e-10
    # The support of the lower plate holds what the upper one is pulled by, through both ways.
    support = -2 * last["lower"].balance()["support"][0]
    assert abs(support - (found.plates + found.shank)[-1]) <= 1e-9 * support
    # Both heads press alike, and the plates on each other by as much.
    press = [last.mu[last.part == k].sum() for k in range(3)]
    np.testing.assert_allclose(press, press[0], rtol=0.1)


def test_friction_between_the_plates_has_a_limit(run):
    script, found, _ = run
    last = found.history.results[-1]
    between = last.part == 0
    limit = 2 * script.FRICTION * last.mu[between].sum()
    assert 0.8 * limit <= found.plates[-1] <= limit * (1 + 1e-9)
    assert not np.any(last.status[between] == Status.STICK)
    early = found.history.results[1]
    assert np.any(early.status[early.part == 0] == Status.STICK)
    assert np.all(np.diff(found.plates + found.shank) > 0)
    assert found.shank[-1] > 0.05 * found.plates[-1]
