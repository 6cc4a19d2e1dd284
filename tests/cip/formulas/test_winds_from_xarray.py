"""Winds from xarray datasets: names, falling coordinates, dates, and what does not fit."""

import datetime

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
        (lambda d: d * 1j, "winds: 'u10': expected real values instead of complex128"),
        (lambda d: d.astype(str), "winds: 'u10': expected real values instead of <U"),
        (
            lambda d: d.assign_coords(lon=list("abcdefghijklmnop")),
            "winds: 'lon': expected real values instead of <U1",
        ),
        (
            lambda d: d.drop_vars("lat").assign_coords(lat=(("lat", "lon"), np.ones((13, 16)))),
            r"winds: the coordinate 'lat' has the dimensions \('lat', 'lon'\), expected lat alone",
        ),
        (
            lambda d: d.assign_coords(time=[datetime.date(2020, 1, n) for n in (1, 2, 3, 4)]),
            "winds: 'time' holds object, expected numbers, datetime64 or timedelta64",
        ),
    ],
)
def test_datasets_that_do_not_fit(change, message):
    with pytest.raises(InputError, match=message):
        Velocity.from_xarray(change(dataset()), ("u10", "v10"), ("lon", "lat"))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"periodic": (True, True, False)}, "periodic: expected True or False, or one for each of"),
        ({"periodic": "no"}, "periodic: expected True or False, .* got 'no'"),
        ({"periodic": {"lon": True}}, "periodic: expected True or False"),
        ({"components": "uv"}, "components: expected a sequence of names, got 'uv'"),
        ({"components": None}, "components: expected a sequence of names, got None"),
        ({"axes": ([1], "lat")}, "axes: expected names"),
    ],
)
def test_arguments_that_do_not_fit(changed, message):
    arguments = {"components": ("u10", "v10"), "axes": ("lon", "lat"), **changed}
    with pytest.raises(InputError, match=message):
        Velocity.from_xarray(dataset(), **arguments)
