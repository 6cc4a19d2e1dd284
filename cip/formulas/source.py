"""A scalar function of space and time, given as a formula, a callable, or arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cip.errors import InputError, NotSupported
from cip.formulas.expression import COORDINATES
from cip.formulas.formula import Box, Formula, spline
from cip.formulas.parameters import Parametrised, checked, require_held
from cip.formulas.parsing import parse
from cip.formulas.snapshots import SnapshotFormula, Snapshots
from cip.formulas.traced_function import clocks_in, portable, timed
from cip.grid import Grid, GridLike, Sphere
from skfem_adini.ground.arguments import own_array, real_number


class Source(Parametrised):
    """A source s(x, t): the rate at which a field grows at each place, in u_t + .. = s - k u.

    Parameters
    ----------
    s : float, str, callable or array
        A number; a formula in x1, x2, x3 (or x, y, z; on a sphere lon, lat in radians) and t; a
        callable of the coordinates as arrays, and of the time if it has an argument ``t`` (or
        ``time``), the last; or values at the nodes of the grid, shape ``grid.nodes``, copied,
        between which it is a quintic spline. In the unit of the field over that of time.

    Raises
    ------
    InputError
        An argument is malformed, or not finite; with a solver, arrays that do not fit its grid.

    Examples
    --------
    >>> from cip import Grid, Solver, Source
    >>> puff = Source.from_expression("q*exp(-50*(x1 - 0.5)**2)", parameters={"q": 2.0})
    >>> solver = Solver(Grid((0, 1), 40, periodic=True), 0.3, source=puff, decay=0.5)
    >>> end = solver.run(solver.state(0.0), 1.0, dt=0.05).final
    >>> bool(end["u"].max() > 0.5)
    True
    """

    _kind = "source"

    def __init__(self, s: Any) -> None:
        self._value, self._name = s, "source"
        self._parameters: dict[str, float] = {}
        self._snapshots: Snapshots | None = None
        self._text: str | None = None
        self._time = isinstance(s, str) or bool(clocks_in(s))
        if isinstance(s, str):
            self._text = s
            parse(s, self._name)
        elif not callable(s):
            if not isinstance(s, Mapping):
                self._value = own_array("source", s)
            if not np.ndim(self._value):
                kinds = "source: expected a number, a text, a callable or an array"
                self._value = real_number(kinds, s)
                if not np.isfinite(self._value):
                    raise InputError(f"source: expected a finite number, got {s!r}")

    @classmethod
    def from_expression(cls, text: str, parameters: Mapping[str, float] | None = None) -> Source:
        """The source with this formula, whose further names are parameters.

        Parameters
        ----------
        text : str
            As for `Velocity.from_expression`.
        parameters : mapping, optional
            Values of further names in the formula.

        Returns
        -------
        Source

        Raises
        ------
        InputError
            A text that is no formula; a parameter that it does not hold or that is not finite.

        Examples
        --------
        >>> from cip import Source
        >>> Source.from_expression("q*sin(x1)", parameters={"q": 2}).with_parameters(q=3).parameters
        {'q': 3.0}
        """
        values = checked(parameters)
        require_held(values, [parse(text, "source", values)])
        self = cls(0.0)
        self._text, self._time, self._parameters = text, True, values
        return self

    @classmethod
    def from_snapshots(cls, times: Any, arrays: Any, grid: Grid, degree: int = 5) -> Source:
        """The source with given values at the nodes of a grid at several times.

        Parameters
        ----------
        times, grid, degree
            As for `Velocity.from_snapshots`, whose splines are those of this source.
        arrays : array_like, shape (T,) + grid.nodes

        Returns
        -------
        Source

        Raises
        ------
        InputError
            As for `Velocity.from_snapshots`.

        Examples
        --------
        >>> import numpy as np
        >>> from cip import Grid, Source
        >>> grid, times = Grid((0, 1), 20, periodic=True), [0.0, 0.5, 1.0, 1.5]
        >>> Source.from_snapshots(times, np.ones((4, 20)), grid).steady
        False
        """
        self = cls(0.0)
        self._snapshots = Snapshots(times, arrays, grid, degree, 1)
        self._time = True
        return self

    @classmethod
    def of(cls, value: Any, name: str) -> Source | None:
        """An argument of the solver as a source, called `name` in messages; None if it is None.

        Parameters
        ----------
        value : object
            A source, what makes one, or None.
        name : str

        Returns
        -------
        Source or None

        Raises
        ------
        InputError
            A value that makes no source.
        """
        if value is None:
            return None
        try:
            found = value if isinstance(value, Source) else cls(value)
        except InputError as error:
            raise InputError(str(error).replace("source", name, 1)) from error
        new = found._copy()
        new._name = name
        return new

    @property
    def steady(self) -> bool:
        """Whether it does not depend on t."""
        if self._text is not None:
            return "t" not in parse(self._text, self._name, self._parameters).variables()
        return not self._time

    @property
    def gridded(self) -> bool:
        """Whether it is given by arrays."""
        return self._snapshots is not None or not (
            self._text is not None or callable(self._value) or not np.ndim(self._value)
        )

    def check_times(self, start: float, end: float) -> None:
        """Raise `InputError` if snapshots do not cover the time from `start` to `end`.

        Parameters
        ----------
        start, end : float
        """
        if self._snapshots is not None:
            self._snapshots.check_times(start, end, self._name)

    def on(self, grid: GridLike) -> Formula:
        """The source as a formula on a grid.

        Parameters
        ----------
        grid : Grid or Sphere

        Returns
        -------
        Formula

        Raises
        ------
        InputError
            Arrays or a formula that do not fit the grid.
        NotSupported
            Snapshots on a sphere.
        """
        if self._snapshots is not None:
            if isinstance(grid, Sphere):
                raise NotSupported(
                    f"{self._name}: snapshots live on a Grid; on a sphere pass a callable of lon, "
                    "lat and t"
                )
            self._snapshots.check_cover(grid, self._name)
            return SnapshotFormula(self._snapshots, 0, f"{self._name}_snapshots")
        if self._text is not None:
            known = self._parameters
            return Formula.of(self._text, grid.bounds, self._name, parameters=known)
        if not callable(self._value) and np.ndim(self._value):
            return spline(self._value, grid, self._name)
        return self._formula(grid.bounds)

    def _formula(self, box: Box) -> Formula:
        return Formula.of(timed(self._value), box, self._name, time=self._time, sparse=False)

    def __getstate__(self) -> dict[str, Any]:
        def trace() -> dict[tuple[str, ...], Any]:
            found = {}
            for dim in (1, 2, 3):
                try:
                    formula = self._formula([(0.0, 1.0)] * dim)
                except InputError:  # it has another number of coordinates
                    continue
                if formula.exact:
                    names = (*COORDINATES[:dim], *(("t",) if self._time else ()))
                    found[names] = [formula.expression]
            return found

        return {**self.__dict__, "_value": portable(self._value, self._name, trace)}
