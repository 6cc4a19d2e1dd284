r"""Covariances of states as operators, by a square root: :math:`B = S S^T`.

The nodal values of an error have the prescribed covariance; its other moments are the derivatives
and means of the spline through the values. So B has the rank of the values, and gradients and means
of increments are consistent with their values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from cip.errors import InputError
from cip.formulas.formula import spline_along
from cip.formulas.snapshots import product_along
from cip.grid import Array, Grid, check_grid
from cip.profiles.catalogue import moments
from cip.stages.state import State, state_of
from skfem_adini.ground.arguments import real_array, real_number


class Covariance:
    r"""The covariance :math:`S S^T` of the moments of a state, given by its square root.

    Parameters
    ----------
    grid : Grid
    profile : str
    root : LinearOperator or array_like
        S, shape (N, r): applied to r independent numbers of variance 1 it gives an error, all
        moments in the order of ``state.data.ravel()``.
    deviations : ndarray
        Standard deviation of the nodal values, shape ``grid.nodes``.

    Attributes
    ----------
    grid : Grid
    profile : str
    root : LinearOperator
    deviations : ndarray

    Raises
    ------
    InputError
        A square root or deviations of another shape than the state's.

    References
    ----------
    A. Weaver and P. Courtier, Correlation modelling on the sphere using a generalized diffusion
    equation, Q. J. R. Meteorol. Soc. 127 (2001), 1815-1846; I. Mirouze and A. T. Weaver,
    Representation of correlation functions in variational assimilation using an implicit diffusion
    operator, ibid. 136 (2010), 1421-1443.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Covariance, Grid
    >>> grid = Grid((0, 1), 64, periodic=True)
    >>> B = Covariance.diffusion(grid, "cubic", deviation=0.3, length=0.1)
    >>> error = B.draw(seed=1)
    >>> error.names, bool(np.allclose(B.deviations, 0.3))
    (('u', 'u_x'), True)
    """

    def __init__(self, grid: Grid, profile: str, root: Any, deviations: ArrayLike) -> None:
        check_grid(grid)
        size = len(moments(profile, grid.dim)) * grid.size
        if isinstance(root, LinearOperator):
            operator = root
        else:
            matrix = real_array("root", root).astype(float)
            if matrix.ndim != 2 or not np.isfinite(matrix).all():
                raise InputError(f"root: expected a finite matrix, got shape {matrix.shape}")
            operator = aslinearoperator(matrix)
        if operator.shape[0] != size:
            raise InputError(
                f"root: expected {size} rows, the moments of {profile!r}, got {operator.shape[0]}"
            )
        self.grid, self.profile, self.root = grid, profile, operator
        self.deviations = real_array("deviations", deviations).astype(float)
        if self.deviations.shape != grid.nodes:
            raise InputError(
                f"deviations: expected shape {grid.nodes}, got {self.deviations.shape}"
            )

    def __repr__(self) -> str:
        low, high = self.deviations.min(), self.deviations.max()
        return (
            f"Covariance({self.profile!r} on {self.grid}, rank {self.root.shape[1]}, deviations "
            f"{low:.3g} to {high:.3g})"
        )

    @classmethod
    def diffusion(
        cls,
        grid: Grid,
        profile: str,
        deviation: ArrayLike,
        length: ArrayLike,
        order: float = 6.0,
    ) -> Covariance:
        r"""Correlations of an implicit diffusion, :math:`(1 - \kappa \Delta)^{-M}`.

        On the line they are those of an autoregressive process of order M, close to a Gaussian for
        large M. They are periodic where the grid is; at other ends the flux of the diffusion is 0.
        The variance is exact at every node, walls included. The operator is applied in the
        eigenvectors of the diffusion along each direction, which are dense matrices.

        Parameters
        ----------
        grid : Grid
        profile : str
            Means over cells, of csl2 and csl4, are those of the spline through the values.
        deviation : float or array_like
            Standard deviation of the values, positive; a number, or an array at the nodes.
        length : float, or one for each direction
            Daley's length, at which the parabola of the correlation at 0 is 1/2:
            sqrt((2 M - dim - 2) kappa).
        order : float
            M, above (dim + 2) / 2.

        Returns
        -------
        Covariance

        Raises
        ------
        InputError
            Deviations or lengths that are not positive, an order too small for errors with
            gradients of finite variance.
        """
        power = real_number("order", order)
        check_grid(grid)
        if not (np.isfinite(power) and 2.0 * power > grid.dim + 2.0):
            raise InputError(f"order: expected more than {(grid.dim + 2) / 2}, got {order!r}")
        lengths = _positive(length, (grid.dim,), "length")
        kappa = lengths**2 / (2.0 * power - grid.dim - 2.0)
        modes = [_diffusion_modes(grid, axis) for axis in range(grid.dim)]
        spectrum = np.ones(())
        for (values, _), factor in zip(modes, kappa, strict=True):
            spectrum = spectrum[..., None] + factor * values
        half = spectrum ** (-0.5 * power)
        variance = half**2
        for axis, (_, vectors) in enumerate(modes):
            variance = product_along(vectors**2, variance, axis)
        wanted = _positive(deviation, grid.nodes, "deviation")
        scale = wanted / np.sqrt(variance)
        return cls(
            grid, profile, _ModeRoot(grid, profile, [v for _, v in modes], half, scale), wanted
        )

    @classmethod
    def patterns(cls, states: Sequence[State], deviations: ArrayLike = 1.0) -> Covariance:
        r"""Errors that are sums of given fields times independent random amplitudes.

        So sources of known shape and unknown strength are a model error, and the differences of the
        members of an ensemble to their mean, divided by the root of their number less one, a
        background error.

        Parameters
        ----------
        states : sequence of State
            On one grid, of one profile.
        deviations : float or array_like
            Standard deviation of each amplitude, positive.

        Returns
        -------
        Covariance

        Raises
        ------
        InputError
            No states, or states that differ in grid or profile.
        """
        if not len(states) or not all(isinstance(state, State) for state in states):
            raise InputError("states: expected at least one State")
        first = states[0]
        same = all(s.grid is first.grid and s.profile == first.profile for s in states)
        if not same:
            raise InputError("states: expected states of one profile on one Grid object")
        spread = _positive(deviations, (len(states),), "deviations")
        columns = np.stack([state.host().data.ravel() for state in states], axis=1) * spread
        nodal = np.sqrt(np.sum(columns[: first.grid.size] ** 2, axis=1))
        return cls(first.grid, first.profile, columns, nodal.reshape(first.grid.nodes))

    def conserving_mass(self) -> Covariance:
        r"""The covariance of these errors given that their integral is zero.

        It is :math:`B - B m m^T B / (m^T B m)` for the weights m of `State.mass`, so analyses with
        it have the mass of the background.

        Returns
        -------
        Covariance
            With smaller deviations.

        Examples
        --------
        >>> from cip import Covariance, Grid
        >>> grid = Grid((0, 1), 32, periodic=True)
        >>> B = Covariance.diffusion(grid, "csl2", deviation=1.0, length=0.1).conserving_mass()
        >>> abs(B.draw(seed=1).mass) < 1e-14
        True
        """
        count = len(moments(self.profile, self.grid.dim))
        weights = np.zeros((count, *self.grid.nodes))
        state = state_of(self.grid, self.profile, weights)
        if "mean" in state.names:
            state["mean"][...] = self.grid.volumes
        else:
            state["u"][...] = self.grid.weights
        along_mass = self.root.rmatvec(weights.ravel())
        along_mass = along_mass / np.linalg.norm(along_mass)
        lost = (self.root.matvec(along_mass))[: self.grid.size].reshape(self.grid.nodes)
        left = np.sqrt(np.maximum(self.deviations**2 - lost**2, 0.0))
        return Covariance(self.grid, self.profile, _Without(self.root, along_mass), left)

    def draw(self, seed: int, t: float = 0.0) -> State:
        """A random error with this covariance.

        Parameters
        ----------
        seed : int
        t : float
            Time of the state.

        Returns
        -------
        State
        """
        numbers = np.random.default_rng(seed).standard_normal(self.root.shape[1])
        count = len(moments(self.profile, self.grid.dim))
        data = np.reshape(self.root @ numbers, (count, *self.grid.nodes))
        return state_of(self.grid, self.profile, data, t)


def _positive(given: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    found = real_array(name, given).astype(float)
    if found.shape not in ((), shape):
        raise InputError(f"{name}: expected one number or shape {shape}, got shape {found.shape}")
    if not (np.isfinite(found).all() and np.all(found > 0.0)):
        raise InputError(f"{name}: expected positive numbers, got {given!r}")
    return np.broadcast_to(found, shape).copy()


def _diffusion_modes(grid: Grid, axis: int) -> tuple[Array, Array]:
    """Eigenvalues and vectors of K v = lambda W v, with V^T W V = 1: K is the matrix of -d^2/dx^2
    by finite volumes, W holds the widths of the nodes' volumes."""
    n, width, periodic = grid.nodes[axis], grid.widths[axis], grid.periodic[axis]
    K, W = np.zeros((n, n)), np.zeros(n)
    for cell, h in enumerate(width):
        a, b = cell, (cell + 1) % n if periodic else cell + 1
        K[[a, b], [a, b]] += 1.0 / h
        K[[a, b], [b, a]] -= 1.0 / h
        W[[a, b]] += 0.5 * h
    root = np.sqrt(W)
    values, vectors = eigh(K / np.outer(root, root))
    return np.maximum(values, 0.0), vectors / root[:, None]


class _ModeRoot(LinearOperator):
    """The map from independent numbers of variance 1, one for each mode, to the moments."""

    def __init__(
        self, grid: Grid, profile: str, vectors: list[Array], half: Array, scale: Array
    ) -> None:
        self._derivatives = SplineDerivatives(grid, profile)
        self._nodes, self._vectors, self._half, self._scale = grid.nodes, vectors, half, scale
        shape = (self._derivatives.count * grid.size, grid.size)
        super().__init__(np.float64, shape)  # type: ignore[call-arg]

    def _in_modes(self, values: Array, transposed: bool) -> Array:
        for axis, matrix in enumerate(self._vectors):
            values = product_along(matrix.T if transposed else matrix, values, axis)
        return values

    def _matvec(self, numbers: Any) -> Array:
        values = self._in_modes(np.reshape(numbers, self._nodes) * self._half, False) * self._scale
        return self._derivatives.moments(values).ravel()

    def _rmatvec(self, weights: Any) -> Array:
        shape = (self._derivatives.count, *self._nodes)
        nodal = self._derivatives.transposed(np.reshape(weights, shape))
        return np.asarray(self._in_modes(nodal * self._scale, True) * self._half).ravel()


class _Without(LinearOperator):
    """A square root of which one direction, a unit vector, is left out."""

    def __init__(self, root: LinearOperator, direction: Array) -> None:
        self._root, self._direction = root, direction
        super().__init__(np.float64, root.shape)  # type: ignore[call-arg]

    def _rest(self, numbers: Any) -> Array:
        numbers = np.ravel(numbers)
        found: Array = numbers - self._direction * (self._direction @ numbers)
        return found

    def _matvec(self, numbers: Any) -> Array:
        return self._root.matvec(self._rest(numbers))

    def _rmatvec(self, weights: Any) -> Array:
        return self._rest(self._root.rmatvec(np.ravel(weights)))


class SplineDerivatives:
    """The moments of a field from its nodal values, as `State.from_function` takes them of an
    array, by one spline matrix for each direction; and the transpose of that map."""

    def __init__(self, grid: Grid, profile: str) -> None:
        wanted = moments(profile, grid.dim)
        self._orders = [
            tuple(
                -1 if axis in moment.averaged else moment.orders[axis] for axis in range(grid.dim)
            )
            for moment in wanted
        ]
        self.nodes, self.count = grid.nodes, len(wanted)
        needed = {(axis, n) for orders in self._orders for axis, n in enumerate(orders) if n}
        self._matrices = {key: _matrix(grid, *key) for key in needed}

    def moments(self, values: Array) -> Array:
        """The moments of nodal values, shape (moments,) + nodes."""
        return np.stack([self._one(values, orders, False) for orders in self._orders])

    def transposed(self, weights: Array) -> Array:
        """The transpose of `moments`, from shape (moments,) + nodes to nodes."""
        parts = [self._one(w, o, True) for w, o in zip(weights, self._orders, strict=True)]
        return np.asarray(sum(parts))

    def _one(self, values: Array, orders: tuple[int, ...], transposed: bool) -> Array:
        for axis, order in enumerate(orders):
            if order:
                matrix = self._matrices[axis, order]
                values = product_along(matrix.T if transposed else matrix, values, axis)
        return values


def _matrix(grid: Grid, axis: int, order: int) -> Array:
    """Columns: a derivative at the nodes (for order -1 the means over the cells that begin there,
    0 where none begins) of the spline that is 1 at one node and 0 at the others."""
    n = grid.nodes[axis]
    spline = spline_along(grid, axis, np.eye(n))
    if order >= 0:
        return np.asarray(spline(grid.coordinates[axis], nu=order))
    found = np.zeros((n, n))
    places, weights = np.polynomial.legendre.leggauss(4)  # exact to degree 7
    for place, weight in zip(places, weights, strict=True):
        inside = grid.edges[axis][:-1] + 0.5 * (1.0 + place) * grid.widths[axis]
        found[: grid.cells[axis]] += 0.5 * weight * spline(inside)
    return found
