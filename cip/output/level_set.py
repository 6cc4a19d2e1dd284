r"""Level sets of fields in the plane: contours, the area inside, and the distance to them.

With a profile of values and gradients the transport of a level set is the gradient-augmented method
(Nave, Rosales and Seibold, J. Comput. Phys. 229, 2010, 3802-3827). Contours are those of the
profile: marching squares find them, Newton's method puts each point on the level.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from cip.errors import InputError, NotSupported
from cip.grid import Array
from cip.output.sample import profile_value
from cip.profiles.catalogue import PLANE, moments
from cip.stages.state import State, state_of
from skfem_adini.ground.arguments import real_number


class _Limits(NamedTuple):
    parts: int = 4  # of a cell in each direction, among whose corners contours are sought
    steps: int = 30  # of Newton's method
    close: float = 1e-11  # last step, in cells
    step: float = 1e-30  # imaginary step by which polynomials are differentiated exactly
    change: float = 1e-4  # cells, for differences of gradients
    far: float = 1.0  # cells that a closest point may lie from the nearest point of a contour
    focus: float = 0.1  # least 1 + curvature times distance: nearer to a centre distances bend


LIMITS = _Limits()


def contour(state: State, level: float = 0.0) -> list[Array]:
    """The lines on which a field in the plane has a value.

    Parameters
    ----------
    state : State
        Of the profile ``bicubic`` or ``adini``, in two dimensions.
    level : float
        In the unit of the field.

    Returns
    -------
    list of ndarray, shape (points, 2)
        Points of each line in order, some four to a cell, on the level of the profile up to
        rounding; a closed line ends with its first point.

    Raises
    ------
    NotSupported
        Another profile.

    References
    ----------
    J.-C. Nave, R. R. Rosales and B. Seibold, A gradient-augmented level set method with an
    optimally local, coherent advection scheme, J. Comput. Phys. 229 (2010), 3802-3827.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, State, contour
    >>> bowl = State.from_function("x1**2 + x2**2 - 1", Grid([(-2, 2)] * 2, (20, 20)))
    >>> (line,) = contour(bowl)
    >>> bool(np.abs(np.hypot(*line.T) - 1).max() < 1e-12)
    True
    """
    field = _Field(state, level)
    return [field.on_level(line) for line in field.marching().lines(0.0)]


def area(state: State, level: float = 0.0) -> float:
    """The area in which a field in the plane is below a level.

    Parameters
    ----------
    state, level
        As for `contour`.

    Returns
    -------
    float
        That of the profile, up to the fourth power of a quarter of a cell over the radius of
        curvature: arcs through three points of the contour.

    Raises
    ------
    NotSupported
        Another profile.
    InputError
        The field is at the level, up to rounding, in a whole cell.

    References
    ----------
    J.-C. Nave, R. R. Rosales and B. Seibold, A gradient-augmented level set method with an
    optimally local, coherent advection scheme, J. Comput. Phys. 229 (2010), 3802-3827.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, State, area
    >>> bowl = State.from_function("x1**2 + x2**2 - 1", Grid([(-2, 2)] * 2, (20, 20)))
    >>> bool(abs(area(bowl) - np.pi) < 1e-6)
    True
    """
    field, total = _Field(state, level), 0.0
    field.check_crossed()
    for points, offsets in zip(*field.marching().filled(-np.inf, 0.0), strict=True):
        for first, last in pairwise(offsets):
            total += field.enclosed(points[first:last])
    return total


def reinitialise(state: State, level: float = 0.0) -> State:
    """The signed distance to a level, negative below it, with its derivatives.

    After a long transport the gradient of a level set function is small in some places and large in
    others. Its distance function has the same contour and gradients of length one: each node's
    closest point on the contour is found by Newton's method, and the mixed derivative follows from
    the curvature there.

    Parameters
    ----------
    state, level
        As for `contour`.

    Returns
    -------
    State
        At the same time. Its level 0 is that of `state` up to the error of the profile.

    Raises
    ------
    InputError
        The field does not take the value.

    References
    ----------
    D. L. Chopp, Some improvements of the fast marching method, SIAM J. Sci. Comput. 23 (2001),
    230-244.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, State, reinitialise
    >>> bowl = State.from_function("x1**2 + x2**2 - 1", Grid([(-2, 2)] * 2, (20, 20)))
    >>> found = reinitialise(bowl)
    >>> bool(np.allclose(found["u"], np.hypot(*found.grid.mesh()) - 1, atol=1e-4))
    True
    """
    from scipy.spatial import KDTree

    field = _Field(state, level)
    lines = [field.on_level(line) for line in field.marching().lines(0.0)]
    if not lines:
        raise InputError(f"level: the field does not take the value {level:.6g}")
    nodes, near = np.stack([x.ravel() for x in state.grid.mesh()]), np.concatenate(lines).T
    shifts = field.images()
    # Nearest among all images of the contour in periodic directions.
    images = np.concatenate([near + shift[:, None] for shift in shifts], axis=1)
    start = images[:, KDTree(images.T).query(nodes.T)[1]]
    foot = field.closest(nodes, start)
    gap = nodes - foot
    below = np.where(np.ravel(state["u"]) - level < 0.0, -1.0, 1.0)
    distance = below * np.hypot(*gap)
    slope, bend = field.gradient(foot), field.hessian(foot)
    steepness = np.maximum(np.hypot(*slope), 1e-300)  # 0 where lines of the contour cross
    normal = slope / steepness
    # Nodes on the contour have no direction to it of their own.
    apart = np.abs(distance) > 1e-6 * min(state.grid.spacing)
    normal = np.where(apart, gap / np.where(apart, distance, 1.0), normal)
    tangent = np.stack([-normal[1], normal[0]])
    curvature = np.einsum("in,ijn,jn->n", tangent, bend, tangent) / steepness
    focus = 1.0 + curvature * distance
    mixed = np.where(focus > LIMITS.focus, curvature / focus, 0.0) * tangent[0] * tangent[1]
    table = {(0, 0): distance, (1, 0): normal[0], (0, 1): normal[1], (1, 1): mixed}
    rows = [table[moment.orders[:2]] for moment in moments(state.profile, 2)]
    data = np.reshape(rows, (len(rows), *state.grid.nodes)).astype(state.data.dtype)
    return state_of(state.grid, state.profile, data, state.t)


class _Field:
    """The profile of a state less a level, with derivatives at any points of shape (2, n)."""

    def __init__(self, state: State, level: float) -> None:
        if not isinstance(state, State):
            raise InputError(f"state: expected a State, got {type(state).__name__}")
        if state.profile not in PLANE:
            raise NotSupported(
                f"profile: level sets need gradients in the plane, 'bicubic' or 'adini', not "
                f"{state.profile!r}; carry the level set function by a solver of its own"
            )
        state = state.host()
        state.check()
        self.grid, self.profile = state.grid, state.profile
        self.level = real_number("level", level)
        self.data = {name: np.asarray(state.data[q], float) for q, name in enumerate(state.names)}
        self.h = np.array(self.grid.spacing)

    def values(self, points: Any, shift: Any = None) -> Any:
        """The field at points, of which `shift` is an infinitesimal (imaginary) displacement."""
        inside = np.stack([self._in_box(axis, x) for axis, x in enumerate(points)])
        return profile_value(self.profile, self.data, self.grid, inside, shift) - self.level

    def gradient(self, points: Array) -> Array:
        """Its gradient, exact: the profile is a polynomial."""
        step = LIMITS.step
        parts = [self.values(points, tuple(1j * step * row)).imag / step for row in np.eye(2)]
        return np.stack(parts)

    def hessian(self, points: Array) -> Array:
        """Its second derivatives, by central differences of the gradient, shape (2, 2, n)."""
        found = []
        for axis in range(2):
            step = np.zeros((2, 1))
            step[axis] = LIMITS.change * self.h[axis]
            ahead, behind = (
                np.stack([self._in_box(q, x) for q, x in enumerate(points + sign * step)])
                for sign in (1.0, -1.0)
            )
            change = self.gradient(ahead) - self.gradient(behind)
            found.append(change / (ahead - behind)[axis])
        H = np.stack(found)
        return 0.5 * (H + H.swapaxes(0, 1))

    def _in_box(self, axis: int, x: Array) -> Array:
        low, high = self.grid.bounds[axis]
        return x if self.grid.periodic[axis] else np.clip(x, low, high)

    def images(self) -> Array:
        """The displacements of images of the box in periodic directions, and none."""
        turns = [(-1, 0, 1) if periodic else (0,) for periodic in self.grid.periodic]
        lengths = [high - low for low, high in self.grid.bounds]
        return np.array([[i * lengths[0], j * lengths[1]] for i in turns[0] for j in turns[1]])

    def check_crossed(self) -> None:
        """Raise `InputError` where all moments of a cell say that it lies at the level."""
        flat = np.ones(self.grid.nodes, bool)
        size = max(float(np.abs(self.data["u"]).max()), abs(self.level))
        for name, values in self.data.items():
            h = np.prod([self.h["xy".index(axis)] for axis in name[2:]])
            offset = self.level if name == "u" else 0.0
            flat &= np.abs(values - offset) * h <= 64.0 * np.finfo(float).eps * size
        for axis in range(2):
            flat = flat & np.roll(flat, -1, axis)
            if not self.grid.periodic[axis]:
                flat = np.delete(flat, -1, axis)
        if flat.any():
            i, j = (int(q) for q in np.argwhere(flat)[0])
            raise InputError(
                f"level: the field is at {self.level:.6g} in {int(flat.sum())} whole cells, the "
                f"first of them ({i}, {j}), so that no area is below it; take another level"
            )

    def marching(self) -> Any:
        """Marching squares over parts of the cells."""
        from contourpy import FillType, LineType, contour_generator

        parts = np.arange(LIMITS.parts) / LIMITS.parts
        lines = []
        for edges in self.grid.edges:
            inner = (edges[:-1, None] + np.diff(edges)[:, None] * parts).ravel()
            lines.append(np.append(inner, edges[-1]))
        points = np.stack([x.ravel() for x in np.meshgrid(*lines)])
        z = self.values(points).reshape(lines[1].size, lines[0].size)
        kinds: Any = {"fill_type": FillType.OuterOffset, "line_type": LineType.Separate}
        return contour_generator(lines[0], lines[1], z, **kinds)

    def sides(self, points: Array) -> Any:
        """For points of shape (n, 2): whether each lies on a side, by direction and end."""
        pairs = zip(points.T, self.grid.bounds, strict=True)
        return np.stack([np.equal.outer(ends, x) for x, ends in pairs])

    def on_level(self, line: Array) -> Array:
        """Points of shape (n, 2) moved to the level along the gradient, along a side if on it."""
        y = np.array(line, dtype=float).T
        free = ~self.sides(np.asarray(line)).any(axis=1)
        for _ in range(LIMITS.steps):
            slope = np.where(free, self.gradient(y), 0.0)
            size = (slope**2).sum(axis=0)
            step = slope * (self.values(y) / np.where(size > 0.0, size, np.inf))
            # A critical point of the field has no direction to its level: stay near.
            length = np.abs(step / self.h[:, None]).max(axis=0)
            step *= np.minimum(1.0, 0.25 / np.maximum(length, 0.25))
            y -= step
            if np.abs(step / self.h[:, None]).max(initial=0.0) <= LIMITS.close:
                break
        return y.T

    def enclosed(self, ring: Array) -> float:
        """Signed area in a closed ring of points; its edges are arcs unless they lie on a side."""
        at_side = self.sides(ring)
        both = at_side[..., :-1] & at_side[..., 1:]
        arc = ~both.any(axis=(0, 1))
        moved = self.on_level(ring)
        # Ends of arcs are moved; corners of the box, and what else lies between sides, are not.
        end = np.append(arc, arc[:1]) | np.append(arc[-1:], arc)
        p = np.where(end[:, None], moved, ring)
        a, b = p[:-1], p[1:]
        middle = self.on_level(0.5 * (a + b))
        chords = 0.5 * (a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1])
        u, v = middle - a, b - a
        arcs = 2.0 / 3.0 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        return float(chords.sum() + arcs[arc].sum())

    def closest(self, x: Array, start: Array) -> Array:
        """The points of the level closest to points x, both of shape (2, n), from nearby ones: by
        Newton's method, where this leads elsewhere by steps along the tangent and back."""
        y, active = start.copy(), np.arange(x.shape[1])
        slope = self.gradient(y)
        weight = ((x - y) * slope).sum(axis=0) / np.maximum((slope**2).sum(axis=0), 1e-300)
        h = self.h[:, None]
        for _ in range(LIMITS.steps):
            at, slope, bend = y[:, active], self.gradient(y[:, active]), self.hessian(y[:, active])
            matrix = np.zeros((active.size, 3, 3))
            matrix[:, :2, :2] = np.moveaxis(weight[active] * bend, -1, 0) + np.eye(2)
            matrix[:, :2, 2] = matrix[:, 2, :2] = slope.T
            miss = np.stack([*(x[:, active] - at - weight[active] * slope), -self.values(at)], 1)
            step = (np.linalg.pinv(matrix) @ miss[..., None])[..., 0].T
            y[:, active], weight[active] = at + step[:2], weight[active] + step[2]
            near = np.hypot(*((y - start)[:, active] / h)) <= LIMITS.far
            active = active[near & (np.abs(step[:2] / h).max(axis=0) > LIMITS.close)]
            if not active.size:
                break
        lost = ~(np.hypot(*((y - start) / h)) <= LIMITS.far)
        lost[active] = True
        lost |= np.hypot(*(x - y)) > np.hypot(*(x - start)) * (1.0 + 1e-12)
        for _ in range(4 if lost.any() else 0):
            at = start[:, lost]
            slope = self.gradient(at)
            tangent = np.stack([-slope[1], slope[0]]) / np.maximum(np.hypot(*slope), 1e-300)
            along = ((x[:, lost] - at) * tangent).sum(axis=0)
            along = np.clip(along, -0.25 * self.h.min(), 0.25 * self.h.min())
            moved = self.on_level((at + along * tangent).T).T
            nearer = np.hypot(*(x[:, lost] - moved)) < np.hypot(*(x[:, lost] - at))
            start[:, lost] = np.where(nearer, moved, at)
        return np.where(lost, start, y)
