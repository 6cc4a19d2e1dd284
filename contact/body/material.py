"""The material of a body, checked against its cells, and the law that follows from it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.body.anisotropic import Anisotropic
from contact.body.axisymmetry import AXISYMMETRIC, AxisymmetricLaw
from contact.body.constitutive import IsotropicLaw, StressLaw, TensorLaw
from contact.body.elasticity import check_locking, lame
from contact.errors import InputError
from skfem_adini.ground.arguments import choice, numbers


def isotropic(new: dict[str, Any], element: Any, count: int) -> dict[str, Any]:
    """Check E and nu, make them read-only arrays, and return the quantities derived from them."""
    for name in ("E", "nu"):
        value = of_each_cell(name, new[name], count)
        value.flags.writeable = False
        new[name] = value
    ring = new["plane"] == AXISYMMETRIC
    plane = None if ring else new["plane"]
    lame_lambda, lame_mu = lame(new["E"], new["nu"], plane)
    check_locking(new["nu"], plane, new["dilatation"], element)
    law = IsotropicLaw(lame_lambda, lame_mu, new["nu"], plane)
    whole = AxisymmetricLaw(law) if ring else law
    return {"lam": lame_lambda, "mu": lame_mu, "law": whole}


def of_each_cell(name: str, value: ArrayLike, count: int) -> NDArray[np.float64]:
    """A number, shape (), or one for each cell, shape (count,)."""
    array = numbers(name, value)
    if array.shape not in ((), (count,)):
        raise InputError(
            f"{name}: expected a number or one value for each of the {count} cells, got shape "
            f"{array.shape}"
        )
    return array


def anisotropic(new: dict[str, Any], dim: int, count: int) -> StressLaw:
    """Law of an anisotropic material, checked against the cells and the other arguments."""
    given = new["anisotropy"]
    if not isinstance(given, Anisotropic):
        raise InputError(f"material: expected Orthotropic(...) or Anisotropic(...), got {given!r}")
    if new["E"] is not None or new["nu"] is not None:
        raise InputError(
            "material: it takes the place of E and nu; give either these or a material"
        )
    if new["dilatation"] != "pointwise":
        raise InputError("dilatation='mean' is for isotropic bodies, given by E and nu")
    if given.C.ndim == 3 and len(given.C) != count:
        raise InputError(
            f"material: it has {len(given.C)} stiffness tensors for a mesh of {count} cells"
        )
    if new["plane"] == AXISYMMETRIC:
        return AxisymmetricLaw.of_material(given)
    return TensorLaw.of(given.C, dim, new["plane"])


def checked_plane(plane: Any, dim: int) -> str | None:
    """The plane of a body in 2-D, "strain" by default, "stress" or "axisymmetric"; None in 3-D."""
    if dim == 2:
        plane = "strain" if plane is None else plane
        choice("plane", plane, ("strain", "stress", AXISYMMETRIC))
        return plane
    if plane is not None and not (isinstance(plane, str) and plane == "strain"):
        raise InputError(
            f"plane={plane!r}: a body in three dimensions is in no plane; leave it out, or make "
            "the body in two dimensions"
        )
    return None
