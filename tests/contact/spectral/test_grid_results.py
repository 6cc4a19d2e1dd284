"""What a result of contact on a grid tells, inside as well, and what is refused."""

import sys
from pathlib import Path

import numpy as np
import pytest

from contact import (
    ContactProblem,
    GridContact,
    HalfSpace,
    Infeasible,
    InputError,
    LayeredBlock,
    NotConverged,
    PeriodicLayers,
    Plane,
    Rigid,
    Rough,
    Status,
    self_affine,
)
from contact import Slice as PublicSlice
from contact.laws.friction import Coulomb
from contact.spectral.grid_result import certified, corrected_area, perimeter
from skfem_adini import ElementQuadAdini

H = self_affine(32, 0.8, 0.01, (1, 8), 4)
PRESSED = Rigid(H.max() - H, force=(0.002, 0.0, 0.01))
SPACE = HalfSpace((1.0, 2.0), (32, 32), 1.0, 0.3)
SMALL = HalfSpace((1.0, 1.0), (8, 8), 1.0, 0.3)
LINE = HalfSpace(1.0, 16, 1.0, 0.3)


def solved(**settings):
    return GridContact(SPACE, PRESSED, 0.4).solve(**settings)


@pytest.fixture(scope="module")
def result():
    return solved()


def test_result_is_consistent(result):
    cell = 2.0 / 32**2
    assert max(result.kkt.values()) < 1e-10
    assert result.resultant == pytest.approx((0.002, 0.0, 0.01), abs=1e-12)
    assert result.shear[0].sum() * cell == pytest.approx(0.002)
    touching = result.status != Status.OPEN
    assert np.array_equal(touching, result.pressure > 0)
    assert result.area == pytest.approx(touching.sum() * cell)
    assert np.abs(result.opening[touching]).max() < 1e-12
    assert result.opening[~touching].min() > -1e-12
    slip = result.status == Status.SLIP
    assert np.hypot(*result.shear)[slip] == pytest.approx(0.4 * result.pressure[slip])
    moved = result.u[2] - result.motion[2]
    assert result.opening == pytest.approx(H.max() - H + moved, abs=1e-14)  # the normal points down
    assert result.slip[0] == pytest.approx(result.u[0] - result.motion[0], abs=1e-14)
    assert "in contact; resultant (0.002, 0, 0.01)" in repr(result)
    _, C = result.spectrum()
    assert C.sum() / 2.0 == pytest.approx(np.var(result.pressure))
    image = result.to_pyvista()
    assert image.dimensions == (32, 32, 1)
    k = image.find_closest_point((3 / 32, 2.0 * 7 / 32, 0.0))
    assert image["pressure"][k] == result.pressure[3, 7]
    assert image["shear"][k] == pytest.approx((*result.shear[:, 3, 7], 0.0))


def test_histograms(result):
    """Between mirrored sides points are weighed by their area."""
    block = PeriodicLayers((1.0, 1.0), [(0.5, 2, 1.0, 0.3)], (4, 4), sides=("x", "y"))
    x = np.arange(5) / 4
    bowl = Rigid(0.01 * (x[:, None] ** 2 + x**2), force=(0.0, 0.0, 1e-4))
    mirrored = GridContact(block, bowl).solve()
    for one, area, bins, mean, rel in (
        (result, np.mean(result.pressure > 0), 20, result.pressure.mean(), 0.05),
        (mirrored, mirrored.area, 1000, 1e-4, 1e-2),
    ):
        density, edges = one.histogram(bins)
        shares = density * np.diff(edges)
        assert np.sum(shares) == pytest.approx(area)
        assert np.sum(shares * 0.5 * (edges[1:] + edges[:-1])) == pytest.approx(mean, rel=rel)
    with pytest.raises(InputError, match="bins=0: expected"):
        result.histogram(0)


def test_perimeter_and_area_of_a_disk():
    """Manhattan perimeter 8 r; the correction is the formula's share of it."""
    n, r = 200, 0.3
    x = (np.arange(n) + 0.5) / n - 0.5
    disk, h = np.hypot(x[:, None], x) < r, (1 / n, 1 / n)
    assert perimeter(disk, h) == pytest.approx(8 * r, rel=0.02)
    off = disk.sum() / n**2 - corrected_area(disk, h)
    assert off == pytest.approx((np.pi - 1 + np.log(2)) / 24 * perimeter(disk, h) / n)
    assert perimeter(np.roll(disk, (n // 2, n // 2), (0, 1)), h) == perimeter(disk, h)


def test_same_physics_in_other_units_directions_and_words(result):
    """Lengths in mm and forces in kN; the surface on top of the body; an obstacle for an array."""
    mm, kn = 1e3, 1e-3
    space = HalfSpace((mm, 2 * mm), (32, 32), kn / mm**2, 0.3, normal=(0, 0, 1))
    gap = (H.max() - H) * mm
    other = GridContact(space, Rigid(gap, force=(0.002 * kn, 0.0, -0.01 * kn)), 0.4).solve()
    assert other.pressure * mm**2 / kn == pytest.approx(result.pressure, rel=1e-8, abs=1e-12)
    assert other.shear * mm**2 / kn == pytest.approx(result.shear, rel=1e-8, abs=1e-10)
    assert other.u[2] / mm == pytest.approx(-result.u[2], abs=1e-12)
    rough = Rough(H, (1.0, 2.0), point=(0.0, 0.0, -H.max()))
    same = GridContact(SPACE, Rigid(rough, force=(0.002, 0.0, 0.01)), 0.4).solve()
    assert same.pressure == pytest.approx(result.pressure, abs=1e-9)


def test_no_contact_and_no_force():
    apart = GridContact(LINE, Plane((0.0, -0.1), (0.0, 1.0)), 0.5).solve()
    assert not apart.pressure.any()
    assert apart.opening == pytest.approx(0.1)
    touching = GridContact(LINE, Rigid(0.1, force=(None, 0.0))).solve()
    assert touching.motion == pytest.approx((0.0, 0.1))
    assert not touching.pressure.any()
    for law in ("coulomb", "tresca"):
        beyond = GridContact(LINE, None, 0.5, law).solve()
        assert not beyond.forces.any()
        assert np.isinf(beyond.opening).all()
        with pytest.raises(Infeasible, match="within reach of no point"):
            GridContact(LINE, Rigid(np.full(16, np.inf), force=(0.0, 1.0)), 0.5, law).solve()


def test_certificate_finds_wrong_forces(result):
    contact = GridContact(result.compliance, PRESSED, 0.4)
    problem, given = contact._case(None).problem(), contact._controls()[0]
    law = Coulomb(np.full((32, 32), 0.4))
    a = problem.turned(-result.motion.reshape(3, 1, 1)).ravel()
    good = certified(problem, law, (result.forces, a), given, 1e-9, ())
    assert good.pressure == pytest.approx(result.pressure)
    top = np.unravel_index(np.argmax(result.forces[0]), (32, 32))
    size = result.forces[0].max()
    nowhere = tuple(np.argwhere(result.pressure == 0)[0])
    for place, factor, more, shift, word in (
        ((0, *top), 1 + 1e-5, 1e-5, 0.0, "obstacle"),
        ((1, *top), 1 + 1e-5, 1e-5, 0.0, "slip"),
        ((slice(None), *nowhere), 0.0, -1e-6, 0.0, "sign"),
        ((0, *top), 1.0, 0.0, 1e-5, "penetration"),
    ):
        wrong = result.forces.copy()
        wrong[place] = wrong[place] * factor + more * size
        with pytest.raises(NotConverged, match=word):
            certified(problem, law, (wrong, a + np.array([shift, 0, 0])), given, 1e-9, ())


@pytest.mark.turns(2)
def test_friction_that_is_large_elsewhere():
    """What holds is the friction where the pressure is, found by sliding, not the largest."""

    def dragged(n, share):
        x = np.arange(n) / n
        ground = Rigid(1e-3 * (1 - np.cos(2 * np.pi * x)), force=(share * 1e-3, 1e-3))
        friction = np.where(abs(x - 0.5) < 0.25, 0.5, 0.1)
        return GridContact(HalfSpace(1.0, n, 1.0, 0.3), ground, friction).solve()

    with pytest.raises(Infeasible, match=r"holds 0\.0001 where all points slide"):
        dragged(8, 0.4)
    assert dragged(32, 0.0999).resultant == pytest.approx((0.0999e-3, 1e-3))


@pytest.mark.parametrize(
    ("ground", "friction", "words"),
    [
        (Rigid(0.0, force=(0.0, 0.0, -1.0)), 0.0, "pulls"),
        (Rigid(0.0, force=(0.5, 0.0, 1.0)), 0.4, "beyond the friction"),
        (Rigid(1e-3 * np.eye(8), displacement=(0.0, 0.0, 0.1)), 0.0, "full contact"),
    ],
)
def test_infeasible(ground, friction, words):
    with pytest.raises(Infeasible, match=words):
        GridContact(SMALL, ground, friction).solve()


@pytest.mark.parametrize(
    ("obstacle", "settings", "words"),
    [
        (np.zeros((8, 7)), {}, "^obstacle"),
        (np.zeros(8), {}, r"^obstacle: gap of shape \(8,\) for points of shape \(8, 8\)"),
        (lambda x: np.zeros(8), {}, r"^obstacle: gap of shape \(8,\)"),
        (np.zeros((8, 8), dtype=complex), {}, "^obstacle"),
        (np.full((8, 8), np.nan), {}, "^obstacle"),
        (0.0, {"friction": -0.1}, "^friction"),
        (0.0, {"friction": np.full((8, 8), np.nan)}, "^friction"),
        (0.0, {"friction": np.zeros((4, 4))}, "^friction"),
        (0.0, {"law": "viscous"}, "^law"),
        (Rigid(0.0, moment=(0.0, 0.0, 1.0)), {}, "^obstacle"),
        (Rigid(0.0, rotation=(0.0, 0.0, 0.1)), {}, "^obstacle"),
        *(
            (0.0, {"compliance": body}, "compliance: expected HalfSpace")
            for body in (None, 3.0, LayeredBlock(1.0, [(1.0, 2, 1.0, 0.3)], "x"))
        ),
    ],
)
def test_refused(obstacle, settings, words):
    with pytest.raises(InputError, match=words):
        GridContact(**({"compliance": SMALL, "obstacle": obstacle} | settings))


def test_what_is_no_tolerance_and_no_step_before_is_refused():
    for tol in (0.0, -1.0, 1.0, np.nan, None, "tight", [1e-9]):
        with pytest.raises(InputError, match="tol="):
            solved(tol=tol)
    coarse = GridContact(LINE, 0.1)
    with pytest.raises(InputError, match=r"after: a result on \(16,\) points"):
        solved(after=coarse.solve())
    with pytest.raises(InputError, match="after: expected a GridResult, got str"):
        solved(after="before")
    with pytest.raises(InputError, match="obstacles=None: expected a sequence"):
        coarse.history(None)


def test_a_body_that_nothing_holds():
    class Free(HalfSpace):
        """The mean displacement along x and z is free."""

        def __init__(self) -> None:
            super().__init__((1.0, 1.0), (8, 8), 1.0, 0.3)
            self.constant = np.array([True, False, True])

    with pytest.raises(InputError, match="nothing holds the body along z"):
        GridContact(Free(), Rigid(0.0, displacement=(0.0, 0.0, 0.1)))
    with pytest.raises(InputError, match="nothing holds the body along x"):
        GridContact(Free(), Rigid(0.0, force=(None, None, 0.1)), 0.3)
    held = GridContact(Free(), Rigid(0.0, force=(0.0, None, 0.1)), 0.3).solve()
    assert held.pressure == pytest.approx(0.1)


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


def test_image_data_of_slices(pressed):
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
        ("periodic", lambda r: r.plane([0.1, 0.2]), "z=.*: expected a finite number"),
        ("periodic", lambda r: r.section(), "y=None: expected a number in space"),
        ("periodic", lambda r: r.section(np.nan), "y=nan: expected a finite number"),
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


BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(BENCHMARKS))
    import rough_layers

    yield rough_layers
    sys.path.remove(str(BENCHMARKS))


@pytest.mark.parametrize("directions", [1, 2])
@pytest.mark.parametrize("dragged", [False, True])
def test_rows_are_certified(benchmark, directions, dragged):
    row = benchmark.measure(benchmark.surface(32, directions), dragged, np)
    assert row["residual"] < 1e-10
    assert 0.02 < row["area"] < 0.3
    nodes = 32 * 32 * (6 if directions == 1 else 32 * 3)
    assert abs(row["unknowns"] / nodes - 1) < 0.05
    assert bool(row["newton"]) == dragged
