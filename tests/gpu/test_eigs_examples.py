"""The example of a spectrum shows what it says, and draws it."""

import importlib.util
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "eigs_spectrum.py"


def test_spectrum(tmp_path):
    spec = importlib.util.spec_from_file_location("eigs_spectrum", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    shown = module.main(["--order", "150", "--output", str(tmp_path)])
    assert shown["residual"] < 1e-9
    assert shown["distance to LAPACK's"] < 1e-9
    # A larger space needs fewer products.
    assert shown["products, ncv = 60"] < shown["products, ncv = 25"]
    assert (tmp_path / "eigs_spectrum.png").stat().st_size > 10_000
