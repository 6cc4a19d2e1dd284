"""Winds from xarray datasets: names, falling coordinates, dates, and what does not fit."""

import numpy as np
import pytest

from cip import Grid, InputError, Velocity

xarray = pytest.importorskip("xarray")
LON, LAT = np.arange(16) / 16, np.linspace(1, 0, 13)
TIMES = np.array([0, 1, 2, 3], dtype="datetime64[s]").astype("datetime64[ns]")


def dataset():
    t = np.arange(4.0)[:, None, None]
    u = 0.3 + 0 * LAT[:, None] * LON + 0.01 * t
    v = 0.1 * LAT[:, None] * np.sin(2 * np.pi * LON) + 0 * t
    dims = ("time", "lat", "lon")
    return xarray.Dataset(
        {"u10": (dims, u), "v10": (dims, v)}, {"time": TIMES, "lat": LAT, "lon": LON}
    )


def test_the_winds_are_those_of_the_arrays():
    found = Velocity.from_xarray(dataset(), ("u10", "v10"), ("lon", "lat"), periodic=(True, False))
    grid = Grid([(0, 1), (0, 1)], (16, 12), periodic=(True, False))
    x, y = grid.mesh()
    arrays = [[0.3 + 0 * x * y + 0.01 * t, 0.1 * y * np.sin(2 * np.pi * x)] for t in range(4)]
    expected = Velocity.from_snapshots(np.arange(4.0), arrays, grid)
    points = np.random.default_rng(0).random((2, 50))
    for component, same in zip(found.on(grid), expected.on(grid), strict=True):
        for orders in ((0, 0, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0)):
            one, other = (
                f.derivative(orders, (1.0,) * 4)(*points, 0.0, 1.3) for f in (component, same)
            )
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    assert np.abs(one).max() > 0.05


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["u10"], "winds: expected an xarray.Dataset, got DataArray"),
        (lambda d: d.rename(u10="u"), "winds: the dataset has no 'u10'; it has"),
        (lambda d: d.expand_dims("level"), r"winds: 'u10' has the dimensions \('level'"),
        (lambda d: d.where(d.lat < 1), "arrays: NaN or infinity in snapshot 0, component 0"),
    ],
)
def test_datasets_that_do_not_fit(change, message):
    with pytest.raises(InputError, match=message):
        Velocity.from_xarray(change(dataset()), ("u10", "v10"), ("lon", "lat"))
