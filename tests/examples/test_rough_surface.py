"""The rough surface: area against load beside theories and half spaces, and slip while dragged."""

import numpy as np
import pytest

# The script runs in every CI run by itself; what it finds is checked in the slow lane.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rough")
    arguments = ["--points", "96", "--steps", "5", "--output", str(folder)]
    found = example("rough_surface").main(arguments)
    found.folder, found.script = folder, example("rough_surface")
    return found


def test_area_against_load(found):
    """Half spaces lie between the asymptotes of the theories, the block between half spaces."""
    results = [r for loads in found.loads.values() for r in loads]
    assert max(max(r.kkt.values()) for r in results + found.drags) < 1e-10
    light = found.areas["coating"] / found.script.PRESSURES
    few = found.areas["coating"] < 0.1
    assert np.count_nonzero(few) >= 3
    assert np.all(light[few] > np.sqrt(8 / np.pi))
    assert np.all(light[few] < np.sqrt(2 * np.pi))
    assert np.all(found.areas["coating"] > found.persson)
    assert np.all(found.areas["coated block"] > found.areas["coating"])
    assert np.all(found.areas["coated block"] < found.areas["substrate"])


def test_slip_while_it_is_dragged(found):
    """The force grows to F P while what sticks shrinks."""
    assert np.all(np.diff(found.share) > 0)
    assert 0.98 < found.share[-1] <= 1 + 1e-9
    assert np.all(np.diff(found.stuck[1:]) <= 0)
    assert found.stuck[1] > 0.1
    assert found.stuck[-1] < 0.02


def test_pictures_and_images(found):
    pyvista = pytest.importorskip("pyvista")
    assert (found.folder / "rough_surface.png").stat().st_size > 10_000
    assert pyvista.read(found.folder / "rough_surface.vti").dimensions == (96, 96, 1)
    image, (points, stress) = pyvista.read(found.folder / "rough_surface_section.vti"), found.inside
    at = image.find_closest_point(points[:, 7, 11])
    assert image.points[at] == pytest.approx(points[:, 7, 11], abs=1e-6)
    assert image["von Mises"][at] == pytest.approx(stress[7, 11])
    assert stress.max() < 2 * found.loads["coated block"][-1].pressure.max()
