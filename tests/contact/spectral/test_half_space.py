"""The symbol of the half space beside point loads, waves and itself turned round."""

import numpy as np
import pytest

from contact import HalfSpace, InputError

E, NU = 2.5, 0.3
G = E / (2 * (1 + NU))


def drop(values, places):
    """Difference of two places, over neighbours: waves at the limit of the grid cancel."""
    smooth = 0.25 * (np.roll(values, 1) + 2 * values + np.roll(values, -1))
    return smooth[places[0]] - smooth[places[1]]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
def test_point_loads(sign, nu):
    """Boussinesq and Cerruti, as differences of two places, far from the images of the load.

    K. L. Johnson, Contact Mechanics, (3.18) and (3.75). The images change the differences by
    about one per cent.
    """
    n = 512
    shear = E / (2 * (1 + nu))
    space = HalfSpace((1.0, 1.0), (n, n), E, nu, normal=(0, 0, sign))
    x = (np.arange(n) - n // 2) / n
    inverse = drop(1 / np.where(x != 0, x, np.inf), places := (n // 2 + 8, n // 2 + 24))
    forces = np.zeros((3, n, n))
    forces[2, n // 2, n // 2] = -sign  # presses
    u = space.apply(forces)
    normal, lateral = -sign * u[2, :, n // 2], u[0, :, n // 2]
    assert drop(normal, places) == pytest.approx((1 - nu) / (2 * np.pi * shear) * inverse, rel=0.02)
    towards = -(1 - 2 * nu) / (4 * np.pi * shear) * inverse
    assert drop(lateral, places) == pytest.approx(towards, rel=0.02)
    forces = np.zeros((3, n, n))
    forces[0, n // 2, n // 2] = 1.0
    u = space.apply(forces)
    for values, factor in ((u[0, :, n // 2], 1.0), (u[0, n // 2, :], 1 - nu)):
        wanted = factor / (2 * np.pi * shear) * inverse
        assert drop(values, places) == pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize(
    ("lengths", "shape"),
    [((2.0,), (16,)), ((2.0,), (15,)), ((2.0, 3.0), (6, 8)), ((1.0, 1.0), (5, 7))],
)
def test_symmetric_and_positive(lengths, shape):
    """Also where waves at the limit of the grid are their own conjugates."""
    space = HalfSpace(lengths, shape, E, NU)
    n = (len(shape) + 1) * int(np.prod(shape))
    W = np.array([space.apply(e.reshape(len(shape) + 1, *shape)).ravel() for e in np.eye(n)])
    S = np.array([space.precondition(e.reshape(len(shape) + 1, *shape)).ravel() for e in np.eye(n)])
    assert pytest.approx(W.T, abs=1e-14 * np.abs(W).max()) == W
    assert pytest.approx(S.T, abs=1e-13 * np.abs(S).max()) == S
    values = np.linalg.eigvalsh(W)
    assert np.sum(np.abs(values) < 1e-12 * values.max()) == len(shape) + 1  # the mean
    assert values.min() > -1e-12 * values.max()
    assert np.linalg.eigvalsh(S).min() > 0
    means = np.eye(n) - np.kron(
        np.eye(len(shape) + 1), np.full((n // (len(shape) + 1),) * 2, (len(shape) + 1) / n)
    )
    assert pytest.approx(means, abs=1e-12) == W @ S


@pytest.mark.parametrize("shape", [(15,), (6, 8)])
def test_normal_products_alone(shape):
    """They are parts of the whole ones; the preconditioner inverts them but for the mean."""
    space = HalfSpace((1.0,) * len(shape), shape, E, NU)
    forces = np.zeros((len(shape) + 1, *shape))
    forces[-1] = np.random.default_rng(1).standard_normal(shape)
    u = space.apply_normal(forces[-1])
    assert u == pytest.approx(space.apply(forces)[-1], abs=1e-14)
    wanted = forces[-1] - forces[-1].mean()
    assert space.precondition_normal(u) == pytest.approx(wanted, abs=1e-12)


def test_plane_strain_is_a_space_whose_load_does_not_vary():
    line = HalfSpace(2.0, 16, E, NU)
    space = HalfSpace((2.0, 0.8), (16, 4), E, NU)
    forces = np.random.default_rng(0).standard_normal((2, 16))
    spread = np.zeros((3, 16, 4))
    spread[0], spread[2] = forces[0, :, None], forces[1, :, None]
    u = space.apply(spread * 0.2)  # a strip of 4 points carries the force of 4 x .2 per length
    assert u[0] == pytest.approx(np.repeat(line.apply(forces)[0][:, None], 4, axis=1), abs=1e-14)
    assert u[2] == pytest.approx(np.repeat(line.apply(forces)[1][:, None], 4, axis=1), abs=1e-14)
    assert u[1] == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"lengths": (1.0, -1.0)}, "lengths"),
        ({"lengths": (1.0, 1.0, 1.0)}, "lengths"),
        ({"shape": (8,)}, "shape"),
        ({"shape": (8, 0.5)}, "shape"),
        ({"E": 0.0}, "E="),
        ({"E": 1e308}, "E=1e[+]308: .* units"),
        ({"E": 1e-308}, "E=1e-308: .* units"),
        ({"lengths": (1e200, 1e200)}, "E=1.0: .* units"),
        ({"lengths": (1e-200, 1e-200)}, "E=1.0: .* units"),
        ({"nu": 0.5}, "nu"),
        ({"nu": np.nan}, "nu"),
        ({"normal": (0, 1, 1)}, "normal"),
        ({"normal": (0, 1)}, "normal"),
    ],
)
def test_refused(settings, words):
    given = {"lengths": (1.0, 1.0), "shape": (8, 8), "E": 1.0, "nu": 0.3}
    with pytest.raises(InputError, match=f"^{words}"):
        HalfSpace(**(given | settings))


@pytest.mark.parametrize(
    "forces", [np.zeros(8), np.zeros((2, 9)), np.zeros((2, 8)) * 1j, "x", None], ids=str
)
def test_forces_of_another_grid_or_kind_are_refused(forces):
    with pytest.raises(InputError, match=r"forces: expected an array of real numbers of shape \(2"):
        HalfSpace(1.0, 8, E=1.0, nu=0.3).apply(forces)
