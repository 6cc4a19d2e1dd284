"""Results of large strain as tables, texts, grids and pictures, beside what they are made of."""

import pickle

import numpy as np
import pytest
from rubber_blocks import FLOOR, alone, cube, pressed
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementTriP1,
    ElementTriP2,
    LinearForm,
    MeshQuad,
    MeshTri,
)
from skfem.helpers import ddot, grad

from contact import (
    ContactProblem,
    ElasticBody,
    FinitePlasticity,
    InputError,
    NeoHooke,
    NonlinearBody,
    NonlinearStepper,
    Pair,
    Plane,
    Tie,
)
from contact.plot import plot_cells, plot_pressure, plot_tractions

RUBBER = NeoHooke(1.0, 9.0)


@pytest.fixture(scope="module")
def history():
    metal = FinitePlasticity(100.0, 0.3, 1.0, 10.0)
    return pressed(cube(ElementQuad1, metal, n=3), 0.2, 0.1).run([0.5, 1.0])


def stack(kind):
    """A block of rubber on one of small strain on the floor, pressed; touching or tied."""
    low = MeshQuad.init_tensor(np.linspace(-0.5, 1.5, 6), np.linspace(0.0, 0.5, 3))
    lower = ElasticBody.from_mesh(low.with_defaults(), ElementQuad1(), E=50.0, nu=0.3)
    lower.fix("left", "x").named("plate")
    high = MeshQuad().refined(2).translated((0.0, 0.5)).with_defaults()
    upper = NonlinearBody.from_mesh(high, ElementQuad1(), stress=RUBBER).fix("top").named("rubber")
    lower.fix("bottom")
    pair = kind(upper, "bottom", lower, "top")
    stepper = NonlinearStepper(ContactProblem([upper, lower], [pair]))
    return stepper.move("top", "y", -0.1, body="rubber").run([1.0])[-1]


def test_tables_are_the_result(history):
    pytest.importorskip("pandas")
    steps, result = history.to_frame(), history[-1]
    assert np.allclose(steps["force_y"], history.curve("top")[:, 1] * -1)
    assert list(steps["stick"] + steps["slip"]) == [(r.mu > 0).sum() for r in history]
    points = result.to_frame()
    assert np.array_equal(points["pressure"], result.mu / result.area)
    assert np.isclose((points["shear"] * result.area).sum(), result.resultant[0], atol=1e-12)
    assert np.all(points["shear"] * points["slip"] <= 0.0)  # friction on the body is against it


def test_texts_name_the_main_facts(history):
    result = history[-1]
    said = result.summary()
    for fact in (
        "coulomb, friction 0.2",
        "4 points",
        f"det F {result.certificate['det_F_min']:.3g}",
    ):
        assert fact in said
    assert f"{result.resultant[1]:.6g}" in said
    assert "<table>" in result._repr_html_()
    assert "2 steps" in history._repr_html_()
    assert pickle.loads(pickle.dumps(history))[-1].summary() == said
    assert len(history[:1]) == 1


def test_the_stress_of_a_uniform_block_is_known_everywhere():
    """P11 = F / A for a stretched bar, sigma11 = P11 l1 / J."""
    body = cube(ElementTriP2, RUBBER)
    body.fix("left", "x").fix("right", "x").fix("bottom", "y")
    result = alone(body).move("right", "x", 0.3).run([0.5, 1.0])[-1]
    one = result[0]
    J = one.volume_ratio()
    expected = result.reaction("right")[0] * 1.3 / J.mean()
    assert np.ptp(J) <= 1e-9
    for stress in (one.stress(), one.cell_stress(), one.nodal_stress()):
        assert np.allclose(stress[0, 0], expected, rtol=1e-8)
        assert np.abs(stress[1, 1]).max() <= 1e-8
    assert np.isclose(one.mesh.p[0].max(), 1.3)
    grid = one.to_pyvista()
    assert np.isclose(np.asarray(grid.points)[:, 0].max(), 1.3)
    assert np.allclose(grid.cell_data["stress_xx"], expected, rtol=1e-8)


@pytest.mark.parametrize("kind", [Pair, Tie])
def test_several_bodies(kind):
    pytest.importorskip("pyvista")
    result = stack(kind)
    force = -result.reaction("top", "rubber")[1]
    told = result.tie_resultants if kind is Tie else result.resultants
    assert np.isclose(told[0, 1], force, rtol=1e-8)
    whole = result.tie_force if kind is Tie else result.contact_force
    assert np.isclose(whole, force, rtol=1e-4)  # normals tilt
    name = "tie 0" if kind is Tie else "contact 0"
    blocks = result.to_pyvista()
    assert blocks.keys() == ["rubber", "plate", name, f"{name} opposite"]
    assert name in result.summary()
    heights = [np.asarray(blocks[n].points)[:, 1] for n in (name, f"{name} opposite")]
    assert np.abs(heights[0] - heights[1]).max() <= 1e-8
    assert np.abs(heights[0] - 0.5).max() <= 0.02  # where the bodies are
    assert len(plot_tractions(result).lines) > 0
    drawn = result.plot(colour="von_mises").collections
    filled = [part.get_array() for part in drawn if part.get_array() is not None]
    assert [part.size for part in filled[:2]] == [16, 10]  # cells of both bodies


def test_points_of_a_curve_are_drawn_in_its_order():
    disk = MeshTri.init_circle(3)
    half = disk.restrict(np.flatnonzero(disk.p[1][disk.t].mean(axis=0) < 0.0))
    sides = {"top": lambda x: np.isclose(x[1], 0.0), "arc": lambda x: x[1] < -1e-9}
    mesh = MeshTri(half.p, half.t).with_boundaries(sides)
    body = NonlinearBody.from_mesh(mesh, ElementTriP1(), stress=RUBBER).fix("top")
    floor = Plane((0.0, -1.0), (0.0, 1.0))
    stepper = NonlinearStepper(ContactProblem(body, "arc", floor)).move("top", "y", -0.2)
    result = stepper.run([0.5, 1.0])[-1]
    line = result.boundary_to_pyvista()
    steps = np.linalg.norm(np.diff(np.asarray(line.points)[line.lines[1:]], axis=0), axis=1)
    assert line.lines[0] == result.mu.size
    assert steps.max() <= 1.5 * np.pi / (result.mu.size - 1)  # the arc is about as long as before
    pressure = plot_tractions(result).lines[0].get_ydata()
    assert np.sum(np.diff(np.sign(np.diff(pressure[pressure > 0]))) != 0) <= 1  # one hill


def test_pictures(history):
    result = history[-1]
    ax = plot_tractions(result)
    assert ax.lines[0].get_xdata().size == result.mu.size
    assert np.allclose(np.sort(ax.lines[0].get_ydata()), np.sort(result.pressure))
    drawn = result.plot(colour="alpha").collections[0]
    assert np.allclose(drawn.get_array(), result[0].scalars["alpha"])
    cells = plot_cells(result).collections[0]
    assert np.allclose(cells.get_array(), result[0].scalars["von_mises"])
    with pytest.raises(InputError, match=r"colour='beta': expected .*alpha"):
        result.plot(colour="beta")
    in_space = pressed(cube(ElementHex1, RUBBER, n=1), 0.0, 0.1).run([1.0])[-1]
    faces = plot_pressure(in_space).collections[0]
    assert np.allclose(faces.get_array(), in_space.pressure.mean())


@LinearForm
def spring(v, w):
    return ddot(w["u"].grad, grad(v))


def test_forms_do_not_say_their_stress():
    mesh = MeshQuad().refined(1).with_defaults()
    body = NonlinearBody.from_forms(mesh, ElementQuad1(), internal=spring).fix("top")
    problem = ContactProblem(body, "bottom", FLOOR[2])
    result = NonlinearStepper(problem).move("top", "y", -0.1).run([1.0])[-1]
    grid = result.to_pyvista()
    assert "stress_xx" not in grid.cell_data
    assert np.allclose(grid.cell_data["det_F"], 0.9)
    with pytest.raises(InputError, match="forms do not say"):
        result[0].stress()
