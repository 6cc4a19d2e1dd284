"""What a result of contact on a grid tells, and what is refused."""

import numpy as np
import pytest

from contact import (
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
from contact.laws.friction import Coulomb
from contact.spectral.grid_result import certified, corrected_area, perimeter

H = self_affine(32, 0.8, 0.01, (1, 8), 4)
PRESSED = Rigid(H.max() - H, force=(0.002, 0.0, 0.01))


def solved(friction=0.4, **settings):
    return GridContact(HalfSpace((1.0, 2.0), (32, 32), 1.0, 0.3), PRESSED, friction).solve(
        **settings
    )


def test_result_is_consistent():
    result = solved()
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
    gap = H.max() - H
    moved = result.u[2] - result.motion[2]
    assert result.opening == pytest.approx(gap + moved, abs=1e-14)  # the normal points down
    assert result.slip[0] == pytest.approx(result.u[0] - result.motion[0], abs=1e-14)
    assert "in contact; resultant (0.002, 0, 0.01)" in repr(result)


def test_histogram_between_mirrored_sides_weighs_points_by_their_area():
    block = PeriodicLayers((1.0, 1.0), [(0.5, 2, 1.0, 0.3)], (4, 4), sides=("x", "y"))
    x = np.arange(5) / 4
    bowl = 0.01 * (x[:, None] ** 2 + x**2)
    result = GridContact(block, Rigid(bowl, force=(0.0, 0.0, 1e-4))).solve()
    density, edges = result.histogram(1000)
    assert np.sum(density * np.diff(edges)) == pytest.approx(result.area)
    mean = np.sum(density * np.diff(edges) * 0.5 * (edges[1:] + edges[:-1]))
    assert mean == pytest.approx(1e-4, rel=1e-2)


def test_spectrum_and_histogram():
    result = solved()
    _, C = result.spectrum()
    assert C.sum() / 2.0 == pytest.approx(np.var(result.pressure))
    density, edges = result.histogram(20)
    assert np.sum(density * np.diff(edges)) == pytest.approx(np.mean(result.pressure > 0))
    with pytest.raises(InputError, match="bins=0: expected"):
        result.histogram(0)
    middle = 0.5 * (edges[1:] + edges[:-1])
    mean = np.sum(density * np.diff(edges) * middle)
    assert mean == pytest.approx(result.pressure.mean(), rel=0.05)


def test_perimeter_and_area_of_a_disk():
    """Manhattan perimeter 8 r; the correction is the formula's share of it."""
    n, r = 200, 0.3
    x = (np.arange(n) + 0.5) / n - 0.5
    disk = np.hypot(x[:, None], x) < r
    assert perimeter(disk, (1 / n, 1 / n)) == pytest.approx(8 * r, rel=0.02)
    off = disk.sum() / n**2 - corrected_area(disk, (1 / n, 1 / n))
    assert off == pytest.approx((np.pi - 1 + np.log(2)) / 24 * perimeter(disk, (1 / n, 1 / n)) / n)
    assert perimeter(np.roll(disk, (n // 2, n // 2), (0, 1)), (1 / n, 1 / n)) == perimeter(
        disk, (1 / n, 1 / n)
    )


def test_image_data():
    result = solved()
    image = result.to_pyvista()
    assert image.dimensions == (32, 32, 1)
    k = image.find_closest_point((3 / 32, 2.0 * 7 / 32, 0.0))
    assert image["pressure"][k] == result.pressure[3, 7]
    assert image["shear"][k] == pytest.approx((*result.shear[:, 3, 7], 0.0))


def test_same_physics_in_other_units_and_directions():
    """Lengths in mm and forces in kN; the surface on top of the body instead of below."""
    one = solved()
    mm, kn = 1e3, 1e-3
    space = HalfSpace((mm, 2 * mm), (32, 32), kn / mm**2, 0.3, normal=(0, 0, 1))
    gap = (H.max() - H) * mm
    other = GridContact(space, Rigid(gap, force=(0.002 * kn, 0.0, -0.01 * kn)), 0.4).solve()
    assert other.pressure * mm**2 / kn == pytest.approx(one.pressure, rel=1e-8, abs=1e-12)
    assert other.shear * mm**2 / kn == pytest.approx(one.shear, rel=1e-8, abs=1e-10)
    assert other.u[2] / mm == pytest.approx(-one.u[2], abs=1e-12)


def test_rough_obstacle_and_array_agree():
    rough = Rough(H, (1.0, 2.0), point=(0.0, 0.0, -H.max()))
    space = HalfSpace((1.0, 2.0), (32, 32), 1.0, 0.3)
    one = GridContact(space, Rigid(rough, force=(0.0, 0.0, 0.01))).solve()
    two = GridContact(space, Rigid(H.max() - H, force=(0.0, 0.0, 0.01))).solve()
    assert one.pressure == pytest.approx(two.pressure, abs=1e-9)


def test_no_contact_and_no_force():
    space = HalfSpace(1.0, 16, 1.0, 0.3)
    apart = GridContact(space, Plane((0.0, -0.1), (0.0, 1.0)), 0.5).solve()
    assert not apart.pressure.any()
    assert apart.opening == pytest.approx(0.1)
    touching = GridContact(space, Rigid(0.1, force=(None, 0.0))).solve()
    assert touching.motion == pytest.approx((0.0, 0.1))
    assert not touching.pressure.any()


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_an_obstacle_beyond_reach(law):
    space = HalfSpace(1.0, 16, 1.0, 0.3)
    result = GridContact(space, None, 0.5, law).solve()
    assert not result.forces.any()
    assert np.isinf(result.opening).all()
    with pytest.raises(Infeasible, match="within reach of no point"):
        GridContact(space, Rigid(np.full(16, np.inf), force=(0.0, 1.0)), 0.5, law).solve()


@pytest.mark.parametrize("tol", [0.0, -1.0, 1.0, np.nan, None, "tight", [1e-9]])
def test_tolerances_out_of_range_are_refused(tol):
    with pytest.raises(InputError, match="tol="):
        solved(tol=tol)


def test_what_is_no_step_before_is_refused():
    coarse = GridContact(HalfSpace(1.0, 16, 1.0, 0.3), 0.1)
    with pytest.raises(InputError, match=r"after: a result on \(16,\) points"):
        solved(after=coarse.solve())
    with pytest.raises(InputError, match="after: expected a GridResult, got str"):
        solved(after="before")
    with pytest.raises(InputError, match="obstacles=None: expected a sequence"):
        coarse.history(None)


def test_light_contact_is_linear_in_the_load():
    """About 2 p / (E* slope): Bush, Gibson and Thomas (1975), Persson (2001)."""
    n = 128
    h = self_affine(n, 0.8, 0.002, (2, 16), 7)
    rough = Rough(h - h.max(), (1.0, 1.0))
    space, modulus = HalfSpace((1.0, 1.0), (n, n), 1.0, 0.3), 1 / 0.91
    shares = []
    for force in (0.002, 0.004, 0.008):
        result = GridContact(space, Rigid(rough, force=(0.0, 0.0, force))).solve()
        shares.append(result.corrected_area / force * modulus * rough.rms_slope)
    assert np.all((np.array(shares) > 1.5) & (np.array(shares) < 2.6))
    assert max(shares) < 1.2 * min(shares)


def test_certificate_finds_wrong_forces():
    result = solved()
    contact = GridContact(result.compliance, PRESSED, 0.4)
    problem, given = contact._case(None).problem(), contact._controls()[0]
    law = Coulomb(np.full((32, 32), 0.4))
    a = problem.turned(-result.motion.reshape(3, 1, 1)).ravel()
    good = certified(problem, law, (result.forces, a), given, 1e-9, ())
    assert good.pressure == pytest.approx(result.pressure)
    top = np.unravel_index(np.argmax(result.forces[0]), (32, 32))
    size = result.forces[0].max()
    open_place = (slice(None), *np.argwhere(result.pressure == 0)[0])
    for change, word in (
        ((0, *top), "obstacle"),
        ((1, *top), "slip"),
    ):
        wrong = result.forces.copy()
        wrong[change] *= 1 + 1e-5
        wrong[change] += 1e-5 * size
        with pytest.raises(NotConverged, match=word):
            certified(problem, law, (wrong, a), given, 1e-9, ())
    wrong = result.forces.copy()
    wrong[open_place] = -1e-6 * size
    with pytest.raises(NotConverged, match="sign"):
        certified(problem, law, (wrong, a), given, 1e-9, ())
    with pytest.raises(NotConverged, match="penetration"):
        certified(problem, law, (result.forces, a + np.array([1e-5, 0, 0])), given, 1e-9, ())


SPACE = HalfSpace((1.0, 1.0), (8, 8), 1.0, 0.3)


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
    ],
)
def test_refused(obstacle, settings, words):
    with pytest.raises(InputError, match=words):
        GridContact(SPACE, obstacle, **settings)


@pytest.mark.parametrize("body", [None, 3.0, LayeredBlock(1.0, [(1.0, 2, 1.0, 0.3)], "x")])
def test_what_is_no_compliance_is_refused(body):
    with pytest.raises(InputError, match="compliance: expected HalfSpace"):
        GridContact(body, 0.0)


@pytest.mark.parametrize(
    ("force", "friction", "words"),
    [((0.0, 0.0, -1.0), 0.0, "pulls"), ((0.5, 0.0, 1.0), 0.4, "beyond the friction")],
)
def test_infeasible(force, friction, words):
    with pytest.raises(Infeasible, match=words):
        GridContact(SPACE, Rigid(0.0, force=force), friction).solve()


@pytest.mark.parametrize("share", [0.101, 0.4])
def test_friction_that_is_large_elsewhere(share):
    """What holds is the friction where the pressure is, found by sliding, not the largest."""
    x = np.arange(32) / 32
    gap = 1e-3 * (1 - np.cos(2 * np.pi * x))
    space, friction = HalfSpace(1.0, 32, 1.0, 0.3), np.where(abs(x - 0.5) < 0.25, 0.5, 0.1)
    with pytest.raises(Infeasible, match=r"holds 0\.0001 where all points slide"):
        GridContact(space, Rigid(gap, force=(share * 1e-3, 1e-3)), friction).solve()
    less = GridContact(space, Rigid(gap, force=(0.0999e-3, 1e-3)), friction).solve()
    assert less.resultant == pytest.approx((0.0999e-3, 1e-3))


def test_beyond_full_contact():
    gap = 0.01 * np.random.default_rng(0).uniform(0, 1, (8, 8))
    with pytest.raises(Infeasible, match="full contact"):
        GridContact(SPACE, Rigid(gap, displacement=(0.0, 0.0, 0.1))).solve()


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


def test_fields_come_when_they_are_asked_for():
    result = GridContact(HalfSpace((1.0, 1.0), (32, 32), E=1.0, nu=0.3), PRESSED).solve()
    assert "u" in result._fields
    assert result.u is result.u
    assert "u" not in result._fields
    result.to_host()
    assert not result._fields
    assert result.pressure.sum() * result.cell == pytest.approx(0.01)
    with pytest.raises(AttributeError, match="'GridResult' object has no attribute 'heat'"):
        _ = result.heat
