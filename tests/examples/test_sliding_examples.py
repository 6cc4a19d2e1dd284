"""Ironing, a lap joint and a rough surface against the law of friction, statics and energy."""

import numpy as np
import pytest

from contact import Status

# The script runs in every CI run by itself; what it finds is checked in the slow lane.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def ironing(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ironing")
    script = example("ironing")
    return script, script.main(["--cells", "9", "--steps", "8", "--output", str(folder)]), folder


def test_every_step_is_certified_and_drawn(ironing):
    _, found, folder = ironing
    for result in found.history.results:
        assert max(result.kkt.values()) <= 1e-10
        assert sum(line.phase == "projection" for line in result.history) <= 6
    assert (folder / "ironing.png").stat().st_size > 10_000


def test_full_slip_to_and_fro(ironing):
    script, found, _ = ironing
    times = found.history.times
    for t, result in zip(times, found.history.results, strict=True):
        if 1.2 < t < 2.0 or t > 2.3:
            sign = 1.0 if t < 2.0 else -1.0
            limit = sign * script.FRICTION * result.mu.sum()
            assert abs(result.t.sum() - limit) <= 1e-10 * abs(limit)
    sliding = found.forces[(times > 1.2) & (times < 1.9), 1]
    assert np.ptp(sliding) <= 0.02 * sliding.mean()


def test_energy_balances_up_to_the_rule_for_integrals(ironing):
    script, found, _ = ironing
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


@pytest.fixture(scope="module")
def lap(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lap")
    script = example("lap_joint")
    arguments = ["--cells", "3", "--steps", "4", "--output", str(folder)]
    return script, script.main(arguments), folder


def test_every_step_of_the_joint_is_certified_and_drawn(lap):
    _, found, folder = lap
    for result in found.history.results:
        assert max(result.kkt.values()) <= 1e-10
    assert (folder / "lap_joint.png").stat().st_size > 10_000


def test_forces_balance_on_each_body(lap):
    _, found, _ = lap
    last = found.history.results[-1]
    for body in found.bodies.values():
        assert np.abs(last[body].balance()["residual"]).max() <= 1e-10
    # The support of the lower plate holds what the upper one is pulled by, through both ways.
    support = -2 * last["lower"].balance()["support"][0]
    assert abs(support - (found.plates + found.shank)[-1]) <= 1e-9 * support
    # Both heads press alike, and the plates on each other by as much.
    press = [last.mu[last.part == k].sum() for k in range(3)]
    np.testing.assert_allclose(press, press[0], rtol=0.1)


def test_friction_between_the_plates_has_a_limit(lap):
    script, found, _ = lap
    last = found.history.results[-1]
    between = last.part == 0
    limit = 2 * script.FRICTION * last.mu[between].sum()
    assert 0.8 * limit <= found.plates[-1] <= limit * (1 + 1e-9)
    assert not np.any(last.status[between] == Status.STICK)
    early = found.history.results[1]
    assert np.any(early.status[early.part == 0] == Status.STICK)
    assert np.all(np.diff(found.plates + found.shank) > 0)
    assert found.shank[-1] > 0.05 * found.plates[-1]


@pytest.fixture(scope="module")
def rough(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rough")
    arguments = ["--points", "96", "--steps", "5", "--output", str(folder)]
    rough = example("rough_surface").main(arguments)
    rough.folder, rough.script = folder, example("rough_surface")
    return rough


def test_area_against_load(rough):
    """Half spaces lie between the asymptotes of the theories, the block between half spaces."""
    results = [r for loads in rough.loads.values() for r in loads]
    assert max(max(r.kkt.values()) for r in results + rough.drags) < 1e-10
    light = rough.areas["coating"] / rough.script.PRESSURES
    few = rough.areas["coating"] < 0.1
    assert np.count_nonzero(few) >= 3
    assert np.all(light[few] > np.sqrt(8 / np.pi))
    assert np.all(light[few] < np.sqrt(2 * np.pi))
    assert np.all(rough.areas["coating"] > rough.persson)
    assert np.all(rough.areas["coated block"] > rough.areas["coating"])
    assert np.all(rough.areas["coated block"] < rough.areas["substrate"])


def test_slip_while_it_is_dragged(rough):
    """The force grows to F P while what sticks shrinks."""
    assert np.all(np.diff(rough.share) > 0)
    assert 0.98 < rough.share[-1] <= 1 + 1e-9
    assert np.all(np.diff(rough.stuck[1:]) <= 0)
    assert rough.stuck[1] > 0.1
    assert rough.stuck[-1] < 0.02


def test_pictures_and_images(rough):
    pyvista = pytest.importorskip("pyvista")
    assert (rough.folder / "rough_surface.png").stat().st_size > 10_000
    assert pyvista.read(rough.folder / "rough_surface.vti").dimensions == (96, 96, 1)
    image, (points, stress) = pyvista.read(rough.folder / "rough_surface_section.vti"), rough.inside
    at = image.find_closest_point(points[:, 7, 11])
    assert image.points[at] == pytest.approx(points[:, 7, 11], abs=1e-6)
    assert image["von Mises"][at] == pytest.approx(stress[7, 11])
    assert stress.max() < 2 * rough.loads["coated block"][-1].pressure.max()
