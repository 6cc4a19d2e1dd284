"""The examples run headless and return the numbers that they print."""

import sys

import numpy as np
import pytest
from example_scripts import load


@pytest.mark.slow
def test_dissertation(tmp_path, capsys):
    found = load("cip_dissertation").main(
        ["--cells", "200", "400", "--advection-cells", "100", "200", "--output", str(tmp_path)]
    )
    np.testing.assert_allclose(found["2.1"]["linear"], [1.024e-2, 5.206e-3], rtol=5e-4)
    assert found["2.2"]["cubic"][0] <= 3.7e-6
    assert found["2.3"]["csl4"][1] <= 4e-8
    # Larger steps interpolate less often.
    assert found["2.6"]["cubic"] == sorted(found["2.6"]["cubic"], reverse=True)
    assert "dissertation" in capsys.readouterr().out
    assert (tmp_path / "cip_dissertation.png").exists()


@pytest.mark.slow
def test_two_dimensions(tmp_path, capsys):
    found = load("cip_two_dimensions").main(["--output", str(tmp_path)])
    assert found["1", "bicubic"][1] <= 6e-4
    assert found["2", "adini"][1][0] <= 0.008
    assert found["2", "bicubic"][1][1] <= 0.0086
    # A single step interpolates once.
    assert found["1", "one step"] <= 0.02 * found["1", "bicubic"][1]
    assert "printed" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {
        "cip_figure_3_2.png",
        "cip_figure_3_3.png",
    }


def test_jiang_shu(tmp_path, capsys):
    rows = load("cip_jiang_shu").main(["--cells", "100", "--output", str(tmp_path)])
    assert rows["csl4", "bounds"]["l1"] < rows["csl2", "bounds"]["l1"] < rows["csl2", None]["l1"]
    assert rows["cubic", "clamp"]["under"] >= 0
    assert "TV/TV0" in capsys.readouterr().out


@pytest.mark.slow
def test_zalesak(tmp_path, capsys):
    rows = load("cip_zalesak").main(["--cells", "40", "--steps", "60", "--output", str(tmp_path)])
    assert rows["adini", "eno"]["error"] < rows["adini", "clamp"]["error"]
    assert abs(rows["csl2", "bounds"]["mass"]) < 1e-6
    assert (tmp_path / "cip_zalesak.png").exists()
    assert "error" in capsys.readouterr().out


@pytest.mark.slow
def test_deformation(tmp_path, capsys):
    found = load("cip_deformation").main(
        ["--cells", "12", "--steps", "8", "--output", str(tmp_path)]
    )
    assert abs(found["csl2 bounds"]["mass"]) < 1e-13
    assert found["csl2 bounds"]["least"] >= -1e-13
    assert abs(found["csl4"]["mass"]) < 1e-13
    assert abs(found["splines"]["mass"]) > 1e-6
    assert "nodes" in capsys.readouterr().out
    assert (tmp_path / "cip_deformation.pvd").exists()
    assert (tmp_path / "cip_deformation.png").stat().st_size > 10_000


@pytest.mark.slow
def test_sensors(tmp_path, capsys):
    found = load("cip_sensors").main(
        ["--cells", "24", "--sensors", "10", "--output", str(tmp_path)]
    )
    assert found["placement"].efficiency > 0.9
    best = found["chosen"]
    assert best.explained
    for name, wanted in {"U": 0.6, "V": 0.3, "a": 0.4, "b": -0.3}.items():
        assert abs(best.parameters[name] - wanted) < 4 * best.parameter_deviations[name] < 0.3
    # Both choices of places stay within what they promise; before, the error was 0.37.
    for name, error in found["error"].items():
        assert error < 1.5 * np.sqrt(np.mean(found[name].deviations ** 2)) < 0.3
    assert best.deviations.mean() < found["random"].deviations.mean()
    assert "true 0.6" in capsys.readouterr().out
    assert (tmp_path / "cip_sensors.png").stat().st_size > 10_000


@pytest.mark.slow
def test_ash(tmp_path, capsys):
    found = load("cip_ash").main(["--cells", "48", "24", "--output", str(tmp_path)])
    # The candidates are .2 apart and puffs come every .05.
    assert np.max(np.abs(found["where"] - [0.66, 1.06])) < 0.06
    assert abs(found["when"] - 0.45) < 0.1
    assert found["total"] == pytest.approx(0.6, rel=0.15)
    assert found["analysis"].explained
    assert "how much" in capsys.readouterr().out
    assert (tmp_path / "cip_ash.png").stat().st_size > 10_000
    assert (tmp_path / "cip_ash.gif").stat().st_size > 50_000


def test_gain(tmp_path, capsys):
    found = load("cip_gain").main(["--cells", "30", "--output", str(tmp_path)])
    assert found["to SciPy"] < 1e-11
    assert found["slowest"] < 1
    # 380 analyses, correlated over some ten: a tenth in the root mean square.
    assert found["filtered"] == pytest.approx(found["expected"], rel=0.1)
    assert "stable" in capsys.readouterr().out
    assert (tmp_path / "cip_gain.png").exists()


def test_ensemble(tmp_path, capsys):
    pytest.importorskip("dapper", reason="DAPPER: pip install 'skfem-adini[ensemble]'")
    found = load("cip_ensemble").main(["--output", str(tmp_path)])
    # 400 members: the error of their mean is a twentieth of the spread, some three times over.
    assert found["between"] < 0.15 * found["spread"]
    assert found["4D-Var"] < 2 * found["spread"]
    assert (tmp_path / "cip_ensemble.png").exists()
    assert "rms" in capsys.readouterr().out


def test_ensemble_says_what_is_missing(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "dapper.da_methods", None)
    monkeypatch.setitem(sys.modules, "dapper", None)
    assert load("cip_ensemble").main(["--output", str(tmp_path)]) == {}
    assert "skipped: DAPPER is not installed; pip install" in capsys.readouterr().out


@pytest.mark.slow
def test_identification(tmp_path, capsys):
    found = load("identify_velocity").main(["--problems", "6", "--output", str(tmp_path)])
    for noise, bound in ((0.0, 1e-4), (1e-3, 2e-3), (1e-2, 1e-2)):
        assert found["errors"][noise] <= bound
    # One snapshot fits, and the answer is wrong: the warning says it.
    assert found["explained"]
    assert found["lost"] > 0.1
    assert "do not determine" in found["said"][0]
    assert np.max(np.abs(found["z"])) < 4.0
    assert "deviation" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {
        "identify_velocity.png",
        "identify_velocity_histogram.png",
    }
