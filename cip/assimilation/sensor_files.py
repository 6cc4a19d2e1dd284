"""Sensors as JSON files and as xarray datasets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError
from cip.formulas.seconds import seconds
from cip.grid import AXES
from cip.output.state_dataset import xarray_module
from cip.output.whole_file import write_whole

Array = NDArray[np.float64]
_FORMAT = "cip sensors 1"


def write_sensors(
    path: str | Path, points: Array, times: Array, values: Array, deviations: Array
) -> None:
    """Write a file of JSON, in which no float is rounded and null stands for a missing report."""
    content = {
        "format": _FORMAT,
        "points": points.tolist(),
        "times": times.tolist(),
        "values": [[None if np.isnan(v) else v for v in row] for row in values.tolist()],
        "deviations": deviations.tolist(),
    }
    write_whole(Path(path), json.dumps(content))


def read_sensors(path: str | Path) -> tuple[Any, Any, Any, Any]:
    """Points, times, values and deviations of a file.

    Raises
    ------
    InputError
        A file that `write_sensors` did not write.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        if content["format"] != _FORMAT:
            raise KeyError("format")
        values = [[np.nan if v is None else v for v in row] for row in content["values"]]
        return content["points"], content["times"], values, content["deviations"]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"path={str(path)!r}: no file of sensors ({error})") from error


def sensors_dataset(points: Array, times: Array, values: Array, deviations: Array) -> Any:
    """An xarray.Dataset of sensors.

    Raises
    ------
    MissingDependency
        xarray is not installed.
    """
    xarray = xarray_module()
    dims = ["t", "sensor"]
    places = {name: ("sensor", x) for name, x in zip(AXES, points, strict=False)}
    data = {"value": (dims, values), "deviation": (dims, deviations)}
    return xarray.Dataset(data, {"t": times, **places})


def parts_of_dataset(dataset: Any, since: Any) -> tuple[Any, Any, Any, Any]:
    """Points, times, values and deviations of a dataset; deviations may lack dimensions.

    Dates become seconds since the date `since`.

    Raises
    ------
    InputError
        A variable or coordinate is missing, or has other dimensions; as `seconds`.
    """
    try:
        points = [dataset[name].values for name in AXES if name in dataset.coords]
        value, deviation = dataset["value"].transpose("t", "sensor"), dataset["deviation"]
        spread = (deviation + 0.0 * value.fillna(0.0)).transpose("t", "sensor").values
        times = dataset["t"].values
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(
            "dataset: expected variables value and deviation over t and sensor, and coordinates "
            f"x, y, z along sensor: {error}"
        ) from error
    return points, seconds(times, "dataset: 't'", since), value.values, spread
