"""The lane on an imitated processor sets names that the installed NumPy knows, or fails."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
pytestmark = pytest.mark.skipif(
    not (ROOT / ".ci").is_dir(), reason="a source distribution has no lanes"
)


@pytest.fixture
def lane():
    spec = importlib.util.spec_from_file_location("lane", ROOT / ".ci/other_processor.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def machine(lane, monkeypatch, dispatch):
    """A machine with every feature, and a NumPy with kernels for some."""
    has = dict.fromkeys([n for p in lane.PROCESSORS for n in p.brings] + list(lane.BEYOND), True)
    monkeypatch.setattr(lane, "__cpu_features__", has | dict.fromkeys(dispatch, True))
    monkeypatch.setattr(lane, "__cpu_dispatch__", list(dispatch))
    monkeypatch.setattr(lane, "_check", lambda names, off: None)


OLD = "SSSE3 SSE41 POPCNT SSE42 AVX F16C XOP FMA4 FMA3 AVX2 AVX512F AVX512CD AVX512_SKX AVX512_ICL"
NEW = "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"
OFF = {  # of each processor, by the tables of its maker
    "Prescott": (OLD, NEW),
    "Nehalem": ("AVX F16C XOP FMA4 FMA3 AVX2 AVX512F AVX512CD AVX512_SKX AVX512_ICL", NEW),
    "Sandybridge": ("F16C XOP FMA4 FMA3 AVX2 AVX512F AVX512CD AVX512_SKX AVX512_ICL", NEW),
    "Haswell": ("XOP FMA4 AVX512F AVX512CD AVX512_SKX AVX512_ICL", "X86_V4 AVX512_ICL AVX512_SPR"),
}


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("version", [0, 1], ids=["numpy 1.26", "numpy 2.4"])
def test_names_of_each_version(lane, monkeypatch, turn, version):
    machine(lane, monkeypatch, (OLD, NEW)[version].split())
    names = lane._names(turn)
    expected = OFF[names["OPENBLAS_CORETYPE"]][version].split()
    assert names["NPY_DISABLE_CPU_FEATURES"].split(",") == expected
    assert lane._names(turn + 4) == names


def test_a_new_name_fails(lane, monkeypatch):
    machine(lane, monkeypatch, ["X86_V3", "X86_V5"])
    with pytest.raises(SystemExit, match=r"kernels for X86_V5, which no processor here has"):
        lane._names(0)


def test_a_name_that_numpy_does_not_know_fails(lane):
    with pytest.raises(SystemExit, match="NumPy does not take"):
        lane._check({"NPY_DISABLE_CPU_FEATURES": "X86_V0"}, [])


def test_features_that_stay_on_fail(lane):
    on = [name for name, has in lane.__cpu_features__.items() if has]
    if not on:
        pytest.skip("NumPy knows no features of this processor")
    with pytest.raises(SystemExit, match="features that stay on"):
        lane._check({}, on[:1])


@pytest.mark.parametrize("turn", range(4))
def test_this_machine(turn):
    script = [sys.executable, str(ROOT / ".ci/other_processor.py"), str(turn)]
    said = subprocess.run(script, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
