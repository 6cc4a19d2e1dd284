"""Tables of contact points, steps and grids, beside the results that they are made from."""

import sys

import numpy as np
import pytest
from pressed_pairs import pair, stack
from skfem import ElementHex1

from contact import (
    GridContact,
    HalfSpace,
    LoadHistory,
    LoadStepper,
    MissingDependency,
    Parabola,
    Rigid,
    Status,
)

pandas = pytest.importorskip("pandas")


@pytest.mark.parametrize("case", ["plane", "space", "pair", "ties"])
def test_a_table_of_points_has_the_numbers_of_the_result(case, make):
    result = {
        "plane": lambda: make.solved(n=4, friction=0.4)[1],
        "space": lambda: make.dome(ElementHex1).solve(),
        "pair": lambda: pair().solve(),
        "ties": lambda: stack().solve(),
    }[case]()
    frame, dim = result.to_frame(), len(result.x)
    assert np.array_equal(frame[list("xyz"[:dim])].to_numpy().T, result.x_nominal)
    assert [Status[name.upper()] for name in frame["status"]] == list(result.status)
    assert np.array_equal(frame["boundary"], result.part)
    expected = {
        "gap": result.gap,
        "pressure": result.pressure + result.tie_pressure,
        "shear": result.shear + result.tie_shear,
        "slip": result.slip,
    }
    for name, values in expected.items():
        columns = [c for c in frame if c.startswith(name)]
        assert np.array_equal(frame[columns].to_numpy(), values.reshape(len(frame), -1))
    assert np.any(expected["pressure"] > 0)


def test_a_table_of_steps_and_what_notebooks_show():
    problem = pair()
    stepper = LoadStepper(problem).load("top", (0.01, 0.0), body="upper")
    assert "no step" in stepper.history._repr_html_()
    history = stepper.run([0.5, 1.0])
    frame = history.to_frame()
    assert np.array_equal(frame["t"], history.times)
    assert np.array_equal(frame[["force_x", "force_y"]].to_numpy(), history.resultant)
    counted = frame[["open", "stick", "slip"]].to_numpy().sum(axis=1)
    assert np.array_equal(counted, [r.status.size for r in history])
    assert list(frame["largest_pressure"]) == [r.pressure.max() for r in history]
    assert list(frame["largest_residual"]) == [max(r.kkt.values()) for r in history]
    assert "2 steps from t = 0.5 to 1" in history._repr_html_()
    assert LoadHistory().to_frame().shape == (0, 1)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_grid_as_a_dataset(dim):
    pytest.importorskip("xarray")
    lengths, cells = ((1.0,), (16,)) if dim == 2 else ((1.0, 2.0), (16, 8))
    place = (0.5, 0.5, 0.0) if dim == 3 else (0.5, 0.0)
    force = (0.001,) + (0.0,) * (dim - 2) + (0.005,)
    ball = Rigid(Parabola(place, radius=2.0), force=force)
    result = GridContact(HalfSpace(lengths, cells, E=1.0, nu=0.3), ball, friction=0.4).solve()
    found = result.to_xarray()
    assert found["pressure"].dims == ("x", "y")[: dim - 1]
    highest = found["pressure"].argmax(...)
    assert abs(float(found["x"][highest["x"]]) - 0.5) < 0.07
    for name, values in (("pressure", result.pressure), ("gap", result.opening)):
        assert np.array_equal(found[name], values)
    assert np.array_equal(found["shear"].sel(direction="x"), result.shear[0])
    assert np.array_equal(found["displacement"].sel(component="xyz"[dim - 1]), result.u[-1])
    assert found.attrs == result.kkt


def test_a_missing_library_is_named(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingDependency, match="pip install pandas"):
        make.solved(n=4, friction=0.4)[1].to_frame()
