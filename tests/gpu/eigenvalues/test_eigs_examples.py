"""The example of a spectrum shows what it says, and draws it."""

from example_scripts import load


def test_spectrum(tmp_path):
    shown = load("eigs_spectrum").main(["--order", "150", "--output", str(tmp_path)])
    assert shown["residual"] < 1e-9
    assert shown["distance to LAPACK's"] < 1e-9
    # A larger space needs fewer products.
    assert shown["products, ncv = 60"] < shown["products, ncv = 25"]
    assert (tmp_path / "eigs_spectrum.png").stat().st_size > 10_000
