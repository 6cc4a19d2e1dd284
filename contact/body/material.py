"""The material of a body with a Basis, which may be changed."""

from __future__ import annotations

from typing import Any

import numpy as np

from contact.body.anisotropic import Anisotropic
from contact.body.axisymmetry import AXISYMMETRIC, AxisymmetricLaw
from contact.body.basis_solid import BasisSolid
from contact.body.constitutive import IsotropicLaw, StressLaw, TensorLaw
from contact.body.elasticity import check_locking, checked_dilatation, lame
from contact.errors import InputError, numbers
from contact.settled import settled


def _property(name: str, text: str) -> Any:
    def change(body: MaterialBody, value: Any) -> None:
        body._set_material(**{name: value})

    return property(lambda body: body._material[name], change, doc=text)


@settled("it follows from E, nu, plane and material; set these", "lam", "mu", "law")
class MaterialBody(BasisSolid):
    """A body whose material may be changed; cached results of the old material are dropped."""

    dim: int
    element: Any

    E = _property("E", "Young's modulus, a number or one a cell; None if anisotropic.")
    nu = _property("nu", "Poisson's ratio, a number or one a cell; None if anisotropic.")
    anisotropy = _property("anisotropy", "The `Anisotropic` material; None if isotropic.")
    plane = _property("plane", '"strain", "stress" or "axisymmetric"; None in three dimensions.')
    dilatation = _property("dilatation", '"pointwise" or "mean".')
    law: StressLaw
    _material: dict[str, Any]

    def _set_material(self, **changed: Any) -> None:
        """Check and store a material; a problem recognises a change by the identity of the dict."""
        if self.thermal is not None:
            raise InputError(
                f"{', '.join(changed)}: the body was heated, and the forces of that hold its old "
                "material; make a new body, and heat it after its material is set"
            )
        new = self.__dict__.get("_material", {}) | changed
        new["plane"] = checked_plane(new["plane"], self.dim)
        old = self.__dict__.get("_material", new)["plane"]
        if old != new["plane"] and AXISYMMETRIC in (old, new["plane"]):
            raise InputError(
                f"plane: a body with plane={old!r} does not become one with {new['plane']!r}, for "
                "its loads and supports are others; make a new body"
            )
        new["dilatation"] = checked_dilatation(new["dilatation"], self.element)
        if new["anisotropy"] is None:
            derived = self._isotropic(new)
        else:
            derived = {"lam": None, "mu": None, "law": self._anisotropic(new)}
        self._material = new
        self.__dict__.update(derived)
        self.__dict__.pop("stiffness", None)

    def _isotropic(self, new: dict[str, Any]) -> dict[str, Any]:
        """Check E and nu, which become read-only arrays, and return what follows from them."""
        count = self.basis.mesh.nelements
        for name in ("E", "nu"):
            value = numbers(name, new[name])
            if value.shape not in ((), (count,)):
                raise InputError(
                    f"{name}: expected a number or one value for each of the {count} cells, got "
                    f"shape {value.shape}"
                )
            value.flags.writeable = False
            new[name] = value
        ring = new["plane"] == AXISYMMETRIC
        plane = None if ring else new["plane"]
        lame_lambda, lame_mu = lame(new["E"], new["nu"], plane)
        check_locking(new["nu"], plane, new["dilatation"], self.element)
        law = IsotropicLaw(lame_lambda, lame_mu, new["nu"], plane)
        whole = AxisymmetricLaw(law) if ring else law
        return {"lam": lame_lambda, "mu": lame_mu, "law": whole}

    def _anisotropic(self, new: dict[str, Any]) -> StressLaw:
        """Law of an anisotropic material, checked against the cells and the other arguments."""
        given, count = new["anisotropy"], self.basis.mesh.nelements
        if not isinstance(given, Anisotropic):
            raise InputError(
                f"material: expected Orthotropic(...) or Anisotropic(...), got {given!r}"
            )
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
        return TensorLaw.of(given.C, self.dim, new["plane"])

    def check_unchanged(self) -> None:
        """Raise an `InputError` if the mesh was edited in place, or the loads to invalid values."""
        super().check_unchanged()
        if not hasattr(self, "_places"):
            self._places = self.mesh.doflocs.copy(), self.mesh.t.copy()
        places, cells = self._places
        if not (np.array_equal(places, self.mesh.doflocs) and np.array_equal(cells, self.mesh.t)):
            raise InputError(
                "mesh: its vertices or cells were changed after the body was made, whose Basis and "
                "matrices are still those of the old ones; make a new mesh and a new body"
            )


def checked_plane(plane: Any, dim: int) -> str | None:
    """The plane of a body in 2-D, "strain" by default, "stress" or "axisymmetric"; None in 3-D."""
    if dim == 2:
        plane = "strain" if plane is None else plane
        if not isinstance(plane, str) or plane not in ("strain", "stress", AXISYMMETRIC):
            raise InputError(f"plane={plane!r}: expected 'strain', 'stress' or 'axisymmetric'")
        return plane
    if plane is not None and not (isinstance(plane, str) and plane == "strain"):
        raise InputError(
            f"plane={plane!r}: a body in three dimensions is in no plane; leave it out, or make "
            "the body in two dimensions"
        )
    return None
