"""Histories on a grid whose obstacle is given at another place in every step."""

import pickle

import numpy as np
import pytest

from contact import (
    GridContact,
    GridResult,
    HalfSpace,
    InputError,
    Moved,
    Parabola,
    PeriodicLayers,
    Plane,
    Rigid,
    Rough,
    Sphere,
)

F, G, N = 0.3, 2e-3, 32
WAVES = 2e-3 * (np.cos(2 * np.pi * np.arange(N) / N) - 1.0)


def compliance(dim, kind="half space"):
    if kind == "layers":
        return PeriodicLayers(
            (1.0,) * (dim - 1), [(0.3, 4, 1.0, 0.3)], (N // (dim - 1),) * (dim - 1)
        )
    return HalfSpace((1.0,) * (dim - 1), (N // (dim - 1),) * (dim - 1), E=1.0, nu=0.3)


def tools(dim):
    """Tools before a body that lies above: from the way along the surface to the shape there."""
    waves = WAVES if dim == 2 else WAVES[:, None] + WAVES
    rough, lengths = Rough(waves, (1.0,) * (dim - 1)), (1.0,) * (dim - 1)
    middle = np.r_[np.full(dim - 1, 0.5), 0.0]
    ball = Sphere(middle - np.eye(dim)[-1], 1.0)
    return {
        "Rough": lambda c: Rough(waves, lengths, point=c),
        "Moved Rough": lambda c: Moved(rough, c),
        "Parabola": lambda c: Parabola(middle + c, 1.0),
        "Moved Sphere": lambda c: Moved(ball, c),
        "Plane": lambda c: Plane(c, np.eye(dim)[-1]),
    }


@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", tools(2))
@pytest.mark.parametrize("dim", [2, 3])
def test_a_random_history_slips_against_its_motion(dim, kind, seed):
    """Whatever the path, in the end all slips: T = F N, or the whole bound, along the last way."""
    rng = np.random.default_rng([seed, dim, len(kind)])
    law = ("coulomb", "tresca")[seed % 2]
    tool, body = tools(dim)[kind], compliance(dim)
    ways = [np.zeros(dim), *(np.r_[c, 0.0] for c in rng.uniform(-0.1, 0.1, (3, dim - 1)))]
    last = rng.choice([-1, 1], dim - 1) * rng.uniform(0.1, 0.2, dim - 1)
    ways.append(ways[-1] + np.r_[last, 0.0])
    press = (None,) * (dim - 1) + (1e-3,)
    still = (0.0,) * (dim - 1) + (None,)
    steps = [Rigid(tool(c), displacement=still, force=press) for c in ways]
    contact = GridContact(body, steps[0], F if law == "coulomb" else G, law)
    results = contact.history(steps)
    end = results[-1]
    bound = F * end.pressure if law == "coulomb" else np.full_like(end.pressure, G)
    rubs = bound > 1e-6 * bound.max()
    unit = (last / np.linalg.norm(last)).reshape((-1,) + (1,) * end.pressure.ndim)
    np.testing.assert_allclose(np.linalg.norm(end.shear, axis=0)[rubs], bound[rubs], rtol=1e-6)
    least = 1 - 1e-6 if dim == 2 else 0.95  # in space the surface's own motion turns it a little
    assert np.all(np.sum(end.shear * unit, axis=0)[rubs] >= least * bound[rubs])
    assert max(end.kkt.values()) <= 1e-10
    # What has slipped altogether is the way, but for the strains.
    np.testing.assert_allclose(end.slip.mean(axis=tuple(range(1, dim))), -ways[-1][:-1], atol=0.02)


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("kind", ["half space", "layers"])
def test_a_plane_moves_as_in_a_rigid(law, kind, tmp_path):
    """The shear of every step, through partial slip, and from a file as well."""
    body, friction = compliance(2, kind), F if law == "coulomb" else G
    ways = [0.0, 2e-4, 5e-4, 3e-4, 0.01, 0.009]
    press = {"displacement": (0.0, 2e-3)} if kind == "layers" else {
        "displacement": (0.0, None), "force": (None, 2e-3)}  # fmt: skip
    flat = [Rigid(Plane((s, 0.0), (0, 1)), **press) for s in ways]
    drawn = [
        Rigid(Plane((0.0, 0.0), (0, 1)), **press | {"displacement": (s, press["displacement"][1])})
        for s in ways
    ]
    ours = GridContact(body, flat[0], friction, law).history(flat)
    theirs = GridContact(body, drawn[0], friction, law).history(drawn)
    for one, other in zip(ours, theirs, strict=True):
        for name in ("shear", "pressure", "u", "slip"):
            a, b = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(a, b, atol=1e-9 * max(np.abs(b).max(), 1e-6))
    assert np.abs(theirs[-1].shear).max() > 1e-5
    loaded = GridResult.load(ours[3].save(tmp_path / "step"))
    np.testing.assert_allclose(loaded.slip, ours[3].slip, atol=1e-15)
    step = GridContact(body, flat[4], friction, law)
    np.testing.assert_allclose(
        step.solve(after=loaded, motion=(ways[4] - ways[3], 0.0)).shear, ours[4].shear, atol=1e-12
    )
    kept = ours[3] if kind == "layers" else pickle.loads(pickle.dumps(ours[3]))
    np.testing.assert_allclose(step.solve(after=kept).shear, ours[4].shear, atol=1e-12)


def test_rolled_heights_are_asked_for():
    body, press = compliance(2), (None, 1e-3)
    steps = [Rigid(-np.roll(WAVES, k), force=press) for k in range(5)]
    contact = GridContact(body, steps[0], F)
    with pytest.raises(InputError, match=r"^motion: .*GridContact.history"):
        contact.history(steps)
    first, second = contact.solve(), GridContact(body, steps[1], F)
    with pytest.raises(InputError, match="motion"):
        second.solve(after=first)
    told = contact.history(steps, motion=[(k / N, 0.0) for k in range(5)])
    same = [Rigid(Rough(WAVES, 1.0, point=(k / N, 0.0)), force=press) for k in range(5)]
    known = GridContact(body, same[0], F).history(same)
    for one, other in zip(told, known, strict=True):
        np.testing.assert_allclose(one.shear, other.shear, atol=1e-9)
    assert told[-1].resultant[0] == pytest.approx(F * 1e-3, rel=1e-8)
    straight = contact.history(steps, motion=[0] * 5)
    assert abs(straight[-1].resultant[0]) < 0.9 * F * 1e-3
    # Without friction, and for heights that stay, nothing is asked.
    GridContact(body, steps[0]).history(steps)
    GridContact(body, 0.0, F).history(
        [Rigid(-WAVES, force=press), Rigid(-WAVES, force=(None, 2e-3))]
    )
    for wrong in (0.0, [0], "0", [(1.0,)] * 5, [(np.nan, 0.0)] * 5):
        with pytest.raises(InputError, match="motion"):
            contact.history(steps, motion=wrong)
    with pytest.raises(InputError, match="motion"):
        contact.solve(motion=0)
