"""Examples of cip return the numbers that they print."""

import sys

import numpy as np
import pytest


@pytest.mark.slow
def test_dissertation(run):
    found = run(
        "cip_dissertation", "--cells", "200", "400", "--advection-cells", "100", "200",
        says="dissertation", files=["cip_dissertation.png"],
    )  # fmt: skip
    np.testing.assert_allclose(found["2.1"]["linear"], [1.024e-2, 5.206e-3], rtol=5e-4)
    assert found["2.2"]["cubic"][0] <= 3.7e-6
    assert found["2.3"]["csl4"][1] <= 4e-8
    # Larger steps interpolate less often.
    assert found["2.6"]["cubic"] == sorted(found["2.6"]["cubic"], reverse=True)


@pytest.mark.slow
def test_two_dimensions(run):
    files = ["cip_figure_3_2.png", "cip_figure_3_3.png"]
    found = run("cip_two_dimensions", says="printed", files=files)
    assert found["1", "bicubic"][1] <= 6e-4
    assert found["2", "adini"][1][0] <= 0.008
    assert found["2", "bicubic"][1][1] <= 0.0086
    # A single step interpolates once.
    assert found["1", "one step"] <= 0.02 * found["1", "bicubic"][1]


def test_jiang_shu(run):
    rows = run("cip_jiang_shu", "--cells", "100", says="TV/TV0")
    assert rows["csl4", "bounds"]["l1"] < rows["csl2", "bounds"]["l1"] < rows["csl2", None]["l1"]
    assert rows["cubic", "clamp"]["under"] >= 0


@pytest.mark.slow
def test_zalesak(run):
    files = ["cip_zalesak.png"]
    rows = run("cip_zalesak", "--cells", "40", "--steps", "60", says="error", files=files)
    assert rows["adini", "eno"]["error"] < rows["adini", "clamp"]["error"]
    assert abs(rows["csl2", "bounds"]["mass"]) < 1e-6


@pytest.mark.slow
def test_deformation(run):
    files = ["cip_deformation.pvd", "cip_deformation.png"]
    found = run("cip_deformation", "--cells", "12", "--steps", "8", says="nodes", files=files)
    assert abs(found["csl2 bounds"]["mass"]) < 1e-13
    assert found["csl2 bounds"]["least"] >= -1e-13
    assert abs(found["csl4"]["mass"]) < 1e-13
    assert abs(found["splines"]["mass"]) > 1e-6


@pytest.mark.turns(4)
def test_week(run):
    pytest.importorskip("xarray")
    files = ["cip_week.gif", "cip_week.png", "week/snapshot_00014.npz"]
    left, week = run("cip_week", says="on 2026-03-08 the masses", files=files)
    for name, exact in {"smoke": 1.0, "pollen": 1.0, "dust": np.exp(-0.7)}.items():
        assert left[name] == pytest.approx(exact, rel=1e-12)
    assert max(np.abs(one.residual).max() / one.mass.max() for one in week.budget.values()) < 1e-13


@pytest.mark.slow
def test_sensors(run):
    files = ["cip_sensors.png"]
    found = run("cip_sensors", "--cells", "24", "--sensors", "10", says="true 0.6", files=files)
    assert found["placement"].efficiency > 0.9
    best = found["chosen"]
    assert best.explained
    for name, wanted in {"U": 0.6, "V": 0.3, "a": 0.4, "b": -0.3}.items():
        assert abs(best.parameters[name] - wanted) < 4 * best.parameter_deviations[name] < 0.3
    # Both choices of places stay within what they promise; before, the error was 0.37.
    for name, error in found["error"].items():
        assert error < 1.5 * np.sqrt(np.mean(found[name].deviations ** 2)) < 0.3
    assert best.deviations.mean() < found["random"].deviations.mean()


@pytest.mark.slow
def test_ash(run):
    files = ["cip_ash.png", "cip_ash.gif"]
    found = run("cip_ash", "--cells", "48", "24", says="how much", files=files)
    # The candidates are .2 apart and puffs come every .05.
    assert np.max(np.abs(found["where"] - [0.66, 1.06])) < 0.06
    assert abs(found["when"] - 0.45) < 0.1
    assert found["total"] == pytest.approx(0.6, rel=0.15)
    assert found["analysis"].explained


def test_gain(run):
    found = run("cip_gain", "--cells", "30", says="stable", files=["cip_gain.png"])
    assert found["to SciPy"] < 1e-11
    assert found["slowest"] < 1
    # 380 analyses, correlated over some ten: a tenth in the root mean square.
    assert found["filtered"] == pytest.approx(found["expected"], rel=0.1)


def test_ensemble(run):
    pytest.importorskip("dapper", reason="DAPPER: pip install 'skfem-adini[ensemble]'")
    found = run("cip_ensemble", says="rms", files=["cip_ensemble.png"])
    # 400 members: the error of their mean is a twentieth of the spread, some three times over.
    assert found["between"] < 0.15 * found["spread"]
    assert found["4D-Var"] < 2 * found["spread"]


def test_ensemble_says_what_is_missing(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "dapper.da_methods", None)
    monkeypatch.setitem(sys.modules, "dapper", None)
    assert run("cip_ensemble", says="skipped: DAPPER is not installed; pip install") == {}


@pytest.mark.slow
def test_identification(run):
    files = ["identify_velocity.png", "identify_velocity_histogram.png"]
    found = run("identify_velocity", "--problems", "6", says="deviation", files=files)
    for noise, bound in ((0.0, 1e-4), (1e-3, 2e-3), (1e-2, 1e-2)):
        assert found["errors"][noise] <= bound
    # One snapshot fits, and the answer is wrong: the warning says it.
    assert found["explained"]
    assert found["lost"] > 0.1
    assert "do not determine" in found["said"][0]
    assert np.max(np.abs(found["z"])) < 4.0


def test_regional(run):
    found = run("cip_regional", says="unaccounted", files=["cip_regional.png"])
    assert found.inflow["x-"][-1] > found.outflow["x+"][-1] > 0.1
    assert np.abs(found.residual).max() < 1e-13


def test_sphere(run):
    found = run("cip_sphere", says="2 hills", files=["cip_sphere.png"])
    for name, mass in found[0].mass.items():
        assert found.final.mass[name] == pytest.approx(mass, rel=1e-13)
    assert np.abs(found.final.data - found[0].data).max() < 0.05
    # Drawn out, the hills are about as high as before.
    assert 0.7 < found[1].data.max() < 1.0
