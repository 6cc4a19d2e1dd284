"""The material of a body with a Basis, which may be changed."""

from __future__ import annotations

from typing import Any

import numpy as np

from contact.body.elasticity import check_locking, checked_dilatation, lame
from contact.body.solid import BasisSolid
from contact.errors import InputError, numbers
from contact.settled import settled


def _property(name: str, text: str) -> Any:
    def change(body: MaterialBody, value: Any) -> None:
        body._set_material(**{name: value})

    return property(lambda body: body._material[name], change, doc=text)


@settled("it follows from E, nu and plane; set these", "lam", "mu")
class MaterialBody(BasisSolid):
    """A body whose material may be changed; cached results of the old material are dropped."""

    dim: int
    element: Any

    E = _property("E", "Young's modulus, a number or one a cell (read-only array).")
    nu = _property("nu", "Poisson's ratio, a number or one a cell (read-only array).")
    plane = _property("plane", '"strain" or "stress"; None in three dimensions.')
    dilatation = _property("dilatation", '"pointwise" or "mean".')
    _material: dict[str, Any]

    def _set_material(self, **changed: Any) -> None:
        """Check and store a material; a problem recognises a change by the identity of the dict."""
        new = self.__dict__.get("_material", {}) | changed
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
        new["plane"] = checked_plane(new["plane"], self.dim)
        new["dilatation"] = checked_dilatation(new["dilatation"], self.element)
        lame_lambda, lame_mu = lame(new["E"], new["nu"], new["plane"])
        check_locking(new["nu"], new["plane"], new["dilatation"], self.element)
        self._material = new
        self.__dict__.update(lam=lame_lambda, mu=lame_mu)
        for derived in ("stiffness", "absolute_stiffness"):
            self.__dict__.pop(derived, None)

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
    """What "plane" means in `dim` dimensions.

    Raises
    ------
    InputError
        Another word than "strain" or "stress"; plane stress in three dimensions.
    """
    if dim == 2:
        plane = "strain" if plane is None else plane
        if not isinstance(plane, str) or plane not in ("strain", "stress"):
            raise InputError(f"plane={plane!r}: expected 'strain' or 'stress'")
        return plane
    if plane is not None and not (isinstance(plane, str) and plane == "strain"):
        raise InputError(
            f"plane={plane!r}: a body in three dimensions is in no plane; leave it out, or make "
            "the body in two dimensions"
        )
    return None
