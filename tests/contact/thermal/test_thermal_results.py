"""Results of thermal contact on disk, in pictures and as VTK; what is refused."""

import matplotlib as mpl
import numpy as np
import pytest
from hot_bodies import blocks, floor, two_bodies
from skfem import ElementHex1, ElementTriP2

from contact import (
    ContactResult,
    InputError,
    ThermalContact,
    ThermalResult,
    Unbounded,
)
from skfem_adini import ElementQuadAdini

mpl.use("Agg")


@pytest.mark.parametrize("element", [ElementTriP2, ElementQuadAdini, ElementHex1])
def test_files_hold_everything(element, tmp_path):
    result = floor(element, expansion=1e-3).fix("top", 1.0).solve()
    again = ThermalResult.load(result.save(tmp_path / "steady"))
    assert again.kkt == pytest.approx(result.kkt, abs=1e-12)
    assert np.array_equal(again.T, result.T)
    assert np.array_equal(again.flux, result.flux)
    assert again.summary() == result.summary()
    assert again.gain == result.gain
    assert np.array_equal(again.contact.stress(), result.contact.stress())
    with pytest.raises(InputError, match="it holds a ThermalResult"):
        ContactResult.load(tmp_path / "steady.npz")


def test_a_step_is_stored_with_the_one_before_and_a_changed_file_is_refused(tmp_path):
    step = two_bodies().run([0.0, 0.1, 0.3])[-1]
    path = step.save(tmp_path / "step.npz")
    again = ThermalResult.load(path)
    assert again.balance() == step.balance()
    assert again.time == 0.3
    assert "unconverged" not in again.certificate()
    wrong = type(step)(**(vars(step) | {"conductance": 1.1 * step.conductance}))
    assert wrong.kkt["heat"] > 1e-4
    with pytest.raises(InputError, match="does not solve the problem"):
        ThermalResult.load(wrong.save(tmp_path / "wrong.npz"))


def test_pictures_and_vtk(tmp_path):
    result = two_bodies().solve()
    assert result.plot().get_xlabel() == "x"
    blocks = result.to_pyvista()
    upper = blocks[0]
    at = np.asarray(upper.points)[:, :2].T
    assert upper.point_data["temperature"] == pytest.approx(result.sample(at, 0), abs=1e-9)
    points = result.boundary_to_pyvista()
    assert np.array_equal(points.point_data["heat_flux"], result.flux)
    solid = floor(ElementHex1).fix("top", 1.0).solve()
    assert solid.plot().name == "3d"
    assert solid.to_pyvista().point_data["temperature"].max() == pytest.approx(1.0)
    assert repr(solid).startswith("ThermalResult(temperature ")
    with pytest.raises(InputError, match=r"^ax: .* axes with projection"):
        solid.plot(result.plot())


def test_nothing_determines_a_temperature():
    upper, lower, problem = blocks()
    model = ThermalContact(problem, 1.0, 0.0, capacity=1.0).fix("top", 1.0, body=upper)
    with pytest.raises(Unbounded, match=r"^body 1: nothing determines its temperature"):
        model.solve()
    warm = model.run([0.0, 1.0], initial=[1.0, 3.0])[-1]
    assert warm.sample([[0.5], [-0.5]], lower) == pytest.approx(3.0)
