import pytest

from cip.characteristics import feet as characteristics
from cip.stages import stage as stages


@pytest.fixture
def equal_substeps(monkeypatch):
    """As many in every run: with another number the feet differ by up to 1e-8 cells."""

    def integrate(*arguments):
        return characteristics.integrate(*arguments[:6], substeps=16)

    monkeypatch.setattr(stages, "integrate", integrate)
    monkeypatch.setattr(stages.Stage, "substeps", lambda self, t, dt: 16)
