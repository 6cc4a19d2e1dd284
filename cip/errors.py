"""Errors of the package, and those that it shares with the others."""

from skfem_adini.ground.errors import (  # noqa: F401
    AdiniError,
    InputError,
    MissingDependency,
    NotConverged,
    NotSupported,
)

CipError = AdiniError


class PeriodicityWarning(UserWarning):
    """A velocity is not quite periodic where its grid is.

    It jumps a little, or its derivative across the sides does. Near these the field is less
    accurate; make the velocity periodic, or the direction of the grid not.

    Examples
    --------
    A parabola that vanishes at both ends, with slopes of opposite signs:

    >>> import warnings
    >>> from cip import Grid, PeriodicityWarning, Solver
    >>> with warnings.catch_warnings(record=True) as said:
    ...     warnings.simplefilter("always")
    ...     solver = Solver(Grid((0, 1), 16, periodic=True), lambda x: x * (1 - x))
    >>> said[0].category is PeriodicityWarning
    True
    """


class DivergenceWarning(UserWarning):
    """A velocity from a mesh has on its grid a divergence that the solution does not have.

    The message says both. Take a finer grid, or, in the plane, the stream function.

    Examples
    --------
    A velocity that jumps between the cells of its mesh, of the lowest Raviart-Thomas element:

    >>> import warnings
    >>> import numpy as np
    >>> import skfem
    >>> from cip import DivergenceWarning, Grid, Velocity
    >>> basis = skfem.Basis(skfem.MeshTri().refined(2), skfem.ElementTriRT0())
    >>> u = basis.project(lambda x: np.stack([np.sin(6 * x[1]), np.sin(6 * x[0])]))
    >>> with warnings.catch_warnings(record=True) as said:
    ...     warnings.simplefilter("always")
    ...     wind = Velocity.from_basis(basis, u, Grid([(0, 1)] * 2, (16, 16)))
    >>> said[0].category is DivergenceWarning
    True
    """


class LeftDomain(CipError):
    """A backward characteristic leaves the domain where no boundary data is given.

    The message names the wall and the time. Pass data for that wall in `boundary`, or make the
    direction periodic.

    Examples
    --------
    Flow to the right, which enters at x = 0:

    >>> from cip import Grid, Solver
    >>> solver = Solver(Grid((0, 1), 16), 1.0)
    >>> solver.step(solver.state(lambda x: x), 0.1)
    Traceback (most recent call last):
        ...
    cip.errors.LeftDomain: boundary: ... comes in through the wall 'x-' ... pass boundary={'x-': ...
    """


class NotFinite(CipError):
    """A velocity, a characteristic or a moment is NaN or infinite; nothing is returned.

    The message names the node or the point. Look there for a division by zero, a logarithm or an
    overflow in the velocity, or take a shorter step.

    Examples
    --------
    A step over 1000 periods, back to where the velocity's derivatives have overflowed:

    >>> import numpy as np
    >>> from cip import Grid, Solver
    >>> solver = Solver(Grid((0, 1), 16, periodic=True), lambda x: 1e4 * np.sin(2 * np.pi * x))
    >>> solver.step(solver.state(0.0), 0.9)
    Traceback (most recent call last):
        ...
    cip.errors.NotFinite: velocity: the characteristic of node ... is not finite at t = ...
    """
