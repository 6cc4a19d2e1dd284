"""Results as tables of pandas and datasets of xarray, which need not be installed."""

from __future__ import annotations

from typing import Any

import numpy as np

from contact.laws.status import Status
from skfem_adini.ground.errors import optional

_NAMES = np.array([status.name.lower() for status in Status])
_FLAGS = {"flag_values": [0, 1, 2], "flag_meanings": " ".join(_NAMES[:3])}  # CF conventions


def points_frame(result: Any) -> Any:
    """The contact points of a `ContactResult`, one a row."""
    shear, slip = result.shear, result.slip
    ties = result.system.rows.ties
    columns = dict(zip("xyz", result.x_nominal, strict=False))
    columns |= {"boundary": result.part, "status": _NAMES[result.status]}
    columns |= {"gap": result.gap, "pressure": result.pressure}
    if np.any(ties):
        columns["pressure"] = columns["pressure"] + result.tie_pressure
        shear = shear + result.tie_shear
    for name, values in (("shear", shear), ("slip", slip)):
        columns |= dict(zip(_directions(name, values.shape[1]), values.T, strict=True))
    if result.system.surface is not None:
        columns |= {"indentation": result.indentation, "worn": result.worn[0]}
        columns |= {"worn_other": result.worn[1]}
    return _frame(columns).rename_axis("point")


def steps_frame(history: Any) -> Any:
    """The steps of a `LoadHistory`, one a row."""
    results = history.results
    if not results:
        return _frame({"t": []}).rename_axis("step")
    kinds = np.array([np.bincount(r.status, minlength=len(Status)) for r in results])
    forces = history.resultant
    columns = {"t": history.times, "contact_force": [r.contact_force for r in results]}
    columns |= {f"force_{c}": forces[:, k] for k, c in enumerate("xyz"[: forces.shape[1]])}
    columns |= {"largest_pressure": [r.pressure.max(initial=0.0) for r in results]}
    met = [k for k in range(len(Status)) if k < 3 or kinds[:, k].any()]
    columns |= {str(_NAMES[k]): kinds[:, k] for k in met}
    columns |= {"iterations": [len(r.history) for r in results]}
    columns |= {"largest_residual": [max(r.kkt.values()) for r in results]}
    return _frame(columns).rename_axis("step")


def grid_dataset(result: Any) -> Any:
    """The surface of a `GridResult`, as a dataset over its directions."""
    xarray = optional("xarray", "to_xarray needs xarray: pip install 'skfem-adini[io]'")
    normal = np.asarray(result.compliance.normal)
    along = [c for c, n in zip("xyz", normal, strict=False) if n == 0]
    places = dict(zip(along, result._lateral(), strict=True))
    components = ["xyz"[k] for k in range(normal.size)]
    fields = {
        "pressure": (along, result.pressure),
        "gap": (along, result.opening),
        "status": (along, result.status, _FLAGS),
        "shear": (["direction", *along], result.shear),
        "slip": (["direction", *along], result.slip),
        "displacement": (["component", *along], result.u),
        "indentation": (along, result.indentation),
        "worn": (["side", *along], result.worn),
    }
    names = {"direction": along, "component": components, "side": ["body", "obstacle"]}
    return xarray.Dataset(fields, {**places, **names}, {**result.kkt})


def _directions(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name}_{k + 1}" for k in range(count)]


def _frame(columns: dict[str, Any]) -> Any:
    pandas = optional("pandas", "to_frame needs pandas: pip install pandas")
    return pandas.DataFrame(columns)
