"""Feet by displacements on a CUDA device: the method of `cip.engines.displacements`.

One kernel follows all nodes through a sub-step, a second one repeats the node of each block where
the inner stages differ most with halved steps. Periodic planes without determinants are then
updated by a kernel that takes the differences of displacements in shared memory; else the
derivatives are stored. The few nodes that need other paths are those of the host. Displacements
and their differences are float64 for moments of any precision.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from cip.characteristics.feet import FEET
from cip.characteristics.flow_derivatives import LOG_DETERMINANT
from cip.engines.cuda_kernels import (
    compiled,
    constants_of,
    for_fields,
    kernel_text,
    modules_of,
    point_of,
    widths_of,
)
from cip.engines.cuda_source import translate
from cip.engines.displacement_loops import spline_source
from cip.engines.displacements import Displacements, TooCoarse, steps_between
from cip.formulas.snapshots import snapshots_of
from cip.profiles.catalogue import moments

Array = Any
_THREADS = 256  # of a block that follows nodes
_GROUP = 2048  # nodes of which one is repeated: its number replaces the low bits of a float
_TILE = (8, 32)  # threads of a block that updates a plane
# Fractions of a sub-step at which the velocity is needed, the last ones by halved steps.
_TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)

# Reduction and polynomials of `displacement_loops.quarter`.
_SINES = """
DEVICE void quarter(double x, double* s, double* c, int* k) {
    const double far = 6755399441055744.0, turns = x * 0.6366197723675814 + far;
    const double n = turns - far;
    *k = __double2loint(turns);
    double y = x - n * 1.5707963267341256;
    y = y - n * 6.077100506303966e-11;
    y = y - n * 2.0222662487959506e-21;
    const double z = y * y;
    double p = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10;
    p = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * p);
    p = -1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * p);
    *s = y + y * z * p;
    p = 2.08757232129817482790e-09 - z * 1.13596475577881948265e-11;
    p = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * p);
    p = 4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * p);
    *c = 1.0 - 0.5 * z + z * z * p;
}
DEVICE double fast_sin(double x) {
    double s, c;
    int k;
    quarter(x, &s, &c, &k);
    s = k & 1 ? c : s;
    return k & 2 ? -s : s;
}
DEVICE double fast_cos(double x) {
    double s, c;
    int k;
    quarter(x, &s, &c, &k);
    c = k & 1 ? s : c;
    return k + 1 & 2 ? -c : c;
}
"""
# `displacement_loops.slope` of the numbers around a place of an array.
_SLOPE = """
DEVICE double slope(const double* a, int step, double* more) {
    const double one = a[step] - a[-step], two = a[2 * step] - a[-2 * step];
    const double three = a[3 * step] - a[-3 * step], four = a[4 * step] - a[-4 * step];
    *more = (1.0 / 280.0) * (14.0 * (one - two) + 6.0 * three - four);
    return 0.75 * one - 0.15 * two + (1.0 / 60.0) * three + *more;
}
"""


def _scalars(name: str, count: int, kind: str = "const real") -> list[str]:
    return [f"{kind} {name}{q}" for q in range(count)]


def _listed(name: str, count: int) -> str:
    return ", ".join(f"{name}{q}" for q in range(count)) or "0"


class DeviceDisplacements(Displacements):
    """As `Displacements`, with feet on the device of an engine."""

    def __init__(self, stage: Any, engine: Any) -> None:
        super().__init__(stage)
        self.xp, self._engine = engine.xp, engine
        self._field = snapshots_of(stage.velocity)
        self._lines: dict[int, list[Array]] = {}  # coordinates of each block
        self._kernels: dict[Any, Any] = {}
        self._tables: dict[Any, Array] = {}
        self._boxes: dict[int, tuple[float, Array]] = {}
        self._updates: dict[int, Any] = {}
        advects = LOG_DETERMINANT in stage.jets
        self.fused = (
            stage.axis is None and not advects and all(self.grid.periodic)
            and all(self.grid.uniform) and min(self.grid.nodes) >= 2 * max(_TILE)
        )  # fmt: skip

    def _host(self, a: Array) -> Array:
        return a.get()

    def _displace(self, row: Array, block: int, times: tuple[float, float], count: int) -> None:
        found, said = self.follow(block, times, count)
        self.judge(said.get())
        row[: len(found)] = found

    def judge(self, said: Any) -> bool:
        """Whether some nodes have no derivatives; raises `TooCoarse`."""
        if float(said[1:].view(np.float32).sum()) > self._limit:
            raise TooCoarse
        return bool(said[0])

    def follow(self, block: int, times: tuple[float, float], count: int) -> tuple[Array, Array]:
        """The displacements of a block in cells, shape (directions, nodes), NaN where they leave
        the grid; and an array whose numbers after the first are the errors of the sub-steps."""
        xp, size, flow = self.xp, self.grid.size, self._flow(block)
        if block not in self._lines:
            self._lines[block] = self._coordinates(flow, block)
        blocks, groups = -(-size // _THREADS), -(-size // _GROUP)
        whole = self._engine.whole
        begin, steps = times[1], list(steps_between(*times, flow.breaks(*times), count))
        said = xp.zeros(1 + len(steps), np.int32)
        old = new = xp.empty((len(self._cells), size))
        for q, step in enumerate(steps):
            new = xp.empty_like(old) if q else old
            chosen = xp.zeros(groups, np.uint32)
            head = (old, new, chosen, *self._lines[block], float(step), whole(q == 0))
            three, five, tables = self._velocity(flow, block, begin, step)
            if (block, tables) not in self._kernels:
                sources = follow_sources(self, flow, tables, block, self._engine.index)
                self._kernels[block, tables] = (*map(compiled, sources),)
            follow, check = self._kernels[block, tables]
            follow((blocks,), (_THREADS,), (*head, *three))
            check((-(-groups // 32),), (32,), (*head, said[1 + q :], *five))
            begin, old = begin - step, new
        return new, said

    def _coordinates(self, flow: Any, block: int) -> list[Array]:
        """Coordinates in each direction, in the units of the flow."""
        lines = list(self.stage.lines(block))
        for q, axis in enumerate(self.stage.moving):
            lines[axis] = (lines[axis] - flow.origin[q]) / flow.unit[q]
        return [self.xp.asarray(line) for line in lines]

    def _velocity(
        self, flow: Any, block: int, begin: float, step: float
    ) -> tuple[list[Any], list[Any], int]:
        """The arguments of both kernels for the velocity in a sub-step, and how many arrays of
        coefficients those of the second one are."""
        times = [begin - part * step for part in _TIMES]
        if self._field is None:
            values = flow.boxes(times)
            return values[::2].ravel().tolist(), values.ravel().tolist(), 0
        found = [self._field.time_weights(t) for t in times]
        first = min(number for number, _ in found)
        count = max(number - first + own.size for number, own in found)
        weights = np.zeros((len(times), count))
        for row, (number, own) in zip(weights, found, strict=True):
            row[number - first : number - first + own.size] = own
        tables = [self._table(flow, block, first + q) for q in range(count)]
        known = self._boxes.get(block)
        if known is None or known[0] != begin:
            known = begin, self._combined(tables, weights[[0, 0]])[0]
        middle, end = self._combined(tables, weights[[2, 4]])
        self._boxes[block] = times[4], end
        return [known[1], middle, end], [*tables, *weights.ravel().tolist()], count

    def _table(self, flow: Any, block: int, m: int) -> Array:
        """Coefficients on the device, the components of planes one after the other."""
        if (block, m) not in self._tables:
            table = flow._table(m)
            if self.stage.axis is None:
                table = np.ascontiguousarray(table.reshape(-1, 2).T).reshape(-1)
            while len(self._tables) >= 8 * len(self.stage.blocks):
                self._tables.pop(next(iter(self._tables)))
            self._tables[block, m] = self.xp.asarray(table)
        return self._tables[block, m]

    def _combined(self, tables: list[Array], weights: Any) -> tuple[Array, Array]:
        """The sums of tables with two sets of weights."""
        size, xp = tables[0].size, self.xp
        two = xp.empty_like(tables[0]), xp.empty_like(tables[0])
        values = weights.ravel().tolist()
        kernel = compiled(combine_source(len(tables)))
        kernel((-(-size // 256),), (256,), (*two, *tables, np.int64(size), *values))
        return two

    def _difference(
        self, a: Array, out: Array, axis: int, factor: float, plus: float, limit: float
    ) -> bool:
        grid, whole = self.grid, self._engine.whole
        n, stride = grid.nodes[axis], int(np.prod(grid.nodes[axis + 1 :]))
        said = self.xp.zeros(1, np.int32)
        kernel = compiled(difference_source(self._engine.index))
        sizes = (whole(grid.size), whole(n), whole(stride), whole(grid.periodic[axis]))
        numbers = (float(factor), float(plus), float(limit / abs(factor)))
        kernel((-(-grid.size // 256),), (256,), (a, out, said, *sizes, *numbers))
        return bool(said.get()[0])

    def most(self, component: int, axis: int) -> float:
        """Largest change of a difference from that of order 6, also of one along the second
        direction of those along the first."""
        return self._slopes * self.grid.spacing[axis] / self.grid.spacing[component]

    def update(self, m: Array, out: Array, t: float, dt: float, count: int) -> bool:
        """Update the moments of all fields; False where some nodes need other derivatives. Raises
        `TooCoarse`."""
        engine, stage = self._engine, self.stage
        d, said = self.follow(0, (t + stage.begin * dt, t + stage.end * dt), count)
        fields = len(engine.fields(m))
        if fields not in self._updates:
            types = engine.limiter, engine.real, engine.index
            source = update_source(self, engine.name(stage), *types, fields)
            self._updates[fields] = compiled(source)
        (nx, ny), (rows, columns) = self.grid.nodes, _TILE
        blocks = -(-ny // columns), -(-nx // rows)
        self._updates[fields](blocks, _TILE[::-1], (m, out, d, said))
        return not self.judge(said.get())


def follow_sources(
    moved: DeviceDisplacements, flow: Any, tables: int, block: int, index: str
) -> tuple[str, str]:
    """CUDA C of the kernels ``run`` of a sub-step of all nodes, and of the estimate of its error.

    Of both: ``old, new, chosen, lines.., step, fresh`` (1: the displacements are zero before); then
    the second one's array of the error, and the velocity at three or five times: numbers that do
    not depend on the place, or three arrays of coefficients, and `tables` with all weights.
    """
    stage, grid = moved.stage, moved.grid
    moving, two, field = stage.moving, len(stage.moving) == 2, moved._field
    held = 0 if field else len(flow._held)
    x, lines = point_of(grid)
    others = [axis for axis in range(3) if axis not in moving]
    units = [unit / cell for unit, cell in zip(flow.unit, moved._cells, strict=False)]
    bounds = [repr(float(b)) for b in moved._bounds(flow)]
    source = _spline_flow(field, flow, stage) if field else (flow.source, "0")
    code = re.sub(r"\b(sin|cos)\(", r"fast_\1(", source[0])
    code = _SINES + translate([code], "flow")

    place = [
        f"    const index sizes[] = {{{source[1]}}};",
        f"    const index at = {_beginning(stage, flow, bool(field))};",
        f"    const real p = {x[moving[0]]}, q = {x[moving[-1] if two else others[0]]};",
        f"    const real r = {x[others[-1]]};",
        "    const real d0 = fresh ? 0 : old[o];",
        f"    const real x0 = p + d0 * {1 / units[0]!r};",
    ]
    place += (
        ["    const real d1 = fresh ? 0 : old[size_ + o];",
         f"    const real y0 = q + d1 * {1 / units[1]!r};"]
        if two else ["    const real d1 = 0, y0 = q;"]
    )  # fmt: skip

    places = ("x", "px", "u"), ("y", "py", "v")
    walls, last = [], []
    for q, (axis, (start, place_, change)) in enumerate(zip(moving, places, strict=False)):
        low, high = bounds[2 * q : 2 * q + 2]
        if grid.periodic[axis]:  # paths that are not finite go too far
            last.append(f"fabs({change}) <= {FEET.cells * moved._cells[q] / flow.unit[q]!r}")
        else:
            walls.append(f"{place_} < {low} || {place_} > {high}")
            last.append(f"{start}0 + {change} >= {low} && {start}0 + {change} <= {high}")

    body = [
        "    const index thread = blockIdx.x * blockDim.x + threadIdx.x;",
        "    const index o = thread < size_ ? thread : size_ - 1;",
        *place,
        *(
            [f"    const real box{k}[] = {{{_listed(f'b{k}_', held)}}};" for k in range(3)]
            if not field
            else []
        ),
        "    real u, v, a = 0, b = 0, sum_a = 0, sum_b = 0, inner = 0;",
        "    bool gone = false;",
    ]
    for s in range(4):
        shift = ("0.0", "0.5", "0.5", "1.0")[s]
        body += [
            "    {",
            f"    const real px = x0 + {shift} * step * a, py = y0 + {shift} * step * b;",
            f"    gone = gone || {' || '.join(walls) or 'false'};",
            f"    flow(px, py, r, at, box{(0, 1, 1, 2)[s]}, sizes, &u, &v);",
            *(["    inner = fabs(u - a) + fabs(v - b);"] if s == 2 else []),
            f"    sum_a += {(1, 2, 2, 1)[s]} * u; sum_b += {(1, 2, 2, 1)[s]} * v; a = u; b = v;",
            "    }",
        ]
    body += [
        "    u = step * (1.0 / 6.0) * sum_a; v = step * (1.0 / 6.0) * sum_b;",
        f"    gone = gone || !({' && '.join(last)});",
        "    unsigned key = 0;",
        "    if (thread < size_) {",
        f'        new_[o] = gone ? (real)nan("") : d0 + u * {units[0]!r};',
        *([f"        new_[size_ + o] = d1 + v * {units[1]!r};"] if two else []),
        "        if (!gone) key = "
        f"(__float_as_uint((float)inner) & ~{_GROUP - 1}u) | (o % {_GROUP});",
        "    }",
        "#if __CUDA_ARCH__ >= 800",
        "    key = __reduce_max_sync(~0u, key);",
        "    if (threadIdx.x % 32 == 0)",
        "#endif",
        f"    atomicMax(chosen + thread / {_GROUP}, key);",
    ]
    head = ["const real* old", "real* new_", "unsigned* chosen", *lines, "const real step",
            "const index fresh"]  # fmt: skip
    if field:
        three = [f"const real* __restrict__ box{k}" for k in range(3)]
        five = _scalars("t", tables, "const real* __restrict__") + _scalars("w", 5 * tables)
        value = [
            "        u = 0; v = 0;",
            "        #pragma unroll 1",
            f"        for (int c = 0; c < {tables}; c++) {{",
            f"            const real weight = weights[{tables} * when + c];",
            "            if (weight != 0) {",
            "                real one, other;",
            "                flow(px, py, r, at, tables[c], sizes, &one, &other);",
            "                u += weight * one; v += weight * other;",
            "            }",
            "        }",
        ]
        given = [f"    const real* tables[] = {{{_listed('t', tables)}}};",
                 f"    const real weights[] = {{{_listed('w', 5 * tables)}}};"]  # fmt: skip
    else:
        three = [name for k in range(3) for name in _scalars(f"b{k}_", held)]
        five = _scalars("b", 5 * held)
        value = [f"        flow(px, py, r, at, boxes + when * {held}, sizes, &u, &v);"]
        given = [f"    const real boxes[] = {{{_listed('b', 5 * held)}}};"]
    check = [
        "    const index thread = blockIdx.x * blockDim.x + threadIdx.x;",
        f"    if (thread >= (size_ + {_GROUP - 1}) / {_GROUP}) return;",
        "    const unsigned key = chosen[thread];",
        f"    if (key < {_GROUP}) return;",
        f"    const index o = thread * {_GROUP} + (index)(key % {_GROUP});",
        *place,
        *given,
        "    real u, v, x = x0, y = y0;",
        "    #pragma unroll 1",
        "    for (int half = 0; half < 2; half++) {",
        "        real a = 0, b = 0, sum_a = 0, sum_b = 0;",
        "        #pragma unroll 1",
        "        for (int s = 0; s < 4; s++) {",
        "        const int when = 2 * half + (s + 1) / 2;",
        "        const real shift = (s == 0 ? 0.0 : s == 3 ? 0.5 : 0.25) * step;",
        "        const real px = x + shift * a, py = y + shift * b;",
        *value,
        "        const real weight = s == 1 || s == 2 ? 2 : 1;",
        "        sum_a += weight * u; sum_b += weight * v; a = u; b = v;",
        "        }",
        "        x += 0.5 * step * (1.0 / 6.0) * sum_a; y += 0.5 * step * (1.0 / 6.0) * sum_b;",
        "    }",
        f"    real worst = fabs(d0 + (x - x0) * {units[0]!r} - new_[o]);",
        *(
            [
                f"    const real other = fabs(d1 + (y - y0) * {units[1]!r} - new_[size_ + o]);",
                "    worst = other > worst ? other : worst;",
            ]
            if two
            else []
        ),
        "    if (worst < 1e30) atomicMax(error, __float_as_int((float)worst));",
    ]
    sizes = constants_of(size=grid.size)
    return (
        kernel_text(sizes, code, [*head, *three], body, grid, index),
        kernel_text(sizes, code, [*head, "int* error", *five], check, grid, index),
    )


def _spline_flow(field: Any, flow: Any, stage: Any) -> tuple[str, str]:
    """Source of ``flow`` of splines, and the numbers of `sizes`."""
    sizes = [int(n) for n in flow.sizes]
    if stage.axis is None:
        sizes[4] //= 2
        sizes.append(flow.count)
    return spline_source(field.degrees[1], len(stage.moving), True), ", ".join(map(str, sizes))


def _beginning(stage: Any, flow: Any, splines: bool) -> str:
    """Code of where the coefficients of a node's line begin."""
    if stage.axis is None or not splines:
        return "0"
    row = int(flow.sizes[2])
    block = stage.grid.nodes[stage.axis] * row
    return f"o / (index){block} * (index){flow.count} + o % (index){row}"


def combine_source(count: int) -> str:
    """CUDA C of ``run(one, other, tables.., size, weights..)``: sums of arrays with two sets of
    weights; those of weight zero are not read."""
    terms = [
        f"    if (w{q} != 0 || w{count + q} != 0) {{ const double x = t{q}[o]; a += w{q} * x; "
        f"b += w{count + q} * x; }}"
        for q in range(count)
    ]
    arguments = [
        "double* __restrict__ one", "double* __restrict__ other",
        *_scalars("t", count, "const double* __restrict__"), "const long long size",
        *_scalars("w", 2 * count, "const double"),
    ]  # fmt: skip
    lines = [
        f'extern "C" __global__ void run({", ".join(arguments)}) {{',
        "    const long long o = blockIdx.x * (long long)blockDim.x + threadIdx.x;",
        "    if (o >= size) return;",
        "    double a = 0, b = 0;",
        *terms,
        "    one[o] = a; other[o] = b;",
        "}",
    ]
    return "\n".join([*lines, ""])


def difference_source(index: str) -> str:
    """CUDA C of ``run(a, out, said, size, n, stride, periodic, factor, plus, most)``, which writes
    ``plus + factor`` times the difference along lines, NaN beside walls and where it changes by
    more than `most` from that of order 6."""
    arguments = [
        "const double* __restrict__ a", "double* __restrict__ out", "int* said",
        *(f"const index {name}" for name in ("size", "n", "stride", "periodic")),
        *(f"const double {name}" for name in ("factor", "plus", "most")),
    ]  # fmt: skip
    return (
        f"#define DEVICE static __device__ __forceinline__\ntypedef {index} index;\n{_SLOPE}"
        f'extern "C" __global__ void run({", ".join(arguments)}) {{'
        + """
    const index o = blockIdx.x * (index)blockDim.x + threadIdx.x;
    if (o >= size) return;
    const index i = o / stride % n;
    const bool inside = i >= 4 && i < n - 4;
    double more = 0, near[9] = {};
    for (int q = 0; q < 9; q++) {
        const index k = inside ? q - 4 : (i + q - 4 + 4 * n) % n - i;
        if (inside || periodic) near[q] = a[o + k * stride];
    }
    const double value = slope(near + 4, 1, &more);
    const bool good = (periodic || inside) && fabs(more) <= most;
    out[o] = good ? plus + factor * value : nan("");
    if (!good) *said = 1;
}
"""
    )


def update_source(
    moved: DeviceDisplacements, name: str, limiter: int, real: str, index: str, fields: int = 1
) -> str:
    """CUDA C of the kernel ``run(m, out, d, said)`` that differences displacements and updates
    `fields` of a periodic plane by the node function `name`; `limiter` from `LIMITER_CODES`."""
    stage, grid = moved.stage, moved.grid
    (nx, ny), h = grid.nodes, grid.spacing
    rows, columns = _TILE
    step = len(moments(stage.profile, 2))
    wide, high = columns + 8, rows + 8
    cross = len(stage.jets) > 6
    body = [
        f"    __shared__ double tile[2][{high * wide}], along[2][{rows * wide}];",
        "    const index size = size_, nx = nx_, ny = ny_;",
        f"    const int lane = threadIdx.y * {columns} + threadIdx.x;",
        f"    const index i0 = blockIdx.y * {rows}, j0 = blockIdx.x * {columns};",
        f"    for (int q = lane; q < {high * wide}; q += {rows * columns}) {{",
        f"        index i = i0 + q / {wide} - 4, j = j0 + q % {wide} - 4;",
        "        i = i < 0 ? i + nx : i >= nx ? i - nx : i;",
        "        j = j < 0 ? j + ny : j >= ny ? j - ny : j;",
        "        tile[0][q] = d[i * ny + j]; tile[1][q] = d[size + i * ny + j];",
        "    }",
        "    __syncthreads();",
        "    double more;",
        "    bool bad = false;",
        f"    for (int q = lane; q < {rows * wide}; q += {rows * columns}) {{",
        *(
            f"        along[{c}][q] = slope(tile[{c}] + q + {4 * wide}, {wide}, &more); "
            f"bad = bad || !(fabs(more) <= {moved.most(c, 0)!r});"
            for c in (0, 1)
        ),
        "    }",
        "    __syncthreads();",
        "    const index i = i0 + threadIdx.y, j = j0 + threadIdx.x, o = i * ny + j;",
        "    const bool mine = i < nx && j < ny;",
        f"    const int here = threadIdx.y * {wide} + threadIdx.x + 4;",
        "    real room[8];",
    ]
    for c in (0, 1):
        scales = [h[c] / h[axis] for axis in (0, 1)]
        body += [
            f"    room[{c}] = (real)tile[{c}][here + {4 * wide}];",
            f"    room[{2 + 2 * c}] = (real)({1.0 - c!r} + {scales[0]!r} * along[{c}][here]);",
            f"    room[{3 + 2 * c}] = (real)({float(c)!r} + {scales[1]!r} * "
            f"slope(tile[{c}] + here + {4 * wide}, 1, &more));",
            f"    bad = bad || !(fabs(more) <= {moved.most(c, 1)!r});",
        ]
        if cross:
            body += [
                f"    room[{6 + c}] = (real)({scales[0] / h[1]!r} * "
                f"slope(along[{c}] + here, 1, &more));",
                f"    bad = bad || !(fabs(more) <= {moved.most(c, 0)!r});",
            ]
    widths, _ = widths_of(grid)
    body += [
        "    if (bad) *said = 1;",
        "    if (!mine) return;",
        *widths,
        "    const Line x = {h0, 0, ny, nx, 1}, y = {h1, 0, 1, ny, 1};",
        "    const Update update = {size, 2, 0, 0, 0};",
        f"    const Limits limits = {{{limiter}, 0, 0, 0}};",
        "    const Foot foot = {room, 1, 0};",
        *for_fields(f"{name}(m, out, foot, x, y, update, o, i, j, limits);", step, fields),
    ]
    arguments = [
        "const real* __restrict__ m", "real* __restrict__ out", "const double* __restrict__ d",
        "int* said",
    ]  # fmt: skip
    code = _SLOPE + translate(modules_of(stage), name)
    return kernel_text(
        constants_of(size=grid.size, nx_=nx, ny_=ny), code, arguments, body, grid, index, real
    )
