"""Hypothesis profiles: `ci` is the fast lane, `slow` runs with `make test-slow`."""

import gc
import os
import sys
import time
import zlib
from pathlib import Path

import matplotlib
import pytest
import pyvista
from hypothesis import HealthCheck, settings

# The suite imports test modules by path; what packages share lies beside this file.
sys.path.insert(0, str(Path(__file__).parent))
from cuda_compiler import compile_cuda  # noqa: F401

matplotlib.use("Agg")
pyvista.OFF_SCREEN = True

_shared = {
    "deadline": None,
    "derandomize": True,
    "suppress_health_check": [HealthCheck.too_slow],
    "database": None,
}
settings.register_profile("ci", max_examples=30, **_shared)
settings.register_profile("slow", max_examples=1000, **_shared)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


def pytest_addoption(parser):
    """Parts of the suite, for lanes whose time is limited."""
    parser.addoption("--shard", help="K/N: the K-th of N parts of the tests, from 0 on")
    parser.addoption("--whole-files", action="store_true", help="shards of files, not of tests")
    parser.addoption(
        "--start-within", type=float, help="seconds after collection in which tests are started"
    )


def pytest_ignore_collect(collection_path, config):
    """Files of other parts are not imported."""
    shard = config.getoption("--shard")
    if shard and config.getoption("--whole-files") and collection_path.name.startswith("test_"):
        part, parts = map(int, shard.split("/"))
        name = collection_path.relative_to(config.rootpath).as_posix()
        if zlib.crc32(name.encode()) % parts != part:
            return True
    return None


def pytest_collection_finish(session):
    """A limited lane counts from here; the garbage collector leaves what was collected alone."""
    session.config.started = time.monotonic()
    gc.collect()
    gc.freeze()


def pytest_runtest_setup(item):
    """Where the time is limited, tests that come too late are skipped and say so."""
    limit = item.config.getoption("--start-within")
    if limit is not None and time.monotonic() - item.config.started > limit:
        pytest.skip(f"the {limit:g} seconds of this lane are over")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Samples and shards where they are asked for; tests marked `gpu` need a device, and say so."""
    _mark_unsampled(items)
    _mark_out_of_turn(items)
    shard = config.getoption("--shard")
    if shard:
        _take_shard(config, items, *map(int, shard.split("/")))
    reason = _no_device()
    if reason:
        for item in items:
            if item.get_closest_marker("gpu"):
                item.add_marker(pytest.mark.skip(reason=reason))


def _take_shard(config, items, part, parts):
    """Keep one part of the tests, or of the files, which share what they set up and compile."""

    def name(item):
        return item.nodeid.split("::")[0] if config.getoption("--whole-files") else item.nodeid

    chosen = [item for item in items if zlib.crc32(name(item).encode()) % parts == part]
    taken = set(chosen)
    config.hook.pytest_deselected(items=[item for item in items if item not in taken])
    if config.getoption("--start-within") is not None:
        # In another order each turn: what comes too late once comes first another time.
        turn = os.environ.get("CI_TURN", "")
        chosen.sort(key=lambda item: zlib.crc32(f"{turn} {name(item)}".encode()))
    items[:] = chosen


def _mark_unsampled(items):
    """Of the fast tests of a function marked `sampled(n)` all but each n-th become slow ones.

    CI_TURN, which CI sets to the number of commits, says from which of them on: n turns take all.
    """
    turn = int(os.environ.get("CI_TURN", 0))
    functions = {}
    for item in items:
        marker = item.get_closest_marker("sampled")
        if marker and not item.get_closest_marker("slow"):
            functions.setdefault(item.nodeid.split("[")[0], (marker.args[0], []))[1].append(item)
    for every, found in functions.values():
        # In a fixed order without pattern: strides would meet the same element again and again.
        # Functions with the same parameters take the same ones and share what these compile.
        found.sort(key=lambda item: zlib.crc32(item.nodeid.partition("[")[2].encode()))
        first = turn % min(every, len(found))
        for k, item in enumerate(found):
            if (k - first) % every:
                item.add_marker(pytest.mark.slow)


def _mark_out_of_turn(items):
    """Tests marked `turns(n)` are slow ones in all but each n-th turn of CI."""
    turn = int(os.environ.get("CI_TURN", 0))
    for item in items:
        marker = item.get_closest_marker("turns")
        if marker and (zlib.crc32(item.nodeid.encode()) + turn) % marker.args[0]:
            item.add_marker(pytest.mark.slow)


def _no_device():
    try:
        import cupy
    except ImportError:
        return "no CuPy: pip install 'skfem-adini[cuda13]'"
    return None if cupy.cuda.is_available() else "no CUDA device"
