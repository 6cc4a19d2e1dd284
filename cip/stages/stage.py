"""One stage of a step: a sweep along an axis, or the direct update of a plane."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.characteristics.feet import FEET, Exits, check_inside, integrate, time_scale
from cip.characteristics.flow_derivatives import LOG_DETERMINANT, Jet, System, exponential
from cip.formulas.expression import COORDINATES, ordered
from cip.formulas.formula import Formula
from cip.formulas.parameters import parameters_in
from cip.formulas.snapshots import snapshots_of
from cip.grid import Array, Grid, places_of
from cip.profiles.catalogue import (
    CONSERVATIVE,
    PLANE,
    carries_slopes,
    line_jets,
    moments,
    plane_jets,
)
from cip.stages.coast import Coast, Stops
from cip.stages.walls import CLOCKS, SplitData, Spread, Wall, WallMoments

_ACROSS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True)
class StageFeet:
    """Feet of a stage as the kernels read them, and the paths that begin on a wall. `data` is flat:
    blocks of components of the length of the grid; conservative profiles have a block for each
    choice of node or middle of the cell across the sweep (`Stage.blocks`), others one."""

    data: Any
    exits: list[Exits | None] = field(default_factory=list)  # of each block
    t_start: float = 0.0
    t_end: float = 0.0
    substeps: tuple[int, ...] = ()  # of each block
    stops: tuple[Stops, ...] = ()  # at coasts, of each block; none without coasts

    @property
    def bounded(self) -> bool:
        """Whether any path begins on a wall."""
        return any(exits is not None for exits in self.exits)

    def interior(self, size: int, block: int = 0) -> NDArray[np.bool_]:
        """For each of the `size` nodes whether its path in a block begins inside the grid, and not
        on a coast."""
        inside = np.ones(size, bool)
        if self.stops:
            inside[self.stops[block].nodes] = False
        exits = self.exits[block]
        if exits is not None:
            inside[exits.nodes] = False
        return inside


@dataclass(frozen=True)
class Correction:
    """Values to be written (or added, if `add`) at indices `places` of the flat moments."""

    places: NDArray[np.int64]
    values: Array
    add: bool


class Stage:
    """A sweep along `axis`, or (None) the direct update of a plane, from the fractions `begin` to
    `end` of dt. `before` are the sweeps of the same step before this one, `walls` the data from
    `cip.stages.walls.walls`, `coast` what stops paths."""

    # Of each of several fields, where their walls or bounds differ; this stage has their feet.
    parts: tuple[Stage, ...] = ()
    bounds: tuple[float, float] | None = None  # of a part, for the limiter
    clocks_of_others: Mapping[int, str] = {}  # how far the sweeps in other directions are
    foot_tolerance: float | None = None  # in cells, if given

    def __init__(
        self,
        grid: Grid,
        velocity: tuple[Formula, ...],
        profile: str,
        advect: bool,
        walls: dict[Wall, Formula],
        axis: int | None,
        begin: float,
        end: float,
        before: tuple[Stage, ...] = (),
        coast: Coast | None = None,
    ) -> None:
        self.grid, self.velocity, self.profile, self.advect = grid, velocity, profile, advect
        self.walls, self.axis, self.begin, self.end = walls, axis, begin, end
        self._before, self.coast = before, coast
        self.conservative = profile in CONSERVATIVE
        self.carries_slopes = carries_slopes(profile, grid.dim)
        self.moving = (0, 1) if axis is None else (axis,)
        self.jets = (
            plane_jets(profile, advect)
            if axis is None
            else line_jets(profile, grid.dim, axis, advect)
        )
        self.system = System([c.expression for c in velocity], self.moving, self.jets)
        self._wall_moments: WallMoments | None = None

    def of_field(self, walls: dict[Wall, Formula], bounds: tuple[float, float]) -> Stage:
        """This stage for a field with its own data on walls and bounds of the limiter."""
        found = copy(self)
        found.bounds, found._wall_moments = bounds, None
        found.__dict__.pop("wall_parameters", None)
        found.take(walls, bounds)
        return found

    def take(self, walls: dict[Wall, Formula], bounds: tuple[float, float]) -> None:
        """Take data on walls as this sweep sees them: in a splitting those of the split flow, kept
        within `bounds`, or of their sign where sweeps compress."""
        self.walls = walls
        if not self.clocks_of_others:
            return
        pairs = zip(self.velocity, COORDINATES, strict=False)
        slopes = [c.expression.derivative(x) for c, x in pairs]
        if self.advect and any(slope.op != "constant" or slope.value != 0.0 for slope in slopes):
            bounds = (
                0.0 if bounds[0] >= 0.0 else -np.inf, 0.0 if bounds[1] <= 0.0 else np.inf
            )  # fmt: skip
        self.walls = {
            wall: SplitData(formula, self.velocity, self.advect, self.clocks_of_others, bounds)
            for wall, formula in walls.items()
            if wall[0] == self.axis
        }

    @property
    def parameters(self) -> list[float]:
        """Values of the parameters of the velocity, in the order of `System.parameters`."""
        values: dict[str, np.float64] = {}
        for c in self.velocity:
            values.update(c.numbers)
        return [float(values[name]) for name in self.system.parameters]

    @cached_property
    def wall_parameters(self) -> list[str]:
        """Parameters of the moments from walls: those of the system, then others of the data."""
        data = parameters_in([formula.expression for formula in self.walls.values()])
        return list(dict.fromkeys([*self.system.parameters, *data]))

    @property
    def blocks(self) -> list[int]:
        """For each block of feet, the number of the moment of values that it moves; [0] except for
        conservative profiles in several dimensions, where the bits of a moment's number are the
        directions over which it is averaged."""
        if not self.conservative or self.axis is None:
            return [0]
        if self.carries_slopes:
            return [0]
        return [bits for bits in range(2**self.grid.dim) if not bits >> self.axis & 1]

    def points(self, block: int) -> list[Array]:
        """Coordinates of the points whose feet make a block: nodes, or middles of cells across."""
        return list(np.meshgrid(*self.lines(block), indexing="ij"))

    def lines(self, block: int) -> list[Array]:
        """Coordinates of these points in each direction."""
        across = [axis for axis in range(self.grid.dim) if axis != self.axis and block >> axis & 1]
        return places_of(self.grid, across if self.conservative else ())

    def feet(self, t: float, dt: float) -> StageFeet:
        """Integrate the characteristics of this part of the step [t, t + dt]."""
        t_start, t_end = t + self.begin * dt, t + self.end * dt
        length = (self.end - self.begin) * dt
        rows, exits, substeps = [], [], []
        for block in self.blocks:
            points = self.points(block)
            found = integrate(
                self.grid, self.velocity, self.system, points, t_end, length, self.tolerance
            )
            rows.extend(self.components(found.jets, points))
            exits.append(found.exits)
            substeps.append(found.substeps)
        made = StageFeet(np.concatenate(rows), exits, t_start, t_end, tuple(substeps))
        made = self.stopped(made)
        for one in made.exits:
            check_inside(self.grid, one, set(self.walls), t_end)
        return made

    def stopped(self, feet: StageFeet) -> StageFeet:
        """The feet of paths that stop at coasts, followed by the sides of all blocks."""
        if self.coast is None or self.axis is None:
            return feet
        data, sides, stops, exits = feet.data.copy(), [], [], list(feet.exits)
        rows = data.reshape(len(self.blocks), len(self.jets), self.grid.size)
        for q, block in enumerate(self.blocks):
            mean = 2 if self.carries_slopes else block + (1 << self.axis)
            own = self.coast.stopped(self.axis, block, rows[q], exits[q], mean)
            stops.append(own[0])
            exits[q] = own[1]
            sides.append(own[2])
        data = np.concatenate([data, *sides])
        return replace(feet, data=data, exits=exits, stops=tuple(stops))

    def components(
        self, jets: dict[Jet, Array], points: list[Array], nodes: Any = None
    ) -> list[Array]:
        """The jets of all or of some nodes in the order of the kernels, displacements in cells, log
        det made det."""
        nodes = np.arange(self.grid.size) if nodes is None else nodes
        index = np.unravel_index(nodes, self.grid.nodes)
        determinant = np.exp(jets[LOG_DETERMINANT]) if LOG_DETERMINANT in self.jets else None
        rows = []
        for jet in self.jets:
            row = jets[jet]
            if jet.component < 3 and not any(jet.orders):
                axis = jet.component
                row = self.grid.index_displacement(axis, points[axis].ravel(), row, index[axis])
            elif jet.component == 3 and determinant is not None:
                row = exponential(jet, jets.__getitem__, determinant)
            rows.append(row)
        return rows

    def corrections(self, feet: StageFeet) -> list[Correction]:
        """The new moments at nodes whose path begins on a wall: from data and, for means, flux."""
        if not feet.bounded:
            return []
        wall, found = self.wall_moments(feet.t_end), []
        for block, exits in zip(self.blocks, feet.exits, strict=True):
            if exits is None:
                continue
            where = self.clocks(feet), self.spread(block, exits.nodes)
            values, flux = wall.values(exits, feet.t_end, *where), None
            if self.conservative:
                flux = wall.flux(exits, feet.t_start, feet.t_end, *where)
            found += self.placed(block, exits.nodes, values, flux)
        return found

    def entered(self, feet: StageFeet) -> dict[Wall, float]:
        """What came in through each wall with data; negative for what also left by another one."""
        assert self.axis is not None
        grid, exits, block = self.grid, feet.exits[-1], self.blocks[-1]
        found: dict[Wall, float] = {}
        stride = int(np.prod(grid.nodes[self.axis + 1 :]))
        if exits is None:
            return found
        for side in (0, 1):
            end = grid.cells[self.axis] * side
            ends = exits.kept(exits.nodes // stride % grid.nodes[self.axis] == end)
            if ends is None:
                continue
            where = self.clocks(feet), self.spread(block, ends.nodes)
            wall = self.wall_moments(feet.t_end)
            flux = wall.flux(ends, feet.t_start, feet.t_end, *where)
            area = self.areas.ravel()[ends.nodes]
            found[self.axis, side] = (1.0 - 2.0 * side) * float(np.sum(flux * area))
        return found

    @cached_property
    def areas(self) -> Array:
        """Of each node the area of the cells across the sweep that begin there, or 0."""
        widths = [
            np.ones(n) if axis == self.axis else np.append(width, 0.0)[:n]
            for axis, (n, width) in enumerate(zip(self.grid.nodes, self.grid.widths, strict=True))
        ]
        return reduce(np.multiply.outer, widths)

    def clocks(self, feet: StageFeet) -> tuple[float, ...]:
        """Beginning, middle and end of the whole step."""
        dt = (feet.t_end - feet.t_start) / (self.end - self.begin)
        return tuple(feet.t_start + (part - self.begin) * dt for part in (0.0, 0.5, 1.0))

    def spread(self, block: int, nodes: NDArray[np.int64]) -> Spread:
        """The points over which data on walls are averaged for a block of feet: Gauss's rule of
        three in each direction of its means, none (a width of 0) where no cell begins."""
        across = [axis for axis in range(self.grid.dim) if block >> axis & 1]
        index, rule = np.unravel_index(nodes, self.grid.nodes), _ACROSS
        places = list(product(rule[0], repeat=len(across)))
        shifts = np.zeros((len(places), 3, nodes.size))
        for q, axis in enumerate(across):
            width = np.append(self.grid.widths[axis], 0.0)[index[axis]]
            shifts[:, axis] = [0.5 * place[q] * width for place in places]
        weights = [np.prod(one) for one in product(0.5 * rule[1], repeat=len(across))]
        return Spread(shifts, np.array(weights))

    def placed(
        self, block: int, nodes: NDArray[np.int64], values: Array, flux: Array | None
    ) -> list[Correction]:
        """The corrections of a block of feet: new moments of shape (.., moments, nodes) at the
        nodes whose path begins on a wall, and the `flux`, shape (.., nodes), that entered before
        each path began."""
        first = block * self.grid.size
        found = [
            Correction(first + q * self.grid.size + nodes, values[..., q, :], False)
            for q in range(values.shape[-2])
        ]
        return found if flux is None else found + self._mass_from_walls(block, nodes, flux)

    def _mass_from_walls(
        self, block: int, nodes: NDArray[np.int64], missing: Array
    ) -> list[Correction]:
        """Corrections of the means for what entered before each path began. The kernel integrates
        the old profile from the wall on: the flux since the beginning of the step is missing in the
        cell after the node and too much in the cell before it."""
        assert self.axis is not None
        grid, axis, size = self.grid, self.axis, self.grid.size
        mean = (2 if self.carries_slopes else block + (1 << axis)) * size
        stride = int(np.prod(grid.nodes[axis + 1 :]))
        place = (nodes // stride) % grid.nodes[axis]
        after, before = place < grid.cells[axis], place > 0
        widths = grid.widths[axis]
        return [
            Correction(mean + nodes[after], missing[..., after] / widths[place[after]], True),
            Correction(
                mean + nodes[before] - stride,
                -missing[..., before] / widths[place[before] - 1],
                True,
            ),
        ]

    def substeps(self, t: float, dt: float) -> int:
        """An even number of sub-steps, enough for a sample of the nodes. The velocity may be steep
        between them: the kernels check every path, and the engine then takes more sub-steps."""
        t_end, length = t + self.end * dt, (self.end - self.begin) * dt
        found = integrate(
            self.grid, self.velocity, self.system, self._sample, t_end, length, self.foot_error
        )
        # Even, as the kernels' check of a path requires.
        return found.substeps // 2 * 2

    def part(self, dt: float) -> tuple[int | None, float, float, float]:
        """The key of this stage in a table of sub-step counts: direction, part of the step, dt."""
        return self.axis, self.begin, self.end, dt

    @cached_property
    def _sample(self) -> list[Array]:
        every = max(1, int(np.ceil(self.grid.size / FEET.sample)))
        return [x.ravel()[::every] for x in self.points(0)]

    @property
    def _given(self) -> float | None:
        from_data = snapshots_of(self.velocity) is not None
        return FEET.data if from_data and self.foot_tolerance is None else self.foot_tolerance

    @property
    def _asked(self) -> float:
        return FEET.tolerance if self._given is None else self._given

    @property
    def tolerance(self) -> float:
        """Error of feet by `integrate`, in cells."""
        # Beyond a kink in time results differ by h^2, of which 1/3, not 1/15, is the finer one's.
        data = snapshots_of(self.velocity)
        return self._asked / (5.0 if data is not None and data.degrees[0] == 1 else 1.0)

    @property
    def foot_error(self) -> float:
        """Error of feet that each step computes, in cells."""
        if self._given is not None or all(c.steady for c in self.velocity):
            return self._asked
        return FEET.unsteady

    @property
    def limit(self) -> float:
        """Largest defect of a path that a kernel computes (`cip.engines.path_kernel`), in cells."""
        # For unsteady formulas the defect can be 15 times the error that `substeps` allows.
        return self.tolerance if self.foot_error == self._asked else 16.0 * self.foot_error

    @cached_property
    def compresses(self) -> bool:
        """Whether this sweep alone changes volumes; sweeps in other directions may compensate."""
        if self.axis is None:
            return False
        slope = self.velocity[self.axis].expression.derivative(COORDINATES[self.axis])
        return slope.op != "constant" or slope.value != 0.0

    @property
    def compressed(self) -> bool:
        """Whether an earlier sweep of the step changes volumes, so that the field is compressed."""
        return any(earlier.compresses for earlier in self._before)

    @property
    def computable(self) -> bool:
        """Whether the kernel that updates a node can compute its foot."""
        return self.formula and not self.conservative

    @cached_property
    def formula(self) -> bool:
        """Whether feet can be compiled: a formula of moderate length, uniform directions."""
        uniform = all(self.grid.uniform[axis] for axis in self.moving)
        if not (uniform and all(c.exact for c in self.velocity)):
            return False
        # The time of compilation grows faster than the number of operations.
        return len(ordered(self.system.rates)) <= 600

    def wall_moments(self, t: float) -> WallMoments:
        """The formulas of new moments from data on walls; `t` is a time of the velocity."""
        if self._wall_moments is None:
            grid = self.grid
            wanted = [moment.orders for moment in moments(self.profile, grid.dim)]
            if self.conservative:
                wanted = [(0, 0, 0, 0), (1, 0, 0, 0)][: 1 + self.carries_slopes]
            scale = time_scale(grid, self.velocity, t)
            steps = (*grid.spacing, *([1.0] * (3 - grid.dim)), scale)
            self._wall_moments = WallMoments(
                grid, self.velocity, self.moving, self.advect, self.walls, wanted, steps
            )
        return self._wall_moments


def stages(
    grid: Grid,
    velocity: tuple[Formula, ...],
    profile: str,
    advect: bool,
    walls: dict[Wall, Formula],
    bounds: tuple[float, float] = (-np.inf, np.inf),
    coast: Coast | None = None,
) -> list[Stage]:
    """The stages of one step: one, or the symmetric sequence of Strang's splitting, in which data
    on walls are kept within `bounds`, or of their sign where sweeps compress."""
    if profile in PLANE:
        return [Stage(grid, velocity, profile, advect, walls, None, 0.0, 1.0)]
    last = grid.dim - 1
    first = [(axis, 0.0, 0.5) for axis in range(last)]
    order = [*first, (last, 0.0, 1.0), *((axis, 0.5, 1.0) for axis, _, _ in reversed(first))]
    found: list[Stage] = []
    done = [0.0] * grid.dim
    for axis, begin, end in order:
        others = {b: CLOCKS[int(2.0 * part)] for b, part in enumerate(done) if b != axis}
        part = (axis, begin, end, tuple(found), coast)
        found.append(Stage(grid, velocity, profile, advect, {}, *part))
        found[-1].clocks_of_others = others
        found[-1].take(walls, bounds)
        done[axis] = end
    return found
