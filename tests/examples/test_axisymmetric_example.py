"""A sphere and a cone on an axisymmetric half space: the script beside Hertz and Sneddon."""

import numpy as np
import pytest

# The script runs in every CI run by itself; what it finds is checked in the slow lane.
pytestmark = pytest.mark.slow


def test_hertz_and_sneddon(example, tmp_path):
    """At 16 cells a contact radius: 2e-3 for the sphere, 5e-3 for the cone."""
    found = example("validation_axisymmetric").main(["--output", str(tmp_path)])
    assert len(found) == 6
    for name, row in found.items():
        bound = 2e-3 if name.startswith("sphere") else 5e-3
        assert row.pressure < bound, name
        assert abs(row.radius) < bound, name
        assert abs(row.force) < bound, name
        assert max(row.result.kkt.values()) < 1e-10
        assert np.abs(row.result.balance()["residual"]).max() < 1e-9
    assert (tmp_path / "validation_axisymmetric.png").stat().st_size > 10_000
