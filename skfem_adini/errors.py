"""Warnings of the package, and the exceptions that it shares with the others."""

from skfem_adini.ground.errors import (  # noqa: F401
    AdiniError,
    InputError,
    MissingDependency,
    NotConverged,
    NotSupported,
    SolverError,
)


class ReducedOrderWarning(UserWarning):
    """Not issued any more: cells on which an order is lost are named in the log (`logging`).

    The name remains so that existing filters work.

    Examples
    --------
    A filter of an older script; nothing can meet it:

    >>> import warnings
    >>> from skfem_adini import ReducedOrderWarning
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", ReducedOrderWarning)
    """


class UnresolvedWarning(UserWarning):
    """A cut domain has gaps, holes or strips narrower than the cells: refine the mesh there.

    The solution is that of another domain there, one whose gap is closed or whose hole is filled.
    Make the cells a few times smaller than the feature, with `refined_at_boundary` or a finer mesh.

    Examples
    --------
    A hole of radius .1 in a disk, on cells of side .25:

    >>> import warnings
    >>> import numpy as np
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import AdiniExtension, CutDomain, ElementQuadAdini, LevelSet
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> basis = Basis(mesh, ElementQuadAdini())
    >>> disk, hole = (LevelSet(lambda x, r=r: x[0] ** 2 + x[1] ** 2 - r**2) for r in (0.8, 0.1))
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     extension = AdiniExtension(basis, CutDomain(mesh, disk - hole))
    >>> found[0].category.__name__
    'UnresolvedWarning'
    """


class IndefiniteWarning(UserWarning):
    """A form that should be positive has a negative eigenvalue: the problem is another one.

    Penalties that are too small, as of Nitsche's method, or a wrong sign in the form make it so. If
    it is meant, as with K - 50 M, filter the warning.

    Examples
    --------
    A stiffness matrix shifted below zero:

    >>> import warnings
    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace, mass
    >>> from skfem_adini import ElementQuadAdini, lowest_eigenpairs
    >>> basis = Basis(MeshQuad().refined(2), ElementQuadAdini())
    >>> K, M = laplace.assemble(basis), mass.assemble(basis)
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     values, _ = lowest_eigenpairs(K - 50 * M, M, 1)
    >>> found[0].category.__name__, round(float(values[0]))
    ('IndefiniteWarning', -50)
    """
