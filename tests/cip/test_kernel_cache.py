"""What numba keeps on disk: loops that take functions as arguments would only pile up there."""

from cip import cpu, line_blocks, path_loops, plane_blocks


def loops(module):
    return [
        value for name, value in vars(module).items() if name.startswith("run_") and callable(value)
    ]


def test_loops_over_functions_stay_in_memory():
    found = [*loops(cpu), *loops(path_loops)]
    assert len(found) >= 7
    assert not any(loop._cache.cache_path for loop in found)


def test_other_loops_are_kept():
    found = [*loops(plane_blocks), *loops(line_blocks)]
    assert len(found) >= 3
    assert all(loop._cache.cache_path for loop in found)
