"""Options of a solve, and their defaults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from contact.errors import InputError
from skfem_adini.ground.arguments import numbers

_OFFERED: dict[str | None, tuple[str, ...]] = {
    None: ("newton", "pdas"),
    "tresca": ("newton", "pdas", "fixed_point"),
    "coulomb": ("newton", "pdas", "fixed_point", "tresca_loop"),
}


@dataclass(frozen=True)
class Options:
    """Options of `contact.problem.contact_problem.ContactProblem.solve`, checked."""

    method: str
    tol: float
    max_iterations: int
    eps: float | None

    @classmethod
    def checked(
        cls,
        law: str | None,
        dim: int,
        method: str,
        tol: float | None,
        max_iterations: int | None,
        eps: float | None,
    ) -> Self:
        """Check the options and set defaults; raises `InputError` for unsupported ones."""
        peer = isinstance(method, str) and method.startswith("qp:")
        if not (isinstance(method, str) and method in _OFFERED[law]) and not peer:
            raise InputError(
                f"method={method!r}: a {law or 'frictionless'} problem takes "
                f"{', '.join(map(repr, _OFFERED[law]))} or 'qp:<solver>'"
            )
        if peer and law is not None and dim == 3:
            raise InputError(f"method={method!r}: friction in 3-D is no QP; use 'newton' or 'pdas'")
        tol = checked_tolerance(default_tolerance(method) if tol is None else tol)
        for name, value in (("max_iterations", max_iterations), ("eps", eps)):
            if value is not None and numbers(name, value).shape != ():
                raise InputError(f"{name}={value!r}: expected one number")
        if max_iterations is None:
            max_iterations = 2000 if method == "fixed_point" else 100
        if not 1 <= max_iterations < np.inf or max_iterations != int(max_iterations):
            raise InputError(f"max_iterations={max_iterations!r}: expected a whole number from 1")
        if eps is not None and (method != "fixed_point" or not 0 < eps < np.inf):
            raise InputError(f"eps={eps!r}: a positive number, for method 'fixed_point' only")
        return cls(method, tol, int(max_iterations), eps)

    @property
    def peer(self) -> str | None:
        """Name of the solver in ``qp:<solver>``; None for the package's own methods."""
        return self.method[3:] if self.method.startswith("qp:") else None


def default_tolerance(method: str) -> float:
    """Default tolerance of the certificate for a method."""
    return 1e-6 if method == "fixed_point" else 1e-7 if method.startswith("qp:") else 1e-10


def checked_tolerance(tol: Any) -> float:
    """The tolerance of a certificate."""
    if numbers("tol", tol).shape != () or not 0 < tol < 1:
        raise InputError(f"tol={tol!r}: expected a number between 0 and 1")
    return float(tol)
