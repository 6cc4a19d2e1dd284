"""Planes and sections through layers in contact beside the sparse path, and as image data."""

import numpy as np
import pytest

from contact import ContactProblem, GridContact, HalfSpace, InputError, PeriodicLayers, Rigid
from contact import Slice as PublicSlice
from skfem_adini import ElementQuadAdini

LAYERS = [(0.1, 2, 3.0, 0.2), (0.4, 4, 1.0, 0.3)]
BLOCKS = {
    "profile": lambda: PeriodicLayers(1.0, LAYERS, 8, sides="x", element=ElementQuadAdini()),
    "periodic": lambda: PeriodicLayers((1.0, 1.25), LAYERS, (6, 5)),
    "mixed": lambda: PeriodicLayers((1.0, 1.25), LAYERS, (4, 5), sides=("periodic", "y")),
    "half space": lambda: PeriodicLayers((1.0, 1.25), LAYERS, (6, 5), base=(1.0, 0.3)),
}


def bowl(x):
    return 0.05 * sum((p - 0.5) ** 2 for p in x[:-1])


@pytest.fixture(scope="module")
def pressed():
    results = {}
    for name, make in BLOCKS.items():
        block = make()
        force = (*[None] * (block.dim - 1), 0.004)
        results[name] = GridContact(block, Rigid(bowl, force=force), friction=0.3).solve()
    return results


@pytest.mark.parametrize("name", BLOCKS)
def test_planes_and_sections_are_fields_at_their_points(name, pressed):
    """And those of the sparse path, where the top holds the mesh."""
    result = pressed[name]
    dim, block = len(result.u), result.compliance
    lowest = result.plane(0.0)
    assert lowest.points.shape == lowest.u.shape == result.u.shape
    assert np.abs(lowest.u - result.u).max() < 1e-12 * np.abs(result.u).max()
    cut = result.section(*([0.3] if dim == 3 else []), levels=6)
    assert cut.points.shape == (dim, block.shape[0], 6)
    assert cut.points[-1, 0] == pytest.approx(np.linspace(0, 0.5, 6))
    assert dim == 2 or np.all(cut.points[1] == 0.3)
    for piece in (result.plane(0.23), cut):
        flat = piece.points.reshape(dim, -1)
        assert np.array_equal(piece.u.reshape(dim, -1), result.sample(flat))
        assert np.array_equal(piece.stress.reshape(dim, dim, -1), result.stress(flat))
    if name != "half space":
        motion = Rigid(bowl, displacement=(*[0.0] * (dim - 1), result.motion[-1]))
        sparse = ContactProblem(block.elastic(), "bottom", motion, 0.3, functional="nodal").solve()
        exact = sparse.sample(cut.points.reshape(dim, -1))
        assert np.abs(cut.u.reshape(dim, -1) - exact).max() < 1e-9 * np.abs(exact).max()


def test_forces_of_a_contact_balance_the_stress_on_every_plane():
    """The mean of the traction on a plane is the resultant, by means over each cell (Q1)."""
    block = PeriodicLayers(1.0, [(0.4, 4, 1.0, 0.3)], 16)
    ground = Rigid(lambda x: 0.1 * (x[0] - 0.5) ** 2, displacement=(0.01, 0.04))
    result = GridContact(block, ground, friction=0.3).solve()
    place, weight = np.polynomial.legendre.leggauss(2)
    across, along = ((place + 1) / 2 + np.arange(16)[:, None]).ravel() / 16, (place + 1) / 20
    mean = np.zeros(2)
    for y, w in zip(along + 0.2, weight / 2, strict=True):
        mean += w * result.stress(np.vstack([across, np.full(across.size, y)]))[1].mean(axis=1)
    assert np.allclose(-mean, result.resultant, rtol=1e-9)


def test_image_data(pressed):
    result = pressed["periodic"]
    cut, plane = result.section(0.5, levels=11), result.plane(0.25)
    image = cut.to_pyvista()
    assert image.dimensions == (6, 1, 11)
    k = image.find_closest_point((2 / 6, 0.5, 0.2))
    assert image.points[k] == pytest.approx((2 / 6, 0.5, 0.2))
    assert image["u"][k] == pytest.approx(cut.u[:, 2, 4])
    assert image["stress"][k].reshape(3, 3) == pytest.approx(cut.stress[:, :, 2, 4])
    assert plane.to_pyvista().dimensions == (6, 5, 1)
    assert plane.to_pyvista().origin == pytest.approx((0, 0, 0.25))
    profile = pressed["profile"].section(levels=3)
    image = profile.to_pyvista()
    assert image.dimensions == (9, 3, 1)
    sigma = profile.stress[:, :, 0, 0]
    assert image["stress"][0] == pytest.approx([*sigma[0], 0, *sigma[1], 0, 0, 0, 0])
    assert isinstance(profile, PublicSlice)


@pytest.mark.parametrize(
    ("name", "ask", "message"),
    [
        ("periodic", lambda r: r.plane(0.6), "points: .* lies below or above the layers"),
        ("periodic", lambda r: r.plane("low"), "z='low': expected real numbers"),
        ("periodic", lambda r: r.plane([0.1, 0.2]), "z=.*: expected one finite number"),
        ("periodic", lambda r: r.section(), "y=None: expected a number in space"),
        ("periodic", lambda r: r.section(np.nan), "y=nan: expected one finite number"),
        ("profile", lambda r: r.section(0.5), "y=0.5: expected a number in space, and none"),
        ("mixed", lambda r: r.section(1.3), "points: .* lies beyond a side"),
        ("periodic", lambda r: r.section(0.5, levels=1), "levels=1: expected a whole number"),
        ("periodic", lambda r: r.sample([[0.1], [0.2]]), "points"),
    ],
)
def test_places_that_are_not_there_are_refused(name, ask, message, pressed):
    with pytest.raises(InputError, match=message):
        ask(pressed[name])


def test_a_half_space_has_no_fields_inside():
    wave = 1e-3 * (1 - np.cos(2 * np.pi * np.arange(16) / 16))
    result = GridContact(HalfSpace(1.0, 16, 1.0, 0.3), Rigid(wave, force=(None, 1e-3))).solve()
    for ask in (lambda: result.plane(0.0), lambda: result.section(), lambda: result.stress([[0]])):
        with pytest.raises(InputError, match="compliance: a HalfSpace has no fields inside"):
            ask()
