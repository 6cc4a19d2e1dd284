"""Files of states at several times: a NumPy archive, netCDF or Zarr; complete or not at all.

An archive has everything as it is in memory. The others hold the dataset of `state_dataset`, which
other programs read, and as attributes and variables what it lacks; all have a checksum.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from secrets import token_hex
from typing import Any, NamedTuple

import numpy as np

from cip.errors import AdiniError, InputError
from cip.grid import Grid, Sphere
from cip.profiles.catalogue import moment_names
from cip.stages.state_dataset import state_dataset, xarray_module
from skfem_adini.ground.archives import checksum, read_arrays, words, write_arrays
from skfem_adini.ground.errors import optional
from skfem_adini.ground.files import complete_file

FORMAT, KIND = 1, "states of cip"
SUFFIXES = (".npz", ".nc", ".zarr")


class Stored(NamedTuple):
    """What a file of states holds."""

    grid: Grid | Sphere
    about: dict[str, Any]  # profile, fields, for each state its bounds and memory, and more
    data: Any  # moments of all states
    t: Any
    extra: dict[str, Any]  # other arrays by name


def suffix_of(path: Any) -> str:
    """The suffix of a file of states; `InputError` for another one."""
    try:
        suffix = Path(path).suffix
    except TypeError:
        raise InputError(f"path={path!r}: expected the name of a file") from None
    if suffix not in SUFFIXES:
        raise InputError(f"path: expected a name that ends in {', '.join(SUFFIXES)}, got {path!r}")
    return suffix


def write_states(
    path: Any,
    states: Sequence[Any],
    more: Mapping[str, Any] | None = None,
    extra: Mapping[str, Any] | None = None,
) -> Path:
    """Write states of one grid and profile, with more words and extra arrays by name."""
    suffix, path = suffix_of(path), Path(path)
    states = [state.host() for state in states]
    first = states[0]
    about = words(
        {
            "kind": KIND, "format": FORMAT, "profile": first.profile, "fields": first.fields,
            "periodic": first.grid.periodic, "dtype": str(first.data.dtype),
            "bounded": [state._bounded for state in states],
            "memory": [state._memory for state in states], "more": dict(more or {}),
            "radius": first.grid.radius if isinstance(first.grid, Sphere) else None,
        }
    )  # fmt: skip
    beside = {f"edges_{q}": line for q, line in enumerate(first.grid.edges)}
    beside |= {f"extra_{name}": np.asarray(value) for name, value in (extra or {}).items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    if suffix == ".npz":
        arrays = {"data": np.stack([s.data for s in states]), "t": [s.t for s in states]}
        return write_arrays(path, {"about": about, **arrays, **beside}, compress=False)
    dataset = state_dataset(states).assign(
        {
            name: ([f"{name}_{q}" for q in range(value.ndim)], value)
            for name, value in beside.items()
        }
    )
    marks = {"about": str(about), "checksum": _sum(dataset, about)}
    return _write_dataset(path, dataset.assign_attrs(marks))


def read_states(path: Any) -> Stored:
    """Read a file of `write_states`; `InputError` for one that is damaged or something else."""
    suffix, path = suffix_of(path), Path(path)
    if not path.exists():
        raise InputError(f"path: {path} does not exist")
    with _reading(path):
        if suffix == ".npz":
            arrays = read_arrays(path)[0]
            about = _about(arrays["about"])
        else:
            dataset = _read_dataset(path)
            about = _about(dataset.attrs["about"])
            if dataset.attrs["checksum"] != _sum(dataset, np.array(dataset.attrs["about"])):
                raise InputError(f"path: {path} was changed since it was written")
            arrays = _arrays(dataset)
        edges = [arrays[f"edges_{q}"] for q in range(len(about["periodic"]))]
        if about.get("radius") is not None:
            grid: Any = Sphere(edges[0].size - 1, edges[1].size - 1, about["radius"])
        else:
            x, y, z = [*edges, None, None][:3]
            grid = Grid.from_coordinates(x, y, z, about["periodic"])
        data = arrays["data"] if suffix == ".npz" else _data(about, grid, arrays)
        extra = {
            name.removeprefix("extra_"): value
            for name, value in arrays.items()
            if name.startswith("extra_") and name.count("_") == 1
        }
        return Stored(grid, about, data, arrays["t"], extra)


def _about(text: Any) -> dict[str, Any]:
    about: dict[str, Any] = json.loads(str(text))
    if about.get("kind") != KIND or about.get("format") != FORMAT:
        raise ValueError(f"it holds {about.get('kind')!r} of format {about.get('format')!r}")
    about["fields"] = tuple(about["fields"])
    return about


def _data(about: dict[str, Any], grid: Grid | Sphere, arrays: Mapping[str, Any]) -> Any:
    """The moments of all states from variables, zero where no cell begins."""
    names = moment_names(about["fields"], about["profile"], grid.dim)
    data = np.zeros((arrays["t"].size, len(names), *grid.nodes), about["dtype"])
    for q, name in enumerate(names):
        values = arrays[name]
        data[:, q][tuple(slice(0, n) for n in values.shape)] = values
    fields = [len(about["fields"])] if about["fields"] else []
    return data.reshape(len(data), *fields, -1, *grid.nodes)


def _sum(dataset: Any, about: Any) -> str:
    """The checksum of all variables of a dataset and of its words."""
    return checksum({"about": about, **_arrays(dataset)})


def _arrays(dataset: Any) -> dict[str, Any]:
    """The variables in the byte order of this machine, which that of a file may not be."""
    found = {str(name): one.values for name, one in dataset.variables.items()}
    return {name: one.astype(one.dtype.newbyteorder("=")) for name, one in found.items()}


def _write_dataset(path: Path, dataset: Any) -> Path:
    if path.suffix == ".nc":
        engine = "h5netcdf" if find_spec("h5netcdf") else "scipy"
        with complete_file(path) as file:
            file.write(dataset.to_netcdf(engine=engine))
        return path
    optional("zarr", "files .zarr need zarr: pip install zarr; or take .npz or .nc")
    if path.exists():
        raise InputError(f"path: {path} exists; remove it first, or take another name")
    aside = path.with_name(f"tmp{token_hex(16)}")
    try:
        dataset.to_zarr(aside, mode="w", consolidated=False)
        os.rename(aside, path)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return path


def _read_dataset(path: Path) -> Any:
    options: dict[str, Any] = {"decode_times": False, "mask_and_scale": False}
    if path.suffix == ".zarr":
        optional("zarr", "files .zarr need zarr: pip install zarr")
        options |= {"engine": "zarr", "consolidated": False}
    with xarray_module().open_dataset(path, **options) as dataset:
        return dataset.load()


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Re-raise errors in the content of a file as the `InputError` of the package."""
    try:
        yield
    except AdiniError:
        raise
    except Exception as error:  # the libraries of these formats raise errors of any type
        raise InputError(f"path: {path} is no file of states, or damaged ({error!r})") from error
