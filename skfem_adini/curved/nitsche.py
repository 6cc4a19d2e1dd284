"""Nitsche's method for Dirichlet conditions on boundaries that cut cells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import BilinearForm, FacetBasis, LinearForm
from skfem.element import DiscreteField, ElementVector
from skfem.helpers import div, dot, grad, mul, sym_grad

from skfem_adini.arguments.pointwise_function import pointwise
from skfem_adini.arguments.positive_number import positive_number
from skfem_adini.conditions.boundary_edges import Value, sample
from skfem_adini.curved.boundary_basis import BoundaryBasis
from skfem_adini.errors import InputError

Array = NDArray[np.float64]
Coefficient = float | Callable[[Array], Any]


def nitsche(
    boundary: Any,
    value: Value = 0.0,
    beta: float = 50.0,
    coefficient: Coefficient = 1.0,
    lame: tuple[Coefficient, Coefficient] | None = None,
) -> tuple[Any, Array]:
    r"""Return matrix and load that impose u = g weakly and symmetrically.

    For :math:`-\nabla \cdot k \nabla u`, to be added to stiffness matrix and load,

    .. math::
        B(u, v) = \int_\Gamma \frac{\beta k}{h} u v - k \, \partial_n u \, v - u \, k \,
        \partial_n v, \quad
        b(v) = \int_\Gamma g \Big(\frac{\beta k}{h} v - k \, \partial_n v\Big);

    for elasticity, with :math:`t(u) = \sigma(u) n`,

    .. math::
        B(u, v) = \int_\Gamma \frac{\beta}{h} \big(2 \mu \, u \cdot v + \lambda (u \cdot n)
        (v \cdot n)\big) - t(u) \cdot v - u \cdot t(v)

    and the load likewise. Only the penalty of the normal part contains lambda, so the tangential
    displacement of nearly incompressible bodies is not penalised with the bulk modulus.

    Parameters
    ----------
    boundary
        From `CutDomain.boundary`, or a scikit-fem `FacetBasis`.
    value
        The data g: a number, a callable of points (2, cells, points) that returns (cells, points)
        or (2, cells, points), or a sequence with one of these for each component.
    beta
        Penalty, without unit. The matrix is definite from beta = 35 with `AdiniExtension` at
        threshold 0.5, and from beta = 50 with a ghost penalty of gamma = 0.02.
    coefficient
        The conductivity k, a positive number or function of points. Scalar fields only.
    lame
        Lame's constants (lambda, mu) for elasticity, numbers or functions of points.
        Functions act on each point alone: points of weight zero lie among the others.

    Returns
    -------
    matrix, load
        Sparse (dofs, dofs) and (dofs,).

    Notes
    -----
    Measured on the disk of radius 0.411, relative errors at n = 32 (``benchmarks/curved.py
    --parts materials``, table `materials` of ``results/curved.json``).

    *Nearly incompressible*, plane strain, the pressure neither zero nor growing:

    ======== ======= ======= =======================
    nu       L2      H1      eigenvalue of torsion
    ======== ======= ======= =======================
    .3       2.1e-7  1.4e-5  6.3e-8
    .49      2.9e-7  1.6e-5  5.5e-7
    .499     1.1e-6  4.6e-5  4.5e-6
    .4999    5.8e-6  1.6e-4  2.7e-5
    .49999   2.9e-5  4.1e-4  1.7e-4
    ======== ======= ======= =======================

    The orders 4 and 3 are kept. Up to nu = .49 hardly any accuracy is lost in L2 and H1, at .499 a
    factor of 5 in L2. Beyond that the element locks, not the boundary conditions: on a fitted
    square with strong conditions the errors grow likewise (by a factor of 16 in L2 at .4999, on the
    cut disk by 28), and a ghost penalty of weight 2 mu + lambda gives the same errors as the
    extension to within a quarter.

    *Conductivities* that vary smoothly, by factors of 1e3 and 1e6 over the disk, do not change
    orders and errors. A *jump* does: the gradient of the solution jumps with it, but that of
    Adini's functions is single-valued at the vertices, so the orders are 1 in L2 and 1/2 in H1,
    whether the jump lies on a grid line or inside cells. Smooth the transition over a few cells, or
    treat the two sides as separate domains.

    Raises
    ------
    InputError
        A penalty that is not positive; a function that reduces over the points; constants that are
        missing, not finite, or negative; data of the wrong shape.

    References
    ----------
    J. Nitsche, Ueber ein Variationsprinzip zur Loesung von Dirichlet-Problemen bei Verwendung von
    Teilraeumen, die keinen Randbedingungen unterworfen sind, Abhandlungen aus dem Mathematischen
    Seminar der Universitaet Hamburg 36 (1971), 9-15.

    P. Hansbo and M. G. Larson, Discontinuous Galerkin methods for incompressible and nearly
    incompressible elasticity by Nitsche's method, Computer Methods in Applied Mechanics and
    Engineering 191 (2002), 1895-1908.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from skfem_adini import CutDomain, ElementQuadAdini
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> domain = CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.81)
    >>> B, b = nitsche(domain.boundary(ElementQuadAdini()), lambda x: x[0])
    >>> B.shape, b.shape
    ((243, 243), (243,))
    """
    if not isinstance(boundary, BoundaryBasis | FacetBasis):
        raise InputError(
            f"boundary: expected what CutDomain.boundary(element) gives, or a FacetBasis, got "
            f"{type(boundary).__name__}"
        )
    beta = positive_number("beta", beta)
    vector = isinstance(boundary.elem, ElementVector)
    if vector != (lame is not None):
        raise InputError(
            "lame: give Lame's constants (lambda, mu) for vector fields, and only for them; got "
            f"{lame!r} for {type(boundary.elem).__name__}"
        )
    x = np.asarray(boundary.global_coordinates())
    if isinstance(boundary, BoundaryBasis):
        value, coefficient, lame = (
            _pointwise(*named)
            for named in (("value", value), ("coefficient", coefficient), ("lame", lame))
        )
    data = sample(value, x, 2 if vector else 1)
    fields = {"g": DiscreteField(data if vector else data[0])}
    if lame is not None:
        if not isinstance(lame, tuple | list) or len(lame) != 2:
            raise InputError(f"lame: expected (lambda, mu), got {lame!r}")
        fields["bulk"] = _field("lame: lambda", lame[0], x, zero=True)
        fields["mu"] = _field("lame: mu", lame[1], x)
        pair = _elastic(beta)
    else:
        fields["k"] = _field("coefficient", coefficient, x)
        pair = _scalar(beta)
    matrix, load = (form.assemble(boundary, **fields) for form in pair)
    return matrix, load


def _pointwise(name: str, data: Any) -> Any:
    """Return the data, with functions that raise an error if they mix points."""
    if isinstance(data, list | tuple):
        return [_pointwise(name, part) for part in data]
    return pointwise(name, data) if callable(data) else data


def _scalar(beta: float) -> tuple[BilinearForm, LinearForm]:
    def flux(u: Any, w: Any) -> Any:
        return w.k * dot(grad(u), w.n)

    def matrix(u: Any, v: Any, w: Any) -> Any:
        return beta * w.k / w.h * u * v - flux(u, w) * v - flux(v, w) * u

    def load(v: Any, w: Any) -> Any:
        return w.g * (beta * w.k / w.h * v - flux(v, w))

    return BilinearForm(matrix), LinearForm(load)


def _elastic(beta: float) -> tuple[BilinearForm, LinearForm]:
    def traction(u: Any, w: Any) -> Any:
        return w.bulk * div(u) * w.n + 2 * w.mu * mul(sym_grad(u), w.n)

    def penalty(u: Any, v: Any, w: Any) -> Any:
        return beta / w.h * (2 * w.mu * dot(u, v) + w.bulk * dot(u, w.n) * dot(v, w.n))

    def matrix(u: Any, v: Any, w: Any) -> Any:
        return penalty(u, v, w) - dot(traction(u, w), v) - dot(traction(v, w), u)

    def load(v: Any, w: Any) -> Any:
        return penalty(w.g, v, w) - dot(traction(v, w), w.g)

    return BilinearForm(matrix), LinearForm(load)


def _field(name: str, coefficient: Coefficient, x: Array, zero: bool = False) -> DiscreteField:
    try:
        data = sample(coefficient, x, 1)[0]
    except InputError as error:
        raise InputError(str(error).replace("value:", f"{name}:")) from error
    if data.min() < 0 or (data.min() == 0 and not zero):
        raise InputError(f"{name}: expected positive values, got {data.min():.3g}")
    return DiscreteField(data)
