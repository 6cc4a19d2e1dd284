"""Velocity fields with exact derivatives where a formula is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Self
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError, PeriodicityWarning
from cip.formulas.dataset import gridded_arrays, meaning
from cip.formulas.expression import COORDINATES, Orders, raised, traced
from cip.formulas.formula import CLOCK, Box, Formula, agree, spline
from cip.formulas.mesh_field import MeshField
from cip.formulas.parameters import Parametrised, checked, require_held
from cip.formulas.snapshots import LazySnapshots, SnapshotFormula, Snapshots
from cip.formulas.spline_basis import SplineFormula
from cip.formulas.traced_function import clock_of, portable, timed, with_time
from cip.grid import AXES, Array, Grid
from skfem_adini.ground.arguments import flag, own_array, real_number
from skfem_adini.ground.errors import warn


class Velocity(Parametrised):
    """The velocity c of u_t + c . grad u = 0 or p_t + div(c p) = 0.

    Parameters
    ----------
    c : callable, array_like, or a sequence of these
        A callable takes the coordinates as arrays, ``c(x1, x2)``, and t last if not `steady`; it
        returns one array for each component. A callable that is plain arithmetic of NumPy
        functions is traced once: its derivatives are exact and it is compiled for CPU and GPU.
        Of any other callable only values are used; its value at a point must not depend on the
        other points of the call, so callables that subtract a mean or shift the array are refused.
        Arrays are nodal values, one for each component, copied and interpolated by quintic splines;
        they are steady.
    jacobian : callable, optional
        ``jacobian(x1, x2)[i][k]`` = dc_i / dx_k, for callables that cannot be traced; default
        sixth-order differences.
    hessian : callable, optional
        ``hessian(x1, x2)[i][k][l]``, likewise.
    steady : bool, optional
        Whether c does not depend on t. By default it does if a callable has an argument ``t`` (or
        ``time``) with a default value, which then receives the time, and else it does not.

    Raises
    ------
    InputError
        An argument is malformed; the message names it.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Velocity
    >>> Velocity(lambda x: x - x**3).exact
    True
    >>> swirl = Velocity.from_expression("sin(pi*x1)**2 * sin(2*pi*x2) * cos(pi*t)", "0")
    >>> swirl.dim, swirl.steady
    (2, False)
    """

    _kind = "velocity"
    # Of a velocity `from_basis`.
    divergence: float
    divergence_of_solution: float
    error: float
    land: NDArray[np.bool_] | None

    def __init__(
        self,
        c: Any,
        jacobian: Callable[..., Any] | None = None,
        hessian: Callable[..., Any] | None = None,
        steady: bool | None = None,
    ) -> None:
        several = isinstance(c, list | tuple)
        if steady is None:
            steady = not any(map(clock_of, c if several else [c]))
            if not steady:  # some components may depend on t and others may not take it as argument
                c = [with_time(part) for part in c] if several else with_time(c)
                jacobian, hessian = with_time(jacobian), with_time(hessian)
        elif not steady:
            c = [timed(part) for part in c] if several else timed(c)
            jacobian, hessian = timed(jacobian), timed(hessian)
        self._c, self._jacobian, self._hessian = c, jacobian, hessian
        self.steady = bool(steady)
        self._formulas: tuple[Formula, ...] | None = None
        self._parameters: dict[str, float] = {}
        self._feet: Any = WeakValueDictionary()  # of a steady velocity, which solvers share
        self._snapshots: Snapshots | None = None
        self._start: Any = None  # the date of t = 0, where there is one
        self._units: dict[str, str] = {}  # of coordinates, as a trajectory names them
        self._mesh: MeshField | None = None
        self._box: Box = ()
        for name, value in {"jacobian": jacobian, "hessian": hessian}.items():
            if value is not None and not (callable(value) and callable(c)):
                raise InputError(f"{name}: expected a callable beside a callable c, got {value!r}")
        if callable(c):
            self.dim = 0  # known once a grid is given
        elif isinstance(c, str):
            raise InputError("c: for a text use Velocity.from_expression")
        else:
            self._c = parts = given_components(c)
            self.dim = len(parts)
            if not steady and any(np.ndim(part) > 0 for part in parts):
                raise InputError("steady: velocities given by arrays are steady")

    @classmethod
    def from_expression(
        cls, *components: str | float, parameters: Mapping[str, float] | None = None
    ) -> Velocity:
        """The velocity with these formulas in x1, x2, x3 (or x, y, z) and t as components.

        Parameters
        ----------
        *components : str or float
            One for each direction, for instance ``"x2", "-x1"``: arithmetic (``+ - * / **``) of
            these variables, numbers, pi and e, with sin, cos, tan, arcsin, arccos, arctan, sinh,
            cosh, tanh, exp, log, sqrt, abs and sign.
        parameters : mapping, optional
            Values of further names in the formulas, which `with_parameters` changes, and by which
            runs are differentiated. They and the numbers in the text are arguments of the compiled
            code on the CPU: others compile nothing. Feet of an unsteady velocity with parameters
            take longer, as their derivatives follow the paths.

        Returns
        -------
        Velocity
            Exact: its derivatives are taken from the formulas.

        Raises
        ------
        InputError
            A text that is not of this form (ASCII only), or whose numbers overflow; a parameter
            that no formula holds, whose value is not a finite number, or whose name is a keyword or
            reserved in Python, C or CUDA.

        Examples
        --------
        >>> from cip import Velocity
        >>> shear = Velocity.from_expression("a*sin(k*x2)", "0", parameters={"a": 1.0, "k": 2.0})
        >>> shear.with_parameters(a=0.5).parameters
        {'a': 0.5, 'k': 2.0}
        """
        if not 1 <= len(components) <= 3:
            raise InputError(f"components: expected 1 to 3 formulas, got {len(components)}")
        self = cls([0.0] * len(components))
        values = checked(parameters)
        formulas = []
        for q, text in enumerate(components):
            name = f"component {q + 1}"
            if not isinstance(text, str):
                text = real_number(f"{name}: expected a text or a number", text)
            box = [(0.0, 1.0)] * len(components)
            formulas.append(Formula.of(text, box, name, parameters=values))
        require_held(values, [formula.expression for formula in formulas])
        self._formulas = tuple(formulas)
        self._parameters = values
        self.steady = all(formula.steady for formula in formulas)
        return self

    @classmethod
    def from_snapshots(
        cls,
        times: Any,
        arrays: Any,
        grid: Grid,
        degree: int = 5,
        time: Literal["cubic", "linear"] = "cubic",
    ) -> Velocity:
        """The velocity with given values at the nodes of a grid at several times.

        Between them it is the tensor-product spline through all values (de Boor, A Practical Guide
        to Splines, 1978, chapters IX and XIII), by default cubic in time (of lower degree for 2 and
        3 times).
        Its derivatives, which the schemes need, are those of the spline, and with four or more
        times it is twice differentiable also at these: steps may cross them. It is compiled for
        CPU and GPU; new data of the same degree and dimension compile nothing.

        Parameters
        ----------
        times : array_like, shape (T,)
            Increasing, at least 2. A step that leaves their range is refused.
        arrays : array_like, shape (T, dim) + grid.nodes
            All components at each time; in one dimension also (T, nodes).
        grid : Grid
            That of the arrays, uniform or not. It covers the grid of the solver or, where it is
            periodic, has a period that fits a whole number of times.
        degree : {5, 3}
            In space: values are of order `degree` + 1 in the spacing, derivatives one less each.
            Kinks in the second derivatives of cubic splines cost the characteristics sub-steps.
        time : {"cubic", "linear"}
            A step over a time of linear interpolation is divided there.

        Returns
        -------
        Velocity
            It depends on t.

        Raises
        ------
        InputError
            Times that do not increase, arrays of another shape, NaN in them (with the place), or
            fewer cells than the degree needs; with a solver, a grid that the data do not cover.

        Examples
        --------
        >>> import numpy as np
        >>> from cip import Grid, Velocity
        >>> grid, times = Grid((0, 1), 20, periodic=True), [0.0, 0.5, 1.0, 1.5]
        >>> winds = [np.sin(2 * np.pi * (grid.coordinates[0] - t)) for t in times]
        >>> velocity = Velocity.from_snapshots(times, winds, grid)
        >>> velocity.dim, velocity.steady, velocity.exact
        (1, False, True)
        """
        field = Snapshots(times, arrays, grid, degree, time=time)
        self = cls([0.0] * grid.dim)
        self._snapshots, self.steady = field, False
        return self

    @property
    def grid(self) -> Grid | None:
        """The grid of its snapshots, for a solver; None for other velocities."""
        return None if self._snapshots is None else self._snapshots.grid

    @classmethod
    def from_xarray(
        cls,
        winds: Any,
        components: Sequence[str],
        axes: Sequence[str],
        time: str = "time",
        periodic: Any = False,
        degree: int = 5,
        in_time: Literal["cubic", "linear"] = "cubic",
        lazy: bool = False,
    ) -> Velocity:
        """The velocity in variables of an xarray.Dataset, by `from_snapshots`.

        Parameters
        ----------
        winds : xarray.Dataset
            Some of its times are ``winds.sel(time=slice(first, last))``, which reads nothing yet.
        components : sequence of str
            Names of the variables in the directions of `axes`, for instance ``("u10", "v10")``.
        axes : sequence of str
            Names of the coordinates that are x1, x2, x3, as ``("lon", "lat")``. Components must be
            in their unit over that of time: convert degrees and m/s before.
        time : str
            Name of the coordinate of time; dates become seconds since the first. Runs carry them
            and the units of the axes on: `Trajectory.to_xarray`, plots and animations have dates.
        periodic : bool or sequence of bool
            Directions whose last value is followed by the first.
        degree : {5, 3}
        in_time : {"cubic", "linear"}
            As `time` of `from_snapshots`.
        lazy : bool
            Read arrays, of a file or of dask, when a step needs them, and keep a few around it: of
            linear interpolation about 8, of cubic about 40, which agrees with that of all to 1e-7.
            For ``bicubic``, ``adini``, ``csl2`` and ``csl4`` on uniform grids in the plane or in
            space; others raise `NotSupported`. Gaps are found when they are read.

        Returns
        -------
        Velocity

        Raises
        ------
        InputError
            A name that the dataset does not have, other dimensions, m/s or no unit over degrees,
            m/s over km, or as for `from_snapshots`.

        Examples
        --------
        >>> import numpy as np
        >>> import xarray
        >>> from cip import Velocity
        >>> axes = {"time": np.arange(4.0), "lat": np.linspace(3, 0, 9), "lon": np.arange(8.0)}
        >>> one = (("time", "lat", "lon"), np.ones((4, 9, 8)))
        >>> winds = xarray.Dataset({"u10": one, "v10": one}, axes)
        >>> Velocity.from_xarray(winds, ("u10", "v10"), ("lon", "lat")).grid
        Grid([0, 7], [0, 3], cells=(7, 8), periodic=(False, False))
        """
        times, read, grid = gridded_arrays(winds, components, axes, time, periodic)
        if flag("lazy", lazy):
            self = cls([0.0] * grid.dim)
            self._snapshots, self.steady = LazySnapshots(times, read, grid, degree, in_time), False
        else:
            self = cls.from_snapshots(times, read(slice(None)), grid, degree, in_time)
        self._start, self._units = meaning(winds, axes, time)
        return self

    @classmethod
    def from_basis(
        cls,
        basis: Any,
        u: Any,
        grid: Grid,
        *,
        times: Any = None,
        stream: bool = False,
        outside: Literal["land"] | None = None,
    ) -> Velocity:
        """The velocity of a scikit-fem solution, read at the nodes of a grid.

        Between the nodes it is their quintic spline. The conservative profiles keep the integral of
        what they carry for any velocity; a uniform field stays uniform as far as the divergence is
        zero. That of the spline is in general not that of the solution, and is measured. A stream
        function gives a velocity without divergence.

        Parameters
        ----------
        basis : skfem.Basis
            Of a vector-valued element (H1 or Raviart-Thomas) on the whole mesh, in two or three
            dimensions, or for `stream` of a scalar one in the plane. Points are sought in the cells
            with straight sides.
        u : array_like, shape (basis.N,) or (times, basis.N)
            The solution.
        grid : Grid
            Of the solver.
        times : array_like, shape (times,), optional
            For a solution that depends on time, as in `from_snapshots`.
        stream : bool
            Whether u is a stream function psi: the velocity is (psi_y, -psi_x). It is found from a
            velocity (a, b) by a Poisson problem, - lap psi = b_x - a_y.
        outside : {None, "land"}
            With "land" nodes outside the mesh get the value of the nearest one inside, and the
            attribute ``land`` marks the cells there for ``Solver(land=)``.

        Returns
        -------
        Velocity
            For this grid, with attributes that hold for the middles of those of its cells that lie
            in the mesh, at all times: ``divergence`` and ``divergence_of_solution``, the largest
            absolute values of div c (1 / time; the relative rate at which a uniform field changes),
            ``error``, the largest difference of a component from the solution, and ``land``, an
            array of bool of shape ``grid.cells``, or None where no cell lies outside.

        Raises
        ------
        InputError
            A node outside the mesh, unless `outside` is "land"; an element, an array or a grid that
            does not fit.

        Warns
        -----
        DivergenceWarning
            The divergence on the grid exceeds that of the solution by more than a hundredth of the
            velocity's largest rate.

        Examples
        --------
        >>> import numpy as np
        >>> import skfem
        >>> from cip import Grid, Velocity
        >>> mesh, element = skfem.MeshTri().refined(2), skfem.ElementTriP2()
        >>> basis = skfem.Basis(mesh, skfem.ElementVector(element))
        >>> u = basis.project(lambda x: np.stack([x[0] ** 2, -2 * x[0] * x[1]]))
        >>> wind = Velocity.from_basis(basis, u, Grid([(0, 1)] * 2, (16, 16)))
        >>> wind.divergence < 1e-9, wind.error < 1e-9
        (True, True)
        """
        field = MeshField(basis, u, grid, times, stream, outside)
        self = cls([0.0] * grid.dim)
        self._mesh, self._snapshots, self.steady = field, field.snapshots, times is None
        self.divergence, self.error, self.land = field.divergence, field.error, field.land
        self.divergence_of_solution = field.divergence_of_solution
        return self

    def _with(self, values: dict[str, float]) -> Self:
        new = super()._with(values)
        new._feet = WeakValueDictionary()
        new._formulas = tuple(formula.with_numbers(values) for formula in self._formulas or ())
        return new

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__ | {"_feet": None}
        for name in ("_c", "_jacobian", "_hessian"):
            value = state[name]
            if isinstance(value, list):
                state[name] = [self._portable(part, len(value)) for part in value]
            else:
                state[name] = self._portable(value)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _feet=WeakValueDictionary())

    def _where(self, dim: int) -> Box:
        """The box from which test points are taken: the last grid's, else the unit box."""
        return self._box if len(self._box) == dim else [(0.0, 1.0)] * dim

    def _portable(self, value: Any, dim: int | None = None) -> Any:
        """A picklable form of a callable for all components (`dim` None: traced for 1 to 3
        directions), or for one component on grids of `dim` directions."""

        def trace() -> dict[tuple[str, ...], Any]:
            found = {}
            for n in (1, 2, 3) if dim is None else (dim,):
                names = (*COORDINATES[:n], *(() if self.steady else ("t",)))
                given = value, self._where(n)
                formulas = traced_velocity(*given, not self.steady) if dim is None else ()
                if dim is not None:
                    formulas = (Formula.of(*given, "c", not self.steady),)
                if formulas and all(formula.exact for formula in formulas):
                    found[names] = [formula.expression for formula in formulas]
            return found

        return portable(value, "velocity", trace)

    @property
    def exact(self) -> bool:
        """Whether every component is a formula; in 1-D for a callable before it meets a grid.

        A callable does not tell its number of components before `on` is called with a grid; until
        then it is traced as a velocity in one dimension.
        """
        if self._snapshots is not None:
            return True
        if self._mesh is not None:
            return False
        formulas = self._formulas or traced_velocity(
            self._c, self._where(self.dim or 1), not self.steady
        )
        return formulas is not None and all(formula.exact for formula in formulas)

    def on(self, grid: Grid) -> tuple[Formula, ...]:
        """One `Formula` for each component on this grid."""
        self._box = grid.bounds
        if self._snapshots is not None:
            return self._snapshots.on(grid)
        if self._mesh is not None:
            return self._mesh.on(grid)
        parts = self._c if self._formulas is None else self._formulas
        if not callable(parts) and len(parts) != grid.dim:
            raise InputError(
                f"velocity: {len(parts)} components on a grid of {grid.dim} directions"
            )
        if self._formulas is not None:
            return self._formulas
        if callable(self._c):
            more = self._jacobian, self._hessian, self.steady, grid
            found = traced_velocity(self._c, grid.bounds, not self.steady)
            return found or formulas_by_values(self._c, *more)
        return tuple(
            Formula.of(part, grid.bounds, f"c{q + 1}", not self.steady)
            if callable(part) or isinstance(part, str) or np.ndim(part) == 0
            else spline(part, grid, f"c{q + 1}")
            for q, part in enumerate(self._c)
        )


def traced_velocity(c: Any, box: Box, time: bool) -> tuple[Formula, ...] | None:
    """The components that a callable computes, compared with it on `box`; None if it is not plain
    arithmetic. `time`: whether its last argument is t."""
    if not callable(c):
        return None
    dim = len(box)
    names = [*COORDINATES[:dim], *(["t"] if time else [])]
    found = []
    for q in range(dim):

        def part(*point: Any, q: int = q) -> Any:
            result = c(*point)
            if isinstance(result, tuple | list | np.ndarray) and np.ndim(result) == 1:
                if len(result) != dim:
                    raise TypeError("wrong number of components")
                return result[q]
            if dim > 1:
                raise TypeError("one component only")
            return result

        expression = traced(part, names)
        if expression is None:
            return None
        found.append(expression)
    if not agree(found, c, box, time):
        return None
    return tuple(Formula(expression, dim) for expression in found)


def given_components(c: Any) -> list[Any]:
    """The components of a velocity given by one or more numbers, arrays (copied) or callables."""
    if isinstance(c, bool | int | float | np.number) or (isinstance(c, np.ndarray) and not c.ndim):
        return [real_number("c", c)]
    if isinstance(c, np.ndarray):
        values = own_array("c", c)
        return [values] if values.ndim == 1 or values.ndim != len(values) + 1 else list(values)
    if isinstance(c, Sequence):
        if len(c) > 3 and all(np.ndim(part) == 0 and not callable(part) for part in c):
            return [own_array("c", c)]
        if not 1 <= len(c) <= 3:
            raise InputError(f"c: expected 1 to 3 components, got {len(c)}")
        return [
            part if callable(part) or isinstance(part, str) else _part(part, f"c{q + 1}")
            for q, part in enumerate(c)
        ]
    raise InputError(f"c: expected a callable or arrays, got {type(c).__name__}")


def _part(value: Any, name: str) -> Any:
    """A component as a number or as a copied array."""
    values = own_array(name, value)
    return values if values.ndim else real_number(name, value)


def formulas_by_values(
    c: Any, jacobian: Any, hessian: Any, steady: bool, grid: Grid
) -> tuple[Formula, ...]:
    """The components of a callable of which only values (and given derivatives) are used."""
    dim = grid.dim

    def part(q: int) -> Callable[..., Any]:
        def values(*point: Any) -> Any:
            result = c(*point)
            parts = (result,) if dim == 1 and np.ndim(result) <= np.ndim(point[0]) else result
            if len(parts) != dim:
                raise InputError(f"c: returned {len(parts)} components, expected {dim}")
            return parts[q]

        return values

    def entry(function: Callable[..., Any], *place: int) -> Callable[..., Any]:
        def values(*point: Any) -> Any:
            result = function(*point)
            if dim == 1 and np.ndim(result) <= np.ndim(point[0]):
                return result
            for q in place:
                result = result[q]
            return result

        return values

    hint = "; a velocity that depends on t is Velocity(c, steady=False)" if steady else ""
    formulas = []
    for q in range(dim):
        known: dict[Orders, Callable[..., Any]] = {}
        for k in range(dim):
            if jacobian is not None:
                known[raised((0, 0, 0, 0), k)] = entry(jacobian, q, k)
            for l in range(k, dim):
                if hessian is not None:
                    known[raised(raised((0, 0, 0, 0), k), l)] = entry(hessian, q, k, l)
        name, time = f"c{q + 1}", not steady
        formulas.append(Formula.by_values(part(q), dim, name, time, known, hint))
        formulas[-1].check_pointwise(grid.bounds, name, time)
    return tuple(formulas)


class _Limits(NamedTuple):  # jumps between sides of a periodic direction, over the largest value
    rounding: float = 1e-6  # jumps below are rounding, of difference quotients too
    jump: float = 1e-3  # a field that jumps by more is not periodic
    kink: float = 1e-3  # the same of derivatives
    nodes: int = 256  # approximate number of points on a side, so that narrow streams are resolved
    # Test times, which are no zeros or periods of usual functions (roots of 1/7, 2 and 11).
    clocks: tuple[float, ...] = (CLOCK, 1.4142135623730951, 3.3166247903554)


LIMITS = _Limits()


def check_periodic(velocity: Sequence[Formula], grid: Grid) -> None:
    """Raise `InputError` if a velocity jumps between opposite sides of a periodic direction. Warn
    of a small jump, or of one of the derivative across the side."""
    for axis in range(grid.dim):
        if not grid.periodic[axis]:
            continue
        for q, formula in enumerate(velocity):
            if isinstance(formula, SplineFormula):  # its basis is periodic where the grid is
                continue
            if COORDINATES[axis] in formula.expression.variables():
                _compare(formula, f"c{q + 1}", grid, axis)


def _clocks(formula: Formula) -> Sequence[float]:
    if isinstance(formula, SnapshotFormula):
        return tuple(float(t) for t in np.quantile(formula.field.times, (0.0, 0.4, 1.0)))
    return LIMITS.clocks[:1] if formula.exact and formula.steady else LIMITS.clocks


def _compare(formula: Formula, name: str, grid: Grid, axis: int) -> None:
    """The values on both sides, and the derivatives across them."""
    low, high = grid.bounds[axis]
    uneven = (np.sqrt(2.0) * np.arange(1, 8) + 0.17) % 1.0
    lines = [a + (b - a) * uneven for a, b in grid.bounds]
    most = LIMITS.nodes if grid.dim == 2 else int(LIMITS.nodes**0.5)
    for q, x in enumerate(grid.coordinates):
        more = (low, high) if q == axis else x[:: -(-x.size // most)]
        lines[q] = np.sort([*lines[q], *more])
    points = np.meshgrid(*lines, indexing="ij")
    for clock in _clocks(formula):
        floor = 0.0
        for order, allowed in ((0, LIMITS.rounding), (1, LIMITS.kink)):
            try:
                values = np.moveaxis(_values(formula, order, axis, grid, points, clock), axis, 0)
            except InputError:  # the callable is not defined on the sides themselves
                return
            if not np.isfinite(values).all():
                break
            jump, size = np.abs(values[-1] - values[0]), float(np.abs(values).max())
            worst = np.unravel_index(int(np.argmax(jump)), jump.shape)
            if jump[worst] > max(allowed * size, floor):  # it may peak between points
                inside = _values(formula, order, axis, grid, grid.mesh(), clock)
                size = float(np.max(np.abs(inside), where=np.isfinite(inside), initial=size))
            if jump[worst] <= max(allowed * size, floor):
                # The difference quotients of a nearly constant velocity are mere rounding.
                floor = LIMITS.rounding * size / (high - low)
                continue
            places = [np.moveaxis(x, axis, 0)[(0, *worst)] for x in points]
            ends = values[(0, *worst)], values[(-1, *worst)]
            text = _text(name, axis, order, places, ends, high)
            if order == 0 and jump[worst] > LIMITS.jump * size:
                raise InputError(f"{text}; {_remedy(grid, axis)}")
            warn(
                f"{text}, and the field is less accurate near there; {_remedy(grid, axis)}",
                PeriodicityWarning,
            )
            return


def _values(
    formula: Formula, order: int, axis: int, grid: Grid, points: Sequence[Array], clock: float
) -> Array:
    """The velocity, or its derivative in the direction of an axis, at points of the box."""
    steps = (*grid.spacing, *([1.0] * (4 - grid.dim)))
    point = [*points, *([np.zeros(())] * (3 - grid.dim))]
    found = formula.derivative(raised((0, 0, 0, 0), axis, order), steps)(*point, clock)
    return np.broadcast_to(found, points[0].shape)


def _remedy(grid: Grid, axis: int) -> str:
    flags = tuple(periodic and q != axis for q, periodic in enumerate(grid.periodic))
    given = flags if any(flags) else False
    return (
        f"pass a velocity with the period of the box, or make the grid not periodic in "
        f"{AXES[axis]} (periodic={given}) and pass the solver data for what then comes in through "
        f"the walls (boundary=0.0, or a dict with '{AXES[axis]}-' and '{AXES[axis]}+')"
    )


def _text(
    name: str, axis: int, order: int, places: Any, ends: tuple[float, float], high: float
) -> str:
    what = f"the derivative of {name} across the side" if order else name
    at = ", ".join(f"{x:.6g}" for x in places)
    return (
        f"velocity: {what} is not periodic in {AXES[axis]}, as the grid is: {ends[0]:.6g} at "
        f"({at}), {ends[1]:.6g} at {AXES[axis]} = {high:.6g}"
    )
