"""Contact against the literature: examples/validation_*.py, with the tolerances they promise."""

import numpy as np
import pytest
from convergence import order


def draws(script, folder):
    """What the script returns; its picture bears its name."""
    found = script.main(["--output", str(folder)])
    assert (folder / f"{script.__name__}.png").stat().st_size > 10_000
    return found


@pytest.fixture(scope="module")
def line(example, tmp_path_factory):
    return draws(example("validation_hertz_line"), tmp_path_factory.mktemp("line"))


@pytest.mark.slow
def test_hertz_line(line):
    """rms(p) / p0 <= 5e-4 and half-width within 1e-3 at h / a = 1 / 16, both at rate 2."""
    fine = line.rows[-1]
    assert fine["pressure"] < 5e-4
    assert abs(fine["half_width"]) < 1e-3
    assert abs(fine["force"]) < 1e-8
    for name in ("pressure", "half_width"):
        assert 1.8 < order([4, 8, 16], [abs(row[name]) for row in line.rows]) < 2.5


@pytest.mark.slow
def test_nafems_cgs1(line):
    """6.21 mm and 3585 MPa within 1 %."""
    a, p = line.cgs1
    assert a == pytest.approx(6.21, rel=0.01)
    assert p == pytest.approx(3585, rel=0.01)


@pytest.mark.slow
def test_flat_punch(example, tmp_path):
    """Centre pressure at h / a = 1 / 16 within .5 % (gauss) and 3 % (bernstein), first order."""
    found = draws(example("validation_flat_punch"), tmp_path)
    assert abs(found["gauss"][-1] - 1) < 0.005
    assert abs(found["bernstein"][-1] - 1) < 0.03
    assert 0.8 < order([4, 8, 16], np.abs(np.array(found["bernstein"]) - 1)) < 1.3


@pytest.mark.slow
def test_hertz_sphere_coarse(example):
    found = example("validation_hertz_sphere").sphere(2)
    assert found.force == pytest.approx(1.0, abs=1e-8)
    assert found.p0 == pytest.approx(1.0, abs=0.05)
    assert found.a == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_hertz_sphere(example):
    """p0 within 2 % at h / a = 1 / 8."""
    found = example("validation_hertz_sphere").sphere(8)
    assert found.p0 == pytest.approx(1.0, abs=0.02)
    assert found.a == pytest.approx(1.0, abs=0.02)


def test_boussinesq_is_in_equilibrium(example):
    """The stress that loads the far sides: free of divergence, and its resultant is the force."""
    script = example("validation_hertz_sphere")
    x, h = np.random.default_rng(3).uniform(0.5, 2.0, (3, 20)), 1e-4
    divergence = np.zeros((3, 20))
    for j in range(3):
        step = h * np.eye(3)[:, j : j + 1]
        difference = script.boussinesq(x + step)[:, j] - script.boussinesq(x - step)[:, j]
        divergence += difference / (2 * h)
    # Central differences.
    assert np.abs(divergence).max() < 1e-6 * np.abs(script.boussinesq(x)).max()
    theta, phi = np.meshgrid(*((np.arange(200) + 0.5) / 200 * a for a in (np.pi / 2, 2 * np.pi)))
    n = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    traction = np.einsum("ij...,j...->i...", script.boussinesq(3.0 * n), n)
    area = 9.0 * np.sin(theta) * (np.pi / 400) * (np.pi / 100)
    total = (traction * area).sum(axis=(1, 2))
    # The midpoint rule.
    np.testing.assert_allclose(total, [0, 0, -script.P], atol=1e-4 * script.P)


@pytest.mark.slow
def test_membrane(example, tmp_path):
    """Contact force, energy and contact set against quadratic triangles and another solver: 1 %."""
    ours, reference = draws(example("validation_membrane"), tmp_path)
    assert ours.force == pytest.approx(reference.force, rel=0.01)
    assert ours.energy == pytest.approx(reference.energy, rel=0.01)
    assert np.sum(ours.close != reference.close) < 0.01 * np.sum(reference.close)


@pytest.mark.slow
def test_stress_below_a_line_contact(example):
    """Hertz' own stress at any depth, and a point force's far away."""
    found = example("validation_far_field").line([0.5, 2.0, 5.0, 15.0, 40.0])
    own = {r: errors[0] for r, errors in found.items()}
    far = {r: errors[1] for r, errors in found.items()}
    pair = {r: errors[2] for r, errors in found.items()}
    # 1e-3 and less; the second moment of the contact adds 2 % to the point force's at 5 a.
    assert max(own.values()) < 0.002
    assert far[15.0] < 0.01
    assert far[5.0] == pytest.approx(0.02, abs=0.01)
    # 1e-3: two forces with that second moment.
    assert max(pair[r] for r in (5.0, 15.0, 40.0)) < 0.01


def test_pair_of_forces_is_the_far_field_of_hertz(example):
    """Closed forms alone: a point force is off like (a / r)^2, the pair like (a / r)^4."""
    script = example("validation_far_field")
    angle = np.linspace(0.1, 1.5, 20)
    where = np.array([np.cos(angle), np.sin(angle)])
    radii = [5, 10, 20]
    exact = [script.hertz(r * where, 2 / np.pi) for r in radii]
    one = [script.stress(r * where, (0.0, 1.0)) for r in radii]
    two = [script.pair(r * where, 1.0) for r in radii]
    for fields, rate in ((one, 2), (two, 4)):
        off = [script.deviation(s, e) for s, e in zip(fields, exact, strict=True)]
        assert order(radii, off) == pytest.approx(rate, abs=0.1)


@pytest.mark.slow
def test_stress_far_below_a_point_contact(example):
    """1 % at five radii, of four forces with the second moment of the pressure."""
    found = example("validation_far_field").point([5.0, 7.5], cells=3, growth=1.15)
    # .0075 and .0063; a single force misses by that moment.
    assert max(four for _, four in found.values()) < 0.01
    assert found[5.0][0] < 0.05


@pytest.mark.slow
def test_order(example, tmp_path):
    """An end of contact inside the boundary costs an order; contact everywhere does not."""
    found = draws(example("validation_order"), tmp_path)
    # 3/2 in theory; where in a cell contact ends scatters the fit upwards (1.5 to 1.95 measured).
    assert 1.3 < found["part"] < 2.1
    assert 2.7 < found["all"] < 3.3
    # With the end on a vertex and the closed form: 1.56 and 1.48, and 2.1 away from it.
    assert found["hertz, all"] == pytest.approx(1.5, abs=0.15)
    assert found["hertz, end"] == pytest.approx(1.5, abs=0.15)
    assert found["hertz, away"] > 1.9
