"""Adini's element times a weight function that vanishes on the boundary."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.element import DiscreteField

from skfem_adini.curved.quadrature.level_set import returned
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.field_on_demand import FieldOnDemand
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import integer

Array = NDArray[np.float64]


class ElementQuadAdiniWeighted(ElementQuadAdini):
    r"""The functions :math:`\omega \varphi_i` with Adini's :math:`\varphi_i`.

    With omega positive inside, zero on the boundary and of non-zero slope there, every function
    satisfies u = 0 exactly and no form on the boundary is needed. The dofs are those of
    :math:`u / \omega`, so `essential_dofs` and nodal values do not apply to u; `AdiniExtension`
    does. Derivatives follow from the product rule.

    Parameters
    ----------
    weight
        Smooth omega of points (2, cells, points), returning (cells, points). For a level set phi
        that is smooth in the whole domain, -phi; a kink inside, such as that of a distance function
        at the centre, reduces the order.
    gradient
        Its gradient, returning (2, cells, points).
    hessian
        Its second derivatives, returning (2, 2, cells, points), for ``derivatives=2``.
    derivatives
        How many orders `gbasis` returns, 0 to 2.
    degree
        Polynomial degree of omega; it is added to `maxdeg`, by which scikit-fem chooses the
        quadrature.

    Raises
    ------
    InputError
        Something that is not a function, derivatives out of range, a Hessian missing; values that
        are NaN or of the wrong shape.

    References
    ----------
    K. Hoellig, U. Reif and J. Wipper, Weighted extended B-spline approximation of Dirichlet
    problems, SIAM Journal on Numerical Analysis 39 (2001), 442-462.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace, mass
    >>> from skfem_adini import AdiniExtension, CutDomain, lowest_eigenpairs
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 17)] * 2)
    >>> omega = lambda x: 0.81 - x[0] ** 2 - x[1] ** 2
    >>> element = ElementQuadAdiniWeighted(omega, lambda x: -2 * x)
    >>> domain = CutDomain(mesh, lambda x: -omega(x))
    >>> A, M = (domain.assemble(form, element) for form in (laplace, mass))
    >>> extension = AdiniExtension(Basis(mesh, element, intorder=1), domain)
    >>> values, _ = lowest_eigenpairs(*extension.apply(A, M), 1, shift=0.0)
    >>> print(np.round(values * 0.81, 6))
    [5.783186]
    """

    dofs_of = "u over the weight"

    def __init__(
        self,
        weight: Callable[[Array], Any],
        gradient: Callable[[Array], Any],
        hessian: Callable[[Array], Any] | None = None,
        derivatives: int = 1,
        degree: int = 2,
    ) -> None:
        for name, function in (("weight", weight), ("gradient", gradient)):
            if not callable(function):
                raise InputError(f"{name}: expected a function, got {type(function).__name__}")
        if derivatives not in (0, 1, 2) or (derivatives == 2 and not callable(hessian)):
            raise InputError(
                f"derivatives: expected 0, 1 or, with a hessian, 2, got {derivatives!r}"
            )
        super().__init__(derivatives)
        self.weight, self.gradient, self.hessian = weight, gradient, hessian
        self.maxdeg = ElementQuadAdini.maxdeg + integer("degree", degree, 0)

    def _parameters(self) -> dict[str, Any]:
        return {
            "weight": self.weight,
            "gradient": self.gradient,
            "hessian": self.hessian,
            "derivatives": self.derivatives,
            "degree": self.maxdeg - ElementQuadAdini.maxdeg,
        }

    def __repr__(self) -> str:
        functions = ("weight", "gradient", "hessian")
        names = {
            name: getattr(value, "__name__", type(value).__name__) if name in functions else value
            for name, value in self._parameters().items()
        }
        given = ", ".join(f"{name}={value}" for name, value in names.items())
        return f"{type(self).__name__}({given})"

    def gbasis(
        self, mapping: Any, X: Array, i: int, tind: NDArray[np.integer] | None = None
    ) -> tuple[DiscreteField]:
        """Return shape function i and its derivatives, see `ClosedFormElement.gbasis`."""
        (field,) = super().gbasis(mapping, X, i, tind)
        x = np.asarray(mapping.F(X, tind))
        phi = np.asarray(field)
        omega = returned("weight", self.weight(x), x.shape[1:])
        fields = {"value": omega * phi}
        if self.derivatives > 0:
            slope = returned("gradient", self.gradient(x), x.shape)
            fields["grad"] = omega * field.grad + phi * slope
        if self.derivatives > 1 and self.hessian is not None:
            second = returned("hessian", self.hessian(x), (2, *x.shape))
            mixed = slope[:, None] * field.grad[None]
            fields["hess"] = omega * field.hess + mixed + mixed.swapaxes(0, 1) + phi * second
        weighted = FieldOnDemand(
            fields["value"], fields.get("grad"), self.derivatives, self._missing
        )
        weighted.hess = fields.get("hess")
        return (weighted,)

    def _missing(self, order: int) -> Array:
        raise InputError(
            f"derivatives: order {order} is not there, the element was made with derivatives="
            f"{self.derivatives}; there are 2, with ElementQuadAdiniWeighted(..., hessian=, "
            "derivatives=2)"
        )
