"""Errors of this package; each message names the argument, what was found, and what to do."""

from __future__ import annotations

import re

# How NumPy shows its numbers, alone or in a tuple; what is said is the number.
_NUMPY_SCALAR = re.compile(
    r"\bnp\.(?:(?:u?int|float|complex|c?longdouble|str_|bool)\d*\(([^()]*|\(.*?\))\)|(True|False)_)"
)


class CipError(Exception):
    """Base class of every error raised on purpose by `cip`.

    Catch it to treat all failures of the package alike; each subclass says what to do about its
    kind.

    Examples
    --------
    >>> from cip import CipError, Grid
    >>> try:
    ...     Grid((0, 1), 3)
    ... except CipError as error:
    ...     print(error)
    shape: expected at least 4 cells in each direction, got 3
    """

    def __str__(self) -> str:
        return _NUMPY_SCALAR.sub(r"\1\2", str(self.args[0]) if self.args else "")


class InputError(CipError, ValueError):
    """An argument is malformed.

    Nothing has been computed. Correct the argument with which the message begins. The class is also
    a `ValueError`.

    Examples
    --------
    A two-dimensional profile on a line:

    >>> from cip import Grid, Solver
    >>> Solver(Grid((0, 1), 16), 1.0, profile="bicubic")
    Traceback (most recent call last):
        ...
    cip.errors.InputError: profile: 'bicubic' is two-dimensional, the grid has 1
    """


class NotSupported(CipError, NotImplementedError):
    """A valid request that this version cannot serve.

    Use the other profile, splitting or backend that the message names.

    Examples
    --------
    Data on a wall that vary along it, together with a splitting:

    >>> from cip import Grid, Solver
    >>> grid = Grid([(0, 1), (0, 1)], (16, 16))
    >>> Solver(grid, (1.0, 0.0), profile="cubic", splitting="strang", boundary={"x-": "x2"})
    Traceback (most recent call last):
        ...
    cip.errors.NotSupported: boundary: with splitting the data of the wall x- must be constant; ...
    """


class MissingDependency(CipError, ImportError):
    """An optional package is needed and not installed.

    Run the command in the message and repeat the call. The class is also an `ImportError`.

    Examples
    --------
    An environment without CuPy:

    >>> from unittest.mock import patch
    >>> from cip import Grid, Solver
    >>> with patch.dict("sys.modules", {"cupy": None}):
    ...     Solver(Grid((0, 1), 16), 1.0, backend="cupy")
    Traceback (most recent call last):
        ...
    cip.errors.MissingDependency: backend='cupy' needs CuPy: pip install ...
    """


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


class NotConverged(CipError):
    """The characteristics do not reach their tolerance within the allowed sub-steps.

    The velocity is not smooth, or varies on a scale much shorter than a step. Smooth it, or take a
    smaller `dt`.

    Examples
    --------
    A velocity with 1000 waves in the domain, and a step over 300 of them:

    >>> import numpy as np
    >>> from cip import Grid, Solver
    >>> velocity = lambda x: 1.5 + np.sin(2000 * np.pi * x)
    >>> solver = Solver(Grid((0, 1), 16, periodic=True), velocity)
    >>> solver.step(solver.state(0.0), 0.2)
    Traceback (most recent call last):
        ...
    cip.errors.NotConverged: characteristics: after ... sub-steps ... Take a smaller dt
    """
