"""SciPy's own tests of eigs, eigsh, svds and the Riccati solvers, with the functions of `gpu`.

This file is also the plugin of the inner pytest, which puts our functions into SciPy's test
modules. `EXPECTED` lists what they refuse or answer otherwise, and why; each entry must occur.
"""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import pytest
from scipy.sparse.linalg import ArpackNoConvergence

import gpu

SUITES = {
    "scipy.sparse.linalg._eigen.arpack.tests.test_arpack": "test",
    "scipy.sparse.linalg._eigen.tests.test_svds": "Test_SVDS_ARPACK or test_small",
    "scipy.linalg.tests.test_solvers": "Are or are_",
}
# By suite: names of tests, what they tell, and why it is so.
EXPECTED = {
    "test_arpack": [
        ("test_symmetric_modes", "argument 'mode'", "no buckling and no Cayley mode"),
        ("test_real_nonsymmetric_modes", "argument 'OPpart'", "no real part of a complex inverse"),
        ("test_standard_nonsymmetric_no_conv", "Spurious no-error", "30 unknowns are decomposed"),
        ("test_reentering", "fail their certificate", "its operator ignores its argument"),
        (
            "test_eigs_for_k_greater",
            "",
            "k = n is found for each kind of A, k > n refused",
        ),
        ("test_eigsh_for_k_greater", "A is not symmetric", "eigh reads one half, we check both"),
    ],
    "test_svds": [
        ("test_svds_input_validation", "Expected regex|InputError", "refused in other words"),
        ("test_svds_input_validation_v0_3", "DID NOT RAISE", "whole numbers are numbers"),
        ("test_svds_input_validation_k_1.3", "DID NOT RAISE", "k may be the order"),
        ("test_svds_input_validation_ncv_1", "DID NOT RAISE", "other ncv are raised, or not used"),
        ("test_svds_parameter_tol", "tol=1.0", "a tolerance of one means nothing"),
        ("test_svd_(v0|rng)$", "DID NOT RAISE Assertion", "decomposed: equal for every start"),
        ("test_svd_maxiter", "0 of 1 eigenvalues converged", "refused in other words"),
    ],
    "test_solvers": [
        ("continuous_are.10-case10", "imaginary axis", "poles on the axis are not stable"),
    ],
}


def adapted(function):
    """Without arguments that have SciPy's default, and with SciPy's error of no convergence."""

    def call(*args, **options):
        for name, usual in (("OPpart", None), ("mode", "normal")):
            if options.get(name, usual) == usual:
                options.pop(name, None)
        try:
            return function(*args, **options)
        except gpu.NotConverged as error:
            raise ArpackNoConvergence(str(error), error.eigenvalues, error.eigenvectors) from None

    return call


OURS = {name: adapted(getattr(gpu, name)) for name in ("eigs", "eigsh", "svds")}
OURS |= {"solve_continuous_are": gpu.care, "solve_discrete_are": gpu.dare}


def pytest_collection_modifyitems(items):
    for module in {item.module for item in items if item.module.__name__ in SUITES}:
        for name, function in OURS.items():
            if hasattr(module, name):
                setattr(module, name, function)


def failures(suite, folder):
    """Names and messages of the tests that failed, and how many passed."""
    report = folder / "report.xml"
    command = [sys.executable, "-m", "pytest", "-q", "-p", Path(__file__).stem, "-k", SUITES[suite]]
    command += ["-p", "no:cacheprovider", f"--junitxml={report}", "--pyargs", suite]
    paths = [str(Path(gpu.__file__).parents[1]), str(Path(__file__).parent)]
    environment = {"PYTHONPATH": ":".join(paths), "OMP_NUM_THREADS": "1", "PATH": "/usr/bin:/bin"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert report.exists(), done.stdout + done.stderr
    cases = [*ElementTree.parse(report).iter("testcase")]
    failed = [
        (case.get("name"), " ".join(f.get("message", "").split()))
        for case in cases
        for f in (*case.findall("failure"), *case.findall("error"))
    ]
    return failed, sum(len(case) == 0 for case in cases)


@pytest.mark.slow
@pytest.mark.parametrize("suite", SUITES)
def test_scipys_own_tests(suite, tmp_path):
    if find_spec(suite) is None:
        pytest.skip("this SciPy was installed without its tests")
    expected = EXPECTED[suite.split(".")[-1]]
    failed, passed = failures(suite, tmp_path)
    fits = [
        [i for i, (test, told, _) in enumerate(expected)
         if re.search(test, name) and re.search(told, message)]
        for name, message in failed
    ]  # fmt: skip
    unknown = [failure for failure, found in zip(failed, fits, strict=True) if not found]
    assert not unknown, "\n".join(f"{name}: {message[:300]}" for name, message in unknown)
    assert {i for found in fits for i in found} == set(range(len(expected))), "one fits nothing"
    assert passed > {"test_arpack": 400, "test_svds": 150, "test_solvers": 30}[suite.split(".")[-1]]
