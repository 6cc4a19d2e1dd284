"""The examples of heat control: what they print is checked, the pictures are written."""

import pytest


@pytest.mark.turns(4)
def test_heat_control(example, tmp_path):
    script = example("heat_control")
    numbers = script.main(["--modes", "5", "--subspaces", "20", "40", "--output", str(tmp_path)])
    assert numbers["default"][1] < 1e-10
    for pi in ("printed", "symmetric"):
        coarse, fine = numbers[f"{pi} 20"], numbers[f"{pi} 40"]
        assert fine[1] < coarse[1]
        assert fine[2] == pytest.approx(-0.31234, abs=1e-4)
    assert numbers["symmetric 20"][1] < 0.7 * numbers["printed 20"][1]
    assert numbers["driven"] < 0.1 * numbers["free"]
    for name in ("heat_control.png", "heat_control.gif"):
        assert (tmp_path / name).stat().st_size > 10000


def test_heat_skfem(example, tmp_path):
    numbers = example("heat_skfem").main(["--refine", "1", "--output", str(tmp_path)])
    assert numbers["paid"] == pytest.approx(numbers["promised"], rel=5e-3)
    assert numbers["residual"] < 1e-10
    assert (tmp_path / "heat_skfem.png").stat().st_size > 10000
