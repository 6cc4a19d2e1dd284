"""Exceptions and warnings of the package, all under :class:`AdiniError`."""

import re

# How NumPy shows its numbers, alone or in a tuple; what is said is the number.
_NUMPY_SCALAR = re.compile(
    r"\bnp\.(?:(?:u?int|float|complex|c?longdouble|str_|bool)\d*\(([^()]*|\(.*?\))\)|(True|False)_)"
)


class AdiniError(Exception):
    """Base class of every exception raised by `skfem_adini`.

    Catch it where any failure of the package is to be treated alike; its subclasses tell what to
    do.

    Examples
    --------
    >>> from skfem_adini import AdiniError, UniformSolver
    >>> try:
    ...     UniformSolver((1, 16), 1.0)
    ... except AdiniError as error:
    ...     print(type(error).__name__)
    InputError
    """

    def __str__(self) -> str:
        return _NUMPY_SCALAR.sub(r"\1\2", str(self.args[0]) if self.args else "")


class InputError(AdiniError, ValueError):
    """An argument cannot be used; the message names it, what was found and what to do.

    Nothing has been computed. Mend the argument that the message begins with; it is a `ValueError`
    too, so that code which knows only the exceptions of Python catches it.

    Examples
    --------
    A plane stress tensor without its zero third row and column:

    >>> import numpy as np
    >>> from skfem_adini import von_mises
    >>> von_mises(np.eye(2))
    Traceback (most recent call last):
        ...
    skfem_adini.errors.InputError: stress: expected shape (3, 3, ...) with sigma_zz, got (2, 2); ...
    """


class MissingDependency(AdiniError, ImportError):
    """An optional package is not installed; the message holds the line that installs it.

    Run the line that the message ends with and repeat the call; it is an `ImportError` too.

    Examples
    --------
    An environment without pyvista:

    >>> from unittest.mock import patch
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini, to_pyvista
    >>> basis = Basis(MeshQuad(), ElementQuadAdini())
    >>> with patch.dict("sys.modules", {"pyvista": None}):
    ...     to_pyvista(basis, basis.zeros())
    Traceback (most recent call last):
        ...
    skfem_adini.errors.MissingDependency: VTK output needs pyvista: pip install ...
    """


class NotConverged(AdiniError):
    """An iteration did not reach its tolerance; the message says how far it came.

    No result is returned. Raise the tolerance or the number of iterations, or take the direct
    solver or the other shift that the message names.

    Examples
    --------
    Multigrid that is allowed one iteration:

    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace, mass
    >>> from skfem_adini import ElementQuadAdini, factorize, near_null_space
    >>> basis = Basis(MeshQuad().refined(2), ElementQuadAdini())
    >>> A = laplace.assemble(basis) + mass.assemble(basis)
    >>> factor = factorize(A, solver="amg", near_null=near_null_space(basis), max_iterations=1)
    >>> factor.solve(basis.project(lambda x: x[0]))
    Traceback (most recent call last):
        ...
    skfem_adini.errors.NotConverged: multigrid: relative residual ... after 1 iterations, ...
    """


class ReducedOrderWarning(UserWarning):
    """Not issued any more: cells on which an order is lost are named in the log (`logging`).

    The name stays so that filters which hold it go on working.

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
