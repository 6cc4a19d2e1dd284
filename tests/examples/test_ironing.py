"""Ironing: examples/ironing.py against the law of friction and the balance of energy."""

import numpy as np
import pytest

# The script runs in every CI run by itself; what it finds is checked in the slow lane.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ironing")
    script = example("ironing")
    return script, script.main(["--cells", "9", "--steps", "8", "--output", str(folder)]), folder


def test_every_step_is_certified_and_drawn(run):
    _, found, folder = run
    for result in found.history.results:
        assert max(result.kkt.values()) <= 1e-10
        assert sum(line.phase == "projection" for line in result.history) <= 6
    assert (folder / "ironing.png").stat().st_size > 10_000


def test_full_slip_to_and_fro(run):
    script, found, _ = run
    times = found.history.times
    for t, result in zip(times, found.history.results, strict=True):
        if 1.2 < t < 2.0 or t > 2.3:
            sign = 1.0 if t < 2.0 else -1.0
            limit = sign * script.FRICTION * result.mu.sum()
            assert abs(result.t.sum() - limit) <= 1e-10 * abs(limit)
    sliding = found.forces[(times > 1.2) & (times < 1.9), 1]
    assert np.ptp(sliding) <= 0.02 * sliding.mean()


def test_energy_balances_up_to_the_rule_for_integrals(run):
    script, found, _ = run
    coarse = script.ironed(9, 4)
    off = []
    for history, upper, work, stored, lost in (
        (coarse[0], coarse[1], *script.energies(coarse[0], coarse[1])),
        (found.history, found.bodies[0], found.work, found.stored, found.lost),
    ):
        assert len(history) == work.size
        assert upper is not None
        off.append(abs(work[-1] - stored[-1] - lost[-1]) / work[-1])
    assert off[1] <= 0.02
    assert off[1] < off[0]
