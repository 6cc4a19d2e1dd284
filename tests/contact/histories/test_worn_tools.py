"""Adhesion, hardness and wear under rigid tools that move far."""

import numpy as np
import pytest
from far_blocks import BALL, LAWS, ROLLER, F, R, block, run
from scipy.integrate import solve_ivp
from skfem import ElementHex1, ElementQuad1, ElementTetP1, ElementTriP1, ElementTriP2

from contact import (
    Adhesion,
    ContactProblem,
    Cylinder,
    InputError,
    LoadHistory,
    LoadStepper,
    Moved,
    Rigid,
    Sphere,
    Wear,
)
from contact.obstacles.tool import WornTools
from skfem_adini import ElementQuadAdini

DEEP, C, K, WAY = 0.02, 2.0, 0.4, 0.6  # depth, stiffness of springs, coefficient of wear, path
ELEMENTS = [ElementTriP1, ElementQuad1, ElementTriP2, ElementQuadAdini, ElementTetP1, ElementHex1]


def springs(wear, count, n):
    """The last step of a roller along springs on a stiff block."""

    def tool(t):
        return Moved(ROLLER, (WAY * max(t - 1, 0) - WAY / 2, -DEEP * min(t, 1)))

    body = block(ElementQuad1, n, E=1e6)
    problem = ContactProblem(body, "top", tool(0), overclosure=C, wear=wear)
    return run(problem, tool, np.r_[1.0, 1 + np.arange(1, count + 1) / count]).results[-1]


def compressed(x):
    return np.maximum(DEEP - (R - np.sqrt(np.maximum(R**2 - x**2, 0.0))), 0.0)


def test_what_is_worn_off_a_tool_stays_with_it():
    """Places of the roller wear under springs that pass: w = c (1 - exp(-k C s))."""
    errors = []
    for n, count in ((16, 10), (32, 20)):
        last = springs(Wear(0.0, K), count, n)
        x = last.x[0] - WAY / 2
        there = np.abs(x) < 0.7 * np.sqrt(2 * R * DEEP)
        exact = compressed(x) * -np.expm1(-K * C * WAY)
        errors.append(np.abs(last.worn[1] - exact)[there].max() / exact.max())
        assert not last.worn[0].any()
    assert errors[1] < 0.07
    assert errors[0] > 1.5 * errors[1]


def test_what_is_worn_off_a_body_stays_behind():
    """Places of the body wear while the roller passes: dw/ds = k C (c(x - s) - w)."""
    errors = []
    for n, count in ((16, 10), (32, 30)):
        last = springs(Wear(K), count, n)
        x = last.x[0][np.abs(last.x[0]) < 0.4]

        def grows(s, w, x=x):
            return K * C * np.maximum(compressed(x + WAY / 2 - s) - w, 0.0)

        found = solve_ivp(grows, (0, WAY), 0.0 * x, max_step=2e-3).y[:, -1]
        errors.append(np.abs(last.worn[0][np.abs(last.x[0]) < 0.4] - found).max() / found.max())
    assert errors[1] < 0.06
    assert errors[0] > 1.5 * errors[1]


def test_lattices_of_tools():
    """Fields that vary slowly are kept, whatever the tool's frame; areas weigh."""
    rng, turn = np.random.default_rng(1), 0.3
    x = np.linspace(0, 1, 401)
    line = np.array([np.cos(turn) * x, np.sin(turn) * x])
    tools = WornTools(0.02, np.zeros((4, 0)))
    wave = 1.0 + np.sin(2 * np.pi * x)
    for _ in range(5):
        tools = tools.after(2, line, 0.2 * wave, rng.uniform(1.0, 1.1, x.size))
    assert np.abs(tools.depth(2, line) - wave).max() < 0.03 * wave.max()
    assert not tools.depth(1, line).any()
    assert np.abs(tools.depth(2, line + 1.0)).max() == 0.0
    assert np.array_equal(tools.after(2, line, wave, 0.0 * x).held, tools.held)


def ironed(element, law, unit=1.0, E=1.0, **surface):
    """A tool pressed, moved and turned, with the given friction."""
    dim = 3 if element in ELEMENTS[4:] else 2
    centre = (0.0,) * (dim - 1) + (unit * (R if dim == 2 else BALL),)
    shape = Cylinder(centre, unit * R) if dim == 2 else Sphere(centre, unit * BALL)
    given = dict(LAWS[law])
    if law == "tresca":
        given["friction"] *= E
    body = block(element, 16 if dim == 2 else 8, E=E, size=unit)

    def tool(t):
        w = unit * np.r_[0.4 * max(t - 1, 0) - 0.2, np.zeros(dim - 2), -0.03 * min(t, 1)]
        turn = 0.5 * max(t - 1, 0)
        return Rigid(shape, tuple(w), rotation=turn if dim == 2 else (0, turn, 0), centre=centre)

    problem = ContactProblem(body, "top", tool(0), **given, **surface)
    stepper = LoadStepper(problem, sliding="finite").obstacle(tool)
    return stepper.run([1.0, 1.2, 1.5, 2.0])


@pytest.mark.sampled(6)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
def test_laws_and_elements(element, law):
    """Certificates, volumes k F s, the hardness, and the same in other units."""
    one = ironed(element, law, wear=Wear(0.2, 0.1), hardness=0.04)
    E, unit = 2e11, 1e-3
    other = ironed(element, law, unit, E, wear=Wear(0.2 / E, 0.1 / E), hardness=0.04 * E)
    volume = np.zeros(2)
    for result, same in zip(one, other, strict=True):
        assert max(*result.kkt.values(), *same.kkt.values()) <= 1e-10
        slid = np.maximum(result.mu, 0) * np.linalg.norm(result.slip_increment, axis=1)
        volume += np.array([0.2, 0.1]) * slid.sum()
        assert result.worn_volume == pytest.approx(volume, rel=1e-9)
        assert result.pressure.max() <= 0.04 * (1 + 1e-9)
        assert np.abs(same.pressure / E - result.pressure).max() <= 1e-8
        assert np.abs(same.worn / unit - result.worn).max() <= 1e-7 * DEEP
        assert np.abs(same.indentation / unit - result.indentation).max() <= 1e-7 * DEEP
    assert volume[0] > 0
    assert one.results[-1].indentation.max() > 0
    assert np.all(np.diff([r.worn[0].max() for r in one]) >= 0)


def test_indentations_stay_and_reload_elastically():
    """Pressed, lifted and moved far away, pressed beside, and at the first place again."""
    places = [(0.0, -0.03), (0.6, 0.1), (0.3, -0.03), (0.0, 0.1), (0.0, -0.03)]
    problem = ContactProblem(block(n=24), "top", ROLLER, hardness=0.06)
    one, away, beside, lifted, again = run(
        problem, lambda t: Moved(ROLLER, places[int(t)]), np.arange(5.0)
    )
    size = one.indentation.max()
    assert size > 1e-3
    assert not away.pressure.any()
    assert np.array_equal(away.indentation, one.indentation)
    apart = one.x[0] > 0.4
    assert beside.indentation[apart].max() > 0.3 * size  # at other places
    assert np.array_equal(lifted.indentation, beside.indentation)
    still = one.x[0] < 0.0
    assert np.abs(again.indentation - one.indentation)[still].max() <= 0.05 * size


@pytest.mark.parametrize("law", ["exponential", "dugdale"])
def test_a_far_tool_adheres_as_one_at_home(law):
    """Pulled, by many contact widths, as the tool at rest on the mesh moved back."""
    glue, way = Adhesion(0.01, 1e-4, law), 0.3
    ends = [
        run(
            ContactProblem(block(n=40, shift=shift), "top", ROLLER, adhesion=glue),
            lambda t, far=far: Moved(ROLLER, (far * max(t - 1, 0), (-0.01, -0.002)[int(t) - 1])),
            [1.0, 2.0],
        ).results[-1]
        for shift, far in ((0.0, way), (-way, 0.0))
    ]
    one, other = ends
    assert one.pressure.min() < -0.005
    assert np.abs(one.pressure - other.pressure).max() <= 1e-9 * one.pressure.max()


def test_worn_tools_in_files(tmp_path):
    def stepper(other=0.1):
        tool = lambda t: Moved(ROLLER, (0.3 * t, -0.02), rotation=t, centre=(0.0, R))  # noqa: E731
        problem = ContactProblem(block(n=10), "top", tool(0), friction=F, wear=Wear(0.1, other))
        return LoadStepper(problem, sliding="finite").obstacle(tool)

    whole = stepper().run([0.3, 0.6, 1.0], path=tmp_path / "run")
    assert whole.results[-1].worn[1].max() > 0
    (tmp_path / "run" / "step_00003.npz").unlink()
    again = stepper().resume(tmp_path / "run")
    for one, two in zip(whole, again, strict=True):
        assert np.abs(one.worn - two.worn).max() <= 1e-9 * one.worn.max()
        assert one.worn_volume == pytest.approx(two.worn_volume, rel=1e-9)
    assert len(LoadHistory.load(tmp_path / "run")) == 3
    with pytest.raises(InputError, match="another problem"):
        stepper(0.2).resume(tmp_path / "run")


def test_bodies_that_slide_on_each_other_do_not_wear():
    low, up = block(n=12).named("low"), block(n=6).named("up")
    surface = low.surface("top")
    for more in ({"wear": 1.0}, {"hardness": 1.0}):
        problem = ContactProblem(up, "bottom", surface, **more)
        with pytest.raises(InputError, match="come and go"):
            LoadStepper(problem, sliding="finite")
