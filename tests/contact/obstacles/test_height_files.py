"""Heights as profilometers write them: a line x y height for each point of a grid."""

import numpy as np
import pytest

from contact import InputError, Rough
from contact.obstacles.rough import read_heights


def lines(heights, spacing=(0.25, 0.5), seed=0):
    """Points in random order, with the rounding of decimal numbers."""
    i, j = np.indices(heights.shape)
    points = np.stack([i * spacing[0] - 3.0, j * spacing[1], heights], axis=-1).reshape(-1, 3)
    return np.random.default_rng(seed).permutation(points)


def test_points_in_any_order(tmp_path):
    heights = np.random.default_rng(1).standard_normal((5, 7))
    np.savetxt(tmp_path / "map.xyz", lines(heights), fmt="%.9g", header="x/um y/um z/nm")
    rough = Rough.from_file(tmp_path / "map.xyz", (1.0, 3.0), scale=1e-9, periodic=False)
    assert rough.heights == pytest.approx(1e-9 * heights, rel=1e-8)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: p[:-1], "do not fill a grid"),
        (lambda p: np.vstack([p[:-1], p[:1]]), "do not fill a grid"),
        (lambda p: p[:, :2], "three numbers a line"),
        (lambda p: np.where([1, 0, 0], p**3, p), "not equally far apart"),
        (lambda p: np.where(p == p[3, 2], np.nan, p), "NaN or infinite"),
    ],
)
def test_what_is_no_grid_is_refused(tmp_path, spoil, words):
    points = lines(np.random.default_rng(1).standard_normal((5, 7)))
    np.savetxt(tmp_path / "map.xyz", spoil(points))
    with pytest.raises(InputError, match=words):
        Rough.from_file(tmp_path / "map.xyz", (1.0, 3.0), periodic=False)


@pytest.mark.parametrize("heights", [np.eye(5) * 1j, np.full((5, 5), "1.0")])
def test_what_is_no_real_array_is_refused(tmp_path, heights):
    np.save(tmp_path / "map.npy", heights)
    with pytest.raises(InputError, match="expected real numbers"):
        Rough.from_file(tmp_path / "map.npy", (1.0, 1.0))


@pytest.mark.parametrize(
    ("name", "content"),
    [("map.npy", b""), ("map.png", b"\x89PNG\r\n\x1a\n\0\0"), ("map.xyz", b""), ("map.txt", b"")],
)
def test_what_ends_too_early_is_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match="not readable as"):
        Rough.from_file(tmp_path / name, (1.0, 1.0))


@pytest.mark.parametrize(
    "text", ["0,5;-1,25\n3;4e-1", "0,5 -1,25\n3 0,4", "0,5\t-1,25\n3,0\t,4", "0.5,-1.25\n3,0.4"]
)
def test_decimal_commas(tmp_path, text):
    """They are known where other marks part the numbers, of which none has a point."""
    (tmp_path / "map.csv").write_text(f"# x,y\n{text}\n")
    found = read_heights(tmp_path / "map.csv")
    assert np.array_equal(found, [[0.5, -1.25], [3.0, 0.4]])


@pytest.mark.parametrize("text", ["0,5\n1,2", "1,5, 2,5\n1,0, 2,0", "1.5;2,5\n1;2"])
def test_commas_that_may_be_decimal_marks_are_refused(tmp_path, text):
    (tmp_path / "map.txt").write_text(text)
    with pytest.raises(InputError, match="its commas may be decimal marks or part the numbers"):
        Rough.from_file(tmp_path / "map.txt", (1.0, 1.0))
