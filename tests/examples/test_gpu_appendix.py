"""The appendix on the host: the three calls of its QR solution, its kernels, its table."""

import numpy as np
import pytest


@pytest.fixture(scope="module")
def appendix(example):
    return example("gpu_appendix")


def test_qr_solution_is_that_of_lu(appendix):
    A, f = np.random.default_rng(1).standard_normal((2, 40, 40))
    x = np.linalg.solve(A, f[0])
    # Both are backward stable: they differ by the condition times rounding.
    limit = 100 * np.linalg.cond(A) * np.finfo(float).eps * np.linalg.norm(x)
    assert np.linalg.norm(appendix.solve_by_qr(A, f[0]) - x) < limit


@pytest.mark.parametrize("size", [64, 1000])
def test_the_host_path_says_so_and_fills_the_table(appendix, monkeypatch, capsys, size, tmp_path):
    monkeypatch.setattr(appendix, "has_device", lambda: False)
    seconds = appendix.main(["--size", str(size), "--order", "30", "--output", str(tmp_path)])
    assert (tmp_path / "gpu_appendix.png").stat().st_size > 10_000
    assert "NumPy on the host" in capsys.readouterr().out
    assert set(seconds) == {"vector addition", "solve by QR", "copy, neighbours", "copy, strided"}
    assert all(value > 0 for value in seconds.values())


@pytest.mark.gpu
def test_the_device_path_checks_its_results(appendix, tmp_path):
    if not appendix.has_device():
        pytest.skip("no CuPy or no device: pip install 'skfem-adini[cuda13]'")
    seconds = appendix.main(["--size", "100000", "--order", "200", "--output", str(tmp_path)])
    assert {"to the device, pinned", "allocation, pool"} <= set(seconds)
