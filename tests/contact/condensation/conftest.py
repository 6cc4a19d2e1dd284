"""A device, or a library that imitates cuDSS on the host."""

import pytest
from fake_cudss import FakeCudss

from contact.condensation import condense as condense_module
from skfem_adini.solvers import cudss_library
from tests.contact.condensation.device_cases import Elsewhere


@pytest.fixture(params=["fake", pytest.param("device", marks=pytest.mark.gpu)])
def engine(request, monkeypatch):
    if request.param == "device":
        try:
            cudss_library.device_arrays()
            cudss_library.load_cudss()
        except ImportError:
            pytest.skip("cuDSS, CuPy or a CUDA device is not there")
        return None
    monkeypatch.setattr(condense_module, "arrays_on", lambda device: Elsewhere())
    return FakeCudss().put_in_place(monkeypatch)
