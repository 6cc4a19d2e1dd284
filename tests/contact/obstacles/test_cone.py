"""The gap to a cone along any ray, beside a search for the first point inside it."""

import numpy as np
import pytest

from contact import Cone, ContactProblem, ElasticBody, InputError, Rigid


def first_inside(apex, axis, angle, x, n, reach=40.0, steps=400_001):
    """Where the ray enters the cone: forwards from outside, backwards from inside."""
    d = np.linspace(-reach, reach, steps)
    at = (x - apex)[:, None] + d * n[:, None]
    along = axis / np.linalg.norm(axis) @ at
    across = np.linalg.norm(at - np.outer(axis / np.linalg.norm(axis), along), axis=0)
    inside = np.flatnonzero(across <= along * np.tan(angle))
    if not inside.size or inside[0] == 0:  # it comes from far inside the cone
        return np.inf
    here = steps // 2 in inside
    return d[inside[0]] if here or d[inside[0]] >= 0 else np.inf


@pytest.mark.sampled(3)
@pytest.mark.parametrize("dim", [2, 3])
def test_rays(dim):
    rng = np.random.default_rng(7)
    seen = {"outside": 0, "inside": 0, "never": 0}
    for k in range(150):
        apex, axis, x, n = rng.standard_normal((4, dim))
        n = axis if k % 5 == 0 else n  # steeper than the surface
        n, angle = n / np.linalg.norm(n), rng.uniform(0.1, 1.45)
        found = Cone(apex, axis, angle)(x[:, None], n[:, None])[0]
        wanted = first_inside(apex, axis, angle, x, n)
        if np.abs(found) > 39 and np.isfinite(found):
            continue
        assert np.isinf(found) == np.isinf(wanted)
        if np.isfinite(wanted):
            assert found == pytest.approx(wanted, abs=3e-4)
        seen["never" if np.isinf(wanted) else "inside" if wanted < 0 else "outside"] += 1
    assert min(seen.values()) >= 10


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_vertical_rays_have_the_gap_of_the_theory(unit):
    """r / tan(half angle), at the tip as well, in any unit."""
    r = unit * np.linspace(0, 2, 9)
    cone = Cone((0.0, -unit), (0.0, -3.0), np.arctan(4.0))
    n = np.array([0 * r, 0 * r - 1])
    assert cone(np.array([r, 0 * r]), n) == pytest.approx(unit + r / 4, rel=1e-14)
    assert cone(np.array([r, 0 * r - 2 * unit]), n) == pytest.approx(r / 4 - unit, abs=1e-14 * unit)
    assert np.all(np.isinf(cone(np.array([r, 0 * r]), -n)))


def test_seat(make):
    """On its own cone a body has the gap zero everywhere, not rounding that looks like none."""
    r = np.linspace(0, 1, 7)
    flat = make.box(make_element(), r, np.linspace(0, 1, 3))
    slope = 0.37
    mesh = make.remesh(flat, np.array([flat.p[0], flat.p[1] + slope * flat.p[0]]))
    body = ElasticBody.from_mesh(mesh, make_element()(), E=1.0, nu=0.3, plane="axisymmetric")
    below = Cone((0.0, 0.0), (0.0, -1.0), np.pi / 2 - 1e-3)
    gap = ContactProblem(body, "bottom", below).rows.gap
    assert np.all(np.isfinite(gap))
    # The complement of a cone is none: a pin of the same slope from above touches at the tip.
    moved = Rigid(below, displacement=(None, 0.01))
    assert ContactProblem(body.fix("top", "y"), "bottom", moved).solve().contact_force > 0


def make_element():
    from skfem import ElementQuad1

    return ElementQuad1


@pytest.mark.parametrize(
    ("cone", "words"),
    [
        (Cone((0.0, 0.0), (0.0, 0.0), 1.0), "axis"),
        (Cone((0.0, 0.0), (0.0, 1.0), 0.0), "half_angle"),
        (Cone((0.0, 0.0), (0.0, 1.0), 1.6), "half_angle"),
        (Cone((0.0, 0.0), (0.0, 1.0), np.nan), "half_angle"),
        (Cone((0.0, 0.0, 0.0), (0.0, 1.0), 1.0), "dimension 3"),
    ],
)
def test_refused(cone, words):
    x = np.zeros((2, 1))
    with pytest.raises(InputError, match=words):
        cone(x, np.array([[0.0], [-1.0]]))
